#include "core/preview.h"

#include <glib.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { BLACK = 64, FULL = 4095 };

#define ELECTRONS_PER_DN 2.5

/* A subject with structure: stripes of a period of 24 px in both directions, blurred by a Gaussian
 * of @sigma_px, which leaves exp(-2 pi^2 sigma^2 / 24^2) of their contrast. */
static double subject(double x, double y, double sigma_px)
{
    double contrast = 0.5 * exp(-2 * M_PI * M_PI * sigma_px * sigma_px / (24 * 24));
    return 1 + contrast * (sin(2 * M_PI * x / 24) + sin(2 * M_PI * y / 24)) / 2;
}

struct frame {
    struct ls_preview_params params;
    uint8_t *raw, *rgb;
    struct ls_preview_figures figures;
};

static struct frame frame_of(const char *format, uint32_t width, uint32_t height)
{
    struct frame f = {.params = {.format = ls_pixel_by_name(format),
                                 .width = width,
                                 .height = height,
                                 .black_dn = BLACK,
                                 .full_scale_dn = FULL,
                                 .electrons_per_dn = ELECTRONS_PER_DN,
                                 .read_noise_dn = 2,
                                 .bin = 4}};
    f.raw = g_malloc0(ls_pixel_payload_bytes(f.params.format, width, height));
    f.rgb = g_malloc0((size_t)(width / 4) * (height / 4) * 3);
    return f;
}

static void clear(struct frame *f)
{
    g_free(f->raw);
    g_free(f->rgb);
}

static void put(struct frame *f, uint32_t x, uint32_t y, double dn)
{
    uint16_t sample = (uint16_t)lrint(fmin(fmax(dn, 0), FULL));
    ls_pixel_pack(f->params.format, &sample, (size_t)y * f->params.width + x, 1, f->raw);
}

static void make(struct frame *f)
{
    g_assert_cmpint(ls_preview_make(&f->params, f->raw, f->rgb, &f->figures), ==, LS_OK);
}

/* The subject at @level DN; with noise as the model has it if @rand, else without and of a model
 * without. */
static void draw(struct frame *f, double level, double sigma_px, GRand *rand)
{
    if (!rand) {
        f->params.electrons_per_dn = 1e12;
        f->params.read_noise_dn = 0;
    }
    for (uint32_t y = 0; y < f->params.height; y++)
        for (uint32_t x = 0; x < f->params.width; x++) {
            double dn = level * subject(x, y, sigma_px), noise = 0;
            for (int i = 0; rand && i < 12; i++) /* of unit variance, near enough to normal */
                noise += g_rand_double(rand) - 0.5;
            put(f, x, y, BLACK + dn + noise * sqrt(dn / ELECTRONS_PER_DN + 4));
        }
    make(f);
}

static double focus(const char *format, double level, double sigma_px, GRand *rand)
{
    struct frame f = frame_of(format, 192, 144);
    draw(&f, level, sigma_px, rand);
    clear(&f);
    return f.figures.focus;
}

static void test_blur(void)
{
    static const char *const formats[] = {"BayerRG12", "BayerGB12p", "Mono12", "Mono12Packed"};
    for (size_t i = 0; i < G_N_ELEMENTS(formats); i++) {
        double last = INFINITY;
        for (double sigma = 0; sigma < 8; sigma += 0.5) {
            double now = focus(formats[i], 1500, sigma, NULL);
            g_assert_cmpfloat(now, <, last);
            last = now;
        }
        g_assert_cmpfloat(last, >=, 0);
    }
    /* contrast falls to 0.43, its square to 0.18; 5 % for whole DN */
    double factor = focus("Mono12", 1500, 4.96, NULL) / focus("Mono12", 1500, 0, NULL);
    g_assert_cmpfloat(fabs(factor / 0.1854 - 1), <, 0.05);
}

static void test_brightness(void)
{
    guint32 seed = (guint32)g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    double truth = focus("BayerRG12", 2000, 1, NULL);
    /* noise brings 24/64 v / mean^2, a fifth of the truth at 60 DN, and is taken off; 2 % of the
     * truth and a tenth of that are five times what remains, the scatter over 6900 greens */
    for (double level = 60; level < 2500; level *= 2) {
        double found = focus("BayerRG12", level, 1, rand);
        double noise = 24.0 / 64 * (level / ELECTRONS_PER_DN + 4) / (level * level);
        g_test_message("at %g DN %.5f, truth %.5f, noise %.5f", level, found, truth, noise);
        g_assert_cmpfloat(fabs(found - truth), <, 0.02 * truth + 0.1 * noise);
    }
    g_rand_free(rand);
}

static void test_dark(void)
{
    struct frame f = frame_of("BayerRG12", 64, 64);
    for (uint32_t i = 0; i < 64 * 64; i++)
        put(&f, i % 64, i / 64, BLACK + (i % 7 == 0)); /* nothing but a little noise */
    make(&f);
    g_assert_cmpfloat(f.figures.focus, ==, 0);
    clear(&f);
}

static void test_clip(void)
{
    struct frame f = frame_of("BayerRG12", 64, 48);
    for (uint32_t y = 0; y < 48; y++)
        for (uint32_t x = 0; x < 64; x++) {
            unsigned c = ls_cfa_channel(LS_CFA_RGGB, x, y);
            bool clipped = c == 0 ? y < 24 : c == 1 && x < 16;
            put(&f, x, y, clipped ? FULL : FULL - 1);
        }
    make(&f);
    g_assert_cmpuint(f.figures.n_colours, ==, 3);
    g_assert_cmpfloat(f.figures.clip[0], ==, 0.5);
    g_assert_cmpfloat(f.figures.clip[1], ==, 0.25);
    g_assert_cmpfloat(f.figures.clip[2], ==, 0);
    clear(&f);
}

static void test_colours(void)
{
    struct frame f = frame_of("BayerGB12p", 36, 24);
    f.params.bin = 4;
    static const double linear[3] = {1, 0.5, 0.25};
    for (uint32_t y = 0; y < 24; y++)
        for (uint32_t x = 0; x < 36; x++)
            put(&f, x, y, BLACK + (FULL - BLACK) * linear[ls_cfa_channel(LS_CFA_GBRG, x, y)]);
    make(&f);
    /* IEC 61966-2-1 of 1, 1/2 and 1/4 */
    static const int codes[3] = {255, 188, 137};
    for (uint32_t i = 0; i < 9 * 6 * 3; i++)
        g_assert_cmpint(abs(f.rgb[i] - codes[i % 3]), <=, 1); /* half a step of the curve's table */
    clear(&f);
}

static void test_edges(void)
{
    struct frame f = frame_of("Mono8", 37, 23); /* of 9 x 5 blocks, and what is left over */
    f.params.full_scale_dn = 255;
    f.params.black_dn = 0;
    for (uint32_t y = 0; y < 23; y++)
        for (uint32_t x = 0; x < 37; x++)
            put(&f, x, y, x >= 36 || y >= 20 ? 255 : 0);
    make(&f);
    for (uint32_t i = 0; i < 9 * 5 * 3; i++)
        g_assert_cmpuint(f.rgb[i], ==, 0);
    g_assert_cmpfloat(f.figures.clip[0], ==, 1 - 36.0 * 20 / (37 * 23));
    clear(&f);
}

static void test_bin(void)
{
    g_assert_cmpuint(ls_preview_bin(2048, 2048, 512), ==, 4);
    g_assert_cmpuint(ls_preview_bin(2052, 1000, 512), ==, 6);
    g_assert_cmpuint(ls_preview_bin(128, 128, 512), ==, 2);
    g_assert_cmpuint(ls_preview_bin(16384, 4, 1024), ==, 16);
}

static void test_wrong(void)
{
    struct frame f = frame_of("Mono8", 16, 16);
    struct ls_preview_params wrong = f.params;
    wrong.bin = 3;
    g_assert_cmpint(ls_preview_make(&wrong, f.raw, f.rgb, &f.figures), ==, LS_ERR_INVALID);
    wrong.bin = 32;
    g_assert_cmpint(ls_preview_make(&wrong, f.raw, f.rgb, &f.figures), ==, LS_ERR_INVALID);
    wrong = f.params;
    wrong.full_scale_dn = wrong.black_dn;
    g_assert_cmpint(ls_preview_make(&wrong, f.raw, f.rgb, &f.figures), ==, LS_ERR_INVALID);
    clear(&f);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/preview/blur-lowers-the-focus-figure", test_blur);
    g_test_add_func("/preview/brightness-and-noise-leave-the-focus-figure", test_brightness);
    g_test_add_func("/preview/a-dark-picture-has-no-focus", test_dark);
    g_test_add_func("/preview/clip-is-the-share-of-lost-photosites-of-each-colour", test_clip);
    g_test_add_func("/preview/colours-come-through-the-srgb-curve", test_colours);
    g_test_add_func("/preview/cut-blocks-are-left-out-but-counted", test_edges);
    g_test_add_func("/preview/the-bin-is-the-smallest-that-fits", test_bin);
    g_test_add_func("/preview/what-makes-no-picture-is-refused", test_wrong);
    return g_test_run();
}

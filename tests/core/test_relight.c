#include "core/envlights.h"
#include "core/half.h"
#include "core/promote.h"
#include "core/relight.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { N_MAX = 400, SPECTRA = 3, W = 70, H = 65 };

/**
 * A take of a Lambertian sphere, made from the definitions: lights of spread strength, droop and
 * duty in the spheres, everything stored as half mosaics.
 */
struct take {
    struct ls_field field;
    uint32_t n;
    float direction[N_MAX][3];
    double omega[N_MAX], k[SPECTRA * N_MAX], g[SPECTRA * N_MAX], p[SPECTRA * 3];
    double duty[SPECTRA], factor[SPECTRA], albedo[SPECTRA][3];
    struct ls_picture white[N_MAX], sphere[SPECTRA];
    const void *tiles[N_MAX + SPECTRA][4];
    GByteArray *store;
    double *shade; /* [n][H][W], n.l */
};

static double shade(uint32_t x, uint32_t y, const float *light)
{
    double nx = (x + 0.5) / W * 1.8 - 0.9, ny = 0.9 - (y + 0.5) / H * 1.8;
    double size = hypot(nx, ny);
    if (size > 0.95) /* the sphere's rim and beyond: a card facing the camera */
        nx = ny = size = 0;
    double nz = sqrt(1 - size * size);
    return fmax(0, nx * (double)light[0] + ny * (double)light[1] + nz * (double)light[2]);
}

/* R of the true field, spectrum s */
static double truth(const struct take *take, uint32_t i, uint32_t s, uint32_t c, uint32_t x,
                    uint32_t y)
{
    return take->albedo[s][c] / M_PI * take->p[s * 3 + c] * take->shade[(i * H + y) * W + x];
}

static uint32_t dome(struct take *take, uint32_t rings)
{
    uint32_t n = 0;
    for (uint32_t r = 0; r <= rings; r++) {
        double t = M_PI * r / rings;
        uint32_t around = MAX(1, (uint32_t)lround(2 * rings * sin(t)));
        for (uint32_t k = 0; k < around; k++, n++) {
            double phi = 2 * M_PI * (k + 0.37) / around;
            take->direction[n][0] = (float)(sin(t) * sin(phi));
            take->direction[n][1] = (float)cos(t);
            take->direction[n][2] = (float)(-sin(t) * cos(phi));
        }
    }
    return n;
}

static size_t tile_begin(uint32_t t)
{
    /* tiles of 70 x 65: 64 x 64, 6 x 64, 64 x 1, 6 x 1 */
    static const size_t begin[] = {0, 64 * 64, 70 * 64, 70 * 64 + 64};
    return begin[t];
}

static size_t pixel_at(uint32_t x, uint32_t y)
{
    uint32_t t = x / 64 + 2 * (y / 64);
    return tile_begin(t) + (y % 64) * (x < 64 ? 64 : W - 64) + x % 64;
}

static void store_picture(struct take *take, uint32_t index, struct ls_picture *picture,
                          const float *mosaic)
{
    uint16_t *half = (uint16_t *)take->store->data + (size_t)index * W * H;
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++)
            half[pixel_at(x, y)] = ls_half_from_float(mosaic[y * W + x]);
    for (uint32_t t = 0; t < 4; t++)
        take->tiles[index][t] = half + tile_begin(t);
    picture->tiles = take->tiles[index];
}

static void gains(struct take *take, double spread, GRand *rand)
{
    for (uint32_t s = 0; s < SPECTRA; s++) {
        double strength[N_MAX];
        for (uint32_t i = 0; i < take->n; i++)
            strength[i] = 7 * (1 + spread * g_rand_double_range(rand, -1, 1));
        g_assert_cmpint(ls_field_normalise_gains(strength, take->n, &take->k[s * take->n],
                                                 &take->g[s * take->n], NULL),
                        ==, LS_OK);
    }
}

/* E x referenceExposure of light i, spectrum s, as photographed */
static double stored(const struct take *take, uint32_t i, uint32_t s, uint32_t x, uint32_t y)
{
    uint32_t c = take->field.n_channels == 3 ? ls_cfa_channel(take->field.cfa, x, y) : 1;
    return take->g[s * take->n + i] * truth(take, i, s, c, x, y) / take->field.scale;
}

static void photograph(struct take *take)
{
    g_autofree float *mosaic = g_new(float, W *H);
    take->store = g_byte_array_new();
    g_byte_array_set_size(take->store, (guint)(2 * (take->n + SPECTRA) * W * H));
    for (uint32_t i = 0; i < take->n; i++) {
        for (uint32_t y = 0; y < H; y++)
            for (uint32_t x = 0; x < W; x++)
                mosaic[y * W + x] = (float)stored(take, i, 0, x, y);
        store_picture(take, i, &take->white[i], mosaic);
    }
    for (uint32_t s = 0; s < SPECTRA; s++) {
        for (uint32_t y = 0; y < H; y++)
            for (uint32_t x = 0; x < W; x++) {
                double sum = 0;
                for (uint32_t i = 0; i < take->n; i++)
                    sum += stored(take, i, s, x, y);
                mosaic[y * W + x] = (float)(sum * take->duty[s] / take->factor[s]);
            }
        store_picture(take, take->n + s, &take->sphere[s], mosaic);
    }
}

static struct take *take_new(enum ls_cfa cfa, double spread)
{
    static const double p[SPECTRA][3] = {{0.7, 1, 0.6}, {1.1, 0.2, 0.03}, {0.02, 0.4, 0.9}};
    static const double albedo[SPECTRA][3] = {{0.6, 0.3, 0.2}, {0.7, 0.4, 0.3}, {0.3, 0.2, 0.1}};
    g_autoptr(GRand) rand = g_rand_new_with_seed(11);
    struct take *take = g_new0(struct take, 1);
    take->n = dome(take, 12);
    take->shade = g_new(double, take->n *W *H);
    for (uint32_t i = 0; i < take->n; i++)
        for (uint32_t y = 0; y < H; y++)
            for (uint32_t x = 0; x < W; x++)
                take->shade[(i * H + y) * W + x] = shade(x, y, take->direction[i]);
    for (uint32_t s = 0; s < SPECTRA; s++) {
        memcpy(take->p + 3 * s, p[s], sizeof p[s]);
        memcpy(take->albedo[s], albedo[s], sizeof albedo[s]);
        take->duty[s] = 0.25 + 0.125 * s;
        take->factor[s] = 1.2 - 0.05 * s;
    }
    gains(take, spread, rand);
    g_assert_cmpint(
        ls_envlights_omega((const float(*)[3])take->direction, take->n, take->omega, NULL), ==,
        LS_OK);
    take->field =
        (struct ls_field){.n_lights = take->n,
                          .n_spectra = SPECTRA,
                          .n_channels = cfa == LS_CFA_NONE ? 1 : 3,
                          .width = W,
                          .height = H,
                          .cfa = cfa,
                          .scale = 0.37,
                          .white = take->white,
                          .sphere = take->sphere,
                          .k = take->k,
                          .g = take->g,
                          .omega_sr = take->omega,
                          .directions = (const float(*)[3])take->direction,
                          .p = take->p,
                          .duty = take->duty,
                          .factor = take->factor,
                          .noise = {.read_variance = 1e-9, .dark_variance = 1e-10, .shot = 1e-7}};
    photograph(take);
    if (cfa == LS_CFA_NONE) /* the mono channel is the scene's green one */
        for (uint32_t s = 0; s < SPECTRA; s++)
            take->p[s] = p[s][1];
    return take;
}

static void take_free(struct take *take)
{
    g_byte_array_unref(take->store);
    g_free(take->shade);
    g_free(take);
}

static const struct ls_demosaic_region all_px = {0, 0, W, H};
static const struct ls_tile_region all_tiles = {0, 0, 2, 2};

static void accumulate(const struct ls_field *field, const struct ls_picture *pictures, uint32_t n,
                       const float *weights, uint32_t n_sums, float *sums)
{
    struct ls_accumulate_job job = {
        .pictures = pictures, .n_pictures = n, .n_sums = n_sums, .weights = weights};
    g_assert_cmpint(ls_accumulate(field, &job, &all_tiles, sums, NULL, NULL), ==, LS_OK);
}

/* the ratio of spectrum s over the whole picture, from what a take holds */
static void ratio_of(const struct ls_field *field, uint32_t s, float *ratio)
{
    size_t n = (size_t)W * H * field->n_channels;
    g_autofree float *row = g_new(float, field->n_lights), *sum = g_new(float, W *H);
    g_autofree float *v = g_new(float, n), *f = g_new(float, n), *sigma = g_new(float, n);
    float sphere = (float)ls_promote_sphere_factor(field, s);
    double neutral[3];
    for (uint32_t c = 0; c < field->n_channels; c++)
        neutral[c] = field->p[s * field->n_channels + c] / field->p[c];
    ls_promote_denominator_row(field, s, row);
    accumulate(field, field->white, field->n_lights, row, 1, sum);
    g_assert_cmpint(ls_relight_demosaic(field, sum, all_px, all_px, v), ==, LS_OK);
    ls_promote_sigma(field, row, field->n_lights, v, n, sigma);
    accumulate(field, &field->sphere[s], 1, &sphere, 1, sum);
    g_assert_cmpint(ls_relight_demosaic(field, sum, all_px, all_px, f), ==, LS_OK);
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, field->n_channels, neutral, ratio, NULL),
                    ==, LS_OK);
}

/* relit with w[n][SPECTRA], shared weights */
static void relight(const struct ls_field *field, const double *w, float *out)
{
    g_autofree float *rows = g_new(float, SPECTRA * field->n_lights);
    g_autofree float *sums = g_new(float, SPECTRA *W *H);
    g_autofree float *ratio = g_new(float, SPECTRA *W *H * 3);
    struct ls_relight_term terms[SPECTRA];
    for (uint32_t s = 0; s < SPECTRA; s++) {
        ls_relight_row(field, w + s, SPECTRA, rows + s * field->n_lights);
        if (s > 0)
            ratio_of(field, s, ratio + s * W * H * 3);
        terms[s] = (struct ls_relight_term){
            .sum = sums + s * W * H, .ratio = s ? ratio + s * W * H * 3 : NULL, .channel = -1};
    }
    accumulate(field, field->white, field->n_lights, rows, SPECTRA, sums);
    g_assert_cmpint(ls_relight_finish(field, all_px, all_px, terms, SPECTRA, NULL, out, NULL), ==,
                    LS_OK);
}

/* weights of an environment that is not symmetric in any way, another per spectrum */
static void environment(const struct take *take, gboolean mirrored, double *w)
{
    struct ls_lobe lobe[SPECTRA] = {
        {.direction = {0.8, 0.6, 0}, .sharpness = 9, .radiance = 1},
        {.direction = {0.48, 0.64, 0.6}, .sharpness = 4, .radiance = 2},
        {.direction = {-0.6, -0.48, 0.64}, .sharpness = 2, .radiance = 0.7}};
    struct ls_lobes lobes = {.n = SPECTRA, .item = lobe};
    for (int s = 0; mirrored && s < SPECTRA; s++)
        lobe[s].direction[0] = -lobe[s].direction[0];
    g_assert_cmpint(
        ls_envlights_lobes((const float(*)[3])take->direction, take->n, NULL, &lobes, w, NULL), ==,
        LS_OK);
}

/* relative RMS of a relit picture against the definition, over the middle of each surface where
 * demosaicing does not matter */
static double relit_error(const struct take *take, const double *w, const float *out)
{
    long double error = 0, size = 0;
    for (uint32_t y = 20; y < 46; y++)
        for (uint32_t x = 20; x < 50; x++)
            for (uint32_t c = 0; c < 3; c++) {
                uint32_t channel = take->field.n_channels == 3 ? c : 1;
                long double sum = 0;
                for (uint32_t i = 0; i < take->n; i++)
                    for (uint32_t s = 0; s < SPECTRA; s++) {
                        double r =
                            take->albedo[s][channel] / M_PI * take->shade[(i * H + y) * W + x];
                        r *= take->field.n_channels == 3 ? take->p[s * 3 + c] : take->p[s];
                        sum += r * w[i * SPECTRA + s];
                    }
                long double d = out[(y * W + x) * 3 + c] - sum;
                error += d * d;
                size += sum * sum;
            }
    return (double)sqrtl(error / size);
}

/* Mono: no demosaic, so the halves' 2.4e-4 rms per sample, averaged over the lights, and of the one
 * picture F is all. Bayer: the shading's curvature across two pixels comes on top. */
static double bound_of(const struct take *take)
{
    return take->field.n_channels == 1 ? 2.5e-4 : 1e-3;
}

static double error_with(struct take *take, const struct ls_field *field, gboolean mirrored)
{
    g_autofree float *out = g_new(float, W *H * 3);
    g_autofree double *w = g_new(double, take->n *SPECTRA), *used = g_new(double, take->n *SPECTRA);
    environment(take, FALSE, w);
    memcpy(used, w, sizeof *w * take->n * SPECTRA);
    if (mirrored)
        environment(take, TRUE, used);
    relight(field, used, out);
    return relit_error(take, w, out);
}

static void test_a_promoted_relit_picture_is_the_definition(void)
{
    static const enum ls_cfa cfas[] = {LS_CFA_NONE, LS_CFA_RGGB, LS_CFA_GRBG, LS_CFA_GBRG,
                                       LS_CFA_BGGR};
    for (size_t k = 0; k < G_N_ELEMENTS(cfas); k++) {
        struct take *take = take_new(cfas[k], 0.1);
        struct ls_diag diag = {{0}};
        g_assert_cmpint(ls_field_check(&take->field, &diag), ==, LS_OK);
        double error = error_with(take, &take->field, FALSE);
        g_test_message("%s: relative rms error %.2g", ls_cfa_name(cfas[k]), error);
        g_assert_cmpfloat(error, <, bound_of(take));
        take_free(take);
    }
}

/* Each mutation is a mistake somebody could make; all must be seen by far. */
static void caught(struct take *take, const struct ls_field *mutant, gboolean mirrored)
{
    double error = error_with(take, mutant, mirrored);
    g_test_message("error with the mistake %.3g", error);
    g_assert_cmpfloat(error, >, 10 * bound_of(take));
    take_free(take);
}

static void test_gain_applied_twice_is_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.3);
    double k[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t j = 0; j < SPECTRA * take->n; j++)
        k[j] = take->k[j] * take->k[j];
    mutant.k = k;
    g_assert_cmpint(ls_field_check(&mutant, NULL), ==, LS_ERR_INVALID);
    caught(take, &mutant, FALSE);
}

static void test_gain_not_applied_is_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.3);
    double one[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t j = 0; j < SPECTRA * take->n; j++)
        one[j] = 1;
    mutant.k = one;
    g_assert_cmpint(ls_field_check(&mutant, NULL), ==, LS_ERR_INVALID);
    caught(take, &mutant, FALSE);
}

/* k = 7 times too small everywhere: the shape is right, the unit is not */
static void test_gains_not_normalised_are_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.1);
    double k[SPECTRA * N_MAX], g[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    struct ls_diag diag = {{0}};
    for (uint32_t j = 0; j < SPECTRA * take->n; j++) {
        k[j] = take->k[j] / 7;
        g[j] = take->g[j] * 7;
    }
    mutant.k = k;
    mutant.g = g;
    g_assert_cmpint(ls_field_check(&mutant, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "normalise"));
    caught(take, &mutant, FALSE);
}

static void test_droop_inverted_is_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.1);
    double factor[SPECTRA];
    struct ls_field mutant = take->field;
    for (int s = 0; s < SPECTRA; s++)
        factor[s] = 1 / take->factor[s];
    mutant.factor = factor;
    caught(take, &mutant, FALSE);
}

/* a sphere at a quarter of the duty is not a sphere of lights a quarter as strong */
static void test_duty_treated_as_gain_is_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.1);
    double duty[SPECTRA], k[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t s = 0; s < SPECTRA; s++) {
        duty[s] = 1;
        for (uint32_t i = 0; i < take->n; i++)
            k[s * take->n + i] = take->k[s * take->n + i] / take->duty[s];
    }
    mutant.duty = duty;
    mutant.k = k;
    caught(take, &mutant, FALSE);
}

static void test_a_mirrored_environment_is_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.1);
    caught(take, &take->field, TRUE);
}

static void test_swapped_lights_are_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.1);
    struct ls_picture white[N_MAX];
    struct ls_field mutant = take->field;
    memcpy(white, take->white, sizeof white);
    /* the key light and the one opposite */
    uint32_t a = 0, b = 0;
    for (uint32_t i = 0; i < take->n; i++) {
        const double key[3] = {0.8, 0.6, 0};
        double now = 0, best_a = 0, best_b = 0;
        for (int c = 0; c < 3; c++) {
            now += key[c] * (double)take->direction[i][c];
            best_a += key[c] * (double)take->direction[a][c];
            best_b += key[c] * (double)take->direction[b][c];
        }
        a = now > best_a ? i : a;
        b = now < best_b ? i : b;
    }
    struct ls_picture keep = white[a];
    white[a] = white[b];
    white[b] = keep;
    mutant.white = white;
    caught(take, &mutant, FALSE);
}

static void test_numbering_from_one_is_caught(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.1);
    struct ls_picture white[N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t i = 0; i < take->n; i++)
        white[i] = take->white[(i + 1) % take->n];
    mutant.white = white;
    caught(take, &mutant, FALSE);
}

/* The paper's plain F/F(0) ignores that each spectrum's lights differ in strength. */
static void test_the_weighted_denominator_beats_the_paper_s(void)
{
    struct take *take = take_new(LS_CFA_NONE, 0.3);
    double even[SPECTRA * N_MAX];
    struct ls_field paper = take->field;
    for (uint32_t s = 0; s < SPECTRA; s++)
        for (uint32_t i = 0; i < take->n; i++)
            even[s * take->n + i] = take->g[i]; /* V as the white sphere shows it */
    paper.g = even;
    double ours = error_with(take, &take->field, FALSE), theirs = error_with(take, &paper, FALSE);
    g_test_message("30 %% spread: weighted %.2g, paper %.2g", ours, theirs);
    g_assert_cmpfloat(ours, <, bound_of(take));
    g_assert_cmpfloat(theirs, >, 3 * ours);
    take_free(take);
}

static void test_white_furnace(void)
{
    static const enum ls_cfa cfas[] = {LS_CFA_NONE, LS_CFA_RGGB};
    for (size_t k = 0; k < G_N_ELEMENTS(cfas); k++) {
        struct take *take = take_new(cfas[k], 0.1);
        g_autofree double *w = g_new0(double, take->n *SPECTRA);
        g_autofree float *out = g_new(float, W *H * 3);
        for (uint32_t c = 0; c < 3; c++)
            take->albedo[0][c] = 0.33;
        g_byte_array_unref(take->store);
        if (cfas[k] == LS_CFA_NONE)
            memcpy(take->p, (const double[]){0.7, 1, 0.6, 1.1, 0.2, 0.03, 0.02, 0.4, 0.9},
                   sizeof take->p);
        photograph(take);
        for (uint32_t i = 0; i < take->n; i++)
            w[i * SPECTRA] = take->omega[i];
        double worst = 0, p[3] = {0.7, 1, 0.6};
        for (uint32_t s = 0; cfas[k] == LS_CFA_NONE && s < SPECTRA; s++)
            take->p[s] = s ? 0.3 : 1;
        relight(&take->field, w, out);
        for (uint32_t y = 20; y < 46; y++)
            for (uint32_t x = 20; x < 50; x++)
                for (uint32_t c = 0; c < 3; c++) {
                    double expected = 0.33 * (cfas[k] == LS_CFA_NONE ? 1 : p[c]);
                    worst = fmax(worst, fabs((double)out[(y * W + x) * 3 + c] / expected - 1));
                }
        g_test_message("%s: furnace off by %.3f %%", ls_cfa_name(cfas[k]), 100 * worst);
        g_assert_cmpfloat(worst, <, 0.01); /* the requirement; the dome has no hole */
        take_free(take);
    }
}

/* Unequal weights in R, G, B: one sum per channel, its own channel taken after demosaic. */
static void test_the_tristimulus_baseline_tints_a_white_object(void)
{
    struct take *take = take_new(LS_CFA_RGGB, 0.1);
    g_autofree double *w = g_new(double, take->n * 3);
    g_autofree float *rows = g_new(float, 3 * take->n), *sums = g_new(float, 3 * W * H);
    g_autofree float *out = g_new(float, W *H * 3);
    const double light[3] = {2, 1, 0.25};
    struct ls_relight_term terms[3];
    for (uint32_t i = 0; i < take->n; i++)
        for (uint32_t c = 0; c < 3; c++)
            w[3 * i + c] = take->omega[i] * light[c];
    for (uint32_t c = 0; c < 3; c++) {
        ls_relight_tristimulus_row(&take->field, w + c, 3, c, rows + c * take->n);
        terms[c] = (struct ls_relight_term){.sum = sums + c * W * H, .channel = (int32_t)c};
    }
    accumulate(&take->field, take->field.white, take->n, rows, 3, sums);
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, terms, 3, NULL, out, NULL), ==,
                    LS_OK);
    for (uint32_t c = 0; c < 3; c++)
        /* albedo x light: p divides out; 1 % as for the furnace */
        g_assert_cmpfloat_with_epsilon(
            (double)out[(30 * W + 30) * 3 + c] / (take->albedo[0][c] * light[c]), 1, 0.01);
    take_free(take);
}

/* Summing lights on the mosaic is exact for shared weights; and M comes last, once. */
static void test_a_crop_is_bit_identical_and_the_matrix_comes_last(void)
{
    struct take *take = take_new(LS_CFA_GBRG, 0.1);
    g_autofree float *rows = g_new(float, take->n), *sum = g_new(float, W *H);
    g_autofree float *ratio = g_new(float, W *H * 3), *crop_ratio = g_new(float, W *H * 3);
    g_autofree float *out = g_new(float, W *H * 3), *crop = g_new(float, W *H * 3);
    const double m[9] = {0, 1, 0, 0, 0, 2, -1, 0, 0};
    const struct ls_demosaic_region part = {17, 5, 23, 31};
    struct ls_relight_term term = {.sum = sum, .ratio = ratio, .channel = -1};
    ls_relight_row(&take->field, take->omega, 1, rows);
    accumulate(&take->field, take->field.white, take->n, rows, 1, sum);
    ratio_of(&take->field, 1, ratio);
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, out, NULL), ==,
                    LS_OK);
    for (uint32_t y = 0; y < part.height; y++)
        memcpy(crop_ratio + y * part.width * 3, ratio + ((part.y + y) * W + part.x) * 3,
               part.width * 3 * sizeof *ratio);
    term.ratio = crop_ratio;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, part, &term, 1, NULL, crop, NULL), ==,
                    LS_OK);
    for (uint32_t y = 0; y < part.height; y++)
        g_assert_cmpmem(crop + y * part.width * 3, part.width * 3 * sizeof *crop,
                        out + ((part.y + y) * W + part.x) * 3, part.width * 3 * sizeof *crop);
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, part, &term, 1, m, crop, NULL), ==,
                    LS_OK);
    const float *raw = out + (part.y * W + part.x) * 3;
    g_assert_cmpfloat(crop[0], ==, raw[1]);
    g_assert_cmpfloat(crop[1], ==, 2 * raw[2]);
    g_assert_cmpfloat(crop[2], ==, -raw[0]);
    const struct ls_demosaic_region outside = {60, 0, 20, 5};
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, outside, &term, 1, m, crop, NULL), ==,
                    LS_ERR_INVALID);
    take_free(take);
}

/* A matrix per pixel: of diagonals, it is the ratio; whole, its products are those of the sum. Maps
 * of the whole picture serve a part of it through their stride. */
static void test_a_matrix_takes_the_place_of_a_ratio(void)
{
    struct take *take = take_new(LS_CFA_RGGB, 0.1);
    g_autofree float *rows = g_new(float, take->n), *sum = g_new(float, W *H);
    g_autofree float *ratio = g_new(float, W *H * 3), *matrix = g_new0(float, W *H * 9);
    g_autofree float *by_ratio = g_new(float, W *H * 3), *by_matrix = g_new(float, W *H * 3);
    g_autofree float *white = g_new(float, W *H * 3), *part = g_new(float, W *H * 3);
    const struct ls_demosaic_region crop = {9, 21, 31, 20};
    struct ls_relight_term term = {.sum = sum, .channel = -1};
    ls_relight_row(&take->field, take->omega, 1, rows);
    accumulate(&take->field, take->field.white, take->n, rows, 1, sum);
    ratio_of(&take->field, 1, ratio);
    for (size_t j = 0; j < (size_t)W * H; j++)
        for (size_t c = 0; c < 3; c++)
            matrix[9 * j + 4 * c] = ratio[3 * j + c];
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, white, NULL),
                    ==, LS_OK);
    term.ratio = ratio;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, by_ratio, NULL),
                    ==, LS_OK);
    term.ratio = NULL;
    term.matrix = matrix;
    g_assert_cmpint(
        ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, by_matrix, NULL), ==,
        LS_OK);
    for (size_t k = 0; k < (size_t)W * H * 3; k++)
        g_assert_cmpfloat(by_matrix[k], ==, by_ratio[k]); /* adding zeros changes nothing */

    for (size_t k = 0; k < (size_t)W * H * 9; k++)
        matrix[k] = (float)(k % 7) - 2;
    term.matrix = matrix + (crop.y * W + crop.x) * 9;
    term.map_stride = W * 9;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, crop, &term, 1, NULL, part, NULL), ==,
                    LS_OK);
    for (uint32_t y = 0; y < crop.height; y++)
        for (uint32_t x = 0; x < crop.width; x++)
            for (uint32_t c = 0; c < 3; c++) {
                size_t at = (crop.y + y) * W + crop.x + x;
                const float *v = white + 3 * at, *m = matrix + 9 * at + 3 * c;
                g_assert_cmpfloat(part[(y * crop.width + x) * 3 + c], ==,
                                  (m[0] * v[0] + m[1] * v[1]) + m[2] * v[2]);
            }
    term.channel = 1;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, crop, &term, 1, NULL, part, NULL), ==,
                    LS_ERR_INVALID);
    term.channel = -1;
    term.ratio = ratio;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, crop, &term, 1, NULL, part, NULL), ==,
                    LS_ERR_INVALID);
    take_free(take);
}

static void refused(struct take *take, const struct ls_field *field, const char *word)
{
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_field_check(field, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, word));
}

static void test_a_field_that_cannot_be_right_is_refused(void)
{
    struct take *take = take_new(LS_CFA_RGGB, 0.1);
    double bad[SPECTRA * N_MAX];
    struct ls_field f = take->field;
    f.n_channels = 1;
    refused(take, &f, "channels");
    f = take->field;
    f.scale = NAN;
    refused(take, &f, "scale");
    f = take->field;
    memcpy(bad, take->duty, sizeof take->duty);
    bad[1] = 0;
    f.duty = bad;
    refused(take, &f, "duty");
    f = take->field;
    memcpy(bad, take->omega, sizeof take->omega);
    bad[3] += 0.1;
    f.omega_sr = bad;
    refused(take, &f, "4 pi");
    f = take->field;
    memcpy(bad, take->p, sizeof take->p);
    bad[1] = 2;
    f.p = bad;
    refused(take, &f, "green");
    f = take->field;
    f.k = NULL;
    refused(take, &f, "missing");
    g_assert_cmpint(ls_field_normalise_gains((const double[]){1, 0}, 2, bad, bad, NULL), ==,
                    LS_ERR_INVALID);
    take_free(take);
}

static void test_regions_of_pixels_carry_their_halo(void)
{
    const struct ls_field field = {.width = 130, .height = 64};
    struct ls_tile_region r = ls_region_of_pixels(&field, 64, 0, 66, 10, 2);
    g_assert_cmpuint(r.x0, ==, 0);
    g_assert_cmpuint(r.x1, ==, 2);
    g_assert_cmpuint(r.y1, ==, 1);
    r = ls_region_of_pixels(&field, 66, 0, 127, 64, 2);
    g_assert_cmpuint(r.x0, ==, 1);
    g_assert_cmpuint(r.x1, ==, 3);
    g_assert_cmpuint(ls_region_width_px(&field, &r), ==, 66);
    g_assert_cmpuint(ls_region_height_px(&field, &r), ==, 64);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/relight/a-promoted-relit-picture-is-the-definition",
                    test_a_promoted_relit_picture_is_the_definition);
    g_test_add_func("/relight/white-furnace-reads-the-albedo", test_white_furnace);
    g_test_add_func("/relight/the-weighted-denominator-beats-the-paper-s",
                    test_the_weighted_denominator_beats_the_paper_s);
    g_test_add_func("/relight/the-tristimulus-baseline-tints-a-white-object",
                    test_the_tristimulus_baseline_tints_a_white_object);
    g_test_add_func("/relight/a-crop-is-bit-identical-and-the-matrix-comes-last",
                    test_a_crop_is_bit_identical_and_the_matrix_comes_last);
    g_test_add_func("/relight/a-matrix-takes-the-place-of-a-ratio",
                    test_a_matrix_takes_the_place_of_a_ratio);
    g_test_add_func("/mutation/gain-applied-twice-is-caught", test_gain_applied_twice_is_caught);
    g_test_add_func("/mutation/gain-not-applied-is-caught", test_gain_not_applied_is_caught);
    g_test_add_func("/mutation/gains-not-normalised-are-caught",
                    test_gains_not_normalised_are_caught);
    g_test_add_func("/mutation/droop-inverted-is-caught", test_droop_inverted_is_caught);
    g_test_add_func("/mutation/duty-treated-as-gain-is-caught",
                    test_duty_treated_as_gain_is_caught);
    g_test_add_func("/mutation/a-mirrored-environment-is-caught",
                    test_a_mirrored_environment_is_caught);
    g_test_add_func("/mutation/swapped-lights-are-caught", test_swapped_lights_are_caught);
    g_test_add_func("/mutation/numbering-from-one-is-caught", test_numbering_from_one_is_caught);
    g_test_add_func("/field/a-field-that-cannot-be-right-is-refused",
                    test_a_field_that_cannot_be_right_is_refused);
    g_test_add_func("/field/regions-of-pixels-carry-their-halo",
                    test_regions_of_pixels_carry_their_halo);
    return g_test_run();
}

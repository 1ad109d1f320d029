#include "tests/core/relight_take.h"

#include "core/envlights.h"
#include "core/half.h"
#include "core/promote.h"

#include <math.h>
#include <string.h>

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

static void place(struct take *take, double y, double phi)
{
    double r = sqrt(fmax(0, 1 - y * y));
    take->direction[take->n][0] = (float)(r * sin(phi));
    take->direction[take->n][1] = (float)y;
    take->direction[take->n++][2] = (float)(-r * cos(phi));
}

static void dome(struct take *take, uint32_t rings)
{
    for (uint32_t r = 0; r <= rings; r++) {
        double t = M_PI * r / rings;
        uint32_t around = MAX(1, (uint32_t)lround(2 * rings * sin(t)));
        for (uint32_t k = 0; k < around; k++)
            place(take, cos(t), 2 * M_PI * (k + 0.37) / around);
    }
}

/* @n directions along a spiral of equal areas. */
static void spiral(struct take *take, uint32_t n)
{
    for (uint32_t k = 0; k < n; k++)
        place(take, 1 - 2 * (k + 0.5) / n, M_PI * (3 - sqrt(5)) * k);
}

/* The first @n lights once more. */
static void double_lights(struct take *take, uint32_t n)
{
    memcpy(take->direction + take->n, take->direction, n * sizeof *take->direction);
    take->n += n;
}

static void place_lights(struct take *take, enum layout layout)
{
    switch (layout) {
    case LAYOUT_DOME:
        dome(take, 12);
        return;
    case LAYOUT_346:
        spiral(take, 346);
        return;
    case LAYOUT_DOUBLED:
        spiral(take, 173);
        double_lights(take, 173);
        return;
    case LAYOUT_PARTLY:
        spiral(take, 300);
        double_lights(take, 46);
        return;
    }
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

void relight_take_photograph(struct take *take)
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

struct take *relight_take_new(enum ls_cfa cfa, double spread, enum layout layout)
{
    static const double p[SPECTRA][3] = {{0.7, 1, 0.6}, {1.1, 0.2, 0.03}, {0.02, 0.4, 0.9}};
    static const double albedo[SPECTRA][3] = {{0.6, 0.3, 0.2}, {0.7, 0.4, 0.3}, {0.3, 0.2, 0.1}};
    const guint32 seed = 11;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    struct take *take = g_new0(struct take, 1);
    place_lights(take, layout);
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
    relight_take_photograph(take);
    if (cfa == LS_CFA_NONE) /* the mono channel is the scene's green one */
        for (uint32_t s = 0; s < SPECTRA; s++)
            take->p[s] = p[s][1];
    return take;
}

void relight_take_free(struct take *take)
{
    g_byte_array_unref(take->store);
    g_free(take->shade);
    g_free(take);
}

static const struct ls_tile_region all_tiles = {0, 0, 2, 2};

void relight_take_sum(const struct ls_field *field, const struct ls_picture *pictures, uint32_t n,
                      const float *weights, uint32_t n_sums, float *sums)
{
    struct ls_accumulate_job job = {
        .pictures = pictures, .n_pictures = n, .n_sums = n_sums, .weights = weights};
    g_assert_cmpint(ls_accumulate(field, &job, &all_tiles, sums, NULL, NULL), ==, LS_OK);
}

void relight_take_ratio(const struct ls_field *field, uint32_t s, float *ratio)
{
    size_t n = (size_t)W * H * field->n_channels;
    g_autofree float *row = g_new(float, field->n_lights), *sum = g_new(float, W *H);
    g_autofree float *v = g_new(float, n), *f = g_new(float, n), *sigma = g_new(float, n);
    float sphere = (float)ls_promote_sphere_factor(field, s);
    double neutral[3];
    for (uint32_t c = 0; c < field->n_channels; c++)
        neutral[c] = field->p[s * field->n_channels + c] / field->p[c];
    ls_relight_row(field->k, field->g + (size_t)s * field->n_lights, field->n_lights, row);
    relight_take_sum(field, field->white, field->n_lights, row, 1, sum);
    g_assert_cmpint(ls_relight_demosaic(field, sum, all_px, all_px, v), ==, LS_OK);
    ls_promote_sigma(field, row, field->n_lights, v, n, sigma);
    relight_take_sum(field, &field->sphere[s], 1, &sphere, 1, sum);
    g_assert_cmpint(ls_relight_demosaic(field, sum, all_px, all_px, f), ==, LS_OK);
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, field->n_channels, neutral, ratio, NULL),
                    ==, LS_OK);
}

void relight_take_relight(const struct ls_field *field, const double *w, float *out)
{
    g_autofree float *rows = g_new(float, SPECTRA * field->n_lights);
    g_autofree double *own = g_new(double, field->n_lights);
    g_autofree float *sums = g_new(float, SPECTRA *W *H);
    g_autofree float *ratio = g_new(float, SPECTRA *W *H * 3);
    struct ls_relight_term terms[SPECTRA];
    for (uint32_t s = 0; s < SPECTRA; s++) {
        for (uint32_t i = 0; i < field->n_lights; i++)
            own[i] = w[i * SPECTRA + s];
        ls_relight_row(field->k, own, field->n_lights, rows + s * field->n_lights);
        if (s > 0)
            relight_take_ratio(field, s, ratio + s * W * H * 3);
        terms[s] = (struct ls_relight_term){
            .sum = sums + s * W * H, .ratio = s ? ratio + s * W * H * 3 : NULL, .channel = -1};
    }
    relight_take_sum(field, field->white, field->n_lights, rows, SPECTRA, sums);
    g_assert_cmpint(ls_relight_finish(field, all_px, all_px, terms, SPECTRA, NULL, out, NULL), ==,
                    LS_OK);
}

void relight_take_environment(const struct take *take, gboolean mirrored, double *w)
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

double relight_take_bound(const struct take *take)
{
    return take->field.n_channels == 1 ? 2.5e-4 : 1e-3;
}

double relight_take_error(struct take *take, const struct ls_field *field, gboolean mirrored)
{
    g_autofree float *out = g_new(float, W *H * 3);
    g_autofree double *w = g_new(double, take->n *SPECTRA), *used = g_new(double, take->n *SPECTRA);
    relight_take_environment(take, FALSE, w);
    memcpy(used, w, sizeof *w * take->n * SPECTRA);
    if (mirrored)
        relight_take_environment(take, TRUE, used);
    relight_take_relight(field, used, out);
    return relit_error(take, w, out);
}

#include "tests/sim/paper_models.h"

#include "core/linear.h"
#include "core/mono_blend.h"
#include "core/promote.h"
#include "core/relight.h"

#include <string.h>

static const struct ls_linear_noise quiet = {1e-14, 0}; /* as in paper_take.c */

/* ---- maps ---- */

static float *stable(const struct paper_take *take, const float *f, const float *v, float *sigma,
                     const double *neutral)
{
    uint32_t colours = (uint32_t)take->colours;
    float *ratio = g_new(float, PIXELS *colours);
    struct ls_diag diag = {{0}};
    if (colours > 1)
        ls_promote_add_contrast(v, SIDE, SIDE, colours, sigma);
    ok(ls_promote_ratio(f, v, sigma, SIDE, SIDE, colours, neutral, ratio, &diag), &diag);
    return ratio;
}

static float *ratio_of(const struct paper_take *take, int s, paper_choice *of)
{
    float row[LIGHTS];
    size_t n = (size_t)(PIXELS * take->colours);
    double neutral[3];
    g_autofree float *f = paper_take_photograph(take, s, of, 0);
    g_autofree float *v = paper_take_white(take, s, of, 0, NULL, row), *sigma = g_new(float, n);
    for (int c = 0; c < take->colours; c++)
        neutral[c] = take->p[s][c] / take->p[0][c];
    ls_promote_sigma(&take->field, row, LIGHTS, v, n, sigma);
    return stable(take, f, v, sigma, neutral);
}

static void tint_of(const struct paper_take *take, int s, double tint[3])
{
    for (int c = 0; c < take->colours; c++)
        tint[c] = take->p[s][c] / (take->p[V][c] + take->p[H][c]);
}

struct parts {
    float *d, *s, *c; /* [PIXELS][colours] */
};

static struct parts separate(const struct paper_take *take, const double *w)
{
    float row[LIGHTS];
    size_t n = (size_t)(PIXELS * take->colours);
    struct parts out = {g_new(float, n), g_new(float, n), g_new(float, n)};
    struct ls_diag diag = {{0}};
    const struct ls_separated_job job = {
        .field = &take->polarised, .n_rows = 1, .weights = row, .region = paper_whole};
    for (int i = 0; i < LIGHTS; i++)
        row[i] = (float)w[i];
    ok(ls_separated_accumulate(&job, out.d, out.s, out.c, NULL, &diag), &diag);
    return out;
}

static void parts_free(struct parts *parts)
{
    g_free(parts->d);
    g_free(parts->s);
    g_free(parts->c);
}

static float *separated_ratio(const struct paper_take *take, int s)
{
    float row[LIGHTS];
    size_t n = (size_t)(PIXELS * take->colours);
    double tint[3];
    struct parts sums = separate(take, take->stage->g[s]);
    g_autofree float *f = paper_take_photograph(take, s, paper_every, 0);
    g_autofree float *lit = g_new(float, n), *sigma = g_new(float, n);
    for (int i = 0; i < LIGHTS; i++)
        row[i] = (float)take->stage->g[s][i];
    for (size_t j = 0; j < n; j++)
        lit[j] = sums.d[j] + sums.s[j];
    tint_of(take, s, tint);
    ls_separated_sigma(&take->polarised, row, lit, n, sigma);
    ls_separate_remainder(f, sums.d, sums.s, sums.c, tint, PIXELS, (uint32_t)take->colours, f,
                          sums.d);
    float *ratio = stable(take, f, sums.d, sigma, tint);
    parts_free(&sums);
    return ratio;
}

/* Pictures of the segments. */
struct segments {
    float *v[SEGMENTS], *f[SEGMENTS], *u[SEGMENTS];
    struct ls_linear_noise noise[SEGMENTS];
};

static void segments_photograph(const struct paper_take *take, int s, struct segments *out)
{
    float row[LIGHTS];
    for (uint32_t q = 0; q < SEGMENTS; q++) {
        out->v[q] = paper_take_white(take, s, paper_segment, q, NULL, row);
        out->f[q] = paper_take_photograph(take, s, paper_segment, q);
        out->u[q] =
            take->phi ? paper_take_white(take, s, paper_every, 0, take->phi + q, row) : NULL;
        out->noise[q] = quiet;
    }
}

static void segments_free(struct segments *segments)
{
    for (int q = 0; q < SEGMENTS; q++) {
        g_free(segments->v[q]);
        g_free(segments->f[q]);
        g_free(segments->u[q]);
    }
}

static float *matrix_of(const struct paper_take *take, int s)
{
    struct segments of;
    struct ls_linear_options options;
    struct ls_diag diag = {{0}};
    float *m = g_new(float, PIXELS * 9);
    segments_photograph(take, s, &of);
    ls_linear_options_default(&options);
    const struct ls_linear_pictures pictures = {.width = SIDE,
                                                .height = SIDE,
                                                .n_segments = SEGMENTS,
                                                .n_lights = LIGHTS,
                                                .n_in = 3,
                                                .n_out = 3,
                                                .v = (const float *const *)of.v,
                                                .f = (const float *const *)of.f,
                                                .v_noise = of.noise,
                                                .f_noise = of.noise,
                                                .total_noise = quiet,
                                                .p_in = take->p[0],
                                                .p_out = take->p[s],
                                                .inputs = {0, 1, 2},
                                                .demosaiced = true};
    const struct ls_linear_part all = {.width = SIDE, .height = SIDE, .out = m};
    ok(ls_linear_fit(&pictures, &options, &all, &diag), &diag);
    segments_free(&of);
    return m;
}

static float *blend_of(const struct paper_take *take, int s)
{
    struct segments of;
    struct ls_diag diag = {{0}};
    float *ratios = g_new(float, PIXELS *SEGMENTS);
    segments_photograph(take, s, &of);
    const struct ls_mono_blend_pictures pictures = {.width = SIDE,
                                                    .height = SIDE,
                                                    .n_segments = SEGMENTS,
                                                    .n_lights = LIGHTS,
                                                    .v = (const float *const *)of.v,
                                                    .u = (const float *const *)of.u,
                                                    .f = (const float *const *)of.f,
                                                    .v_noise = of.noise,
                                                    .f_noise = of.noise,
                                                    .total_noise = quiet,
                                                    .neutral = take->p[s][0] / take->p[0][0]};
    const struct ls_linear_part all = {.width = SIDE, .height = SIDE, .out = ratios};
    ok(ls_mono_blend_fit(&pictures, &all, &diag), &diag);
    segments_free(&of);
    return ratios;
}

static void make_phi(struct paper_take *take)
{
    struct ls_diag diag = {{0}};
    take->phi = g_new(double, LIGHTS *SEGMENTS);
    ok(ls_mono_blend_weights(take->stage->directions, LIGHTS, take->stage->segment, SEGMENTS,
                             take->phi, &diag),
       &diag);
}

static float *map_of(const struct paper_take *take, int s)
{
    switch (take->model) {
    case SPHERE:
        return ratio_of(take, s, paper_every);
    case HEAD_LIGHT:
        return ratio_of(take, s, paper_head);
    case SEPARATED:
        return separated_ratio(take, s);
    case LINEAR:
        return take->phi ? blend_of(take, s) : matrix_of(take, s);
    default:
        return NULL;
    }
}

void paper_take_promote(struct paper_take *take, enum model model)
{
    paper_take_forget(take);
    take->model = model;
    if (model == LINEAR && take->colours == 1)
        make_phi(take);
    for (int s = 1; s < SPECTRA; s++) /* white is as it was photographed */
        take->map[s] = map_of(take, s);
}

/* ---- relighting ---- */

static void finish(const struct paper_take *take, const struct ls_relight_term *term, float *out)
{
    struct ls_diag diag = {{0}};
    float one[PIXELS * 3];
    ok(ls_relight_finish(&take->field, paper_whole, paper_whole, term, 1, NULL, one, &diag), &diag);
    for (int j = 0; j < PIXELS * 3; j++)
        out[j] += one[j];
}

static void add_separated(const struct paper_take *take, int s, const double *w, float *out)
{
    double tint[3];
    int colours = take->colours;
    struct parts sums = separate(take, w);
    g_autofree float *made = g_new0(float, PIXELS *colours);
    tint_of(take, s, tint);
    ls_separated_finish(sums.d, sums.s, sums.c, take->map[s], tint, 1, PIXELS, (uint32_t)colours,
                        made);
    for (int j = 0; j < PIXELS * 3; j++)
        out[j] += made[colours == 3 ? j : j / 3];
    parts_free(&sums);
}

static void add_blend(const struct paper_take *take, int s, const double *w, float *out)
{
    float ratio[PIXELS];
    double weights[LIGHTS];
    for (int q = 0; q < SEGMENTS; q++) {
        for (int i = 0; i < LIGHTS; i++)
            weights[i] = w[i] * take->phi[i * SEGMENTS + q];
        for (int j = 0; j < PIXELS; j++)
            ratio[j] = take->map[s][j * SEGMENTS + q];
        g_autofree float *sum = paper_take_sum(take, 0, weights);
        const struct ls_relight_term term = {.sum = sum, .ratio = ratio, .channel = -1};
        finish(take, &term, out);
    }
}

static void add(const struct paper_take *take, int s, const double *w, float *out)
{
    bool promoted = take->map[s] != NULL, matrix = take->model == LINEAR;
    g_autofree float *sum = paper_take_sum(take, promoted ? 0 : s, w);
    const struct ls_relight_term term = {.sum = sum,
                                         .ratio = matrix ? NULL : take->map[s],
                                         .matrix = matrix ? take->map[s] : NULL,
                                         .channel = -1};
    finish(take, &term, out);
}

static void read_samples(const float *picture, double out[SAMPLES][3])
{
    for (int p = 0; p < SAMPLES; p++) {
        int x = p % ACROSS * SQUARE + SQUARE / 2, y = p / ACROSS * SQUARE + SQUARE / 2;
        for (int c = 0; c < 3; c++)
            out[p][c] = (double)picture[3 * (y * SIDE + x) + c];
    }
}

void paper_take_relight(const struct paper_take *take, const double *w, double out[SAMPLES][3])
{
    g_autofree float *picture = g_new0(float, PIXELS * 3);
    for (int s = 0; s < SPECTRA; s++) {
        const double *row = w + s * LIGHTS;
        if (take->map[s] && take->model == SEPARATED)
            add_separated(take, s, row, picture);
        else if (take->map[s] && take->phi)
            add_blend(take, s, row, picture);
        else
            add(take, s, row, picture);
    }
    read_samples(picture, out);
}

void paper_take_tristimulus(const struct paper_take *take, double *w, double out[SAMPLES][3])
{
    g_autofree float *picture = g_new0(float, PIXELS * 3);
    for (uint32_t c = 0; c < 3; c++) {
        ls_relight_tristimulus(&take->field, c, w + c * LIGHTS);
        g_autofree float *sum = paper_take_sum(take, 0, w + c * LIGHTS);
        const struct ls_relight_term term = {.sum = sum, .channel = (int32_t)c};
        finish(take, &term, picture);
    }
    read_samples(picture, out);
}

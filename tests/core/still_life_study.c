#include "tests/core/still_life_study.h"

#include "core/mono_blend.h"
#include "core/segments.h"

#include <math.h>
#include <string.h>

enum {
    LIGHTS = STILL_LIFE_LIGHTS,
    SPECTRA = STILL_LIFE_SPECTRA,
    MAX_SEGMENTS = STILL_LIFE_MAX_SEGMENTS,
};

/* ---- the pictures of a fit ---- */

enum { UNLIT = UINT32_MAX };

struct pictures {
    uint32_t n_segments, segment[LIGHTS], size[MAX_SEGMENTS];
    uint32_t n_in;
    float *v[MAX_SEGMENTS], *f[MAX_SEGMENTS], *u[MAX_SEGMENTS];
    struct ls_linear_noise v_noise[MAX_SEGMENTS], f_noise[MAX_SEGMENTS], total_noise;
    double p_in[LS_LINEAR_MAX_INPUTS];
    double phi[LIGHTS * MAX_SEGMENTS], others[MAX_SEGMENTS * MAX_SEGMENTS];
};

static struct ls_linear_noise sum_noise(const struct still_life_camera *camera, const double *g,
                                        const uint32_t *segment, const uint32_t *wanted)
{
    struct ls_linear_noise one = still_life_noise(camera, still_life_rate(1)), sum = {0};
    for (uint32_t i = 0; i < LIGHTS; i++)
        if (segment[i] != UNLIT && (!wanted || segment[i] == *wanted)) {
            sum.floor += g[i] * g[i] * one.floor;
            sum.shot = fmax(sum.shot, g[i] * one.shot);
        }
    return sum;
}

static void add_picture(const float *from, size_t pixels, uint32_t colours, double weight,
                        uint32_t step, float *to)
{
    for (size_t i = 0; i < pixels; i++)
        for (uint32_t c = 0; c < colours; c++)
            to[i * step + c] += (float)(weight * (double)from[i * colours + c]);
}

static double towards_camera(const struct still_life *w, uint32_t light)
{
    double dot = 0;
    for (int k = 0; k < 3; k++)
        dot += (double)w->directions[light][k] * (double)w->camera[k];
    return dot;
}

/* All but the lights nearest the camera are dark. */
static void light_the_head(const struct still_life *w, uint32_t *segment)
{
    for (uint32_t i = 0; i < LIGHTS; i++) {
        uint32_t nearer = 0;
        for (uint32_t k = 0; k < LIGHTS; k++)
            nearer += towards_camera(w, k) > towards_camera(w, i);
        segment[i] = nearer < STILL_LIFE_HEADLIGHTS ? 0 : UNLIT;
    }
}

static void take_segments(const struct still_life *w, const struct still_life_camera *camera,
                          float *const *fields, const struct still_life_inputs *inputs, int s,
                          enum still_life_model model, uint32_t n_segments, struct pictures *p)
{
    size_t pixels = (size_t)w->side * w->side;
    const float(*d)[3] = w->directions;
    memset(p, 0, sizeof *p);
    p->n_segments = n_segments;
    p->n_in = (uint32_t)inputs->n * w->colours;
    g_assert_cmpint(ls_segments_partition(d, LIGHTS, n_segments, p->segment, NULL), ==, LS_OK);
    g_assert_cmpint(ls_mono_blend_weights(d, LIGHTS, p->segment, n_segments, p->phi, NULL), ==,
                    LS_OK);
    if (n_segments > 1)
        ls_mono_blend_others(p->phi, LIGHTS, p->segment, n_segments, p->others);
    if (model == STILL_LIFE_HEAD)
        light_the_head(w, p->segment);
    for (uint32_t g = 0; g < n_segments; g++) {
        p->v[g] = g_new0(float, pixels * p->n_in);
        p->u[g] = g_new0(float, w->n);
        p->f[g] = g_new0(float, w->n);
    }
    for (uint32_t i = 0; i < LIGHTS; i++) {
        uint32_t g = p->segment[i];
        if (g == UNLIT)
            continue;
        p->size[g]++;
        add_picture(w->truth[s] + i * w->n, pixels, w->colours, w->g[s][i], w->colours, p->f[g]);
        for (int k = 0; k < inputs->n; k++)
            add_picture(fields[inputs->spectrum[k]] + i * w->n, pixels, w->colours, w->g[s][i],
                        p->n_in, p->v[g] + (unsigned)k * w->colours);
        for (g = 0; g < n_segments && w->colours == 1; g++)
            add_picture(fields[0] + i * w->n, pixels, 1, w->g[s][i] * p->phi[i * n_segments + g], 1,
                        p->u[g]);
    }
    for (uint32_t g = 0; g < n_segments; g++) {
        still_life_take(w, camera, p->size[g], p->f[g]);
        p->f_noise[g] = still_life_noise(camera, still_life_rate(p->size[g]));
        p->v_noise[g] = sum_noise(camera, w->g[s], p->segment, &g);
    }
    p->total_noise = sum_noise(camera, w->g[s], p->segment, NULL);
    for (int k = 0; k < inputs->n; k++)
        for (uint32_t c = 0; c < w->colours; c++)
            p->p_in[(unsigned)k * w->colours + c] = w->p[inputs->spectrum[k]][c];
}

static void free_pictures(struct pictures *p)
{
    for (int g = 0; g < MAX_SEGMENTS; g++) {
        g_free(p->v[g]);
        g_free(p->f[g]);
        g_free(p->u[g]);
    }
}

static struct ls_linear_pictures linear_pictures(const struct still_life *w,
                                                 const struct still_life_camera *camera,
                                                 const struct pictures *p, int s)
{
    return (struct ls_linear_pictures){.width = w->side,
                                       .height = w->side,
                                       .n_segments = p->n_segments,
                                       .n_lights = LIGHTS,
                                       .n_in = p->n_in,
                                       .n_out = w->colours,
                                       .v = (const float *const *)p->v,
                                       .f = (const float *const *)p->f,
                                       .v_noise = p->v_noise,
                                       .f_noise = p->f_noise,
                                       .total_noise = p->total_noise,
                                       .p_in = p->p_in,
                                       .p_out = w->p[s],
                                       .inputs = {0, 1, 2},
                                       .demosaiced = camera->mosaic};
}

/* ---- errors ---- */

double still_life_percent(const struct still_life_sums *s)
{
    return 100 * sqrt(s->difference / s->truth);
}

static void add_sums(struct still_life_sums *s, double difference, double truth)
{
    s->difference += difference;
    s->truth += truth;
}

static double brightness(const struct still_life *w, uint32_t light, size_t pixel)
{
    double sum = 0;
    for (uint32_t c = 0; c < w->colours; c++)
        sum += (double)w->truth[0][light * w->n + pixel * w->colours + c];
    return sum;
}

static void compare(const struct still_life_study *x, uint32_t light, const float *promoted,
                    const float *truth, struct still_life_errors *e)
{
    const struct still_life *w = x->world;
    size_t pixels = (size_t)w->side * w->side;
    for (size_t i = 0; i < pixels; i++) {
        double difference = 0, total = 0, absolute = 0, sum = 0;
        for (uint32_t c = 0; c < w->colours; c++) {
            double of = (double)truth[i * w->colours + c];
            double d = (double)promoted[i * w->colours + c] - of;
            difference += d * d;
            total += of * of;
            absolute += fabs(d);
            sum += of;
        }
        add_sums(&e->field, difference, total);
        if (w->specular[light * pixels + i] > 0.5f)
            add_sums(&e->highlight, difference, total);
        if (!(w->bounced[i] > 0.2f))
            continue;
        add_sums(&e->inter, difference, total);
        double bright = brightness(w, light, i), most = (double)x->brightest[i];
        if (bright > 1e-3 * most && bright < 0.1 * most && sum > 0) {
            e->shadow += 100 * absolute / sum;
            e->n_shadow++;
        }
    }
}

/* Every light's picture in one spectrum, photographed. */
static float *take_field(const struct still_life *w, const struct still_life_camera *camera, int s)
{
    float *field = g_memdup2(w->truth[s], LIGHTS * w->n * sizeof *field);
    for (size_t i = 0; i < LIGHTS; i++)
        still_life_take(w, camera, 1, field + i * w->n);
    return field;
}

void still_life_study_init(struct still_life_study *x, const struct still_life *w, bool noise,
                           bool mosaic, bool every)
{
    enum { SEED = 7 };
    const struct still_life_camera camera = {noise, mosaic, g_rand_new_with_seed(SEED), 0};
    g_test_message("seed %d", SEED);
    still_life_study_init_with(x, w, &camera, every);
}

void still_life_study_init_with(struct still_life_study *x, const struct still_life *w,
                                const struct still_life_camera *camera, bool every)
{
    size_t pixels = (size_t)w->side * w->side;
    *x = (struct still_life_study){.world = w,
                                   .camera = *camera,
                                   .quiet = {false, camera->mosaic, NULL, 0},
                                   .brightest = g_new0(float, pixels)};
    for (int s = 0; s < SPECTRA; s++) {
        x->clean[s] = take_field(w, &x->quiet, s);
        if (s == 0 || every)
            x->noisy[s] = take_field(w, &x->camera, s);
    }
    for (uint32_t k = 0; k < LIGHTS; k++)
        for (size_t i = 0; i < pixels; i++)
            x->brightest[i] = fmaxf(x->brightest[i], (float)brightness(w, k, i));
}

void still_life_study_finish(struct still_life_study *x)
{
    for (int s = 0; s < SPECTRA; s++) {
        g_free(x->clean[s]);
        g_free(x->noisy[s]);
    }
    g_free(x->brightest);
    g_rand_free(x->camera.rand);
}

/* Light @light's inputs side by side: [pixel][n_in]. */
static void gather(const struct still_life *w, float *const *fields,
                   const struct still_life_inputs *inputs, uint32_t light, float *v)
{
    uint32_t n_in = (uint32_t)inputs->n * w->colours;
    size_t pixels = (size_t)w->side * w->side;
    memset(v, 0, pixels * n_in * sizeof *v);
    for (int k = 0; k < inputs->n; k++)
        add_picture(fields[inputs->spectrum[k]] + light * w->n, pixels, w->colours, 1, n_in,
                    v + (unsigned)k * w->colours);
}

static void blend_light(const struct still_life *w, const struct pictures *p, const float *r,
                        const float *v, uint32_t light, float *out)
{
    for (size_t i = 0; i < w->n; i++) {
        double ratio = 0;
        for (uint32_t g = 0; g < p->n_segments; g++)
            ratio += p->phi[light * p->n_segments + g] * (double)r[i * p->n_segments + g];
        out[i] = (float)(ratio * (double)v[i]);
    }
}

static void fit(const struct still_life_study *x, enum still_life_model model,
                const struct pictures *p, int s, float *map, struct ls_linear_error *error)
{
    const struct still_life *w = x->world;
    struct ls_diag diag = {0};
    const struct ls_linear_part all = {
        .width = w->side, .height = w->side, .out = map, .step = p->n_segments > 2, .error = error};
    if (model == STILL_LIFE_BLEND) {
        const struct ls_mono_blend_pictures blend = {.width = w->side,
                                                     .height = w->side,
                                                     .n_segments = p->n_segments,
                                                     .n_lights = LIGHTS,
                                                     .v = (const float *const *)p->v,
                                                     .u = (const float *const *)p->u,
                                                     .f = (const float *const *)p->f,
                                                     .v_noise = p->v_noise,
                                                     .f_noise = p->f_noise,
                                                     .total_noise = p->total_noise,
                                                     .neutral = w->p[s][0] / w->p[0][0],
                                                     .others = p->others};
        g_assert_cmpint(ls_mono_blend_fit(&blend, &all, &diag), ==, LS_OK);
        return;
    }
    struct ls_linear_pictures pictures = linear_pictures(w, &x->camera, p, s);
    struct ls_linear_options options;
    ls_linear_options_default(&options);
    g_assert_cmpint(ls_linear_fit(&pictures, &options, &all, &diag), ==, LS_OK);
}

static void promote(const struct still_life_study *x, enum still_life_model model,
                    const struct pictures *p, const struct still_life_inputs *inputs,
                    float *const *fields, int s, const float *map, struct still_life_errors *e)
{
    const struct still_life *w = x->world;
    size_t pixels = (size_t)w->side * w->side;
    g_autofree float *v = g_new(float, pixels * p->n_in), *out = g_new(float, w->n);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        gather(w, fields, inputs, i, v);
        if (model == STILL_LIFE_BLEND)
            blend_light(w, p, map, v, i, out);
        else
            ls_linear_apply(map, v, pixels, p->n_in, w->colours, out);
        compare(x, i, out, x->clean[s] + i * w->n, e);
    }
}

static bool is_photographed(const struct still_life_inputs *inputs, int s)
{
    for (int k = 0; k < inputs->n; k++)
        if (inputs->spectrum[k] == s)
            return true;
    return false;
}

/* Fit one spectrum and hold it against the truth. */
static void judge_spectrum(const struct still_life_study *x, enum still_life_model model,
                           const struct still_life_inputs *inputs, uint32_t n_segments, int s,
                           struct still_life_row *row)
{
    const struct still_life *w = x->world;
    uint32_t n_in = (uint32_t)inputs->n * w->colours;
    uint32_t depth = model == STILL_LIFE_BLEND ? n_segments : n_in * w->colours;
    g_autofree float *map = g_new(float, (size_t)w->side * w->side * depth);
    struct pictures p;
    take_segments(w, &x->camera, (float *const *)x->noisy, inputs, s, model, n_segments, &p);
    fit(x, model, &p, s, map, &row->left_out);
    promote(x, model, &p, inputs, (float *const *)x->clean, s, map, &row->promotion);
    promote(x, model, &p, inputs, (float *const *)x->noisy, s, map, &row->served);
    free_pictures(&p);
}

static void add_errors(struct still_life_errors *sum, const struct still_life_errors *e)
{
    add_sums(&sum->field, e->field.difference, e->field.truth);
    add_sums(&sum->inter, e->inter.difference, e->inter.truth);
    add_sums(&sum->highlight, e->highlight.difference, e->highlight.truth);
    sum->shadow += e->shadow;
    sum->n_shadow += e->n_shadow;
}

static void add_row(struct still_life_row *sum, const struct still_life_row *row)
{
    add_errors(&sum->promotion, &row->promotion);
    add_errors(&sum->served, &row->served);
    ls_linear_error_add(&sum->left_out, &row->left_out);
}

/* Each spectrum by what its estimate prefers, as a take is served. */
static void judge_better(const struct still_life_study *x, const struct still_life_inputs *inputs,
                         uint32_t n_segments, int s, struct still_life_row *row)
{
    static const struct still_life_inputs white = {1, {0}};
    struct still_life_row matrix = {0}, blend = {0};
    judge_spectrum(x, STILL_LIFE_LINEAR, inputs, n_segments, s, &matrix);
    judge_spectrum(x, STILL_LIFE_BLEND, &white, n_segments, s, &blend);
    bool better = ls_linear_estimate(&blend.left_out) < ls_linear_estimate(&matrix.left_out);
    g_test_message(
        "%d: matrix %.3f estimated %.3f, blend %.3f estimated %.3f", s,
        still_life_percent(&matrix.served.field), 100 * ls_linear_estimate(&matrix.left_out),
        still_life_percent(&blend.served.field), 100 * ls_linear_estimate(&blend.left_out));
    add_row(row, better ? &blend : &matrix);
}

struct still_life_row still_life_judge(const struct still_life_study *x,
                                       enum still_life_model model,
                                       const struct still_life_inputs *inputs, uint32_t n_segments)
{
    const struct still_life *w = x->world;
    struct still_life_row row = {0};
    for (int s = 1; s < SPECTRA; s++) {
        if (is_photographed(inputs, s)) /* selected, not fitted */
            for (uint32_t i = 0; i < LIGHTS; i++) {
                const float *truth = x->clean[s] + i * w->n;
                compare(x, i, truth, truth, &row.promotion);
                compare(x, i, x->noisy[s] + i * w->n, truth, &row.served);
            }
        else if (model == STILL_LIFE_BETTER)
            judge_better(x, inputs, n_segments, s, &row);
        else
            judge_spectrum(x, model, inputs, n_segments, s, &row);
    }
    return row;
}

uint32_t still_life_pictures(const struct still_life_inputs *inputs, uint32_t n_segments)
{
    return (uint32_t)inputs->n * LIGHTS + (uint32_t)(SPECTRA - inputs->n) * n_segments;
}

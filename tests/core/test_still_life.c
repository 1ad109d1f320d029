/*
 * Promotion models on the simulated still life: 346 lights of unequal strength (5 %), R A G C B
 * promoted from what is photographed per light, against the noise-free truth.
 *
 * Fast: 64 x 64 px. LS_TEST_FULL=1: 128 x 128, and every row of the table.
 *
 * Noise: of a sensor of 10500 e full well and 5 e read noise, bracket t, t/8, t/64, where a white
 * diffuser facing a single light reads 0.8 of full scale at t; every sample in range (up to 0.85)
 * counts, weighted by its information. A picture of n lights is exposed 4 / n as long, as a quarter
 * of them faces any surface. Every picture is the mean of two frames: 0.8 % per pixel on white.
 * (With one frame the highlight error at 64 px is 0.22 of Eq. 1's in place of 0.17: what is left of
 * it is the noise of the picture that the sum must reproduce, which no model can remove.)
 *
 * Errors, in percent, over lights, R A G C B and colours (names of core's errors as the judge has
 * them): "field" over all pixels, "inter" where more than 20 % is bounced light, "shadow" the mean
 * relative colour error of pairs of light and pixel of those that see less than a tenth of their
 * brightest light (a thousandth of the brightest at least), "highlight" over pairs that are more
 * than half specular. "Promotion" is M, fitted on noisy pictures, applied to the noise-free white
 * field: what a model adds to it. "Served" is M applied to the noisy white field, as a user gets
 * it.
 *
 * The requirement is on promotion, at every pixel in RGB. Served errors hold the noise of the white
 * field as well. Through a mosaic, pictures this small are ruled by highlights narrower than the
 * filter's period (26 % by Eq. 1 without any noise): no model can tell the colour of what one
 * photosite alone has seen. Those rows are printed, and only the estimate without truth is required
 * of them.
 */
#include "core/demosaic.h"
#include "core/linear.h"
#include "core/mono_blend.h"
#include "core/segments.h"
#include "sim/geometry.h"
#include "sim/truth.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { LIGHTS = 346, SPECTRA = 6, COLOURS = 3, MAX_SEGMENTS = 26, FRAMES = 2 };

/** The world, all of it in memory. */
struct world {
    uint32_t side, colours;
    size_t n;              /* values of a picture: side x side x colours */
    float *truth[SPECTRA]; /* [light][pixel][colour] */
    float *specular;       /* [light][pixel] */
    float *bounced;        /* [pixel] */
    float directions[LIGHTS][3];
    double g[SPECTRA][LIGHTS];
    double p[SPECTRA][COLOURS];
};

static void load_world(struct world *w, uint32_t side, const char *cfa)
{
    struct ls_diag diag = {0};
    struct sim_scene_config config;
    struct sim_scene *scene = NULL;
    struct ls_calibration *calibration = NULL;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], side, side);
    g_strlcpy(config.views[0].cfa, cfa, sizeof config.views[0].cfa);
    config.n_channels = SPECTRA; /* W R A G C B */
    g_assert_cmpint(sim_scene_create(&config, &scene, &diag), ==, LS_OK);
    const struct sim_region region = {0, 0, 0, side, side};
    const double duties[SPECTRA] = {0.5, 0.5, 0.5, 0.5, 0.5, 0.5};
    bool mono = !strcmp(cfa, "mono");
    size_t pixels = (size_t)side * side;
    *w = (struct world){.side = side, .colours = mono ? 1 : COLOURS};
    w->n = pixels * w->colours;
    g_assert_cmpint(sim_truth_calibration(scene, 0, mono ? "Mono8" : "BayerRG8", duties, SPECTRA,
                                          &calibration, &diag),
                    ==, LS_OK);
    g_autofree float *all = g_new(float, SPECTRA * w->n);
    w->specular = g_new(float, LIGHTS *pixels);
    w->bounced = g_new(float, pixels);
    for (int s = 0; s < SPECTRA; s++) {
        w->truth[s] = g_new(float, LIGHTS * w->n);
        for (uint32_t c = 0; c < w->colours; c++)
            w->p[s][c] = (double)calibration->p[s][c];
    }
    for (uint32_t i = 0; i < LIGHTS; i++) {
        memcpy(w->directions[i], sim_scene_geometry(scene)->direction[i], sizeof w->directions[i]);
        g_assert_cmpint(sim_truth_field(scene, &region, i, all, &diag), ==, LS_OK);
        g_assert_cmpint(sim_truth_specular(scene, &region, i, w->specular + i * pixels, &diag), ==,
                        LS_OK);
        for (uint32_t s = 0; s < SPECTRA; s++) {
            memcpy(w->truth[s] + i * w->n, all + s * w->n, w->n * sizeof *all);
            w->g[s][i] = sim_scene_gain(scene, i, s);
        }
    }
    g_assert_cmpint(sim_truth_bounced(scene, &region, w->bounced, &diag), ==, LS_OK);
    ls_calibration_destroy(calibration);
    sim_scene_destroy(scene);
}

static void free_world(struct world *w)
{
    for (int s = 0; s < SPECTRA; s++)
        g_free(w->truth[s]);
    g_free(w->specular);
    g_free(w->bounced);
}

/* ---- the camera ---- */

static const double full_well_e = 10500, read_e = 5;
static const double single_rate = 0.8 / (0.9 * M_1_PI); /* full scales per unit of R, at t */

/** How a picture is taken. */
struct camera {
    bool noise, mosaic;
    GRand *rand;
};

static double gaussian(GRand *rand)
{
    double u = 1 - g_rand_double(rand);
    return sqrt(-2 * log(u)) * cos(2 * M_PI * g_rand_double(rand));
}

static double rate_of(double n_lights)
{
    return single_rate * fmin(1, 4 / n_lights);
}

/* Variance of the merged bracket. */
static double variance_of(double x, double rate)
{
    double information = 0;
    for (int k = 2; k >= 0; k--) {
        double scale = rate / (1 << 3 * k), raw = fmax(x, 0) * scale;
        if (raw <= 0.85 || k == 2)
            information += scale * scale /
                           ((raw * full_well_e + read_e * read_e) / (full_well_e * full_well_e));
    }
    return 1 / information / FRAMES;
}

/* What promotion is told of it: the longest exposure alone. */
static struct ls_linear_noise noise_model(const struct camera *camera, double rate)
{
    if (!camera->noise)
        return (struct ls_linear_noise){0};
    return (struct ls_linear_noise){pow(read_e / full_well_e / rate, 2) / FRAMES,
                                    1 / (full_well_e * rate) / FRAMES};
}

static void through_mosaic(const struct world *w, float *rgb)
{
    uint32_t side = w->side;
    g_autofree float *mosaic = g_new(float, (size_t)side *side);
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++)
            mosaic[y * side + x] =
                rgb[(y * side + x) * 3 + (unsigned)ls_cfa_channel(LS_CFA_RGGB, x, y)];
    const struct ls_demosaic_region all = {0, 0, side, side};
    const struct ls_demosaic_source source = {mosaic, side, all, side, side, LS_CFA_RGGB};
    const struct ls_demosaic_target target = {{rgb, rgb + 1, rgb + 2}, 3, 3 * side};
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_GRADIENT, &target), ==, LS_OK);
}

static void take(const struct world *w, const struct camera *camera, double n_lights,
                 float *picture)
{
    double rate = rate_of(n_lights);
    for (size_t j = 0; j < w->n && camera->noise; j++)
        picture[j] += (float)(gaussian(camera->rand) * sqrt(variance_of((double)picture[j], rate)));
    if (camera->mosaic && w->colours == 3)
        through_mosaic(w, picture);
}

/* Every light's picture in one spectrum, photographed. */
static float *take_field(const struct world *w, const struct camera *camera, int s)
{
    float *field = g_memdup2(w->truth[s], LIGHTS * w->n * sizeof *field);
    for (size_t i = 0; i < LIGHTS; i++)
        take(w, camera, 1, field + i * w->n);
    return field;
}

/* ---- the pictures of a fit ---- */

/** What is photographed per light: spectra in order, white first. */
struct inputs {
    int n, spectrum[SPECTRA];
};

static const struct inputs white_alone = {1, {0}};

struct pictures {
    uint32_t n_segments, segment[LIGHTS], size[MAX_SEGMENTS];
    uint32_t n_in;
    float *v[MAX_SEGMENTS], *f[MAX_SEGMENTS], *u[MAX_SEGMENTS];
    struct ls_linear_noise v_noise[MAX_SEGMENTS], f_noise[MAX_SEGMENTS], total_noise;
    double p_in[LS_LINEAR_MAX_INPUTS];
    double phi[LIGHTS * MAX_SEGMENTS];
};

static struct ls_linear_noise sum_noise(const struct camera *camera, const double *g,
                                        const uint32_t *segment, uint32_t wanted)
{
    struct ls_linear_noise one = noise_model(camera, rate_of(1)), sum = {0};
    for (uint32_t i = 0; i < LIGHTS; i++)
        if (!segment || segment[i] == wanted) {
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

static void take_segments(const struct world *w, const struct camera *camera, float *const *fields,
                          const struct inputs *inputs, int s, uint32_t n_segments,
                          struct pictures *p)
{
    size_t pixels = (size_t)w->side * w->side;
    const float(*d)[3] = w->directions;
    memset(p, 0, sizeof *p);
    p->n_segments = n_segments;
    p->n_in = (uint32_t)inputs->n * w->colours;
    g_assert_cmpint(ls_segments_partition(d, LIGHTS, n_segments, p->segment, NULL), ==, LS_OK);
    g_assert_cmpint(ls_mono_blend_weights(d, LIGHTS, p->segment, n_segments, p->phi, NULL), ==,
                    LS_OK);
    for (uint32_t g = 0; g < n_segments; g++) {
        p->v[g] = g_new0(float, pixels * p->n_in);
        p->u[g] = g_new0(float, w->n);
        p->f[g] = g_new0(float, w->n);
    }
    for (uint32_t i = 0; i < LIGHTS; i++) {
        uint32_t g = p->segment[i];
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
        take(w, camera, p->size[g], p->f[g]);
        p->f_noise[g] = noise_model(camera, rate_of(p->size[g]));
        p->v_noise[g] = sum_noise(camera, w->g[s], p->segment, g);
    }
    p->total_noise = sum_noise(camera, w->g[s], NULL, 0);
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

static struct ls_linear_pictures linear_pictures(const struct world *w, const struct camera *camera,
                                                 const struct pictures *p, int s)
{
    return (struct ls_linear_pictures){.width = w->side,
                                       .height = w->side,
                                       .n_segments = p->n_segments,
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

struct sums {
    double difference, truth;
};

struct errors {
    struct sums field, inter, highlight;
    double shadow;
    uint64_t n_shadow;
};

static double percent(const struct sums *s)
{
    return 100 * sqrt(s->difference / s->truth);
}

static void add_sums(struct sums *s, double difference, double truth)
{
    s->difference += difference;
    s->truth += truth;
}

/** Errors of one spectrum's promoted field. */
struct tally {
    const struct world *world;
    float *brightest; /* [pixel], of the white field's lights */
};

static double brightness(const struct world *w, uint32_t light, size_t pixel)
{
    double sum = 0;
    for (uint32_t c = 0; c < w->colours; c++)
        sum += (double)w->truth[0][light * w->n + pixel * w->colours + c];
    return sum;
}

static void compare(const struct tally *t, uint32_t light, const float *promoted,
                    const float *truth, struct errors *e)
{
    const struct world *w = t->world;
    size_t pixels = (size_t)w->side * w->side;
    for (size_t i = 0; i < pixels; i++) {
        double difference = 0, total = 0, absolute = 0, sum = 0;
        for (uint32_t c = 0; c < w->colours; c++) {
            double x = (double)truth[i * w->colours + c];
            double d = (double)promoted[i * w->colours + c] - x;
            difference += d * d;
            total += x * x;
            absolute += fabs(d);
            sum += x;
        }
        add_sums(&e->field, difference, total);
        if (w->specular[light * pixels + i] > 0.5f)
            add_sums(&e->highlight, difference, total);
        if (!(w->bounced[i] > 0.2f))
            continue;
        add_sums(&e->inter, difference, total);
        double bright = brightness(w, light, i), most = (double)t->brightest[i];
        if (bright > 1e-3 * most && bright < 0.1 * most && sum > 0) {
            e->shadow += 100 * absolute / sum;
            e->n_shadow++;
        }
    }
}

/** One row of the table. */
struct row {
    struct errors promotion, served;
    struct ls_linear_error left_out;
};

enum model { LINEAR, BLEND };

/** Fields of the noisy and the noise-free camera, by spectrum. */
struct study {
    const struct world *world;
    struct camera camera, quiet;
    float *noisy[SPECTRA], *clean[SPECTRA]; /* noisy: NULL where nobody photographs it */
    struct tally tally;
};

static void set_up(struct study *x, const struct world *w, bool noise, bool mosaic)
{
    size_t pixels = (size_t)w->side * w->side;
    *x = (struct study){.world = w,
                        .camera = {noise, mosaic, g_rand_new_with_seed(7)},
                        .quiet = {false, mosaic, NULL},
                        .tally = {w, g_new0(float, pixels)}};
    for (int s = 0; s < SPECTRA; s++) {
        x->clean[s] = take_field(w, &x->quiet, s);
        if (s == 0 || w->colours == 1) /* what is photographed per light */
            x->noisy[s] = take_field(w, &x->camera, s);
    }
    for (uint32_t k = 0; k < LIGHTS; k++)
        for (size_t i = 0; i < pixels; i++)
            x->tally.brightest[i] = fmaxf(x->tally.brightest[i], (float)brightness(w, k, i));
}

static void tear_down(struct study *x)
{
    for (int s = 0; s < SPECTRA; s++) {
        g_free(x->clean[s]);
        g_free(x->noisy[s]);
    }
    g_free(x->tally.brightest);
    g_rand_free(x->camera.rand);
}

/* Light @light's inputs side by side: [pixel][n_in]. */
static void gather(const struct world *w, float *const *fields, const struct inputs *inputs,
                   uint32_t light, float *v)
{
    uint32_t n_in = (uint32_t)inputs->n * w->colours;
    size_t pixels = (size_t)w->side * w->side;
    memset(v, 0, pixels * n_in * sizeof *v);
    for (int k = 0; k < inputs->n; k++)
        add_picture(fields[inputs->spectrum[k]] + light * w->n, pixels, w->colours, 1, n_in,
                    v + (unsigned)k * w->colours);
}

static void blend_light(const struct world *w, const struct pictures *p, const float *r,
                        const float *v, uint32_t light, float *out)
{
    for (size_t i = 0; i < w->n; i++) {
        double ratio = 0;
        for (uint32_t g = 0; g < p->n_segments; g++)
            ratio += p->phi[light * p->n_segments + g] * (double)r[i * p->n_segments + g];
        out[i] = (float)(ratio * (double)v[i]);
    }
}

static void fit(const struct study *x, enum model model, const struct pictures *p, int s,
                float *map, struct row *row)
{
    const struct world *w = x->world;
    struct ls_diag diag = {0};
    if (model == BLEND) {
        const struct ls_mono_blend_pictures blend = {.width = w->side,
                                                     .height = w->side,
                                                     .n_segments = p->n_segments,
                                                     .v = (const float *const *)p->v,
                                                     .u = (const float *const *)p->u,
                                                     .f = (const float *const *)p->f,
                                                     .v_noise = p->v_noise,
                                                     .total_noise = p->total_noise,
                                                     .neutral = w->p[s][0] / w->p[0][0]};
        g_assert_cmpint(ls_mono_blend_ratios(&blend, 0, w->side, map, &diag), ==, LS_OK);
        return;
    }
    struct ls_linear_pictures pictures = linear_pictures(w, &x->camera, p, s);
    struct ls_linear_options options;
    ls_linear_options_default(&options);
    g_assert_cmpint(ls_linear_fit(&pictures, &options, 0, w->side, map, &diag), ==, LS_OK);
    if (p->n_segments > 1)
        g_assert_cmpint(ls_linear_leave_one_out(&pictures, &options, 0, w->side, 1, &row->left_out,
                                                NULL, &diag),
                        ==, LS_OK);
}

static void promote(const struct study *x, enum model model, const struct pictures *p,
                    const struct inputs *inputs, float *const *fields, int s, const float *map,
                    struct errors *e)
{
    const struct world *w = x->world;
    size_t pixels = (size_t)w->side * w->side;
    g_autofree float *v = g_new(float, pixels * p->n_in), *out = g_new(float, w->n);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        gather(w, fields, inputs, i, v);
        if (model == BLEND)
            blend_light(w, p, map, v, i, out);
        else
            ls_linear_apply(map, v, pixels, p->n_in, w->colours, out);
        compare(&x->tally, i, out, x->clean[s] + i * w->n, e);
    }
}

static bool is_photographed(const struct inputs *inputs, int s)
{
    for (int k = 0; k < inputs->n; k++)
        if (inputs->spectrum[k] == s)
            return true;
    return false;
}

static struct row judge(const struct study *x, enum model model, const struct inputs *inputs,
                        uint32_t n_segments)
{
    const struct world *w = x->world;
    size_t pixels = (size_t)w->side * w->side;
    struct row row = {0};
    uint32_t n_in = (uint32_t)inputs->n * w->colours;
    uint32_t per_pixel = model == BLEND ? n_segments : n_in * w->colours;
    g_autofree float *map = g_new(float, pixels *per_pixel);
    for (int s = 1; s < SPECTRA; s++) {
        if (is_photographed(inputs, s)) { /* selected, not fitted */
            for (uint32_t i = 0; i < LIGHTS; i++) {
                const float *truth = x->clean[s] + i * w->n;
                compare(&x->tally, i, truth, truth, &row.promotion);
                compare(&x->tally, i, x->noisy[s] + i * w->n, truth, &row.served);
            }
            continue;
        }
        struct pictures p;
        take_segments(w, &x->camera, (float *const *)x->noisy, inputs, s, n_segments, &p);
        fit(x, model, &p, s, map, &row);
        promote(x, model, &p, inputs, (float *const *)x->clean, s, map, &row.promotion);
        promote(x, model, &p, inputs, (float *const *)x->noisy, s, map, &row.served);
        free_pictures(&p);
    }
    return row;
}

static void print(const char *name, uint32_t pictures, const struct row *r)
{
    const struct errors *p = &r->promotion, *s = &r->served;
    const struct ls_linear_error *e = &r->left_out;
    double raw = e->total > 0 ? 100 * sqrt(e->difference / e->total) : NAN;
    double alone = e->total > 0 ? 100 * sqrt(fmax(e->difference - e->noise, 0) / e->total) : NAN;
    g_test_message("%-26s %5u | %6.3f %6.3f %6.2f %6.3f | %6.3f %6.3f %6.2f %6.3f | %6.3f %6.3f",
                   name, pictures, percent(&p->field), percent(&p->inter),
                   p->shadow / (double)p->n_shadow, percent(&p->highlight), percent(&s->field),
                   percent(&s->inter), s->shadow / (double)s->n_shadow, percent(&s->highlight), raw,
                   alone);
}

static void print_head(const char *camera)
{
    g_test_message("%s; percent: promotion alone | as served | left out, less noise", camera);
    g_test_message("%-26s %5s | %6s %6s %6s %6s | %6s %6s %6s %6s | %6s %6s", "", "shots", "field",
                   "inter", "shadow", "highl", "field", "inter", "shadow", "highl", "LOO", "LOO-n");
}

static bool full(void)
{
    return g_getenv("LS_TEST_FULL") != NULL;
}

static struct row judge_and_print(const struct study *x, enum model model,
                                  const struct inputs *inputs, uint32_t n_segments,
                                  const char *name)
{
    struct row row = judge(x, model, inputs, n_segments);
    int fitted = SPECTRA - inputs->n;
    g_autofree char *label = g_strdup_printf("%s, G = %u", name, n_segments);
    print(label, (uint32_t)(inputs->n * LIGHTS) + (uint32_t)fitted * n_segments, &row);
    return row;
}

static double shadow(const struct errors *e)
{
    return e->shadow / (double)e->n_shadow;
}

static void assert_estimate(const struct row *row)
{
    const struct ls_linear_error *e = &row->left_out;
    double estimate = 100 * sqrt(e->difference / e->total), truth = percent(&row->served.field);
    g_assert_cmpfloat(estimate, <=, 1.5 * truth);
    g_assert_cmpfloat(truth, <=, 1.5 * estimate);
}

static void test_segments_leave_less_than_half(void)
{
    struct world w;
    load_world(&w, full() ? 128 : 64, "RG");
    static const struct {
        bool noise, mosaic;
        const char *name;
    } cameras[] = {{true, false, "RGB at every pixel, noise"},
                   {false, false, "RGB at every pixel, no noise"},
                   {true, true, "mosaic, noise"},
                   {false, true, "mosaic, no noise"}};
    for (size_t k = 0; k < (full() ? G_N_ELEMENTS(cameras) : 1); k++) {
        struct study x;
        set_up(&x, &w, cameras[k].noise, cameras[k].mosaic);
        print_head(cameras[k].name);
        struct row eq1 = judge_and_print(&x, LINEAR, &white_alone, 1, "RGB");
        static const uint32_t others[] = {6, 26};
        for (size_t j = 0; full() && j < G_N_ELEMENTS(others); j++)
            judge_and_print(&x, LINEAR, &white_alone, others[j], "RGB");
        struct row linear = judge_and_print(&x, LINEAR, &white_alone, 14, "RGB");
        tear_down(&x);
        assert_estimate(&linear);
        if (cameras[k].mosaic)
            continue;
        const struct errors *a = &eq1.promotion, *b = &linear.promotion;
        g_assert_cmpfloat(percent(&b->field), <=, 0.4 * percent(&a->field));
        g_assert_cmpfloat(percent(&b->inter), <=, 0.5 * percent(&a->inter));
        g_assert_cmpfloat(percent(&b->highlight), <=, 0.2 * percent(&a->highlight));
        if (!cameras[k].noise) /* noise alone is 5 % in shadows this deep */
            g_assert_cmpfloat(shadow(b), <=, 0.5 * shadow(a));
    }
    free_world(&w);
}

static void test_mono_blends_and_fits(void)
{
    static const struct inputs two = {2, {0, 3}}, three = {3, {0, 1, 5}};
    struct world w;
    struct study x;
    load_world(&w, full() ? 128 : 64, "mono");
    set_up(&x, &w, true, false);
    print_head("mono, noise");
    struct row eq1 = judge_and_print(&x, BLEND, &white_alone, 1, "mono W");
    if (full())
        judge_and_print(&x, BLEND, &white_alone, 6, "mono W");
    struct row blend = judge_and_print(&x, BLEND, &white_alone, 14, "mono W");
    if (full())
        judge_and_print(&x, BLEND, &white_alone, 26, "mono W");
    struct row linear = judge_and_print(&x, LINEAR, &two, 14, "mono W G");
    struct row third = judge_and_print(&x, LINEAR, &three, 14, "mono W R B");
    g_assert_cmpfloat(percent(&blend.promotion.field), <, percent(&eq1.promotion.field));
    g_assert_cmpfloat(percent(&linear.promotion.field), <, percent(&eq1.promotion.field));
    g_assert_cmpfloat(percent(&third.promotion.field), <, percent(&linear.promotion.field));
    tear_down(&x);
    free_world(&w);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/still-life/fourteen-segments-leave-less-than-half-of-eq-1s-error",
                    test_segments_leave_less_than_half);
    g_test_add_func("/still-life/mono-blends-ratios-and-fits-spectra", test_mono_blends_and_fits);
    return g_test_run();
}

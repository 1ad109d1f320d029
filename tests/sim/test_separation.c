/* Polarisation factors, separation, Eq. 3 and the conductor blend against the simulated world. */
#include "polarised_field.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { AMBER = 2, BLUE = 5 };

/* What is left in D of the highlight of a light, as a share of it; NAN: none to be seen. */
static double leak(const struct polarised_field *f, uint32_t light)
{
    float *row = g_new0(float, f->n_lights), *d = g_new(float, 3 * f->n_px);
    float *specular = g_new(float, 3 * f->n_px), *white = g_new(float, 3 * f->n_px);
    double left = 0, sum = 0;
    row[light] = 1;
    polarised_field_sums(f, row, d, NULL, NULL);
    polarised_field_truth(f, light, POLARISED_W, NULL, white);
    polarised_field_specular(f, light, specular);
    for (uint32_t k = 1; k < 3 * f->n_px; k += 3) { /* green, the same in W and V + H */
        left += (double)d[k] - (double)(white[k] - specular[k]);
        sum += (double)specular[k];
    }
    g_free(row);
    g_free(d);
    g_free(white);
    g_free(specular);
    return sum > 0.1 ? fabs(left / sum) : NAN;
}

struct leaks {
    uint32_t lights, over_5, over_20, inseparable;
    double worst, mean; /* of separable lights */
};

static struct leaks all_leaks(const struct polarised_field *f)
{
    struct leaks out = {0};
    for (uint32_t i = 0; i < f->n_lights; i++) {
        double found = leak(f, i);
        if (!isfinite(found))
            continue;
        out.lights++;
        if (ls_split_inseparable(&f->split[i])) {
            out.inseparable++;
            continue;
        }
        out.over_5 += found > 0.05;
        out.over_20 += found > 0.2;
        out.worst = fmax(out.worst, found);
        out.mean += found;
    }
    out.mean /= MAX(1u, out.lights - out.inseparable);
    g_test_message("%u lights: leak over 5 %% %u, over 20 %% %u, mean %.4f, worst %.4f, "
                   "inseparable %u",
                   out.lights, out.over_5, out.over_20, out.mean, out.worst, out.inseparable);
    return out;
}

/* The black ball is all highlight, so what D holds of it is error. A facet's a differs over the
 * breadth of a highlight by up to 0.01, which 1/|a_V - a_H| <= 5 makes 5 % twice over, near where
 * lights are inseparable; elsewhere by less than 5 %, and 0.5 % in the mean. */
static void test_elevations(void)
{
    struct polarised_field f;
    polarised_field_init(&f, "gloss", 56, 346, 0);
    struct ls_polarisation *a = g_new(struct ls_polarisation, f.n_lights);
    for (uint32_t i = 0; i < f.n_lights; i++)
        a[i] = ls_polarisation_ideal();
    polarised_field_split(&f, a);
    struct leaks ideal = all_leaks(&f);
    polarised_field_factors(&f, 0.1);
    struct leaks ours = all_leaks(&f);
    g_assert_cmpuint(ideal.lights, >, 320);
    g_assert_cmpuint(ideal.over_5, >, ideal.lights / 4);
    g_assert_cmpuint(ideal.over_20, >, ideal.lights / 12);
    g_assert_cmpfloat(ours.worst, <, 0.1);
    g_assert_cmpuint(ours.over_5, <, ours.lights / 50);
    g_assert_cmpfloat(ours.mean, <, 0.005);
    g_assert_cmpuint(ours.inseparable, <, ours.lights / 30);
    g_free(a);
    polarised_field_finish(&f);
}

/* a of light @d where a sphere beside the centre shows it. */
static struct ls_polarisation shown(const float d[3], const double beside_m[3], double radius_m)
{
    struct ls_polarisation_path path = {.camera = {0, 0, 1.6}, .camera_up = {0, 1, 0}}, moved;
    struct ls_polarisation a;
    double point[3];
    for (int k = 0; k < 3; k++)
        path.light[k] = 1.35 * (double)d[k];
    moved = path;
    for (int k = 0; k < 3; k++) {
        moved.light[k] -= beside_m[k];
        moved.camera[k] -= beside_m[k];
    }
    g_assert_cmpint(ls_polarisation_highlight(&moved, radius_m, point, NULL), ==, LS_OK);
    for (int k = 0; k < 3; k++)
        point[k] += beside_m[k];
    g_assert_cmpint(ls_polarisation_reflect(&path, point, LS_POLARISATION_INDEX, &a, NULL), ==,
                    LS_OK);
    return a;
}

/* What stays in D of the highlights of a sphere, by the geometry alone, with the factors of a
 * sphere of @assumed_m at the centre: the mean over separable lights. */
static double assumed_leak(const struct polarised_field *f, const double beside_m[3],
                           double radius_m, double assumed_m)
{
    static const double centre[3];
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < f->n_lights; i++) {
        const float *d = sim_scene_geometry(f->scene)->direction[i];
        struct ls_polarisation a = shown(d, centre, assumed_m);
        struct ls_polarisation right = shown(d, beside_m, radius_m);
        if (d[2] < -0.9f || !ls_polarisation_separable(a)) /* behind the ball */
            continue;
        sum += fabs(2 * (right.h - a.h) / (a.v - a.h));
        n++;
    }
    return sum / n;
}

/* The numbers of core/polarisation.h, half a percent up. Of a point at the centre the centre is
 * right. */
static void test_assumed(void)
{
    static const struct {
        double beside_m[3], radius_m, most, of_centre_s;
    } subjects[] = {{{0, 0, 0}, 0, 0.09, INFINITY},     {{0, 0, 0}, 0.05, 0.035, 0.5},
                    {{0, 0, 0}, 0.1, 0.035, 0.5},       {{0, 0, 0}, 0.15, 0.088, 0.5},
                    {{0.1, 0, 0}, 0.05, 0.072, 0.8},    {{0, 0.1, 0}, 0.05, 0.117, 0.9},
                    {{-0.055, 0.055, 0}, 0.05, 0.09, 1}};
    static const float light[3] = {0.36f, 0.48f, 0.8f};
    const struct ls_polarisation_path path = {.light = {1.35 * 0.36, 1.35 * 0.48, 1.35 * 0.8},
                                              .camera = {0, 0, 1.6},
                                              .camera_up = {0, 1, 0}};
    struct ls_polarisation a;
    struct polarised_field f;
    polarised_field_init(&f, "gloss", 8, 346, 0);
    g_assert_cmpint(ls_polarisation_assume(&path, &a, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(
        a.v, shown(light, subjects[0].beside_m, LS_POLARISATION_SUBJECT_M).v, 1e-6); /* floats */
    for (size_t k = 0; k < G_N_ELEMENTS(subjects); k++) {
        const double *at = subjects[k].beside_m, r = subjects[k].radius_m;
        double found = assumed_leak(&f, at, r, LS_POLARISATION_SUBJECT_M);
        double centre = assumed_leak(&f, at, r, 0);
        g_test_message("at (%g, %g, %g), radius %g m: leak %.4f, with the centre's factors %.4f",
                       at[0], at[1], at[2], r, found, centre);
        g_assert_cmpfloat(found, <, subjects[k].most);
        if (isfinite(subjects[k].of_centre_s))
            g_assert_cmpfloat(found, <=, subjects[k].of_centre_s * centre);
    }
    polarised_field_finish(&f);
}

/* V and H exchanged put every highlight into D, whatever a says: nothing is left that holds. */
static void test_swap(void)
{
    struct polarised_field f;
    polarised_field_init(&f, "gloss", 48, 60, 0);
    polarised_field_factors(&f, 0.1);
    struct leaks right = all_leaks(&f);
    const struct ls_picture *v = f.field.v;
    f.field.v = f.field.h;
    f.field.h = v;
    struct leaks swapped = all_leaks(&f);
    g_assert_cmpfloat(right.mean, <, 0.01);
    g_assert_cmpfloat(swapped.mean, >, 0.5);
    g_assert_cmpuint(swapped.over_20, >, 9 * swapped.lights / 10);
    polarised_field_finish(&f);
}

/* Where a picture's pixel is the ball at least two pixels deep. */
static void find_ball(const struct polarised_field *f, uint8_t *on_ball)
{
    const struct sim_pixel *pixels = f->scene->view[0].pixels;
    for (uint32_t k = 0; k < f->n_px; k++) {
        on_ball[k] = 1;
        for (int32_t y = -2; y <= 2; y++)
            for (int32_t x = -2; x <= 2; x++) {
                int32_t at = (int32_t)k + y * (int32_t)f->size + x;
                on_ball[k] &=
                    at >= 0 && at < (int32_t)f->n_px && pixels[at].surface != SIM_NO_SURFACE;
            }
    }
}

/* Measured on the ball's noisy mosaics against the half vector: within three standard errors and
 * 0.01, the breadth of the highlight, for all but one light in a hundred (three sigma: 0.3 %). */
static void test_measured(void)
{
    const uint64_t seed = 20170;
    struct polarised_field f;
    g_test_message("seed %" G_GUINT64_FORMAT, seed);
    polarised_field_init(&f, "gloss", 80, 346, seed);
    polarised_field_factors(&f, 0.1);
    uint8_t *on_ball = g_new(uint8_t, f.n_px);
    float *plane = g_new(float, 3 * f.n_px);
    uint32_t measured = 0, off = 0;
    double worst = 0, closure = 0;
    find_ball(&f, on_ball);
    for (uint32_t i = 0; i < f.n_lights; i++) {
        for (uint32_t kind = 0; kind < POLARISED_KINDS; kind++)
            polarised_field_mosaic(&f, kind, i, plane + kind * f.n_px);
        struct ls_polarisation_probe probe = {.v = plane + f.n_px,
                                              .h = plane + 2 * f.n_px,
                                              .w = plane,
                                              .on_ball = on_ball,
                                              .width = f.size,
                                              .height = f.size,
                                              .noise = f.field.noise};
        struct ls_polarisation_measured found;
        if (ls_polarisation_measure(&probe, &found, NULL))
            continue;
        double error = fabs(found.a.v - f.a[i].v);
        measured++;
        off += error > 0.01 + 3 * found.sigma;
        worst = fmax(worst, error);
        closure += found.closure;
    }
    g_test_message("%u lights measured, worst error of a_V %.4f, %u off, closure %.4f", measured,
                   worst, off, closure / measured);
    g_assert_cmpuint(measured, >, 200);
    g_assert_cmpuint(off, <=, measured / 100);
    /* a polariser's sheet takes different shares of R, G and B; the mean over a mosaic is near 1 */
    g_assert_cmpfloat(fabs(closure / measured - 1), <, 0.02);
    g_free(on_ball);
    g_free(plane);
    polarised_field_finish(&f);
}

/* Squared errors and truth over the pixels of one material. */
struct errors {
    double sphere, separated, plain, truth;
};

static double percent(double error, double truth)
{
    return 100 * sqrt(error / truth);
}

enum { WAX, MATTE, GOLD, CHROME, BODIES };
static const uint16_t material[BODIES] = {SIM_MAT_RED_WAX, SIM_MAT_OCHRE, SIM_MAT_GOLD,
                                          SIM_MAT_CHROME};
static const char *const body_name[BODIES] = {"red wax", "matte", "gold", "chrome"};

static int body_at(const struct polarised_field *f, uint32_t k)
{
    const struct sim_pixel *pixel = &f->scene->view[0].pixels[k];
    for (int b = 0; pixel->surface != SIM_NO_SURFACE && b < BODIES; b++)
        if (f->scene->subject.surface[pixel->surface].material == material[b])
            return b;
    return BODIES;
}

/* Marks the pixels whose truth a demosaic shows within 2 % of its brightest colour, in white and
 * in @channel: elsewhere the truth itself is what the mosaic made of it. */
static void find_smooth(const struct polarised_field *f, uint32_t light, uint32_t channel,
                        uint8_t *smooth)
{
    float *plain = g_new(float, 3 * f->n_px), *seen = g_new(float, 3 * f->n_px);
    memset(smooth, 1, f->n_px);
    for (int pass = 0; pass < 2; pass++) {
        polarised_field_truth(f, light, pass ? POLARISED_W : channel, plain, seen);
        for (uint32_t k = 0; k < f->n_px; k++) {
            const float *p = plain + 3 * k, *q = seen + 3 * k;
            float most = fmaxf(p[0], fmaxf(p[1], p[2]));
            for (int c = 0; c < 3; c++)
                smooth[k] &= fabsf(q[c] - p[c]) <= 0.02f * most && most > 0;
        }
    }
    g_free(plain);
    g_free(seen);
}

/* One spectrum's promotion, three ways: Eq. 1 on W; separated with the remainder's ratio; separated
 * with F/V of W as ratio. */
struct promotion {
    uint32_t channel;
    double tint[3];
    float *sphere, *remainder; /* ratios, [n_px][3] */
    float *d, *s, *c, *white, *row;
};

static void promotion_init(struct promotion *p, struct polarised_field *f, uint32_t channel)
{
    size_t n = 3 * (size_t)f->n_px;
    float **spans[] = {&p->sphere, &p->remainder, &p->d, &p->s, &p->c, &p->white};
    for (size_t k = 0; k < G_N_ELEMENTS(spans); k++)
        *spans[k] = g_new(float, n);
    p->row = g_new0(float, f->n_lights);
    p->channel = channel;
    polarised_field_p(f, channel, p->tint);
    for (int k = 0; k < 3; k++)
        p->tint[k] /= f->white[k];
    polarised_field_ratio(f, channel, false, p->sphere);
    polarised_field_ratio(f, channel, true, p->remainder);
}

static void promotion_finish(struct promotion *p)
{
    float *spans[] = {p->sphere, p->remainder, p->d, p->s, p->c, p->white, p->row};
    for (size_t k = 0; k < G_N_ELEMENTS(spans); k++)
        g_free(spans[k]);
}

/* The picture of a row of weights by Eq. 1 (@sphere), and separated. NULL: not wanted. */
static void promote(const struct promotion *p, const struct polarised_field *f, float *sphere,
                    float *separated, float *plain)
{
    size_t n = 3 * (size_t)f->n_px;
    polarised_field_sums(f, p->row, p->d, p->s, p->c);
    polarised_field_white(f, p->row, p->white);
    for (size_t k = 0; k < n; k++) {
        sphere[k] = p->sphere[k] * p->white[k];
        separated[k] = plain[k] = 0;
    }
    ls_separated_finish(p->d, p->s, p->c, p->remainder, p->tint, 1, f->n_px, 3, separated);
    ls_separated_finish(p->d, p->s, p->c, p->sphere, p->tint, 1, f->n_px, 3, plain);
}

/* Errors under single lights in pixels of which more than half is specular; for the matte body, in
 * all. */
static void highlight_errors(struct polarised_field *f, uint32_t channel, struct errors out[BODIES])
{
    size_t n = 3 * (size_t)f->n_px;
    struct promotion p;
    float *sphere = g_new(float, n), *ours = g_new(float, n), *plain = g_new(float, n);
    float *truth = g_new(float, n), *specular = g_new(float, n);
    uint8_t *smooth = g_new(uint8_t, f->n_px);
    promotion_init(&p, f, channel);
    memset(out, 0, BODIES * sizeof *out);
    for (uint32_t i = 0; i < f->n_lights; i += 5) {
        p.row[i] = 1;
        promote(&p, f, sphere, ours, plain);
        p.row[i] = 0;
        polarised_field_truth(f, i, channel, NULL, truth);
        polarised_field_specular(f, i, specular);
        find_smooth(f, i, channel, smooth);
        for (size_t k = 0; k < n; k++) {
            int body = body_at(f, (uint32_t)(k / 3));
            size_t green = k - k % 3 + 1;
            if (body == BODIES || !smooth[k / 3] ||
                (body != MATTE && specular[green] < 0.5f * p.white[green]))
                continue;
            out[body].sphere += pow((double)sphere[k] - (double)truth[k], 2);
            out[body].separated += pow((double)ours[k] - (double)truth[k], 2);
            out[body].plain += pow((double)plain[k] - (double)truth[k], 2);
            out[body].truth += pow((double)truth[k], 2);
        }
    }
    for (int b = 0; b < BODIES; b++)
        g_test_message("channel %u, %s: Eq. 1 %.2f %%, separated %.2f %%, with F/V %.2f %%",
                       channel, body_name[b], percent(out[b].sphere, out[b].truth),
                       percent(out[b].separated, out[b].truth),
                       percent(out[b].plain, out[b].truth));
    promotion_finish(&p);
    g_free(sphere);
    g_free(ours);
    g_free(plain);
    g_free(truth);
    g_free(specular);
    g_free(smooth);
}

static void test_highlights(void)
{
    const uint64_t seed = 31;
    struct polarised_field f;
    struct errors amber[BODIES], blue[BODIES];
    g_test_message("seed %" G_GUINT64_FORMAT, seed);
    polarised_field_init(&f, "highlights", 144, 80, seed);
    highlight_errors(&f, AMBER, amber);
    highlight_errors(&f, BLUE, blue);
    for (int b = 0; b < BODIES; b++) {
        g_assert_cmpfloat(amber[b].truth, >, 0.1); /* there is something to judge */
        g_assert_cmpfloat(blue[b].truth, >, 0.1);
        /* the demosaic alone is allowed 2 % of the brightest colour, in white and in truth */
        g_assert_cmpfloat(percent(amber[b].separated, amber[b].truth), <, 5);
        g_assert_cmpfloat(percent(blue[b].separated, blue[b].truth), <, 9);
        if (b == WAX)
            continue;
        /* Eq. 1 is right for these; the blend may cost a fifth of its noise */
        g_assert_cmpfloat(amber[b].separated, <, 1.2 * 1.2 * amber[b].sphere);
        g_assert_cmpfloat(blue[b].separated, <, 1.2 * 1.2 * blue[b].sphere);
    }
    /* Eq. 1 tints the wax's highlight with the wax */
    g_assert_cmpfloat(percent(amber[WAX].sphere, amber[WAX].truth), >, 12);
    g_assert_cmpfloat(amber[WAX].separated, <, 0.4 * 0.4 * amber[WAX].sphere);
    g_assert_cmpfloat(blue[WAX].separated, <, 0.6 * 0.6 * blue[WAX].sphere);
    g_assert_cmpfloat(percent(blue[WAX].separated, blue[WAX].truth), <, 6);
    /* with the dielectric highlights in its denominator, Eq. 1's ratio is no better anywhere */
    g_assert_cmpfloat(amber[WAX].separated, <, amber[WAX].plain);
    g_assert_cmpfloat(blue[WAX].separated, <, blue[WAX].plain);
    polarised_field_finish(&f);
}

/* A whole environment of one spectrum, brighter from one side, on the matte sphere: the mean of
 * each colour, and the root mean square over its pixels where there is no noise. */
static void matte_case(uint32_t channel, uint64_t seed)
{
    struct polarised_field f;
    struct promotion p;
    polarised_field_init(&f, "highlights", 128, 90, seed);
    size_t n = 3 * (size_t)f.n_px;
    float *sphere = g_new(float, n), *ours = g_new(float, n), *plain = g_new(float, n);
    promotion_init(&p, &f, channel);
    for (uint32_t i = 0; i < f.n_lights; i++)
        p.row[i] = (1 + f.scene->geometry.direction[i][0]) / (float)f.n_lights;
    promote(&p, &f, sphere, ours, plain);
    double sum[2][3] = {{0}}, difference = 0, squares = 0;
    for (size_t k = 0; k < n; k++)
        if (body_at(&f, (uint32_t)(k / 3)) == MATTE) {
            sum[0][k % 3] += (double)sphere[k];
            sum[1][k % 3] += (double)ours[k];
            difference += pow((double)ours[k] - (double)sphere[k], 2);
            squares += pow((double)sphere[k], 2);
        }
    g_test_message("channel %u, seed %" G_GUINT64_FORMAT ": separated / sphere %.5f %.5f %.5f, "
                   "pixels apart %.3f %%",
                   channel, seed, sum[1][0] / sum[0][0], sum[1][1] / sum[0][1],
                   sum[1][2] / sum[0][2], percent(difference, squares));
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat(fabs(sum[1][c] / sum[0][c] - 1), <, 0.005); /* what is promised */
    if (seed == 0)
        g_assert_cmpfloat(percent(difference, squares), <, 0.5);
    promotion_finish(&p);
    g_free(sphere);
    g_free(ours);
    g_free(plain);
    polarised_field_finish(&f);
}

/* Another spectrum, or no noise, takes no other way through the code. */
static bool brief(void)
{
    return g_getenv("LS_TEST_BRIEF") != NULL;
}

static void test_matte(void)
{
    matte_case(AMBER, 32);
    if (brief())
        return;
    matte_case(AMBER, 0);
    matte_case(BLUE, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/separation/factors-hold-at-every-elevation-and-the-ideal-does-not",
                    test_elevations);
    g_test_add_func(
        "/separation/assumed-factors-leak-less-than-the-centre-s-where-things-have-a-size",
        test_assumed);
    g_test_add_func("/separation/v-and-h-swapped-are-caught", test_swap);
    g_test_add_func("/separation/measured-factors-agree-with-the-half-vector", test_measured);
    g_test_add_func("/separation/a-red-highlight-stays-white-and-metals-keep-their-colour",
                    test_highlights);
    g_test_add_func("/separation/matte-is-the-same-by-separated-and-sphere", test_matte);
    return g_test_run();
}

/* A calibration that went wrong says so in a sentence; a single bad thing does not spoil the rest.
 */
#include "core/calibration.h"
#include "core/gains.h"
#include "core/merge.h"
#include "core/shading.h"
#include "core/vec3.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SIZE = 96, PIXELS = SIZE * SIZE, LIGHTS = 40 };

static struct ls_pinhole camera(void)
{
    const double eye[3] = {0, 0, 1.6}, at[3] = {0};
    struct ls_pinhole c;
    /* the sphere's outline is 37.5 px in radius */
    g_assert_cmpint(ls_pinhole_aim(eye, at, 60, 9.6, SIZE, SIZE, &c, NULL), ==, LS_OK);
    return c;
}

static const struct ls_sphere ball = {{0, 0, 0}, 0.1};

static struct ls_sphere_view *view(void)
{
    struct ls_pinhole c = camera();
    struct ls_sphere_view *v = NULL;
    g_assert_cmpint(ls_sphere_view_create(&c, LS_CFA_NONE, &ball, NULL, 0, &v, NULL), ==, LS_OK);
    return v;
}

/* An exact picture of strength @q under a light, from the formula in core/shading.h. */
static void paint(const struct ls_sphere_view *v, const double at[3], double q, float *e)
{
    memset(e, 0, PIXELS * sizeof *e);
    double r2 = ls_dot3(at, at), axis[3] = {at[0], at[1], at[2]};
    ls_unit3(axis);
    for (uint32_t k = 0; k < v->n; k++) {
        const struct ls_sphere_pixel *p = &v->pixels[k];
        double l[3], n[3];
        for (int j = 0; j < 3; j++) {
            l[j] = at[j] - (double)p->x[j];
            n[j] = (double)p->n[j];
        }
        double d2 = ls_dot3(l, l), facing = fmax(0, ls_dot3(n, l));
        e[p->index] = (float)(q * r2 * ls_dot3(axis, l) * facing / (M_PI * d2 * d2));
    }
}

/* ---- outline ---- */

static void refuse_outline(const float *picture, double x, const char *words)
{
    struct ls_pinhole c = camera();
    struct ls_sphere guess = ball, found;
    struct ls_outline o;
    struct ls_diag diag = {{0}};
    guess.centre_m[0] = x;
    enum ls_err err = ls_sphere_locate(&c, picture, &guess, &found, &o, &diag);
    g_test_message("%s", diag.text);
    g_assert_cmpint(err, !=, LS_OK);
    g_assert_nonnull(strstr(diag.text, words));
}

/* A disc of 1 before @background, its middle at x = 48 + @shift px. */
static void disc(float *e, double shift, float background)
{
    for (int k = 0; k < PIXELS; k++) {
        double dx = k % SIZE + 0.5 - 48 - shift, dy = k / SIZE + 0.5 - 48;
        e[k] = dx * dx + dy * dy < 37.5 * 37.5 ? 1 : background;
    }
}

static void test_outline_refused(void)
{
    float *e = g_new0(float, PIXELS);
    refuse_outline(e, 0, "dark around");
    for (int k = 0; k < PIXELS; k++)
        e[k] = 1;
    refuse_outline(e, 0, "no outline");
    for (int k = 0; k < PIXELS; k++)
        e[k] = NAN;
    refuse_outline(e, 0, "dark around");
    for (int k = 0; k < PIXELS; k++)
        e[k] = (float)((k * 2654435761u) >> 8 & 0xff); /* noise */
    refuse_outline(e, 0, "no outline");
    disc(e, 45, 0); /* half outside the picture */
    refuse_outline(e, 0.06, "no outline");
    refuse_outline(e, 5, "");
    refuse_outline(e, NAN, "");
    g_free(e);
}

static void test_outline_among_lights(void)
{
    struct ls_pinhole c = camera();
    struct ls_sphere guess = ball, found;
    struct ls_outline o;
    float *e = g_new0(float, PIXELS);
    disc(e, 0, 0.02f);
    for (int k = 0; k < 40; k++) { /* lights of the dome behind the sphere, ten times as bright */
        double a = k * 2.399963, r = 39 + (k % 5) * 2;
        int x = (int)(48 + r * cos(a)), y = (int)(48 + r * sin(a));
        if (x >= 0 && x < SIZE && y >= 0 && y < SIZE)
            e[y * SIZE + x] = 10;
    }
    e[48 * SIZE + 40] = NAN;
    guess.centre_m[0] = 0.03;
    guess.centre_m[1] = -0.02;
    struct ls_diag diag = {{0}};
    enum ls_err err = ls_sphere_locate(&c, e, &guess, &found, &o, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_test_message("(%.2f, %.2f) px, radius %.2f, rms %.2f of %u", o.x_px, o.y_px, o.radius_px,
                   o.rms_px, o.n_used);
    /* a third of the rim is disturbed by up to a pixel */
    g_assert_cmpfloat(hypot(o.x_px - 48, o.y_px - 48), <, 0.3);
    g_assert_cmpfloat(fabs(o.radius_px - 37.5), <, 0.4);
    g_free(e);
}

/* ---- shading ---- */

static const double light[3] = {0.5, 0.6, 1.0};

static void test_spoilt_pixels(void)
{
    struct ls_sphere_view *v = view();
    float *e = g_new(float, PIXELS);
    uint8_t *validity = g_new0(uint8_t, PIXELS);
    struct ls_shading s;
    paint(v, light, 100, e);
    for (uint32_t k = 0; k < v->n; k++) {
        uint32_t p = v->pixels[k].index;
        if (k % 10 == 0)
            e[p] *= 20; /* an unexpected highlight */
        if (k % 17 == 0)
            e[p] = k % 2 ? NAN : INFINITY;
        if (k % 7 == 0) {
            e[p] = 3; /* clipped, and marked so */
            validity[p] = LS_VALIDITY_SATURATED;
        }
    }
    g_assert_cmpint(ls_shading_fit(v, light, e, validity, &s, NULL), ==, LS_OK);
    g_test_message("strength %.5f +- %.5f, %.0f %% refused", s.strength[0], s.sigma[0],
                   100 * s.rejected);
    g_assert_cmpfloat(fabs(s.strength[0] - 100), <, 0.01);
    g_assert_true(s.has_direction);
    g_assert_cmpfloat(hypot(s.offset[0], s.offset[1]), <, 1e-4);
    ls_sphere_view_destroy(v);
    g_free(e);
    g_free(validity);
}

static void test_nothing_there(void)
{
    struct ls_sphere_view *v = view();
    float *e = g_new0(float, PIXELS);
    struct ls_shading s;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_shading_fit(v, light, e, NULL, &s, NULL), ==, LS_OK);
    g_assert_cmpfloat(fabs(s.strength[0]), <, 1e-20);
    g_assert_false(s.has_direction);
    for (int k = 0; k < PIXELS; k++)
        e[k] = (float)((int)((k * 2654435761u) >> 8 & 0xff) - 128) / 1000; /* noise around 0 */
    g_assert_cmpint(ls_shading_fit(v, light, e, NULL, &s, NULL), ==, LS_OK);
    g_test_message("noise: strength %.5f +- %.5f", s.strength[0], s.sigma[0]);
    g_assert_cmpfloat(fabs(s.strength[0]), <, 5 * s.sigma[0]);
    g_assert_false(s.has_direction);
    for (int k = 0; k < PIXELS; k++)
        e[k] = NAN;
    g_assert_cmpint(ls_shading_fit(v, light, e, NULL, &s, NULL), ==, LS_OK);
    g_assert_cmpfloat(s.sigma[0], ==, 0);
    const double inside[3] = {0, 0, 0.05}, nowhere[3] = {NAN, 0, 1}, behind[3] = {0, 0.01, -1.35};
    g_assert_cmpint(ls_shading_fit(v, inside, e, NULL, &s, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "outside the sphere"));
    g_assert_cmpint(ls_shading_fit(v, nowhere, e, NULL, &s, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_shading_fit(v, behind, e, NULL, &s, NULL), ==, LS_OK);
    g_assert_cmpfloat(s.sigma[0], ==, 0); /* the camera sees none of its side */
    double step[3], sigma[3];
    g_assert_cmpint(ls_centre_step(&s, 1, 0, step, sigma, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "not determined"));
    ls_sphere_view_destroy(v);
    g_free(e);
}

static void test_too_small(void)
{
    struct ls_pinhole c = camera();
    struct ls_sphere small = {{0}, 0.002};
    struct ls_sphere_view *v = NULL;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_sphere_view_create(&c, LS_CFA_NONE, &small, NULL, 0, &v, &diag), ==,
                    LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "too small"));
    g_assert_null(v);
}

/* ---- gains ---- */

struct fixture {
    double strength[LIGHTS * 2], sigma[LIGHTS * 2], lit[LIGHTS * 2];
    double g[LIGHTS], k[LIGHTS], sigma_k[LIGHTS], colour[LIGHTS];
    uint8_t one_sided[LIGHTS], flags[LIGHTS];
    struct ls_gains_input in;
    struct ls_gains out;
};

/* Two mono cameras, the second half as sensitive; gains 0.9 and 1.1 in turn. */
static struct fixture *fixture(void)
{
    struct fixture *f = g_new0(struct fixture, 1);
    f->in = (struct ls_gains_input){LIGHTS, 2, 1, f->strength, f->sigma, f->lit, f->one_sided};
    f->out = (struct ls_gains){f->g, f->k, f->sigma_k, f->colour, f->flags};
    for (int i = 0; i < LIGHTS; i++)
        for (int c = 0; c < 2; c++) {
            f->strength[2 * i + c] = (i % 2 ? 1.1 : 0.9) * (c ? 50 : 100);
            f->sigma[2 * i + c] = 1e-3 * f->strength[2 * i + c];
            f->lit[2 * i + c] = 0.5;
        }
    return f;
}

static void refuse_gains(struct fixture *f, const char *words)
{
    struct ls_diag diag = {{0}};
    enum ls_err err = ls_gains_solve(&f->in, &f->out, &diag);
    g_test_message("%s", diag.text);
    g_assert_cmpint(err, ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, words));
    g_free(f);
}

static void test_gains_refused(void)
{
    struct fixture *f = fixture();
    memset(f->sigma, 0, sizeof f->sigma);
    refuse_gains(f, "no light brightens");
    f = fixture();
    for (int i = 0; i < 2 * LIGHTS; i++)
        f->strength[i] = i % 3 ? NAN : -1;
    refuse_gains(f, "no light brightens");
    f = fixture();
    for (int i = 0; i < 2 * LIGHTS; i++)
        f->sigma[i] = 0.05 * f->strength[i];
    refuse_gains(f, "100 times its error");
    f = fixture();
    for (int i = 0; i < LIGHTS; i++)
        f->lit[2 * i + i % 2] = 0.05; /* each light is seen by one camera only */
    refuse_gains(f, "share no light");
}

static void test_single_faults(void)
{
    struct fixture *f = fixture();
    f->strength[2 * 7] = 0.01; /* dead */
    f->strength[2 * 7 + 1] = -0.02;
    f->sigma[2 * 7] = f->sigma[2 * 7 + 1] = 0.05;
    f->sigma[2 * 8] = f->sigma[2 * 8 + 1] = NAN; /* never seen */
    f->sigma[2 * 9] = INFINITY;                  /* one camera only */
    f->strength[2 * 10] = INFINITY;
    f->one_sided[11] = 1;
    g_assert_cmpint(ls_gains_solve(&f->in, &f->out, NULL), ==, LS_OK);
    g_assert_cmpuint(f->flags[7], ==, LS_LIGHT_DEAD);
    g_assert_cmpfloat(fabs(f->k[7] - 1), <, 0.01);
    g_assert_cmpfloat(f->sigma_k[7], >, 0.9);
    g_assert_cmpuint(f->flags[8], ==, LS_LIGHT_UNCERTAIN);
    g_assert_cmpfloat(f->sigma_k[8], >, 0.08); /* the others' spread is 10 % */
    g_assert_cmpuint(f->flags[11], ==, LS_LIGHT_ONE_SIDED);
    g_assert_cmpfloat(f->sigma_k[11] / f->k[11], >=, 0.02);
    double sum = 0;
    for (int i = 0; i < LIGHTS; i++) {
        sum += f->g[i] / LIGHTS;
        if (i == 7 || i == 8)
            continue;
        /* two lights of forty lean the mean by at most a twentieth of the spread */
        g_assert_cmpfloat(fabs(f->k[i] * (i % 2 ? 1.1 : 0.9) - 1), <, 0.006);
        g_assert_cmpfloat(f->sigma_k[i], >, 0);
    }
    g_assert_cmpfloat(fabs(sum - 1), <, 1e-9);
    g_assert_cmpfloat(fabs(f->out.level[0][0] / f->out.level[1][0] - 2), <, 1e-9);
    g_free(f);
}

/* One colour of one light is 3 % off: it gets its factor; noise gets none. */
static void test_colour_factor(void)
{
    enum { N = 30 };
    double strength[N * 3], sigma[N * 3], lit[N], g[N], k[N], sigma_k[N], colour[N * 3];
    uint8_t flags[N];
    struct ls_gains_input in = {N, 1, 3, strength, sigma, lit, NULL};
    struct ls_gains out = {g, k, sigma_k, colour, flags};
    for (int i = 0; i < N; i++) {
        lit[i] = 1;
        for (int c = 0; c < 3; c++) {
            strength[3 * i + c] = 10 * (c + 1) * (1 + 0.0004 * ((7 * i + 3 * c) % 5 - 2));
            sigma[3 * i + c] = 1e-3 * strength[3 * i + c];
        }
    }
    strength[3 * 4 + 2] *= 1.03;
    for (int c = 0; c < 3; c += 2) /* of two that differ one is known too badly to say so */
        strength[3 * 6 + c] *= 1.03;
    sigma[3 * 6] = 6e-3 * strength[3 * 6];
    g_assert_cmpint(ls_gains_solve(&in, &out, NULL), ==, LS_OK);
    double all = k[4] * colour[3 * 4 + 2];
    g_test_message("k %.4f, colour factors %.4f %.4f %.4f", k[4], colour[12], colour[13],
                   colour[14]);
    g_assert_cmpfloat(fabs(all * 1.03 - 1), <, 0.003);
    for (int i = 0; i < N; i++)
        for (int c = 0; c < 3 && i != 4 && i != 6; c++)
            g_assert_cmpfloat(colour[3 * i + c], ==, 1);
    g_assert_cmpfloat(colour[3 * 6], ==, 1);
    g_assert_cmpfloat(colour[3 * 6 + 2], <, 0.995);
}

/* A light known to a third of the spread leans on the others by a tenth, and says what it then
 * knows. */
static void test_leaning(void)
{
    struct fixture *f = fixture();
    for (int c = 0; c < 2; c++) {
        f->strength[2 * 5 + c] = 1.3 * (c ? 50 : 100);
        f->sigma[2 * 5 + c] = 0.05 * f->strength[2 * 5 + c]; /* of no SNR of 100 */
    }
    g_assert_cmpint(ls_gains_solve(&f->in, &f->out, NULL), ==, LS_OK);
    double own = 2 / (0.05 * 0.05), spread = log(1.1 / 0.9) / 2, theirs = 1 / (spread * spread);
    double g = exp((own * log(1.3) + theirs * log(0.99) / 2) / (own + theirs));
    g_test_message("k %.4f +- %.4f, expected %.4f", f->k[5], f->sigma_k[5], 1 / g);
    /* the mean of g holds this light too: a fortieth of what it is above 1; and of odd ones one is
     * missing among the others */
    g_assert_cmpfloat(fabs(f->k[5] / f->k[0] * g / 0.9 - 1), <, 0.002);
    g_assert_cmpfloat(fabs(f->sigma_k[5] / f->k[5] * sqrt(own + theirs) - 1), <, 0.01);
    g_free(f);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/gains/no-sphere-no-light-and-noise-are-refused", test_outline_refused);
    g_test_add_func("/gains/the-outline-is-found-among-lights", test_outline_among_lights);
    g_test_add_func("/gains/highlights-clipped-and-broken-pixels-do-not-matter",
                    test_spoilt_pixels);
    g_test_add_func("/gains/a-dark-picture-is-no-light", test_nothing_there);
    g_test_add_func("/gains/a-sphere-of-a-few-pixels-is-refused", test_too_small);
    g_test_add_func("/gains/nothing-to-compare-is-refused", test_gains_refused);
    g_test_add_func("/gains/a-dead-and-an-unseen-light-are-flagged-alone", test_single_faults);
    g_test_add_func("/gains/a-light-known-badly-leans-on-the-others", test_leaning);
    g_test_add_func("/gains/a-colour-that-differs-gets-its-factor", test_colour_factor);
    return g_test_run();
}

/* Polarisation factors, the split of V and H, and the conductor blend, against long double. */
#include "core/conductor.h"
#include "core/polarisation.h"
#include "core/separate.h"

#include "tests/core/noise.h"
#include "tests/core/split_samples.h"

#include <float.h>
#include <glib.h>
#include <math.h>
#include <string.h>

struct vector {
    long double x, y, z;
};

static long double dot(struct vector a, struct vector b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static struct vector cross(struct vector a, struct vector b)
{
    return (struct vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static struct vector unit(struct vector a)
{
    long double s = 1 / sqrtl(dot(a, a));
    return (struct vector){a.x * s, a.y * s, a.z * s};
}

static struct vector across(struct vector up, struct vector ray)
{
    long double t = dot(up, ray);
    return unit((struct vector){up.x - t * ray.x, up.y - t * ray.y, up.z - t * ray.z});
}

/* Power through the analyser by the textbook's way: parts across and in the plane of incidence, and
 * Fresnel's equations in sines and tangents of the two angles. */
static long double textbook(struct vector l, struct vector v, struct vector e, struct vector a,
                            long double index)
{
    struct vector in = {-l.x, -l.y, -l.z}, s = unit(cross(in, v));
    struct vector p_in = cross(in, s), p_out = cross(v, s);
    long double i = acosl(dot(l, v)) / 2, t = asinl(sinl(i) / index);
    long double rs = -sinl(i - t) / sinl(i + t), rp = tanl(i - t) / tanl(i + t);
    long double out = rs * dot(e, s) * dot(a, s) + rp * dot(e, p_in) * dot(a, p_out);
    return out * out;
}

static struct ls_polarisation reflect(double x, double y, double z)
{
    struct ls_polarisation_path path = {
        .light = {x, y, z}, .camera = {0, 0, 1.6}, .camera_up = {0, 1, 0}};
    struct ls_polarisation a;
    g_assert_cmpint(ls_polarisation_reflect(&path, NULL, LS_POLARISATION_INDEX, &a, NULL), ==,
                    LS_OK);
    return a;
}

static void test_textbook(void)
{
    const uint64_t seed = 1657;
    struct noise noise = {.state = seed};
    uint32_t compared = 0;
    g_test_message("seed %" G_GUINT64_FORMAT, seed);
    for (int n = 0; n < 20000; n++) {
        double l[3], index = 1.2 + noise_uniform(&noise);
        for (int k = 0; k < 3; k++)
            l[k] = noise_normal(&noise);
        struct ls_polarisation_path path = {
            .light = {l[0], l[1], l[2]}, .camera = {0.3, -0.2, 1.6}, .camera_up = {0.1, 1, 0}};
        struct vector to_light = unit((struct vector){l[0], l[1], l[2]});
        struct vector to_camera = unit((struct vector){0.3, -0.2, 1.6});
        struct vector e = across((struct vector){0, 1, 0}, to_light);
        struct vector a = across((struct vector){0.1, 1, 0}, to_camera);
        long double v = textbook(to_light, to_camera, e, a, index);
        long double h = textbook(to_light, to_camera, cross(to_light, e), a, index);
        struct ls_polarisation found;
        g_assert_cmpint(ls_polarisation_reflect(&path, NULL, index, &found, NULL), ==, LS_OK);
        g_assert_cmpfloat(fabs(found.v + found.h - 1), <, 1e-15);
        if (v + h < 1e-5L)
            continue; /* a is the quotient of two losses there */
        compared++;
        /* double rounding of amplitudes around 0.2, divided by powers of 1e-5 at least */
        g_assert_cmpfloat(fabs(found.v - (double)(v / (v + h))), <, 1e-12);
    }
    g_assert_cmpuint(compared, >, 19000);
}

static void test_equator(void)
{
    for (int k = 1; k < 360; k++) { /* level lights are s, and so is the analyser */
        double phi = k * M_PI / 180;
        struct ls_polarisation a = reflect(1.35 * sin(phi), 0, 1.35 * cos(phi));
        g_assert_cmpfloat(fabs(a.v - 1), <, 1e-12);
    }
    struct ls_polarisation near = reflect(0, 1e-9, 1.35), left = reflect(-0.7, 0.8, -0.6);
    struct ls_polarisation right = reflect(0.7, 0.8, -0.6), below = reflect(0.7, -0.8, -0.6);
    g_assert_cmpfloat(fabs(near.v - 1), <, 1e-12);
    g_assert_cmpfloat(fabs(left.v - right.v), <, 1e-14); /* mirror images */
    g_assert_cmpfloat(fabs(left.v - below.v), <, 1e-14);
    g_assert_cmpfloat(left.v, <, 0.9);
}

/* At twice the Brewster angle from the camera, atan 1.5, straight above: the vertical light does
 * not reflect, the horizontal one is stopped. Beside it a is upside down. */
static void test_brewster(void)
{
    double angle = 2 * atan(1.5);
    struct ls_polarisation a = reflect(0, 1.35 * sin(angle), 1.35 * cos(angle));
    g_assert_cmpfloat(a.v, ==, 0.5);
    g_assert_false(ls_polarisation_separable(a));
    struct ls_polarisation beside = reflect(0.1, 1.35 * sin(angle), 1.35 * cos(angle));
    g_assert_cmpfloat(beside.h, >, 0.9);
    g_assert_true(ls_polarisation_separable(beside));
    g_assert_true(ls_polarisation_separable(ls_polarisation_ideal()));
    g_assert_false(ls_polarisation_separable((struct ls_polarisation){NAN, 0}));
}

static void test_highlight(void)
{
    struct noise noise = {.state = 5};
    uint32_t hidden = 0;
    for (int n = 0; n < 1000; n++) {
        struct ls_polarisation_path path = {.camera = {0, 0, 1.6}, .camera_up = {0, 1, 0}};
        double point[3];
        for (int k = 0; k < 3; k++)
            path.light[k] = noise_normal(&noise);
        double far = 1.35 / hypot(hypot(path.light[0], path.light[1]), path.light[2]);
        for (int k = 0; k < 3; k++)
            path.light[k] *= far;
        g_assert_cmpint(ls_polarisation_highlight(&path, 0.2, point, NULL), ==, LS_OK);
        hidden += point[0] == 0 && point[1] == 0 && point[2] == 0;
        if (point[0] == 0 && point[1] == 0 && point[2] == 0)
            continue;
        struct vector p = {point[0], point[1], point[2]};
        struct vector l =
            unit((struct vector){path.light[0] - p.x, path.light[1] - p.y, path.light[2] - p.z});
        struct vector v = unit((struct vector){-p.x, -p.y, 1.6L - p.z});
        struct vector h = unit((struct vector){l.x + v.x, l.y + v.y, l.z + v.z});
        g_assert_cmpfloat(fabs((double)sqrtl(dot(p, p)) - 0.2), <, 1e-12);
        g_assert_cmpfloat((double)dot(h, p) / 0.2, >, 1 - 1e-12);
        g_assert_cmpfloat((double)dot(l, p), >, 0);
    }
    /* a ball of 0.2 m hides what stands within asin(0.2/1.35) + asin(0.2/1.6) = 15.7 degrees of
     * straight behind: 1.9 % of all directions */
    g_assert_cmpuint(hidden, >, 5);
    g_assert_cmpuint(hidden, <, 40);
}

static void test_refusals(void)
{
    struct ls_polarisation a;
    struct ls_polarisation_path path = {
        .light = {0, 1, 1}, .camera = {0, 0, 1.6}, .camera_up = {0, 1, 0}};
    double centre[3] = {0, 0, 0}, point[3];
    struct ls_split split;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_polarisation_reflect(&path, centre, 1, &a, &diag), ==, LS_ERR_INVALID);
    path.light[1] = NAN;
    g_assert_cmpint(ls_polarisation_reflect(&path, NULL, 1.5, &a, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_polarisation_highlight(&path, 0.1, point, NULL), ==, LS_ERR_INVALID);
    path.light[1] = 1;
    g_assert_cmpint(ls_polarisation_reflect(&path, path.light, 1.5, &a, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_polarisation_highlight(&path, 0.8, point, NULL), ==, LS_ERR_INVALID);
    path.camera_up[1] = 0;
    path.camera_up[2] = 1;
    g_assert_cmpint(ls_polarisation_reflect(&path, NULL, 1.5, &a, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_split_make((struct ls_polarisation){0, 0}, 1, 1, &split, NULL), ==,
                    LS_ERR_INVALID);
    g_assert_cmpint(ls_split_make((struct ls_polarisation){1, INFINITY}, 1, 1, &split, NULL), ==,
                    LS_ERR_INVALID);
    g_assert_cmpint(ls_split_make(ls_polarisation_ideal(), 0, 1, &split, NULL), ==, LS_ERR_INVALID);
}

/* Pure noise has no highlight, however bright its brightest sample; nor have pictures of NaN. */
static void test_no_highlight(void)
{
    enum { SIDE = 80 };
    struct noise noise = {.state = 77};
    float *v = g_new(float, SIDE *SIDE), *h = g_new(float, SIDE *SIDE);
    struct ls_polarisation_probe probe = {
        .v = v, .h = h, .width = SIDE, .height = SIDE, .noise = {.read_variance = 1}};
    struct ls_polarisation_measured out;
    for (int pass = 0; pass < 2; pass++) {
        for (int k = 0; k < SIDE * SIDE; k++) {
            v[k] = pass ? NAN : (float)noise_normal(&noise);
            h[k] = pass ? INFINITY : (float)noise_normal(&noise);
        }
        g_assert_cmpint(ls_polarisation_measure(&probe, &out, NULL), ==, LS_ERR_NOT_FOUND);
    }
    probe.width = 0;
    g_assert_cmpint(ls_polarisation_measure(&probe, &out, NULL), ==, LS_ERR_INVALID);
    g_free(v);
    g_free(h);
}

/* A Gaussian highlight of known a on a matte ball, 400 times: the standard error is honest. */
static void test_honest(void)
{
    enum { SIDE = 40, TRIES = 400 };
    const double a_v = 0.83, read = 1e-4, shot = 1e-3;
    struct noise noise = {.state = 78};
    float *v = g_new(float, SIDE *SIDE), *h = g_new(float, SIDE *SIDE);
    struct ls_polarisation_probe probe = {
        .v = v, .h = h, .width = SIDE, .height = SIDE, .noise = {read, 0, shot}};
    uint32_t within = 0;
    double mean = 0, sigma = 0;
    for (int n = 0; n < TRIES; n++) {
        struct ls_polarisation_measured out;
        for (int k = 0; k < SIDE * SIDE; k++) {
            double x = k % SIDE - 19.3, y = k / SIDE - 18.8;
            double s = exp(-(x * x + y * y) / 8), ball = 0.01;
            double to_v = a_v * s + ball, to_h = (1 - a_v) * s + ball;
            v[k] = (float)(to_v + sqrt(read + shot * to_v) * noise_normal(&noise));
            h[k] = (float)(to_h + sqrt(read + shot * to_h) * noise_normal(&noise));
        }
        g_assert_cmpint(ls_polarisation_measure(&probe, &out, NULL), ==, LS_OK);
        within += fabs(out.a.v - a_v) < out.sigma;
        mean += out.a.v / TRIES;
        sigma += out.sigma / TRIES;
    }
    g_test_message("mean %.5f, sigma %.5f, %u of %d within one", mean, sigma, within, TRIES);
    /* 68 % within one sigma; 400 draws give +- 2.3 %, three of them 7 % */
    g_assert_cmpfloat(fabs((double)within / TRIES - 0.683), <, 0.07);
    g_assert_cmpfloat(fabs(mean - a_v), <, 4 * sigma / sqrt(TRIES));
    g_free(v);
    g_free(h);
}

static void test_ideal_is_the_papers(void)
{
    struct ls_split split;
    float v = 5, h = 2, d, s;
    g_assert_cmpint(ls_split_make(ls_polarisation_ideal(), 1, 1, &split, NULL), ==, LS_OK);
    split_samples(&split, &v, &h, 1, &d, &s);
    g_assert_cmpfloat(s, ==, v - h);
    g_assert_cmpfloat(d, ==, 2 * h);
}

/* Of known D and S, any a and gains; float's rounding, amplified by 1/|a_V - a_H|. */
static void test_split(void)
{
    const uint64_t seed = 1658;
    struct noise noise = {.state = seed};
    g_test_message("seed %" G_GUINT64_FORMAT, seed);
    for (int n = 0; n < 100000; n++) {
        double scale = pow(10, 60 * noise_uniform(&noise) - 30);
        double a_v = noise_uniform(&noise), a_h = 1 - a_v;
        double k_v = 0.5 + noise_uniform(&noise), k_h = 0.5 + noise_uniform(&noise);
        double of_d = scale * noise_normal(&noise), of_s = scale * noise_normal(&noise);
        float v = (float)((a_v * of_s + of_d / 2) / k_v),
              h = (float)((a_h * of_s + of_d / 2) / k_h);
        float d, s;
        struct ls_split split;
        g_assert_cmpint(ls_split_make((struct ls_polarisation){a_v, a_h}, k_v, k_h, &split, NULL),
                        ==, LS_OK);
        split_samples(&split, &v, &h, 1, &d, &s);
        double size = k_v * fabs((double)v) + k_h * fabs((double)h);
        if (ls_split_inseparable(&split)) {
            g_assert_cmpfloat(fabs(a_v - a_h), <, LS_POLARISATION_LEAST + 1e-15);
            g_assert_cmpfloat(s, ==, 0);
            g_assert_cmpfloat(fabs((double)d - of_d - of_s), <=, 3 * FLT_EPSILON * size);
            continue;
        }
        double bound = 4 * FLT_EPSILON * size / fabs(a_v - a_h);
        g_assert_cmpfloat(fabs((double)d - of_d), <=, 2 * bound);
        g_assert_cmpfloat(fabs((double)s - of_s), <=, bound);
    }
}

/* F of a field whose dielectric highlights are known gives the ratio of its diffuse part. */
static void test_remainder(void)
{
    const double tint[3] = {0.9, 0.3, 0.05};
    float f[3], d[3] = {4, 2, 1}, s[3] = {1, 1, 1}, c[3] = {0.25f, 0.25f, 0.25f}, up[3], down[3];
    const float ratio[3] = {0.8f, 0.2f, 0.1f};
    for (int k = 0; k < 3; k++)
        f[k] = ratio[k] * (d[k] + c[k]) + (float)tint[k] * (s[k] - c[k]);
    ls_separate_remainder(f, d, s, c, tint, 1, 3, up, down);
    for (int k = 0; k < 3; k++)
        g_assert_cmpfloat(fabsf(up[k] / down[k] - ratio[k]), <, 4 * FLT_EPSILON);
    memset(s, 0, sizeof s);
    ls_separate_remainder(f, d, s, NULL, tint, 1, 3, f, d);
    g_assert_cmpfloat(d[0], ==, 4); /* without highlights: F/V, in place */
}

static long double share_of(const double white[3], double t, bool plain, const float s[3],
                            double sigma)
{
    long double r = s[0] / (long double)white[0], g = s[1] / (long double)white[1];
    long double b = s[2] / (long double)white[2], m = fmaxl(fabsl(r), fmaxl(fabsl(g), fabsl(b)));
    long double a = g == 0 ? INFINITY : fabsl(1 - r / g), o = b == 0 ? INFINITY : fabsl(1 - r / b);
    if (plain) { /* the paper's difference of plain quotients */
        a = s[1] == 0 ? INFINITY : fabsl(white[0] / white[1] - s[0] / (long double)s[1]);
        o = s[2] == 0 ? INFINITY : fabsl(white[0] / white[2] - s[0] / (long double)s[2]);
    }
    long double q = m == 0 ? 0 : sigma > 0 ? fminl(1, fmaxl(0, (m / sigma - 10) / 20)) : 1;
    return q * q * (3 - 2 * q) * (fminl(a / t, 1) + fminl(o / t, 1)) / 2;
}

static float share_found(const struct ls_conductor *o, const float s[3], float sigma, float out[3])
{
    float share, *plane[3] = {out, out + 1, out + 2};
    const float *const from[3] = {s, s + 1, s + 2};
    ls_conductor_part(o, from, &sigma, 1, plane, &share);
    return share;
}

static void test_share(void)
{
    const uint64_t seed = 1659;
    const double white[3] = {0.8, 1, 0.6};
    struct noise noise = {.state = seed};
    g_test_message("seed %" G_GUINT64_FORMAT, seed);
    for (int plain = 0; plain < 2; plain++) {
        struct ls_conductor o;
        g_assert_cmpint(ls_conductor_make(white, 0.3, plain, &o, NULL), ==, LS_OK);
        for (int n = 0; n < 50000; n++) {
            float s[3], out[3], scale = powf(10, (float)(8 * noise_uniform(&noise) - 4));
            float sigma = n % 3 ? 0.03f * scale * (float)noise_uniform(&noise) : 0;
            for (int c = 0; c < 3; c++)
                s[c] = scale * (float)(white[c] * (1 + 0.2 * noise_normal(&noise)));
            float share = share_found(&o, s, sigma, out);
            /* a is a difference of numbers near 1, over t: 2 ulp of 1 / 0.3 each; the plain form's
             * thresholds are rounded too */
            g_assert_cmpfloat(
                fabs((double)share - (double)share_of(white, 0.3, plain, s, (double)sigma)), <,
                3e-6);
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat(out[c], ==, share * s[c]);
        }
    }
}

static void test_colours(void)
{
    const double white[3] = {0.8, 1, 0.6};
    const float light[3] = {4, 5, 3}, gold[3] = {4 * 0.95f, 5 * 0.8f, 3 * 0.4f};
    const float red[3] = {4, 0.2f, 0.1f}, dark[3] = {-4, -0.2f, -0.1f};
    struct ls_conductor o;
    float out[3];
    g_assert_cmpint(ls_conductor_make(white, LS_CONDUCTOR_THRESHOLD, false, &o, NULL), ==, LS_OK);
    g_assert_cmpfloat(share_found(&o, light, 0, out), <, 1e-6f);
    g_assert_cmpfloat(share_found(&o, gold, 0, out), >, 0.8f);
    g_assert_cmpfloat(share_found(&o, red, 0, out), ==, 1);
    g_assert_cmpfloat(share_found(&o, dark, 0, out), ==, 1); /* the sign makes no difference */
    g_assert_cmpfloat(share_found(&o, red, 5.0f / 30, out), ==, 1);
    g_assert_cmpfloat(share_found(&o, red, 5.0f / 10, out), ==, 0); /* too dark: dielectric */
    const double no_white[3] = {0.8, 0, 0.6};
    g_assert_cmpint(ls_conductor_make(no_white, 0.3, false, &o, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_conductor_make(white, NAN, false, &o, NULL), ==, LS_ERR_INVALID);
}

/* Every triple of hard numbers, and noise as hard: a share in [0, 1] and a finite part. */
static void test_hard(void)
{
    static const float hard[] = {0, -0.0f, 0x1p-149f, -0x1p-149f, FLT_MIN, 1e-30f,
                                 1, -1,    1e30f,     -1e30f,     FLT_MAX, -FLT_MAX};
    enum { N = G_N_ELEMENTS(hard) };
    static const double whites[2][3] = {{0.8, 1, 0.6}, {1e-6, 1e6, 1}};
    for (int w = 0; w < 2; w++) {
        struct ls_conductor o;
        g_assert_cmpint(ls_conductor_make(whites[w], 0.3, w, &o, NULL), ==, LS_OK);
        for (int k = 0; k < N * N * N * N; k++) {
            float s[3] = {hard[k % N], hard[k / N % N], hard[k / N / N % N]}, out[3];
            float share = share_found(&o, s, fabsf(hard[k / N / N / N]), out);
            g_assert_true(share >= 0 && share <= 1);
            for (int c = 0; c < 3; c++)
                g_assert_true(fabsf(out[c]) <= fabsf(s[c]));
        }
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/polarisation/half-vector-agrees-with-the-textbook", test_textbook);
    g_test_add_func("/polarisation/level-lights-are-ideal-and-mirror-images-alike", test_equator);
    g_test_add_func("/polarisation/no-highlight-at-the-brewster-angle-above", test_brewster);
    g_test_add_func("/polarisation/highlight-is-where-the-normal-halves", test_highlight);
    g_test_add_func("/polarisation/nonsense-is-refused", test_refusals);
    g_test_add_func("/polarisation/noise-is-no-highlight", test_no_highlight);
    g_test_add_func("/polarisation/standard-error-is-honest", test_honest);
    g_test_add_func("/separate/ideal-factors-are-the-papers", test_ideal_is_the_papers);
    g_test_add_func("/separate/recovers-diffuse-and-specular", test_split);
    g_test_add_func("/separate/remainder-is-the-ratio-of-the-rest", test_remainder);
    g_test_add_func("/conductor/share-agrees-with-long-double", test_share);
    g_test_add_func("/conductor/colours-of-light-and-of-metal-are-told-apart", test_colours);
    g_test_add_func("/conductor/hard-numbers-stay-finite", test_hard);
    return g_test_run();
}

/* mirror_ball: balls rendered from environments whose map is known. */
#include "core/environment.h"
#include "core/mirror_ball.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SIDE = 140, WIDTH = 128, HEIGHT = 64 };
static const double radius = 60, centre[2] = {71.3, 68.7};

/** Radiance from a direction, one channel; the three channels are 1, 2 and 3 times that. */
typedef double environment(const double d[3], const void *data);

static double smooth(const double d[3], const void *data)
{
    return 1 + 0.5 * d[0] + 0.3 * d[1] * d[2] + 0.2 * d[1];
}

static double constant(const double d[3], const void *data)
{
    return 2;
}

static double spot(const double d[3], const void *data)
{
    const double *at = data;
    return 100 * exp(400 * (d[0] * at[0] + d[1] * at[1] + d[2] * at[2] - 1));
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double length(const double a[3])
{
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

/* what a distant camera sees at (x, y) of the ball: mirrored at the normal, told without half
 * angles; black beside it */
static double seen(const struct ls_mirror_ball *ball, double x, double y, environment *from,
                   const void *data)
{
    const double up[3] = {0, 1, 0};
    double ahead[3], right[3], above[3], normal[3], d[3], towards = 0;
    double u = (x - ball->centre_px[0]) / ball->radius_px;
    double v = (ball->centre_px[1] - y) / ball->radius_px;
    if (u * u + v * v >= 1)
        return 0;
    for (int k = 0; k < 3; k++)
        ahead[k] = ball->to_camera[k] / length(ball->to_camera);
    cross(up, ahead, right);
    double l = length(right);
    for (int k = 0; k < 3; k++)
        right[k] /= l;
    cross(ahead, right, above);
    for (int k = 0; k < 3; k++) {
        normal[k] = u * right[k] + v * above[k] + sqrt(1 - u * u - v * v) * ahead[k];
        towards += normal[k] * ahead[k];
    }
    for (int k = 0; k < 3; k++)
        d[k] = 2 * towards * normal[k] - ahead[k];
    return from(d, data);
}

/* each pixel the mean of 4 x 4 points */
static void photograph(const struct ls_mirror_ball *ball, float *rgb, environment *from,
                       const void *data)
{
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            double sum = 0;
            for (int k = 0; k < 16; k++)
                sum += seen(ball, x + (k % 4 + 0.5) / 4, y + ((k >> 2) + 0.5) / 4, from, data) / 16;
            for (int c = 0; c < 3; c++)
                rgb[3 * (y * SIDE + x) + (uint32_t)c] =
                    (float)(sum * (c + 1) * ball->reflectivity[c]);
        }
}

static struct ls_mirror_ball a_ball(const float *rgb, const double to_camera[3])
{
    struct ls_mirror_ball ball = {.rgb = rgb,
                                  .width = SIDE,
                                  .height = SIDE,
                                  .centre_px = {centre[0], centre[1]},
                                  .radius_px = radius,
                                  .reflectivity = {0.607, 0.616, 0.634},
                                  .blind_rad = ls_mirror_ball_blind(radius, 2)};
    memcpy(ball.to_camera, to_camera, sizeof ball.to_camera);
    return ball;
}

static double texel_sr(uint32_t y)
{
    return 2 * M_PI / WIDTH * (cos(M_PI * y / HEIGHT) - cos(M_PI * (y + 1) / HEIGHT));
}

static const double cameras[][3] = {{0, 0, 1}, {1, 0, 0}, {-0.5, 0.4, 0.3}, {0.2, -0.8, -1}};

static void test_a_smooth_environment_comes_back(void)
{
    static float rgb[3 * SIDE * SIDE], map[3 * WIDTH * HEIGHT];
    static uint8_t filled[WIDTH * HEIGHT];
    for (size_t k = 0; k < G_N_ELEMENTS(cameras); k++) {
        struct ls_mirror_ball ball = a_ball(rgb, cameras[k]);
        double worst = 0;
        photograph(&ball, rgb, smooth, NULL);
        g_assert_cmpint(ls_mirror_ball_map(&ball, WIDTH, HEIGHT, map, filled, NULL, NULL), ==,
                        LS_OK);
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
            double d[3];
            ls_latlong_direction((i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT, d);
            for (uint32_t c = 0; c < 3 && !filled[i]; c++)
                worst = fmax(worst, fabs((double)map[3 * i + c] / (c + 1) - smooth(d, NULL)));
        }
        g_test_message("camera (%g, %g, %g): within %.4f of radiances 0.2 to 1.8", cameras[k][0],
                       cameras[k][1], cameras[k][2], worst);
        /* two pixels from the rim a pixel spans 10 degrees, over which the environment changes by
         * 0.1; bilinear samples miss a small part of that */
        g_assert_cmpfloat(worst, <, 0.02);
    }
}

static void test_a_spot_is_found_where_it_is(void)
{
    static float rgb[3 * SIDE * SIDE], map[3 * WIDTH * HEIGHT];
    static const double spots[][3] = {
        {0.6, 0.8, 0}, {-0.8, 0, 0.6}, {0, -0.6, -0.8}, {0.36, 0.48, 0.8}};
    for (size_t k = 0; k < 16; k++) {
        const double *at = spots[k % 4];
        struct ls_mirror_ball ball = a_ball(rgb, cameras[k / 4]);
        double sum[3] = {0};
        double behind = 0;
        for (int j = 0; j < 3; j++)
            behind -= at[j] * ball.to_camera[j] / length(ball.to_camera);
        if (behind > 0.5) /* towards the rim pixels grow beyond the spot's 3 degrees */
            continue;
        photograph(&ball, rgb, spot, at);
        g_assert_cmpint(ls_mirror_ball_map(&ball, WIDTH, HEIGHT, map, NULL, NULL, NULL), ==, LS_OK);
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
            double d[3];
            ls_latlong_direction((i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT, d);
            for (int j = 0; j < 3; j++)
                sum[j] += (double)map[3 * i] * texel_sr(i / WIDTH) * d[j];
        }
        /* the centre of gravity, to a tenth of a pixel's 1.9 degrees; mirrored it would be tens
         * of degrees off */
        double off = 0;
        for (int j = 0; j < 3; j++)
            off += pow(sum[j] / length(sum) - at[j], 2);
        g_test_message("%.2f degrees off", sqrt(off) * 180 / M_PI);
        g_assert_cmpfloat(sqrt(off), <, 0.2 * M_PI / 180);
        /* its energy: 100 x 2 pi / 400 */
        g_assert_cmpfloat_with_epsilon(length(sum) / (100 * 2 * M_PI / 400), 1, 0.01);
    }
}

static void test_a_single_pixel_keeps_its_energy(void)
{
    static float rgb[3 * SIDE * SIDE], map[3 * WIDTH * HEIGHT];
    static const uint32_t at[][2] = {{71, 68}, {95, 60}, {40, 85}, {71, 115}, {110, 85}};
    for (size_t k = 0; k < G_N_ELEMENTS(at); k++) {
        struct ls_mirror_ball ball = a_ball(rgb, cameras[k % 4]);
        double sum = 0;
        memset(rgb, 0, sizeof rgb);
        rgb[3 * (at[k][1] * SIDE + at[k][0])] = 1e6f;
        g_assert_cmpint(ls_mirror_ball_map(&ball, WIDTH, HEIGHT, map, NULL, NULL, NULL), ==, LS_OK);
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
            sum += (double)map[3 * i] * texel_sr(i / WIDTH);
        /* the header's bound */
        g_assert_cmpfloat_with_epsilon(sum / (1e6 / 0.607 * 4 / (radius * radius)), 1, 0.01);
    }
}

static void test_the_blind_cone_is_filled_and_marked(void)
{
    static float rgb[3 * SIDE * SIDE], map[3 * WIDTH * HEIGHT];
    static uint8_t filled[WIDTH * HEIGHT];
    struct ls_mirror_ball_report report;
    struct ls_mirror_ball ball = a_ball(rgb, cameras[0]);
    double low = INFINITY, high = -INFINITY;
    photograph(&ball, rgb, smooth, NULL);
    ball.blind_rad = 0.5;
    g_assert_cmpint(ls_mirror_ball_map(&ball, WIDTH, HEIGHT, map, filled, &report, NULL), ==,
                    LS_OK);
    /* texels of 1.4 degrees along a rim of 86: the count is that coarse */
    g_assert_cmpfloat_with_epsilon(report.filled_sr / (2 * M_PI * (1 - cos(0.5))), 1, 0.02);
    for (double a = 0; a < 2 * M_PI; a += 0.01) {
        const double rim[3] = {sin(0.5) * cos(a), sin(0.5) * sin(a), -cos(0.5)};
        low = fmin(low, smooth(rim, NULL)), high = fmax(high, smooth(rim, NULL));
    }
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
        double d[3];
        ls_latlong_direction((i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT, d);
        g_assert_cmpint(filled[i], ==, acos(-d[2]) < 0.5 ? 1 : 0);
        if (filled[i]) { /* between what its rim shows */
            g_assert_cmpfloat((double)map[3 * i], >, low - 0.01);
            g_assert_cmpfloat((double)map[3 * i], <, high + 0.01);
        }
    }
    photograph(&ball, rgb, constant, NULL);
    g_assert_cmpint(ls_mirror_ball_map(&ball, WIDTH, HEIGHT, map, filled, &report, NULL), ==,
                    LS_OK);
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
        g_assert_cmpfloat_with_epsilon((double)map[3 * i + 1], 4, 1e-5);
    g_assert_cmpfloat_with_epsilon(report.peak, 6, 1e-5);
}

static void test_what_lies_beside_the_ball_never_reaches_the_map(void)
{
    static float rgb[3 * SIDE * SIDE], map[3 * WIDTH * HEIGHT];
    struct ls_mirror_ball ball = a_ball(rgb, cameras[0]);
    enum ls_err err = LS_OK;
    ball.blind_rad = 0.01;
    /* a mask that leaves less and less around the ball: refused, or without an effect */
    for (double beside = 2; beside > 0.5; beside -= 0.125) {
        for (uint32_t y = 0; y < SIDE; y++)
            for (uint32_t x = 0; x < SIDE; x++)
                if (hypot(x + 0.5 - centre[0], y + 0.5 - centre[1]) > radius + beside)
                    rgb[3 * (y * SIDE + x)] = NAN;
        err = ls_mirror_ball_map(&ball, WIDTH, HEIGHT, map, NULL, NULL, NULL);
        for (uint32_t i = 0; i < 3 * WIDTH * HEIGHT && !err; i++)
            g_assert_true(isfinite(map[i]));
        g_assert_true(!err || beside <= 1.5);
    }
    g_assert_cmpint(err, ==, LS_ERR_INVALID);
}

static void test_what_makes_no_sense_is_refused(void)
{
    static float rgb[3 * SIDE * SIDE], map[3 * 8 * 4];
    struct ls_mirror_ball good = a_ball(rgb, cameras[0]), bad = good;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_mirror_ball_map(&good, 8, 4, map, NULL, NULL, NULL), ==, LS_OK);
    bad.centre_px[0] = 50;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 8, 4, map, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good, bad.radius_px = NAN;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 8, 4, map, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good, bad.width = bad.height = 40000; /* one texel of 3e10 samples */
    bad.centre_px[0] = bad.centre_px[1] = bad.radius_px = 20000;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 1, 1, map, NULL, NULL, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "reduce the picture"));
    bad.centre_px[0] = bad.centre_px[1] = bad.radius_px = LS_MIRROR_BALL_MAX_RADIUS_PX + 1;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 8, 4, map, NULL, NULL, NULL), ==, LS_ERR_LIMIT);
    bad = good, bad.blind_rad = 2;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 8, 4, map, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good, bad.reflectivity[1] = 0;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 8, 4, map, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good, bad.to_camera[0] = bad.to_camera[2] = 0, bad.to_camera[1] = 1;
    g_assert_cmpint(ls_mirror_ball_map(&bad, 8, 4, map, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_mirror_ball_map(&good, 0, 4, map, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    rgb[3 * (80 * SIDE + 90)] = INFINITY;
    g_assert_cmpint(ls_mirror_ball_map(&good, 8, 4, map, NULL, NULL, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "(90, 80)"));
    rgb[3 * (80 * SIDE + 90)] = 0;
    rgb[0] = NAN; /* beside the ball: not looked at */
    g_assert_cmpint(ls_mirror_ball_map(&good, 8, 4, map, NULL, NULL, NULL), ==, LS_OK);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/mirror-ball/a-smooth-environment-comes-back",
                    test_a_smooth_environment_comes_back);
    g_test_add_func("/mirror-ball/a-spot-is-found-where-it-is", test_a_spot_is_found_where_it_is);
    g_test_add_func("/mirror-ball/a-single-pixel-keeps-its-energy",
                    test_a_single_pixel_keeps_its_energy);
    g_test_add_func("/mirror-ball/the-blind-cone-is-filled-and-marked",
                    test_the_blind_cone_is_filled_and_marked);
    g_test_add_func("/mirror-ball/what-lies-beside-the-ball-never-reaches-the-map",
                    test_what_lies_beside_the_ball_never_reaches_the_map);
    g_test_add_func("/mirror-ball/what-makes-no-sense-is-refused",
                    test_what_makes_no_sense_is_refused);
    return g_test_run();
}

/* Chrome probes in real photographs: twelve lights, two probes, against the directions published
 * with them. Skips where the photographs are not there. */
#include "core/chrome_ball.h"
#include "core/vec3.h"
#include "tests/core/shared_data.h"

#include <glib.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <jpeglib.h>

enum { LIGHTS = 12 };

/* light_directions.txt of PSBox (MIT licence, github.com/yxiong/PSBox, data folder): x right, y up,
 * z towards the camera; rounded to 1e-5. The mean of
 * both probes, each from the pixels above 250 of 255. */
static const double published[3][LIGHTS] = {
    {-0.34766, -0.23339, 0.01584, 0.26564, 0.32175, -0.21774, 0.20203, -0.12833, 0.18378, 0.22177,
     -0.21343, -0.13562},
    {0.07253, 0.35143, 0.38113, 0.15765, -0.03782, -0.17722, -0.23338, 0.21042, 0.19363, -0.30673,
     -0.31596, -0.18023},
    {0.93481, 0.90666, 0.92438, 0.95109, 0.94607, 0.95978, 0.95117, 0.96915, 0.96371, 0.92560,
     0.92446, 0.97423}};

/* Mean of the colours, [height][width]; NULL if there is no such file. */
static float *read_jpeg(const char *path, uint32_t *width, uint32_t *height)
{
    FILE *file = fopen(path, "rb");
    if (!file)
        return NULL;
    struct jpeg_decompress_struct jpeg;
    struct jpeg_error_mgr error;
    jpeg.err = jpeg_std_error(&error);
    jpeg_create_decompress(&jpeg);
    jpeg_stdio_src(&jpeg, file);
    jpeg_read_header(&jpeg, TRUE);
    jpeg_start_decompress(&jpeg);
    *width = jpeg.output_width;
    *height = jpeg.output_height;
    float *out = g_new(float, (size_t)*width **height);
    uint8_t *row = g_new(uint8_t, (size_t)*width * 3);
    g_assert_cmpint(jpeg.output_components, ==, 3);
    for (uint32_t y = 0; y < *height; y++) {
        jpeg_read_scanlines(&jpeg, &row, 1);
        for (uint32_t x = 0; x < *width; x++)
            out[(size_t)y * *width + x] = (float)(row[3 * x] + row[3 * x + 1] + row[3 * x + 2]) / 3;
    }
    jpeg_finish_decompress(&jpeg);
    jpeg_destroy_decompress(&jpeg);
    fclose(file);
    g_free(row);
    return out;
}

/* The circle that lies beside the photographs, marked by hand by their author: column, row counted
 * from the bottom (1 = middle of the first pixel) and radius. An outline cannot be found here: the
 * ball mirrors its surroundings up to its rim. */
static gboolean read_circle(const char *folder, double circle[3])
{
    char *path = g_build_filename(folder, "circle_data.txt", NULL), *text = NULL;
    gboolean ok = g_file_get_contents(path, &text, NULL, NULL) &&
                  sscanf(text, "%lf %lf %lf", &circle[0], &circle[1], &circle[2]) == 3;
    g_free(path);
    g_free(text);
    return ok;
}

/* A camera so far away that its rays are parallel to 0.01 degrees, and the ball in it. */
static struct ls_sphere_view *view_of(const double circle[3], uint32_t width, uint32_t height)
{
    const double far_m = 1000, radius_m = 0.1, eye[3] = {0, 0, far_m}, at[3] = {0};
    double metres = radius_m / circle[2]; /* per pixel */
    struct ls_sphere ball = {
        {(circle[0] - 0.5 - width / 2.0) * metres, (circle[1] - 0.5 - height / 2.0) * metres, 0},
        radius_m};
    struct ls_pinhole camera;
    struct ls_sphere_view *view = NULL;
    g_assert_cmpint(
        ls_pinhole_aim(eye, at, 1000, metres / far_m * 1000 * width, width, height, &camera, NULL),
        ==, LS_OK);
    g_assert_cmpint(ls_sphere_view_create(&camera, LS_CFA_NONE, &ball, NULL, 0, &view, NULL), ==,
                    LS_OK);
    return view;
}

static double off_deg(const double direction[3], int light)
{
    double truth[3] = {published[0][light], published[1][light], published[2][light]};
    double d[3], found[3] = {direction[0], direction[1], direction[2]};
    ls_unit3(truth);
    ls_unit3(found);
    ls_along3(found, truth, -1, d);
    return 2 * asin(0.5 * ls_length3(d)) * 180 / M_PI;
}

/* Adds the direction to @sum. */
static double look(const char *folder, const double circle[3], int light, double sum[3])
{
    uint32_t width = 0, height = 0;
    char name[32];
    snprintf(name, sizeof name, "Image_%02d.JPG", light + 1);
    char *path = g_build_filename(folder, name, NULL);
    float *picture = read_jpeg(path, &width, &height);
    g_assert_nonnull(picture);
    struct ls_sphere_view *view = view_of(circle, width, height);
    struct ls_highlight h;
    struct ls_diag diag = {{0}};
    enum ls_err err = ls_chrome_highlight(view, picture, INFINITY, &h, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    ls_along3(sum, h.direction, 1, sum);
    double off = off_deg(h.direction, light);
    g_test_message("%s: (%.3f, %.3f, %.3f): %.2f degrees, %u pixels", name, h.direction[0],
                   h.direction[1], h.direction[2], off, h.n);
    ls_sphere_view_destroy(view);
    g_free(picture);
    g_free(path);
    return off;
}

static void test_probes(void)
{
    static const char *const probes[2] = {"LightProbe-1", "LightProbe-2"};
    double sum = 0, of_both = 0, direction[LIGHTS][3] = {{0}};
    for (int k = 0; k < 2; k++) {
        char *name = g_build_filename("stacks", "psbox", probes[k], NULL);
        char *folder = shared_data(name);
        double circle[3];
        g_free(name);
        if (!folder)
            return; /* skipped, with a message */
        g_assert_true(read_circle(folder, circle));
        for (int i = 0; i < LIGHTS; i++)
            sum += look(folder, circle, i, direction[i]);
        g_free(folder);
    }
    for (int i = 0; i < LIGHTS; i++)
        of_both += off_deg(direction[i], i) / LIGHTS;
    g_test_message("off by %.2f degrees on average, the mean of both probes by %.2f",
                   sum / (2 * LIGHTS), of_both);
    g_assert_cmpfloat(sum / (2 * LIGHTS), <, 2);
    g_assert_cmpfloat(of_both, <, 1); /* what was published is a mean of both as well */
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/chrome/probes-in-photographs-give-the-published-directions", test_probes);
    return g_test_run();
}

/* Where the simulated lights stand. */
#include "sim/geometry.h"
#include "tests/core/shared_data.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>

static double total(const struct sim_geometry *g)
{
    double sum = 0;
    for (uint32_t i = 0; i < g->n_lights; i++)
        sum += g->omega_sr[i];
    return sum;
}

static void test_reference(void)
{
    struct sim_geometry g;
    uint32_t equator = 0, front = 0;
    g_assert_cmpint(sim_geometry_sphere(346, 1.35, &g, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < 346; i++) {
        const float *d = g.direction[i], *p = g.position_m[i];
        g_assert_cmpfloat(
            fabs(sqrt((double)p[0] * p[0] + (double)p[1] * p[1] + (double)p[2] * p[2]) - 1.35), <,
            1e-6);
        equator += fabsf(d[1]) < 1e-6f;
        front += d[2] > 0.999999f;
        g_assert_cmpfloat(d[1], >, -sin(71 * M_PI / 180));
        double nearest = 4;
        for (uint32_t j = 0; j < 346; j++) {
            const float *e = g.direction[j];
            if (i != j)
                nearest = fmin(nearest, acos(fmin(1, (double)d[0] * e[0] + (double)d[1] * e[1] +
                                                         (double)d[2] * e[2])));
        }
        g_assert_cmpfloat(nearest, >, 8 * M_PI / 180); /* evenly spread ... */
        g_assert_cmpfloat(nearest, <, 13 * M_PI / 180);
    }
    g_assert_cmpuint(equator, ==, 30);
    g_assert_cmpuint(front, ==, 1);
    g_assert_cmpfloat(fabs(total(&g) / (4 * M_PI) - 1), <, 1e-3); /* floats summed one by one */
    sim_geometry_finish(&g);
}

static void test_file(void)
{
    struct sim_geometry g;
    char *path = NULL;
    int fd = g_file_open_tmp("positions-XXXXXX.csv", &path, NULL);
    g_assert_cmpint(fd, >=, 0);
    g_close(fd, NULL);
    g_file_set_contents(path, "# left, up, away\n0,132,0\n-100,0,-50\n-100,0,-50\n", -1, NULL);
    g_assert_cmpint(sim_geometry_load(path, "left,up,away", "cm", &g, NULL), ==, LS_OK);
    g_assert_cmpuint(g.n_lights, ==, 3);
    g_assert_cmpfloat(fabs(g.position_m[1][0] - 1.0), <, 1e-6);
    g_assert_cmpfloat(fabs(g.position_m[1][2] - 0.5), <, 1e-6);
    g_assert_cmpfloat(g.omega_sr[1], ==, g.omega_sr[2]); /* coincident lights share a cell */
    g_assert_cmpfloat(g.omega_sr[1], >, 1);
    g_assert_cmpfloat(fabs(total(&g) / (4 * M_PI) - 1), <, 1e-3);
    sim_geometry_finish(&g);
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_geometry_load("/nowhere.csv", "left,up,away", "cm", &g, &diag), ==,
                    LS_ERR_NOT_FOUND);
    g_unlink(path);
    g_free(path);
}

static void test_measured_rig(void)
{
    struct sim_geometry g;
    char *path = shared_data("rig/ict_lightstage_x_346_positions_cm.csv");
    if (!path)
        return;
    g_assert_cmpint(sim_geometry_load(path, "left,up,away", "cm", &g, NULL), ==, LS_OK);
    g_assert_cmpuint(g.n_lights, ==, 346);
    g_assert_cmpfloat(fabs(g.position_m[0][1] - 1.3232), <, 1e-6);
    g_assert_cmpfloat(fabs(total(&g) / (4 * M_PI) - 1), <, 1e-3);
    sim_geometry_finish(&g);
    g_free(path);
}

static void test_nearest(void)
{
    struct sim_geometry g;
    g_assert_cmpint(sim_geometry_sphere(346, 1.35, &g, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < 346; i++)
        g_assert_cmpuint(sim_geometry_nearest(&g, g.direction[i]), ==, i);
    sim_geometry_finish(&g);
    g_assert_cmpint(sim_geometry_sphere(0, 1, &g, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(sim_geometry_sphere(12, NAN, &g, NULL), ==, LS_ERR_INVALID);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/geometry/the-reference-sphere-is-even-and-open-below", test_reference);
    g_test_add_func("/geometry/a-file-is-turned-into-the-stage-frame", test_file);
    g_test_add_func("/geometry/the-measured-rig-loads", test_measured_rig);
    g_test_add_func("/geometry/every-light-is-nearest-to-itself", test_nearest);
    return g_test_run();
}

/* smooth_cells: energy, smoothness and rotation on domes of every shape; the white furnace with
 * both kinds of cells. */
#include "core/envlights.h"
#include "core/smooth_cells.h"
#include "tests/core/maps.h"
#include "tests/core/shared_data.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MOST = 512 };

struct dome {
    const char *name;
    size_t n;
    float d[MOST][3];
};

static void add(struct dome *dome, double x, double y, double z)
{
    double length = sqrt(x * x + y * y + z * z);
    float *d = dome->d[dome->n++];
    d[0] = (float)(x / length), d[1] = (float)(y / length), d[2] = (float)(z / length);
}

static struct dome rings(double lowest_deg)
{
    struct dome dome = {.name = "rings"};
    dome.n = ring_dome(dome.d, lowest_deg);
    return dome;
}

static struct dome spiral(size_t n)
{
    struct dome dome = {.name = "spiral"};
    for (size_t i = 0; i < n; i++) {
        double y = 1 - 2 * ((double)i + 0.5) / (double)n, a = (double)i * M_PI * (3 - sqrt(5));
        add(&dome, sqrt(1 - y * y) * cos(a), y, sqrt(1 - y * y) * sin(a));
    }
    return dome;
}

static struct dome icosahedron(void)
{
    struct dome dome = {.name = "icosahedron"};
    double g = 0.5 * (1 + sqrt(5));
    for (int k = 0; k < 4; k++) {
        double a = k & 1 ? 1 : -1, b = k & 2 ? g : -g;
        add(&dome, 0, a, b), add(&dome, a, b, 0), add(&dome, b, 0, a);
    }
    return dome;
}

static struct dome few(size_t n)
{
    struct dome dome = {.name = "few"};
    for (size_t i = 0; i < n; i++)
        add(&dome, 0.3, 0.2 * (double)i, 1); /* in one plane with the centre, on one side */
    return dome;
}

/* pairs: 346 lights at 173 places */
static struct dome coincident(void)
{
    struct dome half = spiral(173), dome = {.name = "coincident"};
    for (size_t i = 0; i < half.n; i++)
        for (int twice = 0; twice < 2; twice++)
            add(&dome, (double)half.d[i][0], (double)half.d[i][1], (double)half.d[i][2]);
    return dome;
}

static size_t all_domes(struct dome *out)
{
    const struct dome domes[] = {rings(170),    rings(130),   rings(90),  rings(20), spiral(346),
                                 spiral(5),     few(1),       few(2),     few(3),    few(30),
                                 icosahedron(), coincident(), spiral(12), rings(60)};
    memcpy(out, domes, sizeof domes);
    return G_N_ELEMENTS(domes);
}

/* solid angles: what a constant map of 1 gives */
static enum ls_err cells_of(const void *d, size_t n, double *omega, struct ls_diag *diag)
{
    static const float one[3] = {1, 1, 1};
    static double weights[3 * MOST];
    const struct ls_map map = {.rgb = one, .width = 1, .height = 1};
    enum ls_err err = ls_smooth_cells_map(d, n, NULL, &map, weights, diag);
    for (size_t i = 0; i < n; i++)
        omega[i] = weights[3 * i];
    return err;
}

static void test_a_constant_map_is_four_pi_on_any_dome(void)
{
    static struct dome domes[32];
    static double omega[MOST];
    size_t n = all_domes(domes);
    for (size_t k = 0; k < n; k++) {
        struct ls_diag diag = {{0}};
        int err = cells_of(domes[k].d, domes[k].n, omega, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        /* 3e5 additions of doubles */
        g_assert_cmpfloat_with_epsilon(total(omega, domes[k].n, 1), 4 * M_PI, 1e-9);
        for (size_t i = 0; i < domes[k].n; i++)
            g_assert_cmpfloat(omega[i], >=, 0);
    }
}

static void test_equal_places_get_equal_light(void)
{
    static double omega[MOST];
    struct dome twelve = icosahedron(), pairs = coincident();
    g_assert_cmpint(cells_of(twelve.d, 12, omega, NULL), ==, LS_OK);
    for (int i = 0; i < 12; i++)
        /* parts of half a degree in a cell of 63: the rule's error */
        g_assert_cmpfloat_with_epsilon(omega[i] / (4 * M_PI / 12), 1, 1e-3);
    g_assert_cmpint(cells_of(pairs.d, pairs.n, omega, NULL), ==, LS_OK);
    for (size_t i = 0; i < pairs.n; i += 2) {
        g_assert_cmpfloat(omega[i], ==, omega[i + 1]);
        g_assert_cmpfloat(omega[i], >, 0);
    }
}

static void test_energy_of_any_map_is_kept(void)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    static const uint32_t sizes[][2] = {{1, 1}, {2, 1}, {7, 5}, {64, 33}, {301, 150}};
    static struct dome domes[32];
    static double w[3 * MOST];
    size_t n = all_domes(domes);
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < n; k++) {
        struct random_map m = random_map(rand, sizes[k % 5][0], sizes[k % 5][1]);
        double rotation[9];
        ls_rotation_y(g_rand_double_range(rand, -4, 4), rotation);
        g_assert_cmpint(ls_smooth_cells_map((const float(*)[3])domes[k].d, domes[k].n, rotation,
                                            &m.map, w, NULL),
                        ==, LS_OK);
        assert_energy_kept(w, domes[k].n, &m);
        g_free(m.rgb);
    }
}

/* the weights of a sun of energy 1 in one direction, by a lobe too narrow to matter */
static void sun(const struct dome *dome, const double d[3], double *w)
{
    struct ls_lobe lobe = {.direction = {d[0], d[1], d[2]}, .sharpness = 1e10, .radiance = 1};
    struct ls_lobes lobes = {.n = 1, .item = &lobe};
    lobe.radiance = 1 / ls_lobe_energy(&lobe);
    g_assert_cmpint(
        ls_smooth_cells_lobes((const float(*)[3])dome->d, dome->n, NULL, &lobes, w, NULL), ==,
        LS_OK);
    g_assert_cmpfloat_with_epsilon(total(w, dome->n, 1), 1, 1e-9);
}

static void test_a_moving_sun_fades_from_light_to_light(void)
{
    static double before[MOST], now[MOST];
    struct dome dome = rings(130);
    double step = 0.25 * M_PI / 180, largest = 0;
    for (int k = 0; k < 80; k++) {
        double t = 0.2 + k * step, d[3] = {sin(t) * 0.6, cos(t), sin(t) * 0.8};
        sun(&dome, d, now);
        for (size_t i = 0; i < dome.n && k > 0; i++)
            largest = fmax(largest, fabs(now[i] - before[i]));
        memcpy(before, now, sizeof now);
    }
    g_test_message("largest change of a weight per quarter degree: %.3f", largest);
    /* a share falls from 1 to 0 over a triangle's height, here at least 6 degrees (24 steps);
     * nearest cells would jump by 1 */
    g_assert_cmpfloat(largest, <, 1.0 / 20);
}

static void test_a_sun_on_a_light_is_that_light_and_one_between_is_between(void)
{
    static double w[MOST];
    struct dome dome = spiral(346);
    const double d[3] = {(double)dome.d[100][0], (double)dome.d[100][1], (double)dome.d[100][2]};
    sun(&dome, d, w);
    /* the lobe is 1e-5 rad wide */
    g_assert_cmpfloat_with_epsilon(w[100], 1, 1e-3);
    const double between[3] = {0.5 * (d[0] + (double)dome.d[121][0]),
                               0.5 * (d[1] + (double)dome.d[121][1]),
                               0.5 * (d[2] + (double)dome.d[121][2])};
    double length =
        sqrt(between[0] * between[0] + between[1] * between[1] + between[2] * between[2]);
    const double unit[3] = {between[0] / length, between[1] / length, between[2] / length};
    sun(&dome, unit, w);
    g_assert_cmpfloat_with_epsilon(w[100], 0.5, 1e-3); /* neighbours on the spiral, 21 apart */
    g_assert_cmpfloat_with_epsilon(w[121], 0.5, 1e-3);
}

static void test_a_million_times_brighter_texel_keeps_its_energy(void)
{
    enum { W = 256, H = 128 };
    g_autofree float *rgb = g_new0(float, 3 * W * H);
    static double w[3 * MOST];
    static struct dome domes[32];
    size_t n = all_domes(domes);
    static const uint32_t at[][2] = {{0, 0}, {255, 127}, {64, 40}, {190, 64}, {255, 63}};
    for (size_t k = 0; k < 5 * n; k++) {
        const struct dome *dome = &domes[k / 5];
        uint32_t x = at[k % 5][0], y = at[k % 5][1];
        struct ls_map map = {.rgb = rgb, .width = W, .height = H};
        float *texel = rgb + 3 * ((size_t)y * W + x);
        double sr = 2 * M_PI / W * (cos(M_PI * y / H) - cos(M_PI * (y + 1) / H));
        texel[0] = 1e6f;
        g_assert_cmpint(
            ls_smooth_cells_map((const float(*)[3])dome->d, dome->n, NULL, &map, w, NULL), ==,
            LS_OK);
        g_assert_cmpfloat_with_epsilon(total(w, dome->n, 3) / (1e6 * sr), 1, 1e-12);
        texel[0] = 0;
    }
}

static void test_turning_the_map_a_texel_equals_turning_by_its_angle(void)
{
    enum { W = 60, H = 30 };
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_autofree float *rgb = g_new0(float, 3 * W * H), *turned = g_new0(float, 3 * W * H);
    static double a[3 * MOST], b[3 * MOST];
    double rotation[9];
    struct dome dome = rings(150);
    g_test_message("seed %u", seed);
    for (uint32_t k = 0; k < 3 * W * H; k++)
        rgb[k] = (float)g_rand_double(rand);
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++)
            memcpy(turned + 3 * (y * W + (x + W - 7) % W), rgb + 3 * (y * W + x), 3 * sizeof *rgb);
    struct ls_map map = {.rgb = rgb, .width = W, .height = H};
    ls_rotation_y(2 * M_PI * 7 / W, rotation);
    g_assert_cmpint(ls_smooth_cells_map((const float(*)[3])dome.d, dome.n, rotation, &map, a, NULL),
                    ==, LS_OK);
    map.rgb = turned;
    g_assert_cmpint(ls_smooth_cells_map((const float(*)[3])dome.d, dome.n, NULL, &map, b, NULL), ==,
                    LS_OK);
    for (size_t i = 0; i < 3 * dome.n; i++)
        /* the same samples of the map meet the same triangles: rounding only, unless a sample
         * lies on an edge, where both sides agree */
        g_assert_cmpfloat_with_epsilon(a[i], b[i], 1e-9);
}

static void test_what_is_not_finite_is_refused(void)
{
    float rgb[3 * 4 * 2] = {0}, d[2][3] = {{0, 0, 1}, {0, NAN, 0}};
    struct ls_map map = {.rgb = rgb, .width = 4, .height = 2};
    double w[6];
    g_assert_cmpint(ls_smooth_cells_map((const float(*)[3])d, 2, NULL, &map, w, NULL), ==,
                    LS_ERR_INVALID);
    rgb[7] = INFINITY;
    g_assert_cmpint(ls_smooth_cells_map((const float(*)[3])d, 1, NULL, &map, w, NULL), ==,
                    LS_ERR_INVALID);
    g_assert_cmpint(cells_of(d, 0, w, NULL), ==, LS_ERR_INVALID);
}

/* the most that the brightness of a white Lambertian under constant radiance 1 is off, over
 * directions of its normal that see no hole */
static double furnace_error(const struct dome *dome, const double *omega)
{
    double worst = 0;
    for (int k = 0; k < 200; k++) {
        double y = 1 - 2 * (k + 0.5) / 200, a = k * 2.4, reads = 0;
        const double n[3] = {sqrt(1 - y * y) * cos(a), y, sqrt(1 - y * y) * sin(a)};
        for (size_t i = 0; i < dome->n; i++)
            reads += omega[i] *
                     fmax(0, n[0] * (double)dome->d[i][0] + n[1] * (double)dome->d[i][1] +
                                 n[2] * (double)dome->d[i][2]) /
                     M_PI;
        worst = fmax(worst, fabs(reads - 1));
    }
    return worst;
}

static void a_furnace(const struct dome *dome)
{
    static double nearest[MOST], smooth[MOST];
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])dome->d, dome->n, nearest, NULL), ==,
                    LS_OK);
    g_assert_cmpint(cells_of(dome->d, dome->n, smooth, NULL), ==, LS_OK);
    double a = furnace_error(dome, nearest), b = furnace_error(dome, smooth);
    g_test_message("%s, %zu lights: white reads 1 within %.2e (nearest), %.2e (smooth)", dome->name,
                   dome->n, a, b);
    /* what the method asks of the whole chain */
    g_assert_cmpfloat(a, <, 0.01);
    g_assert_cmpfloat(b, <, 0.01);
}

static void test_a_white_furnace_reads_white(void)
{
    struct dome even = spiral(346), pairs = coincident();
    a_furnace(&even);
    a_furnace(&pairs);
}

static void test_the_measured_rig_is_a_white_furnace_too(void)
{
    g_autofree char *path = shared_data("rig/ict_lightstage_x_346_positions_cm.csv"), *text = NULL;
    struct dome dome = {.name = "measured rig"};
    gsize bytes;
    if (!path)
        return;
    g_assert_true(g_file_get_contents(path, &text, &bytes, NULL));
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (char **line = lines; *line; line++) {
        double left, up, away;
        if (sscanf(*line, "%lf,%lf,%lf", &left, &up, &away) == 3)
            add(&dome, -left, up, -away);
    }
    g_assert_cmpuint(dome.n, ==, 346);
    static double smooth[MOST];
    g_assert_cmpint(cells_of(dome.d, dome.n, smooth, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(total(smooth, dome.n, 1), 4 * M_PI, 1e-9);
    static double nearest[MOST];
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])dome.d, dome.n, nearest, NULL), ==,
                    LS_OK);
    g_test_message("measured rig: white reads 1 within %.2e (nearest), %.2e (smooth)",
                   furnace_error(&dome, nearest), furnace_error(&dome, smooth));
    /* the hole below: its light comes from the rim, 20 degrees off */
    g_assert_cmpfloat(furnace_error(&dome, nearest), <, 0.02);
    g_assert_cmpfloat(furnace_error(&dome, smooth), <, 0.02);
}

/* the other kind of cells on the same domes, one light and coincident ones among them */
static void test_nearest_cells_keep_their_energy_on_any_dome_too(void)
{
    enum { W = 64, H = 32 };
    g_autofree float *rgb = g_new0(float, 3 * W * H);
    static struct dome domes[32];
    static double w[3 * MOST];
    size_t n = all_domes(domes);
    const double sr = 2 * M_PI / W * (cos(M_PI * 9 / H) - cos(M_PI * 10 / H));
    rgb[3 * (9 * W + 40)] = 1e6f;
    for (size_t k = 0; k < n; k++) {
        const float(*d)[3] = (const float(*)[3])domes[k].d;
        const struct ls_map map = {.rgb = rgb, .width = W, .height = H};
        g_assert_cmpint(ls_envlights_omega(d, domes[k].n, w, NULL), ==, LS_OK);
        g_assert_cmpfloat_with_epsilon(total(w, domes[k].n, 1), 4 * M_PI, 1e-9);
        g_assert_cmpint(ls_envlights_map(d, domes[k].n, NULL, &map, w, NULL), ==, LS_OK);
        g_assert_cmpfloat_with_epsilon(total(w, domes[k].n, 3) / (1e6 * sr), 1, 1e-12);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/smooth-cells/a-constant-map-is-four-pi-on-any-dome",
                    test_a_constant_map_is_four_pi_on_any_dome);
    g_test_add_func("/smooth-cells/equal-places-get-equal-light",
                    test_equal_places_get_equal_light);
    g_test_add_func("/smooth-cells/energy-of-any-map-is-kept", test_energy_of_any_map_is_kept);
    g_test_add_func("/smooth-cells/a-moving-sun-fades-from-light-to-light",
                    test_a_moving_sun_fades_from_light_to_light);
    g_test_add_func("/smooth-cells/a-sun-on-a-light-is-that-light-and-one-between-is-between",
                    test_a_sun_on_a_light_is_that_light_and_one_between_is_between);
    g_test_add_func("/smooth-cells/a-million-times-brighter-texel-keeps-its-energy",
                    test_a_million_times_brighter_texel_keeps_its_energy);
    g_test_add_func("/smooth-cells/turning-the-map-a-texel-equals-turning-by-its-angle",
                    test_turning_the_map_a_texel_equals_turning_by_its_angle);
    g_test_add_func("/smooth-cells/what-is-not-finite-is-refused",
                    test_what_is_not_finite_is_refused);
    g_test_add_func("/envlights/nearest-cells-keep-their-energy-on-any-dome-too",
                    test_nearest_cells_keep_their_energy_on_any_dome_too);
    g_test_add_func("/furnace/white-reads-white-with-either-cells",
                    test_a_white_furnace_reads_white);
    g_test_add_func("/furnace/the-measured-rig-reads-white-too",
                    test_the_measured_rig_is_a_white_furnace_too);
    return g_test_run();
}

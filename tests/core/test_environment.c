#include "core/envlights.h"
#include "tests/core/maps.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static void test_cells_partition_the_sphere(void)
{
    float d[512][3];
    double omega[512];
    for (double lowest = 30; lowest <= 170; lowest += 70) {
        size_t n = ring_dome(d, lowest);
        g_assert_cmpint(ls_envlights_omega((const float(*)[3])d, n, omega, NULL), ==, LS_OK);
        /* 1e6 additions of doubles; the requirement is 1e-6 */
        g_assert_cmpfloat_with_epsilon(total(omega, n, 1), 4 * M_PI, 1e-9);
        for (size_t i = 0; i < n; i++)
            g_assert_cmpfloat(omega[i], >, 0);
    }
}

static void test_a_cell_s_solid_angle_is_right(void)
{
    /* a cube's six faces: each sees 4 pi / 6; turned, so that no border follows the grid */
    const double r[3][3] = {{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}};
    float d[6][3];
    double omega[6];
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 3; k++)
            d[i][k] = (float)(r[i / 2][k] * (i % 2 ? -3 : 3)); /* any length */
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])d, 6, omega, NULL), ==, LS_OK);
    for (int i = 0; i < 6; i++)
        /* straight cuts of 4e-3 rad and four corners of 4e-4 rad */
        g_assert_cmpfloat_with_epsilon(omega[i], 4 * M_PI / 6, 2e-6);
}

static void test_holes_and_single_lights(void)
{
    float one[1][3] = {{0, 0, 2}}, poles[3][3] = {{0, 1, 0}, {0, -1, 0}, {0, 1, 0}};
    double omega[3];
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])one, 1, omega, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(omega[0], 4 * M_PI, 1e-12);
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])poles, 3, omega, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(omega[0], M_PI, 1e-6); /* shared by the coincident pair */
    g_assert_cmpfloat(omega[0], ==, omega[2]);
    g_assert_cmpfloat_with_epsilon(omega[1], 2 * M_PI, 1e-6);
    one[0][2] = 0;
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])one, 1, omega, NULL), ==, LS_ERR_INVALID);
    one[0][2] = NAN;
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])one, 1, omega, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])one, 0, omega, NULL), ==, LS_ERR_INVALID);
}

static void test_energy_of_any_map_is_kept(void)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    static const uint32_t sizes[][2] = {{1, 1}, {2, 1}, {7, 5}, {64, 33}, {301, 150}};
    float d[512][3];
    static double w[3 * 512];
    size_t n = ring_dome(d, 130);
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < G_N_ELEMENTS(sizes); k++) {
        struct random_map m = random_map(rand, sizes[k][0], sizes[k][1]);
        double rotation[9];
        ls_rotation_y(g_rand_double_range(rand, -4, 4), rotation);
        g_assert_cmpint(ls_envlights_map((const float(*)[3])d, n, rotation, &m.map, w, NULL), ==,
                        LS_OK);
        assert_energy_kept(w, n, &m);
        g_free(m.rgb);
    }
}

static void test_a_sun_of_one_texel_keeps_its_energy_and_its_place(void)
{
    enum { W = 256, H = 128 };
    g_autofree float *rgb = g_new0(float, 3 * W * H);
    float d[512][3];
    static double w[3 * 512];
    size_t n = ring_dome(d, 130);
    static const uint32_t at[][2] = {{0, 0}, {255, 127}, {64, 40}, {65, 41}, {190, 64}, {255, 63}};
    for (size_t k = 0; k < G_N_ELEMENTS(at); k++) {
        uint32_t x = at[k][0], y = at[k][1];
        struct ls_map map = {.rgb = rgb, .width = W, .height = H};
        float *texel = rgb + 3 * ((size_t)y * W + x);
        double sr = 2 * M_PI / W * (cos(M_PI * y / H) - cos(M_PI * (y + 1) / H)), sun[3];
        texel[0] = 1e6f;
        g_assert_cmpint(ls_envlights_map((const float(*)[3])d, n, NULL, &map, w, NULL), ==, LS_OK);
        g_assert_cmpfloat_with_epsilon(total(w, n, 3) / (1e6 * sr), 1, 1e-12);
        ls_latlong_direction((x + 0.5) / W, (y + 0.5) / H, sun);
        for (size_t i = 0; i < n; i++) {
            double cosine = sun[0] * d[i][0] + sun[1] * d[i][1] + sun[2] * d[i][2], best = -1;
            for (size_t j = 0; j < n; j++)
                best = fmax(best, sun[0] * d[j][0] + sun[1] * d[j][1] + sun[2] * d[j][2]);
            /* a light that gets some of it is within a texel's diagonal of being nearest */
            if (w[3 * i] > 0)
                g_assert_cmpfloat(acos(fmin(1, cosine)), <, acos(fmin(1, best)) + 0.07);
        }
        texel[0] = 0;
    }
}

static void test_a_light_on_the_right_is_lit_from_the_map_s_right_half(void)
{
    enum { W = 64, H = 32 };
    g_autofree float *rgb = g_new0(float, 3 * W * H);
    const float d[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    double w[18], rotation[9];
    for (uint32_t y = 12; y < 20; y++)
        for (uint32_t x = 46; x < 50; x++) /* u = 3/4: +x, camera-right */
            rgb[3 * (y * W + x)] = 1;
    struct ls_map map = {.rgb = rgb, .width = W, .height = H};
    g_assert_cmpint(ls_envlights_map(d, 6, NULL, &map, w, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(w[0], total(w, 6, 3), 1e-12); /* mirrored, it would be w[3] */
    g_assert_cmpfloat(w[0], >, 0.1);
    ls_rotation_y(M_PI / 2, rotation); /* right-handed about y: +x goes to -z, behind */
    g_assert_cmpint(ls_envlights_map(d, 6, rotation, &map, w, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(w[15], total(w, 6, 3), 1e-12);
}

static void test_turning_the_map_a_texel_equals_turning_by_its_angle(void)
{
    enum { W = 60, H = 30 };
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_autofree float *rgb = g_new0(float, 3 * W * H), *turned = g_new0(float, 3 * W * H);
    float d[512][3];
    static double a[3 * 512], b[3 * 512];
    double rotation[9];
    size_t n = ring_dome(d, 150);
    g_test_message("seed %u", seed);
    for (uint32_t k = 0; k < 3 * W * H; k++)
        rgb[k] = (float)g_rand_double(rand);
    /* +y takes +x (u = 3/4) to -z (u = 1/2): columns move to the left */
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++)
            memcpy(turned + 3 * (y * W + (x + W - 7) % W), rgb + 3 * (y * W + x), 3 * sizeof *rgb);
    struct ls_map map = {.rgb = rgb, .width = W, .height = H};
    ls_rotation_y(2 * M_PI * 7 / W, rotation);
    g_assert_cmpint(ls_envlights_map((const float(*)[3])d, n, rotation, &map, a, NULL), ==, LS_OK);
    map.rgb = turned;
    g_assert_cmpint(ls_envlights_map((const float(*)[3])d, n, NULL, &map, b, NULL), ==, LS_OK);
    for (size_t i = 0; i < 3 * n; i++)
        /* borders are cut in other places: 1e-4 of a cell of 0.04 sr */
        g_assert_cmpfloat_with_epsilon(a[i], b[i], 4e-6);
}

static void test_a_map_that_is_not_finite_is_refused_by_texel(void)
{
    float rgb[3 * 4 * 2] = {0};
    const float d[1][3] = {{0, 0, 1}};
    struct ls_map map = {.rgb = rgb, .width = 4, .height = 2};
    struct ls_diag diag = {{0}};
    double w[3];
    rgb[3 * 6 + 1] = INFINITY;
    g_assert_cmpint(ls_envlights_map(d, 1, NULL, &map, w, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "(2, 1)"));
    rgb[3 * 6 + 1] = -3; /* negative is allowed: nothing is clamped */
    g_assert_cmpint(ls_envlights_map(d, 1, NULL, &map, w, &diag), ==, LS_OK);
    g_assert_cmpfloat(w[1], <, 0);
    map.width = 0;
    g_assert_cmpint(ls_envlights_map(d, 1, NULL, &map, w, &diag), ==, LS_ERR_INVALID);
}

/* A mirrored map, or one turned by half, fails here. */
static void test_the_middle_of_a_map_is_behind_the_subject(void)
{
    static const struct {
        double u, v, d[3];
    } known[] = {{0.5, 0.5, {0, 0, -1}}, {0.75, 0.5, {1, 0, 0}}, {0.25, 0.5, {-1, 0, 0}},
                 {0, 0.5, {0, 0, 1}},    {1, 0.5, {0, 0, 1}},    {0.3, 0, {0, 1, 0}},
                 {0.3, 1, {0, -1, 0}}};
    const float lights[2][3] = {{0.8f, 0.6f, 0}, {-0.8f, 0.6f, 0}};
    float rgb[3 * 4 * 2] = {0};
    const struct ls_map map = {.rgb = rgb, .width = 4, .height = 2};
    double d[3], w[6];
    for (size_t k = 0; k < G_N_ELEMENTS(known); k++) {
        ls_latlong_direction(known[k].u, known[k].v, d);
        for (int i = 0; i < 3; i++)
            g_assert_cmpfloat_with_epsilon(d[i], known[k].d[i], 1e-15);
    }
    rgb[3 * 2] = 7; /* u in [0.5, 0.75), v in [0, 0.5): up, behind, to the right */
    g_assert_cmpint(ls_envlights_map(lights, 2, NULL, &map, w, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(w[0] + w[3], 7 * M_PI / 2, 1e-12); /* a quarter of a half */
    g_assert_cmpfloat(w[3], <, 1e-4 * w[0]); /* the cells' border is the texel's, followed so far */
}

/* --- lobes --- */

static struct ls_lobes *parse(const char *text, enum ls_err expected, const char *word)
{
    struct ls_lobes *lobes = NULL;
    struct ls_diag diag = {{0}};
    g_autofree char *exact = g_memdup2(text, strlen(text));
    g_assert_cmpint(ls_lobes_parse_json(exact, strlen(text), &lobes, &diag), ==, expected);
    g_assert_cmpint(lobes != NULL, ==, expected == LS_OK);
    if (word)
        g_assert_nonnull(strstr(diag.text, word));
    return lobes;
}

#define LOBE(direction, sharpness, nm, value)                                        \
    "{\"format\":1,\"lobes\":[{\"direction\":" direction ",\"sharpness\":" sharpness \
    ",\"radiance\":2,\"spectrum\":{\"wavelength_nm\":" nm ",\"value\":" value "}}]}"

static void test_lobes_are_read(void)
{
    struct ls_lobes *lobes = parse(LOBE("[0,0,2]", "3", "[400,500]", "[1,3]"), LS_OK, NULL);
    const double ahead[3] = {0, 0, 1}, aside[3] = {1, 0, 0};
    g_assert_cmpuint(lobes->n, ==, 1);
    g_assert_cmpfloat(lobes->item[0].direction[2], ==, 1);
    g_assert_cmpfloat_with_epsilon(lobes->item[0].spectrum.v[14], 2, 1e-12); /* 450 nm */
    g_assert_cmpfloat_with_epsilon(ls_lobe_radiance(&lobes->item[0], ahead), 2, 1e-12);
    g_assert_cmpfloat_with_epsilon(ls_lobe_radiance(&lobes->item[0], aside), 2 * exp(-3), 1e-12);
    ls_lobes_destroy(lobes);
}

static void test_bad_lobes_are_refused_with_a_sentence(void)
{
    parse("", LS_ERR_INVALID, "line");
    parse("{", LS_ERR_INVALID, "line");
    parse("[]", LS_ERR_INVALID, "format");
    parse("{\"format\":2,\"lobes\":[]}", LS_ERR_UNSUPPORTED, "format 2");
    parse("{\"format\":1,\"format\":1}", LS_ERR_INVALID, "duplicate");
    parse("{\"format\":1,\"lobes\":[]}", LS_ERR_INVALID, "lobes");
    parse("{\"format\":1,\"lobes\":{}}", LS_ERR_INVALID, "lobes");
    parse("{\"format\":1,\"lobes\":[3]}", LS_ERR_INVALID, "lobe 0");
    parse(LOBE("[0,0]", "3", "[400]", "[1]"), LS_ERR_INVALID, "direction");
    parse(LOBE("[0,0,0]", "3", "[400]", "[1]"), LS_ERR_INVALID, "direction");
    parse(LOBE("[0,0,\"1\"]", "3", "[400]", "[1]"), LS_ERR_INVALID, "direction");
    parse(LOBE("[0,0,1]", "-1", "[400]", "[1]"), LS_ERR_INVALID, "sharpness");
    parse(LOBE("[0,0,1]", "1e999", "[400]", "[1]"), LS_ERR_INVALID, "");
    parse(LOBE("[0,0,1]", "1", "[400,400]", "[1,1]"), LS_ERR_INVALID, "ascend");
    parse(LOBE("[0,0,1]", "1", "[400,500]", "[1]"), LS_ERR_INVALID, "equal length");
    parse(LOBE("[0,0,1]", "1", "[400]", "[-1]"), LS_ERR_INVALID, "value");
    parse(LOBE("[0,0,1]", "1", "[]", "[]"), LS_ERR_INVALID, "equal length");
    g_autofree char *deep = g_strnfill(100000, '[');
    parse(deep, LS_ERR_INVALID, "line");
}

static void test_every_truncation_of_lobes_is_refused(void)
{
    const char *text = LOBE("[0,0,1]", "1", "[400]", "[1]");
    for (size_t bytes = 0; bytes < strlen(text); bytes++) {
        g_autofree char *cut = g_memdup2(text, bytes + 1);
        struct ls_lobes *lobes = NULL;
        g_assert_cmpint(ls_lobes_parse_json(cut, bytes, &lobes, NULL), !=, LS_OK);
        g_assert_null(lobes);
    }
}

static void test_a_lobe_keeps_its_energy_at_any_sharpness(void)
{
    static const double sharpness[] = {0, 1e-12, 0.5, 10, 1e3, 1e6, 1e12};
    float d[512][3];
    static double w[512];
    size_t n = ring_dome(d, 130);
    for (size_t k = 0; k < G_N_ELEMENTS(sharpness); k++) {
        double s = sharpness[k];
        struct ls_lobe lobe = {.direction = {0.6, 0.64, 0.48}, .sharpness = s, .radiance = 3};
        struct ls_lobes lobes = {.n = 1, .item = &lobe};
        double exact = 3 * 2 * M_PI * (s < 1e-9 ? 2 : -expm1(-2 * s) / s);
        g_assert_cmpint(ls_envlights_lobes((const float(*)[3])d, n, NULL, &lobes, w, NULL), ==,
                        LS_OK);
        g_assert_cmpfloat_with_epsilon(total(w, n, 1) / exact, 1, 1e-9);
    }
}

static void test_a_lobe_s_cells_match_a_rendered_map(void)
{
    enum { W = 720, H = 360 };
    g_autofree float *rgb = g_new0(float, 3 * W * H);
    float d[512][3];
    static double w[512], m[3 * 512];
    double rotation[9];
    size_t n = ring_dome(d, 150);
    struct ls_lobe lobe = {.direction = {0.6, 0.64, 0.48}, .sharpness = 6, .radiance = 1};
    struct ls_lobes lobes = {.n = 1, .item = &lobe};
    struct ls_map map = {.rgb = rgb, .width = W, .height = H};
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            double at[3];
            ls_latlong_direction((x + 0.5) / W, (y + 0.5) / H, at);
            rgb[3 * (y * W + x)] = (float)ls_lobe_radiance(&lobe, at);
        }
    ls_rotation_y(0.3, rotation);
    g_assert_cmpint(ls_envlights_lobes((const float(*)[3])d, n, rotation, &lobes, w, NULL), ==,
                    LS_OK);
    g_assert_cmpint(ls_envlights_map((const float(*)[3])d, n, rotation, &map, m, NULL), ==, LS_OK);
    for (size_t i = 0; i < n; i++)
        /* half-degree texels stand for their centre: 1e-4 of a bright cell */
        g_assert_cmpfloat_with_epsilon(w[i], m[3 * i], 3e-6);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/envlights/cells-partition-the-sphere", test_cells_partition_the_sphere);
    g_test_add_func("/envlights/a-cell-s-solid-angle-is-right", test_a_cell_s_solid_angle_is_right);
    g_test_add_func("/envlights/holes-and-single-lights", test_holes_and_single_lights);
    g_test_add_func("/envlights/energy-of-any-map-is-kept", test_energy_of_any_map_is_kept);
    g_test_add_func("/envlights/a-sun-of-one-texel-keeps-its-energy-and-its-place",
                    test_a_sun_of_one_texel_keeps_its_energy_and_its_place);
    g_test_add_func("/envlights/a-light-on-the-right-is-lit-from-the-map-s-right-half",
                    test_a_light_on_the_right_is_lit_from_the_map_s_right_half);
    g_test_add_func("/envlights/turning-the-map-a-texel-equals-turning-by-its-angle",
                    test_turning_the_map_a_texel_equals_turning_by_its_angle);
    g_test_add_func("/envlights/a-map-that-is-not-finite-is-refused-by-texel",
                    test_a_map_that_is_not_finite_is_refused_by_texel);
    g_test_add_func("/environment/the-middle-of-a-map-is-behind-the-subject",
                    test_the_middle_of_a_map_is_behind_the_subject);
    g_test_add_func("/environment/lobes-are-read", test_lobes_are_read);
    g_test_add_func("/environment/bad-lobes-are-refused-with-a-sentence",
                    test_bad_lobes_are_refused_with_a_sentence);
    g_test_add_func("/environment/every-truncation-of-lobes-is-refused",
                    test_every_truncation_of_lobes_is_refused);
    g_test_add_func("/envlights/a-lobe-keeps-its-energy-at-any-sharpness",
                    test_a_lobe_keeps_its_energy_at_any_sharpness);
    g_test_add_func("/envlights/a-lobe-s-cells-match-a-rendered-map",
                    test_a_lobe_s_cells_match_a_rendered_map);
    return g_test_run();
}

/* captured: charts under environments whose spectra are known. */
#include "core/captured.h"
#include "core/environment.h"
#include "tests/core/lighting_once.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { PATCHES = 8, NEUTRALS = 2, CHARTS = 5 };

static const double normals[CHARTS][3] = {
    {0, 0, 1}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -0.8, -0.6}};
static const double neutral_reflectance[NEUTRALS] = {0.9, 0.36};

/** Patches 0 and 1 are neutral; a camera of three bells. */
struct world {
    struct ls_spectrum reflectance[PATCHES], sensitivity[3];
    struct ls_lobe lobe[2];
    struct ls_lobes lobes;
};

static double bell(int i, double centre, double width)
{
    return exp(-0.5 * pow((i - centre) / width, 2));
}

static struct world *a_world(void)
{
    struct world *world = g_new0(struct world, 1);
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        for (int p = 0; p < PATCHES; p++)
            world->reflectance[p].v[i] =
                p < NEUTRALS ? neutral_reflectance[p] : 0.05 + 0.8 * bell(i, 12 * (p - 1.5), 8);
        for (int c = 0; c < 3; c++)
            world->sensitivity[c].v[i] = bell(i, 45 - 15 * c, 6) / 75;
        world->lobe[0].spectrum.v[i] = i / 40.0;                                         /* warm */
        world->lobe[1].spectrum.v[i] = bell(i, 33, 2) + bell(i, 11, 2) + bell(i, 46, 2); /* lines */
    }
    world->lobe[0].direction[0] = -1;
    world->lobe[1].direction[0] = 1;
    world->lobe[0].sharpness = world->lobe[1].sharpness = 4;
    world->lobe[0].radiance = world->lobe[1].radiance = 1;
    world->lobes = (struct ls_lobes){.n = 2, .item = world->lobe};
    return world;
}

/* irradiance over pi on a normal, as one spectrum: 60000 directions of a spiral */
static void light_on(const struct world *world, const double normal[3], struct ls_spectrum *out)
{
    enum { N = 60000 };
    memset(out, 0, sizeof *out);
    for (int k = 0; k < N; k++) {
        double y = 1 - 2 * (k + 0.5) / N, a = k * M_PI * (3 - sqrt(5));
        const double d[3] = {sqrt(1 - y * y) * cos(a), y, sqrt(1 - y * y) * sin(a)};
        double cosine = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2];
        for (int l = 0; cosine > 0 && l < 2; l++) {
            double size = 4.0 / N * cosine * ls_lobe_radiance(&world->lobe[l], d);
            for (int i = 0; i < LS_SPECTRUM_N; i++)
                out->v[i] += size * world->lobe[l].spectrum.v[i];
        }
    }
}

static char *json_of(const struct world *world, const char *saturated)
{
    GString *json = g_string_new("{\"format\":1,\"ball\":{\"picture\":\"ball.exr\",\"centre_px\":"
                                 "[50,50],\"radius_px\":40,\"camera_direction\":[0,0,2],"
                                 "\"polariser\":\"vertical\"},\"neutrals\":[");
    for (int p = 0; p < NEUTRALS; p++)
        g_string_append_printf(json, "%s{\"patch\":%d,\"reflectance\":%g}", p ? "," : "", p,
                               neutral_reflectance[p]);
    g_string_append(json, "],\"charts\":[");
    for (int k = 0; k < CHARTS; k++) {
        struct ls_spectrum light;
        double p[PATCHES * 3];
        light_on(world, normals[k], &light);
        chart_reads(world->reflectance, PATCHES, world->sensitivity, 3, &light, p);
        g_string_append_printf(json, "%s{\"normal\":[%g,%g,%g],%s\"rgb\":[", k ? "," : "",
                               normals[k][0], normals[k][1], normals[k][2],
                               k == 0 && saturated ? saturated : "");
        for (int i = 0; i < PATCHES; i++)
            g_string_append_printf(json, "%s[%.12g,%.12g,%.12g]", i ? "," : "", p[3 * i],
                                   p[3 * i + 1], p[3 * i + 2]);
        g_string_append(json, "]}");
    }
    g_string_append(json, "]}");
    return g_string_free(json, FALSE);
}

static struct ls_captured *parse(const char *text, enum ls_err wanted, const char *word)
{
    struct ls_captured *captured = NULL;
    struct ls_diag diag = {{0}};
    g_autofree char *exact = g_memdup2(text, strlen(text) + 1);
    int err = ls_captured_parse_json(exact, strlen(text), &captured, &diag);
    if (wanted == LS_OK)
        g_assert_cmpstr(diag.text, ==, "");
    else
        g_assert_nonnull(strstr(diag.text, word));
    g_assert_cmpint(err, ==, wanted);
    g_assert_cmpint(captured != NULL, ==, wanted == LS_OK);
    return captured;
}

/* the largest difference of what the chart should read of @light in @direction, over what the
 * brightest neutral reads */
static double error_of(const struct ls_captured *captured, const struct world *world,
                       const struct ls_spectrum *light, const double direction[3])
{
    double cell[3], got[PATCHES * 3], p[PATCHES * 3], worst = 0;
    for (int c = 0; c < 3; c++)
        cell[c] = ls_spectrum_dot(light, &world->sensitivity[c]);
    g_assert_true(ls_captured_targets(captured, direction, cell, got));
    chart_reads(world->reflectance, PATCHES, world->sensitivity, 3, light, p);
    for (int k = 0; k < PATCHES * 3; k++)
        worst = fmax(worst, fabs(got[k] - p[k]) / p[k % 3]);
    return worst;
}

static void test_one_spectrum_is_read_exactly(void)
{
    struct world *world = a_world();
    world->lobe[1].spectrum = world->lobe[0].spectrum;
    g_autofree char *text = json_of(world, NULL);
    struct ls_captured *captured = parse(text, LS_OK, NULL);
    g_assert_cmpstr(captured->picture, ==, "ball.exr");
    g_assert_cmpstr(captured->polariser, ==, "vertical");
    g_assert_false(captured->has_reflectivity);
    for (int k = 0; k < 50; k++) {
        double y = 1 - 2 * (k + 0.5) / 50, a = 2.4 * k;
        const double d[3] = {sqrt(1 - y * y) * cos(a), y, sqrt(1 - y * y) * sin(a)};
        /* twelve digits of text */
        g_assert_cmpfloat(error_of(captured, world, &world->lobe[0].spectrum, d), <, 1e-10);
    }
    ls_captured_destroy(captured);
    g_free(world);
}

static void test_two_spectra_are_told_apart_by_direction(void)
{
    struct world *world = a_world();
    g_autofree char *text = json_of(world, NULL);
    struct ls_captured *captured = parse(text, LS_OK, NULL);
    const double left[3] = {-1, 0, 0}, right[3] = {1, 0, 0};
    double warm = error_of(captured, world, &world->lobe[0].spectrum, left);
    double lines = error_of(captured, world, &world->lobe[1].spectrum, right);
    double wrong = error_of(captured, world, &world->lobe[1].spectrum, left);
    g_test_message("error of a patch over white: %.4f and %.4f, with the other side's chart %.4f",
                   warm, lines, wrong);
    /* a chart sees its whole half of the world; the other lobe is behind it but for its flank of
     * exp(-4) */
    g_assert_cmpfloat(warm, <, 0.03);
    g_assert_cmpfloat(lines, <, 0.03);
    g_assert_cmpfloat(wrong, >, 4 * fmax(warm, lines));
    ls_captured_destroy(captured);
    g_free(world);
}

/* Of a direction between two charts: by the squares of their cosines. The neutrals are as bright on
 * both, so that the scale is 1. */
static void test_charts_weigh_as_the_squares_of_their_cosines(void)
{
    struct world *world = a_world();
    world->lobe[1].spectrum = world->lobe[0].spectrum;
    g_autofree char *text = json_of(world, NULL);
    struct ls_captured *captured = parse(text, LS_OK, NULL);
    const double between[3] = {0.6, 0, 0.8};
    double cell[3], got[PATCHES * 3];
    for (int k = 0; k < CHARTS; k++)
        for (int p = 0; p < PATCHES; p++)
            for (int c = 0; c < 3; c++)
                captured->chart[k].rgb[p][c] = p < NEUTRALS ? neutral_reflectance[p] : k + p + c;
    for (int c = 0; c < 3; c++)
        cell[c] = 0.36 + 0.64;
    g_assert_true(ls_captured_targets(captured, between, cell, got));
    for (int p = NEUTRALS; p < PATCHES; p++)
        for (int c = 0; c < 3; c++) /* charts 0 and 1: ahead and right */
            g_assert_cmpfloat_with_epsilon(got[3 * p + c], 0.64 * (p + c) + 0.36 * (1 + p + c),
                                           1e-12);
    ls_captured_destroy(captured);
    g_free(world);
}

static void test_a_saturated_neutral_is_left_out(void)
{
    struct world *world = a_world();
    world->lobe[1].spectrum = world->lobe[0].spectrum;
    g_autofree char *text = json_of(world, "\"saturated\":[0],");
    struct ls_captured *captured = parse(text, LS_OK, NULL);
    const double front[3] = {0, 0, 1};
    captured->chart[0].rgb[0][0] *= 0.5; /* clipped: it reads too little */
    captured->chart[0].rgb[0][1] *= 0.7;
    g_assert_cmpfloat(error_of(captured, world, &world->lobe[0].spectrum, front), <, 1e-10);
    ls_captured_destroy(captured);
    g_free(world);
}

static void test_where_no_chart_faces_the_nearest_is_taken_and_told(void)
{
    struct world *world = a_world();
    g_autofree char *text = json_of(world, NULL);
    struct ls_captured *captured = parse(text, LS_OK, NULL);
    const double right[3] = {1, 0, 0}, back[3] = {0, 0, -1}, cell[3] = {1, 2, 3};
    double a[PATCHES * 3], b[PATCHES * 3];
    captured->n_charts = 3; /* front, right, left */
    for (int k = 0; k < 3; k++)
        captured->chart[k].normal[2] = k == 0 ? 1 : 1e-3;
    g_assert_false(ls_captured_targets(captured, back, cell, a));
    captured->n_charts = 2; /* the right one stands alone where it faces */
    captured->chart[0].normal[0] = -1, captured->chart[0].normal[2] = 0;
    g_assert_true(ls_captured_targets(captured, right, cell, b));
    g_assert_cmpmem(a, sizeof a, b, sizeof b);
    for (int c = 0; c < 3; c++) /* scaled to the cell, channel by channel; twelve digits */
        g_assert_cmpfloat_with_epsilon(a[c], neutral_reflectance[0] * cell[c], 1e-9);
    captured->n_charts = CHARTS;
    ls_captured_destroy(captured);
    g_free(world);
}

static void replace_and_parse(const char *text, const char *from, const char *to, const char *word)
{
    g_autoptr(GString) changed = g_string_new(text);
    g_assert_cmpuint(g_string_replace(changed, from, to, 1), ==, 1);
    parse(changed->str, LS_ERR_INVALID, word);
}

static void test_bad_files_are_refused_by_key(void)
{
    struct world *world = a_world();
    g_autofree char *text = json_of(world, NULL);
    g_autofree char *colour = json_of(world, "\"saturated\":[5],");
    g_autofree char *both = json_of(world, "\"saturated\":[0,1],");
    g_assert_true(ls_captured_is(text, strlen(text)));
    g_assert_false(ls_captured_is("{\"lobes\":[]}", 12));
    g_assert_false(ls_captured_is("[", 1));
    parse("", LS_ERR_INVALID, "line");
    parse("[]", LS_ERR_INVALID, "format");
    parse("{\"format\":2}", LS_ERR_UNSUPPORTED, "format 2");
    parse(colour, LS_ERR_INVALID, "patch 5");
    parse(both, LS_ERR_INVALID, "no neutral");
    replace_and_parse(text, "\"picture\":\"ball.exr\"", "\"picture\":3", "picture");
    replace_and_parse(text, "[50,50]", "[50]", "centre_px");
    replace_and_parse(text, "\"radius_px\":40", "\"radius_px\":-1", "radius_px");
    replace_and_parse(text, "[0,0,2]", "[0,0,0]", "camera_direction");
    replace_and_parse(text, "\"vertical\"", "\"slanted\"", "polariser");
    replace_and_parse(text, "\"polariser\"", "\"blind_deg\":91,\"polariser\"", "blind_deg");
    replace_and_parse(text, "\"polariser\"", "\"reflectivity\":[1,2,1],\"polariser\"",
                      "reflectivity");
    replace_and_parse(text, "\"patch\":1", "\"patch\":8", "patch");
    replace_and_parse(text, "\"normal\":[1,0,0]", "\"normal\":[0,0,0]", "normal");
    replace_and_parse(text, "\"rgb\":[[", "\"rgb\":[[1,1,1],[", "patches");
    for (size_t bytes = 0; bytes < strlen(text); bytes += 1 + strlen(text) / 300) {
        struct ls_captured *captured = NULL;
        g_assert_cmpint(ls_captured_parse_json(text, bytes, &captured, NULL), !=, LS_OK);
        g_assert_null(captured);
    }
    g_free(world);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/captured/one-spectrum-is-read-exactly", test_one_spectrum_is_read_exactly);
    g_test_add_func("/captured/two-spectra-are-told-apart-by-direction",
                    test_two_spectra_are_told_apart_by_direction);
    g_test_add_func("/captured/charts-weigh-as-the-squares-of-their-cosines",
                    test_charts_weigh_as_the_squares_of_their_cosines);
    g_test_add_func("/captured/a-saturated-neutral-is-left-out",
                    test_a_saturated_neutral_is_left_out);
    g_test_add_func("/captured/where-no-chart-faces-the-nearest-is-taken-and-told",
                    test_where_no_chart_faces_the_nearest_is_taken_and_told);
    g_test_add_func("/captured/bad-files-are-refused-by-key", test_bad_files_are_refused_by_key);
    return g_test_run();
}

/* The calibration's JSON: round trip, and input from people who mean harm or mistyped. */
#include "core/calibration.h"

#include <glib.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct ls_spectral_table ramp(uint32_t rows)
{
    struct ls_spectral_table t = {.start_nm = 380, .step_nm = 5, .n = 3, .rows = rows};
    t.v = g_new(float, rows * 3);
    for (uint32_t i = 0; i < rows * 3; i++)
        t.v[i] = 0.1f + (float)i / 7;
    return t;
}

static struct ls_calibration *sample(uint32_t n_colours)
{
    struct ls_calibration *c = NULL;
    g_assert_cmpint(ls_calibration_create(5, 2, n_colours, &c, NULL), ==, LS_OK);
    strcpy(c->channels[0].name, "W");
    strcpy(c->channels[1].name, "V");
    c->channels[1].polariser = true;
    c->channels[0].spectrum = ramp(1);
    for (uint32_t i = 0; i < 5; i++) {
        c->position_m[i][1] = c->direction[i][1] = 1;
        c->omega_sr[i] = 2.5132741f;
        c->k[i] = 1 + (float)i / 3;
        c->k[5 + i] = 1.3f;
        c->sigma_k[i] = 0.01f;
    }
    c->patterns = g_new0(struct ls_calibration_pattern, 1);
    c->n_patterns = 1;
    c->patterns[0] = (struct ls_calibration_pattern){1, "sphere", 728.0 / 65535, 1.2118};
    c->scale = 0.00229183118;
    for (uint32_t k = 0; k < n_colours; k++)
        c->p[0][k] = c->p[1][k] = 0.76f;
    c->n_patches = 2;
    c->patch_names = g_malloc0(2 * sizeof *c->patch_names);
    strcpy(c->patch_names[0], "white");
    strcpy(c->patch_names[1], "black \"2\"");
    c->reflectance = ramp(2);
    c->L = g_new(float, 2 * n_colours * 2);
    for (uint32_t i = 0; i < 2 * n_colours * 2; i++)
        c->L[i] = (float)i / 3;
    c->camera = (struct ls_calibration_camera){.black_dn = 64,
                                               .full_scale_dn = 4095,
                                               .electrons_per_dn = 2.56,
                                               .read_noise_dn = 1.95,
                                               .exposure_offset_us = 13.7,
                                               .range_low = 0.125,
                                               .range_high = 0.75,
                                               .n_hot = 1};
    c->camera.sensitivity = ramp(n_colours);
    c->camera.hot = g_malloc0(sizeof *c->camera.hot);
    c->camera.hot[0][0] = 185;
    c->camera.hot[0][1] = 44;
    strcpy(c->camera.cfa, n_colours == 1 ? "mono" : "RG");
    strcpy(c->camera.pixel_format, "BayerRG12");
    c->has_m = n_colours == 3;
    for (int r = 0; r < 3 && c->has_m; r++)
        c->m[r][r] = 1.75;
    return c;
}

/* What a measured calibration has besides. */
static void measure(struct ls_calibration *c)
{
    g_assert_cmpint(ls_calibration_add_measured(c, NULL), ==, LS_OK);
    c->flags[3] = LS_LIGHT_ONE_SIDED | LS_LIGHT_DEAD;
    c->flags[4] = LS_LIGHT_UNCERTAIN;
    c->measured_direction[2][0] = 0.6f;
    c->measured_direction[2][1] = 0.8f;
    c->sigma_direction_deg[2] = 0.17f;
    g_assert_cmpint(ls_calibration_add_polarisation(c, 2, NULL), ==, LS_OK);
    c->a_v[7] = 0.9f;
    c->a_h[9] = -0.1f;
    c->k_colour = g_new(float, 10 * c->n_colours);
    for (uint32_t i = 0; i < 10 * c->n_colours; i++)
        c->k_colour[i] = 1 + (float)i / 1000;
    c->has_mirror = true;
    for (uint32_t k = 0; k < c->n_colours; k++)
        c->mirror_reflectivity[k] = 0.625;
    g_assert_cmpint(ls_calibration_put_residual(c, "outline", 1, "px", NULL), ==, LS_OK);
    g_assert_cmpint(ls_calibration_put_residual(c, "share", 0.5, "", NULL), ==, LS_OK);
    g_assert_cmpint(ls_calibration_put_residual(c, "outline", 0.04, "px", NULL), ==, LS_OK);
    strcpy(c->provenance.date, "2030-01-02T03:04:05Z");
    strcpy(c->provenance.software, "lightstaged 0.1.0");
    c->provenance.n_takes = 1;
    strcpy(c->provenance.takes[0].subject, "grey sphere");
    strcpy(c->provenance.takes[0].take, "t-1");
}

static char *text_of(uint32_t n_colours)
{
    struct ls_calibration *c = sample(n_colours);
    char *text = NULL;
    g_assert_cmpint(ls_calibration_write(c, &text, NULL), ==, LS_OK);
    ls_calibration_destroy(c);
    return text;
}

static void round_trip(uint32_t n_colours)
{
    struct ls_calibration *a = sample(n_colours), *b = NULL;
    struct ls_diag diag = {{0}};
    char *text = text_of(n_colours), *again = NULL;
    g_assert_null(strstr(text, "residuals")); /* what was not measured leaves no key */
    free(text);
    measure(a);
    g_assert_cmpint(ls_calibration_write(a, &text, NULL), ==, LS_OK);
    enum ls_err err = ls_calibration_parse(text, strlen(text), &b, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpuint(b->n_lights, ==, 5);
    g_assert_cmpuint(b->n_colours, ==, n_colours);
    g_assert_true(b->channels[1].polariser && !b->channels[0].polariser);
    g_assert_cmpuint(b->channels[1].spectrum.n, ==, 0);
    g_assert_cmpmem(a->k, 10 * sizeof(float), b->k, 10 * sizeof(float));
    g_assert_cmpmem(a->L, 4 * n_colours * sizeof(float), b->L, 4 * n_colours * sizeof(float));
    g_assert_cmpmem(a->reflectance.v, 6 * sizeof(float), b->reflectance.v, 6 * sizeof(float));
    g_assert_cmpstr(b->patch_names[1], ==, "black \"2\"");
    g_assert_cmpuint(b->camera.hot[0][0], ==, 185);
    g_assert_cmpint(ls_calibration_channel(b, "V"), ==, 1);
    g_assert_cmpint(ls_calibration_channel(b, "R"), ==, -1);
    g_assert_cmpfloat(ls_calibration_factor(b, 1, "sphere", 0.0111), ==, 1.2118);
    g_assert_cmpfloat(ls_calibration_factor(b, 1, "sphere", 0.02), ==, 0);
    g_assert_cmpfloat(ls_calibration_factor(b, 0, "sphere", 0.0111), ==, 0);
    g_assert_true(b->has_m == (n_colours == 3));
    g_assert_cmpmem(a->flags, 5, b->flags, 5);
    g_assert_cmpmem(a->k_colour, 10 * n_colours * sizeof(float), b->k_colour,
                    10 * n_colours * sizeof(float));
    g_assert_cmpmem(a->measured_direction, 15 * sizeof(float), b->measured_direction,
                    15 * sizeof(float));
    g_assert_cmpuint(b->n_polarised, ==, 2);
    g_assert_cmpfloat(b->a_v[7], ==, 0.9f);
    g_assert_cmpfloat(b->a_h[9], ==, -0.1f);
    g_assert_cmpfloat(b->mirror_reflectivity[n_colours - 1], ==, 0.625);
    g_assert_cmpuint(b->n_residuals, ==, 2);
    g_assert_cmpfloat(b->residuals[0].value, ==, 0.04);
    g_assert_cmpstr(b->provenance.takes[0].take, ==, "t-1");
    g_assert_cmpint(ls_calibration_write(b, &again, NULL), ==, LS_OK);
    g_assert_cmpstr(text, ==, again);
    free(text);
    free(again);
    ls_calibration_destroy(a);
    ls_calibration_destroy(b);
}

static void test_round_trip(void)
{
    round_trip(3);
    round_trip(1);
}

/* Replace the value at a dotted path ("k.W.2": keys and indices) by @value; "" removes it. */
static char *changed(const char *path, const char *value)
{
    struct ls_calibration *c = sample(3);
    char *text = NULL;
    measure(c);
    g_assert_cmpint(ls_calibration_write(c, &text, NULL), ==, LS_OK);
    ls_calibration_destroy(c);
    json_t *root = json_loads(text, 0, NULL), *at = root;
    char **keys = g_strsplit(path, ".", -1);
    guint n = g_strv_length(keys);
    for (guint i = 0; i + 1 < n; i++)
        at = json_is_array(at) ? json_array_get(at, (size_t)atoi(keys[i]))
                               : json_object_get(at, keys[i]);
    g_assert_nonnull(at);
    json_t *new = *value ? json_loads(value, JSON_DECODE_ANY, NULL) : NULL;
    if (json_is_array(at))
        json_array_set_new(at, (size_t)atoi(keys[n - 1]), new);
    else if (new)
        json_object_set_new(at, keys[n - 1], new);
    else
        json_object_del(at, keys[n - 1]);
    free(text);
    text = json_dumps(root, 0);
    json_decref(root);
    g_strfreev(keys);
    return text;
}

static void test_wrong_values(void)
{
    static const struct {
        const char *path, *value, *named;
        enum ls_err err;
    } cases[] = {
        {"format", "2", "format", LS_ERR_UNSUPPORTED},
        {"format", "", "format", LS_ERR_INVALID},
        {"lights.position_m", "[]", "lights.position_m", LS_ERR_INVALID},
        {"lights.position_m.3", "[1, 2]", "lights.position_m[3]", LS_ERR_INVALID},
        {"lights.direction.2", "[0, 2, 0]", "lights.direction[2]", LS_ERR_INVALID},
        {"lights.omega_sr.4", "-1", "lights.omega_sr[4]", LS_ERR_INVALID},
        {"channels", "{}", "channels", LS_ERR_INVALID},
        {"channels.1.name", "\"W\"", "channels[1].name", LS_ERR_INVALID},
        {"channels.1.name", "\"a name much longer than fits\"", "channels[1].name", LS_ERR_INVALID},
        {"channels.1.kind", "\"laser\"", "channels[1].kind", LS_ERR_INVALID},
        {"channels.0.spectrum.step_nm", "0", "channels[0].spectrum.step_nm", LS_ERR_INVALID},
        {"channels.0.spectrum.values", "[1]", "channels[0].spectrum.values", LS_ERR_INVALID},
        {"k.W", "[1, 1, 1, 1]", "k.W", LS_ERR_INVALID},
        {"k.W.2", "0", "k.W[2]", LS_ERR_INVALID},
        {"k.V.0", "\"1\"", "k.V[0]", LS_ERR_INVALID},
        {"sigma_k", "", "sigma_k", LS_ERR_INVALID},
        {"p.V", "[1, 1]", "p.V", LS_ERR_INVALID},
        {"pattern_factors.0.channel", "\"X\"", "pattern_factors[0].channel", LS_ERR_INVALID},
        {"pattern_factors.0.factor", "-1", "pattern_factors[0].factor", LS_ERR_INVALID},
        {"scale", "0", "scale", LS_ERR_INVALID},
        {"chart.names", "[]", "chart.names", LS_ERR_INVALID},
        {"chart.reflectance.values", "[[1, 2]]", "chart.reflectance.values", LS_ERR_INVALID},
        {"chart", "", "L", LS_ERR_INVALID},
        {"L.1", "[[1, 1]]", "L[1]", LS_ERR_INVALID},
        {"camera.full_scale_dn", "1e9", "camera.full_scale_dn", LS_ERR_INVALID},
        {"camera.range", "[0.9, 0.1]", "camera.range", LS_ERR_INVALID},
        {"camera.cfa", "\"mono\"", "camera.cfa", LS_ERR_INVALID},
        {"camera.hot_pixels.0", "[1.5, 2]", "camera.hot_pixels[0][0]", LS_ERR_INVALID},
        {"camera", "", "camera", LS_ERR_INVALID},
        {"M.1", "[1, 2]", "M[1]", LS_ERR_INVALID},
        {"lights.flags", "[]", "lights.flags", LS_ERR_INVALID},
        {"lights.flags.dead", "[5]", "lights.flags.dead[0]", LS_ERR_INVALID},
        {"lights.flags.dead", "[1.5]", "lights.flags.dead[0]", LS_ERR_INVALID},
        {"lights.flags.dead", "[1,1,1,1,1,1]", "lights.flags.dead", LS_ERR_LIMIT},
        {"lights.measured_direction.1", "[1, 1, 0]", "measured_direction[1]", LS_ERR_INVALID},
        {"lights.sigma_direction_deg.1", "-1", "sigma_direction_deg[1]", LS_ERR_INVALID},
        {"k_colour.V.4", "[1, 1]", "k_colour.V[4]", LS_ERR_INVALID},
        {"k_colour.V.4", "[1, 1, 0]", "k_colour.V[4][2]", LS_ERR_INVALID},
        {"polarisation", "[]", "polarisation", LS_ERR_INVALID},
        {"polarisation.a_v", "[]", "polarisation.a_v", LS_ERR_INVALID},
        {"polarisation.a_h", "[[1, 1, 1, 1, 1]]", "polarisation.a_h", LS_ERR_INVALID},
        {"polarisation.a_h.1.2", "1e9", "polarisation.a_h[1][2]", LS_ERR_INVALID},
        {"mirror_reflectivity", "[1]", "mirror_reflectivity", LS_ERR_INVALID},
        {"residuals.1.unit", "1", "residuals[1].unit", LS_ERR_INVALID},
        {"residuals.1.name", "\"\"", "residuals[1].name", LS_ERR_INVALID},
        {"provenance.takes.0.take", "", "provenance.takes[0].take", LS_ERR_INVALID},
        {"provenance.date", "7", "provenance.date", LS_ERR_INVALID},
        {"pattern_factors.0.sigma", "-1", "pattern_factors[0].sigma", LS_ERR_INVALID},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        char *text = changed(cases[i].path, cases[i].value);
        struct ls_calibration *c = NULL;
        struct ls_diag diag = {{0}};
        enum ls_err err = ls_calibration_parse(text, strlen(text), &c, &diag);
        g_test_message("%s = %s: %s", cases[i].path, cases[i].value, diag.text);
        g_assert_cmpint(err, ==, cases[i].err);
        g_assert_null(c);
        g_assert_nonnull(strstr(diag.text, cases[i].named));
        free(text);
    }
}

static void expect_refused(const char *text, size_t size)
{
    struct ls_calibration *c = NULL;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_calibration_parse(text, size, &c, &diag), !=, LS_OK);
    g_assert_cmpstr(diag.text, !=, "");
    g_assert_null(c);
}

static void test_hostile(void)
{
    char *text = text_of(3);
    for (size_t n = 0; n < strlen(text); n++)
        expect_refused(text, n);
    char *nested = g_malloc(200000);
    memset(nested, '[', 200000);
    expect_refused(nested, 200000);
    g_free(nested);
    static const char *const odd[] = {"",
                                      "null",
                                      "[]",
                                      "{\"format\": 1}",
                                      "{\"format\": 1, \"format\": 1}",
                                      "{\"format\": 1, \"lights\": 3, \"channels\": null}",
                                      "{\"format\": 1e400}",
                                      "\xff\xfe"};
    for (size_t i = 0; i < G_N_ELEMENTS(odd); i++)
        expect_refused(odd[i], strlen(odd[i]));
    free(text);
}

/* One byte replaced anywhere: accepted or refused with a sentence, never a crash. */
static void test_mangled(void)
{
    char *text = text_of(3);
    size_t size = strlen(text);
    guint32 seed = g_test_rand_int() == 0 ? 1 : (guint32)g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int i = 0; i < 3000; i++) {
        size_t at = (size_t)g_rand_int_range(rand, 0, (gint32)size);
        char kept = text[at];
        struct ls_calibration *c = NULL;
        struct ls_diag diag = {{0}};
        text[at] = (char)g_rand_int_range(rand, 0, 256);
        if (ls_calibration_parse(text, size, &c, &diag))
            g_assert_cmpstr(diag.text, !=, "");
        ls_calibration_destroy(c);
        text[at] = kept;
    }
    g_rand_free(rand);
    free(text);
}

static void test_uncalibrated(void)
{
    struct ls_calibration *c = sample(3);
    struct ls_diag diag = {{0}};
    g_assert_cmpfloat(ls_calibration_factor(c, 1, "sphere", 0.0111), ==, 1.2118);
    g_assert_cmpfloat(ls_calibration_factor(c, 1, "sphere", 0.01115), ==, 0); /* 0.4 % off */
    g_assert_cmpint(ls_calibration_lacks_factor(c, 1, "sphere", 0.02, &diag), ==, LS_ERR_NOT_FOUND);
    g_assert_nonnull(strstr(diag.text, "channel V, pattern sphere at duty 0.02"));
    g_assert_nonnull(strstr(diag.text, "0.011109"));
    ls_calibration_lacks_factor(c, 0, "headlight", 0.5, &diag);
    g_assert_nonnull(strstr(diag.text, "none"));
    struct ls_calibration_pattern p = {0, "headlight", 0.5, 1.01, 0.001};
    g_assert_cmpint(ls_calibration_put_factor(c, &p, &diag), ==, LS_OK);
    p.factor = 1.02;
    g_assert_cmpint(ls_calibration_put_factor(c, &p, &diag), ==, LS_OK);
    g_assert_cmpuint(c->n_patterns, ==, 2);
    g_assert_cmpfloat(ls_calibration_factor(c, 0, "headlight", 0.5), ==, 1.02);
    p.factor = NAN;
    g_assert_cmpint(ls_calibration_put_factor(c, &p, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_calibration_put_residual(c, "x", INFINITY, "", &diag), ==, LS_ERR_INVALID);
    ls_calibration_destroy(c);
}

static void test_not_finite(void)
{
    for (int which = 0; which < 12; which++) {
        struct ls_calibration *c = sample(3);
        char *text = NULL;
        measure(c);
        float *const at[] = {&c->k[1],
                             &c->sigma_k[9],
                             &c->omega_sr[4],
                             &c->position_m[2][1],
                             &c->p[1][2],
                             &c->channels[0].spectrum.v[2],
                             &c->reflectance.v[5],
                             &c->L[3],
                             &c->camera.sensitivity.v[4],
                             &c->measured_direction[1][0],
                             &c->k_colour[7],
                             &c->a_h[2]};
        *at[which] = which % 2 ? NAN : INFINITY;
        g_assert_cmpint(ls_calibration_write(c, &text, NULL), ==, LS_ERR_INVALID);
        g_assert_null(text);
        ls_calibration_destroy(c);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/calibration/comes-back-as-written", test_round_trip);
    g_test_add_func("/calibration/a-number-that-is-not-finite-is-never-left-out", test_not_finite);
    g_test_add_func("/calibration/a-wrong-value-is-refused-by-name", test_wrong_values);
    g_test_add_func("/calibration/a-pattern-without-a-factor-is-named-in-a-sentence",
                    test_uncalibrated);
    g_test_add_func("/calibration/cut-and-nested-text-is-refused", test_hostile);
    g_test_add_func("/calibration/mangled-text-never-crashes", test_mangled);
    return g_test_run();
}

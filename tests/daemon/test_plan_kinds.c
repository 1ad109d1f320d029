/* The kinds of a plan: which lights each picture shows, at which levels, under which name. */
#include "core/bases.h"
#include "core/segments.h"
#include "core/smooth_order.h"
#include "daemon/config.h"
#include "daemon/passes.h"
#include "daemon/plan.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

enum { LIGHTS = 346, FIRST_ADDRESS = 1000 };

struct fixture {
    char *dir;
    struct ls_config *config;
};

static void write_file(struct fixture *f, const char *name, const char *text)
{
    char *path = g_build_filename(f->dir, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    g_free(path);
}

static void setup(struct fixture *f, gconstpointer unused)
{
    struct ls_diag diag = {0};
    f->dir = g_dir_make_tmp("ls-plan-XXXXXX", NULL);
    GString *positions = g_string_new("");
    for (int i = 0; i < LIGHTS; i++) { /* a spiral from top to bottom; addresses backwards */
        double y = 1 - (2 * i + 1.0) / LIGHTS, r = sqrt(1 - y * y), a = i * 2.399963;
        g_string_append_printf(positions, "%.9f,%.9f,%.9f,%d\n", r * cos(a), y, r * sin(a),
                               FIRST_ADDRESS + LIGHTS - 1 - i);
    }
    write_file(f, "p.csv", positions->str);
    g_string_free(positions, TRUE);
    write_file(f, "rig.conf",
               "lights = { positions = \"p.csv\"; };\n"
               "channels = ( { name = \"W\"; }, { name = \"R\"; }, { name = \"V\"; kind = "
               "\"polariser\"; }, { name = \"H\"; kind = \"polariser\"; } );\n"
               "cameras = ( { address = \"127.0.0.1\"; pixel_format = \"BayerRG12\"; position_m = "
               "[0.0, 0.0, 1.5]; look_at_m = [0, 0, 0]; focal_length_mm = 50; sensor_mm = [11.3, "
               "11.3]; range = [0.1, 0.85]; black_dn = 64; full_scale_dn = 4095; max_fps = 72; } "
               ");\n");
    write_file(f, "daemon.conf",
               "storage = \"takes\"; socket = \"s.sock\"; rig = \"rig.conf\";\n"
               "controller = { address = \"127.0.0.1\"; port = 1502; };\n");
    char *path = g_build_filename(f->dir, "daemon.conf", NULL);
    if (ls_config_load(path, &f->config, &diag))
        g_error("%s", diag.text);
    g_free(path);
}

static void teardown(struct fixture *f, gconstpointer unused)
{
    const char *names[] = {"daemon.conf", "rig.conf", "p.csv"};
    ls_config_destroy(f->config);
    for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
        char *path = g_build_filename(f->dir, names[i], NULL);
        g_unlink(path);
        g_free(path);
    }
    g_rmdir(f->dir);
    g_free(f->dir);
}

static enum ls_err parse(struct fixture *f, const char *conditions, struct ls_plan **out,
                         struct ls_diag *diag)
{
    char *text = g_strdup_printf("subject = \"still\"; exposures_us = [100, 800]; darks = 2;\n"
                                 "reference = { every = 0; };\n"
                                 "conditions = ( %s );\n",
                                 conditions);
    enum ls_err err = ls_plan_parse(text, f->config, out, diag);
    g_free(text);
    return err;
}

static struct ls_plan *plan_of(struct fixture *f, const char *conditions)
{
    struct ls_diag diag = {0};
    struct ls_plan *plan = NULL;
    if (parse(f, conditions, &plan, &diag))
        g_error("%s", diag.text);
    return plan;
}

/* The lit conditions in order. */
static const struct ls_plan_condition *next_lit(const struct ls_plan *plan, uint32_t *at)
{
    while (*at < plan->n_conditions && plan->conditions[*at].dark)
        ++*at;
    return *at < plan->n_conditions ? &plan->conditions[(*at)++] : NULL;
}

static uint32_t row_of(const struct ls_led *led)
{
    return FIRST_ADDRESS + LIGHTS - 1 - led->light;
}

/* Level of every light of the rig under a condition. */
static void levels_of(const struct ls_plan_condition *c, uint16_t levels[LIGHTS])
{
    memset(levels, 0, LIGHTS * sizeof *levels);
    for (uint32_t i = 0; i < c->lights.n_leds; i++) {
        g_assert_cmpuint(c->lights.leds[i].channel, ==, c->channel);
        levels[row_of(&c->lights.leds[i])] = c->lights.leds[i].level;
    }
}

/* Mean angle from segment to segment, degrees. */
static double segment_step(float directions[LIGHTS][3], const uint32_t *segment,
                           const uint32_t order[14])
{
    float middle[14][3] = {{0}};
    for (int i = 0; i < LIGHTS; i++)
        for (int k = 0; k < 3; k++)
            middle[segment[i]][k] += directions[i][k];
    return ls_smooth_order_step((const float(*)[3])middle, 14, order) * 180 / G_PI;
}

static void test_segments(struct fixture *f, gconstpointer unused)
{
    struct ls_plan *plan =
        plan_of(f, "{ kind = \"segments\"; count = 14; channels = [\"W\", \"R\"]; }");
    float directions[LIGHTS][3];
    uint32_t segment[LIGHTS], order[14] = {0}, numbers[14], seen[2] = {0}, at = 0;
    uint16_t levels[LIGHTS];
    for (uint32_t g = 0; g < 14; g++)
        numbers[g] = g;
    for (int i = 0; i < LIGHTS; i++)
        memcpy(directions[i], f->config->lights[i].position_m, sizeof directions[i]);
    g_assert_cmpint(ls_segments_partition((const float(*)[3])directions, LIGHTS, 14, segment, NULL),
                    ==, LS_OK);
    for (uint16_t channel = 0; channel < 2; channel++)
        for (uint32_t g = 0; g < 14; g++) {
            const struct ls_plan_condition *c = next_lit(plan, &at);
            char *id = g_strdup_printf("segment-%c-%02u", "WR"[channel], c -> part);
            g_assert_cmpstr(c->id, ==, id);
            g_assert_cmpstr(c->pattern, ==, "segments-14");
            if (channel) /* the way back */
                g_assert_cmpuint(c->part, ==, order[13 - g]);
            order[g] = channel ? order[g] : c->part;
            g_assert_cmpuint(c->part, <, 14);
            seen[channel] |= 1u << c->part;
            g_assert_cmpuint(c->parts, ==, 14);
            g_assert_cmpint(c->channel, ==, channel);
            g_assert_cmpint(c->lights.kind, ==, LS_CONDITION_SEGMENT);
            g_assert_cmpuint(c->level, ==, 65535 / 25); /* 346 / 14, rounded up */
            levels_of(c, levels);
            for (int i = 0; i < LIGHTS; i++)
                g_assert_cmpuint(levels[i], ==, segment[i] == c->part ? c->level : 0);
            g_free(id);
        }
    g_assert_null(next_lit(plan, &at));
    g_assert_cmphex(seen[0], ==, 0x3fff);
    g_assert_cmphex(seen[1], ==, 0x3fff);
    /* even segments are some sqrt(4 pi / 14) = 54 degrees apart; by number they jump about */
    double by_number = segment_step(directions, segment, numbers);
    double step = segment_step(directions, segment, order);
    g_test_message("mean step %.1f degrees, by number %.1f", step, by_number);
    g_assert_cmpfloat(step, <, 1.2 * 54);
    g_assert_cmpfloat(by_number, >, step);
    ls_plan_destroy(plan);
}

static double cosine_to_camera(const struct fixture *f, uint32_t i)
{
    const float *p = f->config->lights[i].position_m;
    return p[2] / sqrt((double)p[0] * p[0] + (double)p[1] * p[1] + (double)p[2] * p[2]);
}

static void test_headlight(struct fixture *f, gconstpointer unused)
{
    struct ls_plan *plan =
        plan_of(f, "{ kind = \"headlight\"; channels = [\"R\"]; },"
                   "{ kind = \"headlight\"; channels = [\"W\"]; lights = [5, 9]; }");
    uint32_t at = 0, nearer = 0;
    uint16_t levels[LIGHTS];
    const struct ls_plan_condition *c = next_lit(plan, &at);
    g_assert_cmpstr(c->id, ==, "headlight-R");
    g_assert_cmpstr(c->pattern, ==, "headlight");
    levels_of(c, levels);
    double farthest = 1;
    for (uint32_t i = 0; i < LIGHTS; i++)
        if (levels[i])
            farthest = fmin(farthest, cosine_to_camera(f, i));
    for (uint32_t i = 0; i < LIGHTS; i++)
        nearer += cosine_to_camera(f, i) >= farthest;
    g_assert_cmpuint(nearer, ==, 3);
    g_assert_cmpuint(c->level, ==, 65535 / 3);
    c = next_lit(plan, &at);
    g_assert_cmpstr(c->pattern, ==, "headlight-2");
    levels_of(c, levels);
    g_assert_true(levels[5] && levels[9] && c->lights.n_leds == 2);
    ls_plan_destroy(plan);
}

static void test_multiplex(struct fixture *f, gconstpointer unused)
{
    struct ls_plan *plan = plan_of(f, "{ kind = \"multiplex\"; channels = [\"W\"]; }");
    uint32_t at = 0;
    uint16_t levels[LIGHTS];
    uint8_t on[347];
    for (uint32_t row = 0; row < 347; row++) {
        const struct ls_plan_condition *c = next_lit(plan, &at);
        char *id = g_strdup_printf("multiplex-W-%04u", row);
        g_assert_cmpstr(c->id, ==, id);
        g_assert_cmpstr(c->pattern, ==, "multiplex");
        g_assert_cmpuint(c->part, ==, row);
        g_assert_cmpuint(c->parts, ==, 347);
        ls_multiplex_row(347, row, on);
        levels_of(c, levels);
        for (int i = 0; i < LIGHTS; i++)
            g_assert_cmpuint(levels[i], ==, on[i] ? c->level : 0);
        g_free(id);
    }
    g_assert_null(next_lit(plan, &at));
    ls_plan_destroy(plan);
}

/* As bright as the current of a row of 174 lights allows; a level that the plan names stays. */
static void test_current(struct fixture *f, gconstpointer unused)
{
    static const struct {
        uint32_t current_ma;
        uint16_t level;
    } cases[] = {{300000, 65535}, {121800, 65535}, {121799, 65534}, {60900, 32767}, {0, 1}};
    for (size_t k = 0; k < G_N_ELEMENTS(cases); k++) {
        const struct ls_lights_info info = {.max_current_ma = cases[k].current_ma,
                                            .led_current_ma = 700};
        struct ls_plan *plan =
            plan_of(f, "{ kind = \"multiplex\"; channels = [\"W\", \"R\"]; },"
                       "{ kind = \"multiplex\"; channels = [\"V\"]; level = 9; },"
                       "{ kind = \"sphere\"; channels = [\"W\"]; }");
        uint32_t at = 0;
        uint16_t levels[LIGHTS];
        ls_plan_fit_current(plan, &info);
        for (uint32_t row = 0; row < 2 * 347; row++) {
            const struct ls_plan_condition *c = next_lit(plan, &at);
            uint64_t drawn = 0;
            g_assert_cmpuint(c->level, ==, cases[k].level);
            levels_of(c, levels);
            for (int i = 0; i < LIGHTS; i++) {
                g_assert_true(levels[i] == 0 || levels[i] == c->level);
                drawn += levels[i] * 700ull;
            }
            g_assert_true(k == 4 || drawn <= cases[k].current_ma * 65535ull);
        }
        for (uint32_t row = 0; row < 347; row++)
            g_assert_cmpuint(next_lit(plan, &at)->level, ==, 9);
        g_assert_cmpuint(next_lit(plan, &at)->level, ==, 65535 / 90);
        ls_plan_destroy(plan);
    }
}

static void test_harmonics(struct fixture *f, gconstpointer unused)
{
    struct ls_plan *plan =
        plan_of(f, "{ kind = \"harmonics\"; channels = [\"W\"]; degree = 3; },"
                   "{ kind = \"harmonics\"; channels = [\"R\"]; degree = 3; form "
                   "= \"biased\"; }");
    float directions[LIGHTS][3];
    double y[LIGHTS];
    uint32_t at = 0;
    uint16_t plus[LIGHTS], minus[LIGHTS], biased[LIGHTS];
    for (int i = 0; i < LIGHTS; i++)
        memcpy(directions[i], f->config->lights[i].position_m, sizeof directions[i]);
    uint32_t biased_at = 0;
    while (plan->conditions[biased_at].dark || plan->conditions[biased_at].channel != 1)
        biased_at++;
    for (uint32_t index = 0; index < 16; index++) {
        const struct ls_plan_condition *p = next_lit(plan, &at);
        const struct ls_plan_condition *n = index ? next_lit(plan, &at) : NULL;
        const struct ls_plan_condition *b = next_lit(plan, &biased_at);
        g_assert_cmpuint(p->part, ==, index);
        g_assert_cmpuint(p->parts, ==, 16);
        double peak =
            ls_harmonic_weights(index, LS_BASIS_BIASED, (const float(*)[3])directions, LIGHTS, y);
        levels_of(p, plus);
        memset(minus, 0, sizeof minus);
        if (n)
            levels_of(n, minus);
        levels_of(b, biased);
        for (int i = 0; i < LIGHTS; i++) {
            double f_i = ls_harmonic(index, directions[i]) / peak;
            /* each level is rounded by half a step at most */
            g_assert_cmpfloat(fabs((plus[i] - minus[i]) - f_i * p->level), <=, 0.5);
            g_assert_cmpfloat(fabs((2.0 * biased[i] - b->level) - f_i * b->level), <=, 1 + 1e-9);
        }
    }
    g_assert_cmpstr(plan->conditions[biased_at - 1].id, ==, "harmonic-R-15");
    g_assert_cmpstr(plan->conditions[biased_at - 1].pattern, ==, "harmonic-15");
    g_assert_cmpstr(plan->conditions[2].id, ==, "harmonic-W-00p");
    g_assert_cmpstr(plan->conditions[4].id, ==, "harmonic-W-01n");
    g_assert_cmpstr(plan->conditions[4].pattern, ==, "harmonic-01n");
    ls_plan_destroy(plan);
}

static void test_gradients(struct fixture *f, gconstpointer unused)
{
    struct ls_plan *plan = plan_of(f, "{ kind = \"gradients\"; channels = [\"W\"]; }");
    uint32_t at = 0;
    uint16_t levels[LIGHTS];
    for (int axis = 0; axis < 4; axis++) {
        const struct ls_plan_condition *c = next_lit(plan, &at);
        static const char *const ids[] = {"gradient-W-x", "gradient-W-y", "gradient-W-z",
                                          "gradient-W-full"};
        g_assert_cmpstr(c->id, ==, ids[axis]);
        levels_of(c, levels);
        for (int i = 0; i < LIGHTS; i++) {
            double w = axis < 3 ? 0.5 + 0.5 * f->config->lights[i].position_m[axis] : 1;
            /* half a step, and positions of nine digits */
            g_assert_cmpfloat(fabs(levels[i] - w * c->level), <=, 0.51);
        }
    }
    ls_plan_destroy(plan);
}

/* Every kind at once, in every channel, as one program of the reference controller. */
static void test_limits(struct fixture *f, gconstpointer unused)
{
    const struct ls_lights_info info = {.n_lights = FIRST_ADDRESS + LIGHTS,
                                        .n_channels = 8,
                                        .pwm_period_us = 50,
                                        .pwm_levels = 1000,
                                        .min_pulse_us = 50,
                                        .max_pulse_us = 500000,
                                        .min_period_us = 13888,
                                        .max_duty_permille = 500,
                                        .max_current_ma = 300000,
                                        .led_current_ma = 700,
                                        .max_conditions = 8192,
                                        .max_steps = 65536,
                                        .max_program_bytes = 4 << 20};
    static const char *const kinds[] = {
        "{ kind = \"each\"; channels = [\"W\", \"R\", \"V\", \"H\"]; }",
        "{ kind = \"segments\"; count = 26; channels = [\"W\", \"R\"]; }",
        "{ kind = \"headlight\"; channels = [\"W\", \"R\"]; }",
        "{ kind = \"multiplex\"; channels = [\"W\", \"R\", \"V\", \"H\"]; }",
        "{ kind = \"harmonics\"; degree = 9; channels = [\"W\"]; }",
        "{ kind = \"harmonics\"; degree = 9; form = \"biased\"; channels = [\"W\", \"R\"]; }",
        "{ kind = \"gradients\"; channels = [\"W\", \"R\"]; }"};
    for (size_t k = 0; k < G_N_ELEMENTS(kinds); k++) {
        struct ls_diag diag = {0};
        struct ls_plan *plan = plan_of(f, kinds[k]);
        struct ls_pass pass;
        g_assert_cmpint(ls_pass_init(&pass, plan, info.max_steps), ==, LS_OK);
        uint8_t *wanted = g_malloc(plan->n_steps);
        memset(wanted, 1, plan->n_steps);
        g_assert_cmpuint(ls_pass_fill(&pass, plan, &info, wanted, 0, false), ==, plan->n_steps);
        if (ls_lights_test(&info, &pass.program, &diag))
            g_error("%s: %s", kinds[k], diag.text);
        ls_pass_finish(&pass);
        g_free(wanted);
        ls_plan_destroy(plan);
    }
}

/* A white sphere before the first light, after every hundred shots and at the end. */
static void test_references(struct fixture *f, gconstpointer unused)
{
    static const struct {
        const char *text;
        uint32_t references, channels, every; /* conditions between */
        const char *last;
    } cases[] = {
        {"", 8, 1, 50, "reference-W-07"}, /* 692 shots */
        {"reference = { every = 691; };", 2, 1, 346, "reference-W-01"},
        {"reference = { every = 692; };", 0, 0, 0, NULL},
        {"reference = { every = 0; };", 0, 0, 0, NULL},
        {"reference = { every = 101; channels = [\"R\", \"W\"]; level = 5000; };", 8, 2, 51,
         "reference-W-07"},
    };
    for (size_t k = 0; k < G_N_ELEMENTS(cases); k++) {
        struct ls_diag diag = {0};
        struct ls_plan *plan = NULL;
        char *text = g_strdup_printf("subject = \"still\"; exposures_us = [100, 800]; darks = 2; "
                                     "%s conditions = ( { kind = \"each\"; channels = "
                                     "[\"R\"]; } );",
                                     cases[k].text);
        if (ls_plan_parse(text, f->config, &plan, &diag))
            g_error("%s", diag.text);
        uint32_t at = 0, lit = 0, since = 0, references = 0, watches = 0;
        for (uint32_t i = 0; i < plan->n_conditions; i++)
            watches += plan->conditions[i].watch;
        g_assert_cmpuint(watches, ==, LIGHTS / 50); /* references are not counted */
        for (const struct ls_plan_condition *c, *last = NULL; (c = next_lit(plan, &at)); last = c) {
            if (!c->reference) {
                lit++;
                since++;
                g_assert_true(cases[k].references == 0 || references > 0);
                g_assert_true(cases[k].references == 0 || since <= cases[k].every);
                continue;
            }
            g_assert_true(lit == 0 || lit == LIGHTS || since == cases[k].every || last->reference);
            references += !last || !last->reference;
            since = 0;
            g_assert_cmpint(c->lights.kind, ==, LS_CONDITION_SPHERE);
            g_assert_cmpstr(c->pattern, ==, "");
            g_assert_cmpuint(c->n_steps, ==, 2);
            g_assert_cmpuint(c->level, ==, cases[k].channels == 2 ? 5000 : 65535 / 90);
        }
        g_assert_cmpuint(lit, ==, LIGHTS);
        g_assert_cmpuint(references, ==, cases[k].references);
        if (cases[k].last)
            g_assert_cmpstr(plan->conditions[plan->n_conditions - 1].id, ==, cases[k].last);
        ls_plan_destroy(plan);
        g_free(text);
    }
}

static double mean_step(struct fixture *f, struct ls_plan *plan, uint32_t *lights)
{
    float directions[2 * LIGHTS][3];
    uint32_t order[2 * LIGHTS], n = 0, at = 0;
    for (const struct ls_plan_condition *c; (c = next_lit(plan, &at)); n++) {
        g_assert_cmpint(c->light, >=, 0);
        lights[n] = order[n] = (uint32_t)c->light;
        g_assert_cmpuint(n, <, 2 * LIGHTS);
        g_assert_cmpuint(row_of(&c->lights.leds[0]), ==, c->light);
        memcpy(directions[n], f->config->lights[c->light].position_m, sizeof directions[n]);
        order[n] = n;
    }
    g_assert_cmpuint(n, ==, 2 * LIGHTS);
    return ls_smooth_order_step((const float(*)[3])directions, n, order) * 180 / G_PI;
}

/* Neighbours follow each other, the second channel on the way back; the plan's text decides. */
static void test_order(struct fixture *f, gconstpointer unused)
{
    uint32_t smooth[2 * LIGHTS], again[2 * LIGHTS], given[2 * LIGHTS];
    struct ls_plan *a = plan_of(f, "{ kind = \"each\"; channels = [\"W\", \"R\"]; }");
    struct ls_plan *b = plan_of(f, "{ kind = \"each\"; channels = [\"W\", \"R\"]; }");
    struct ls_plan *c =
        plan_of(f, "{ kind = \"each\"; channels = [\"W\", \"R\"]; order = \"given\"; }");
    double step = mean_step(f, a, smooth), by_row = mean_step(f, c, given);
    g_test_message("mean step %.2f degrees, by row %.2f", step, by_row);
    g_assert_cmpfloat(step, <, 1.1 * 10.35); /* the nearest neighbours' mean distance */
    g_assert_cmpfloat(by_row, >, 50);
    mean_step(f, b, again);
    g_assert_cmpmem(smooth, sizeof smooth, again, sizeof again);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        g_assert_cmpuint(smooth[i], ==, smooth[2 * LIGHTS - 1 - i]);
        g_assert_cmpuint(given[i], ==, i);
    }
    ls_plan_destroy(a);
    ls_plan_destroy(b);
    ls_plan_destroy(c);
    uint32_t at = 0;
    a = plan_of(f, "{ kind = \"each\"; channels = [\"W\"]; lights = [9, 300, 2, 10]; }");
    g_assert_cmpint(next_lit(a, &at)->light, ==, 9);
    g_assert_cmpint(next_lit(a, &at)->light, ==, 300);
    ls_plan_destroy(a);
}

static void test_refusals(struct fixture *f, gconstpointer unused)
{
    static const char *const cases[][2] = {
        {"{ kind = \"segments\"; channels = [\"W\"]; }", "count: expected 1 to 346"},
        {"{ kind = \"segments\"; count = 347; channels = [\"W\"]; }",
         "count: 347: expected 0 to 346"},
        {"{ kind = \"segments\"; count = 3; lights = [1]; channels = [\"W\"]; }",
         "unknown key lights"},
        {"{ kind = \"sphere\"; count = 3; channels = [\"W\"]; }", "unknown key count"},
        {"{ kind = \"harmonics\"; degree = 10; channels = [\"W\"]; }",
         "degree: 10: expected 0 to 9"},
        {"{ kind = \"harmonics\"; level = 499; channels = [\"W\"]; }", "expected at least 500"},
        {"{ kind = \"gradients\"; level = 1; channels = [\"W\"]; }", "expected at least 500"},
        {"{ kind = \"harmonics\"; form = \"halves\"; channels = [\"W\"]; }",
         "\"pairs\" or \"biased\""},
        {"{ kind = \"headlight\"; lights = [4, 4]; channels = [\"W\"]; }", "light 4 stands twice"},
        {"{ kind = \"segments\"; count = 3; channels = [\"W\"]; },"
         "{ kind = \"segments\"; count = 2; channels = [\"W\"]; }",
         "segment-W-00 is asked for twice"},
        {"{ kind = \"each\"; order = \"random\"; channels = [\"W\"]; }", "\"smooth\" or \"given\""},
        {"{ kind = \"sphere\"; order = \"smooth\"; channels = [\"W\"]; }", "unknown key order"},
        {"{ kind = \"each\"; level = 9; channels = [\"W\"]; }", "photographed at 65535"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct ls_diag diag = {0};
        struct ls_plan *plan = NULL;
        g_assert_cmpint(parse(f, cases[i][0], &plan, &diag), ==, LS_ERR_INVALID);
        if (!strstr(diag.text, cases[i][1]))
            g_error("\"%s\" does not say \"%s\"", diag.text, cases[i][1]);
    }
}

static void test_factors(struct fixture *f, gconstpointer unused)
{
    struct ls_plan *plan =
        plan_of(f, "{ kind = \"each\"; lights = [3]; channels = [\"R\"]; },"
                   "{ kind = \"segments\"; count = 2; channels = [\"R\", \"W\"]; },"
                   "{ kind = \"sphere\"; channels = [\"R\"]; level = 700; }");
    struct ls_calibration_pattern patterns[] = {{1, "segments-2", 378 / 65535.0, 1.25},
                                                {1, "sphere", 728 / 65535.0, 1.2}};
    struct ls_calibration cal = {.n_channels = 2,
                                 .n_patterns = 2,
                                 .patterns = patterns,
                                 .channels = {{.name = "W"}, {.name = "R"}}};
    static const double expected[] = {1, 1.25, 1.25, 0, 0, 0};
    uint32_t at = 0;
    for (size_t i = 0; i < G_N_ELEMENTS(expected); i++)
        g_assert_cmpfloat(ls_plan_factor(next_lit(plan, &at), f->config, &cal), ==, expected[i]);
    ls_plan_destroy(plan);
}

#define ADD(sentence, function) \
    g_test_add("/plan-kinds/" sentence, struct fixture, NULL, setup, function, teardown)

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("segments-partition-the-lights", test_segments);
    ADD("a-head-light-is-the-three-lights-nearest-the-camera", test_headlight);
    ADD("multiplexing-shows-the-rows-of-the-s-matrix", test_multiplex);
    ADD("multiplexing-is-as-bright-as-the-current-allows", test_current);
    ADD("harmonics-come-in-pairs-or-biased", test_harmonics);
    ADD("gradients-follow-the-axes", test_gradients);
    ADD("every-kind-fits-the-reference-controller", test_limits);
    ADD("references-stand-every-hundred-shots", test_references);
    ADD("neighbouring-lights-follow-each-other", test_order);
    ADD("wrong-kinds-are-refused", test_refusals);
    ADD("a-pattern-or-level-without-a-factor-has-none", test_factors);
    return g_test_run();
}

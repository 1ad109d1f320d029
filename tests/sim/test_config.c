/* The simulator's configuration file: what it means, and what it refuses. */
#include "core/pixel.h"
#include "sim/config.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <string.h>

static enum ls_err load(const char *text, struct sim_config *config, struct ls_diag *diag)
{
    char *path = NULL;
    int fd = g_file_open_tmp("ls-config-XXXXXX", &path, NULL);
    g_assert_cmpint(fd, >=, 0);
    g_close(fd, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    enum ls_err err = sim_config_load(path, config, diag);
    g_unlink(path);
    g_free(path);
    return err;
}

static void test_empty(void)
{
    struct sim_config config, defaults;
    struct ls_diag diag = {0};
    g_assert_cmpint(load("", &config, &diag), ==, LS_OK);
    sim_config_defaults(&defaults);
    g_assert_cmpuint(config.scene.n_lights, ==, 346);
    g_assert_cmpuint(config.controller.n_lights, ==, 346);
    g_assert_cmpuint(config.controller.n_channels, ==, 8);
    g_assert_cmpuint(config.controller.pwm_levels, ==, config.scene.pwm_levels + 1);
    g_assert_cmpuint(config.scene.n_cameras, ==, 1);
    g_assert_cmpstr(config.cameras[0].address, ==, "127.0.0.2");
    g_assert_cmpmem(&config.scene, sizeof config.scene, &defaults.scene, sizeof defaults.scene);
    g_assert_cmpmem(&config.controller, sizeof config.controller, &defaults.controller,
                    sizeof defaults.controller);
}

static void test_values(void)
{
    static const char text[] =
        "scene = { scene = \"grey\"; seed = 7; lights = 12; radius_m = 2; pwm_levels = 255;\n"
        "  channels = ( { name = \"W\"; spectrum = \"white\"; droop = 1.2; },\n"
        "               { name = \"V\"; kind = \"vertical\"; spectrum = \"white\"; } ); };\n"
        "cameras = ( { address = \"127.0.0.9\"; width = 64; height = 32; cfa = \"GB\";\n"
        "              pixel_format = \"BayerGB12\"; position_m = [0.0, 1.0, 2.5]; },\n"
        "            { cfa = \"mono\"; exposure_offset_us = 3.5; } );\n"
        "controller = { heartbeat_ms = 250; port = 1502; };\n"
        "faults = ( { kind = \"stall\"; at = 5; value = 20; }, \n"
        "           { kind = \"drop_pulse\"; camera = 1; at = 4; count = 2; },\n"
        "           { kind = \"packet_loss\"; value = 0.01; seed = 3; } );\n"
        "log = \"shown.jsonl\";\n";
    struct sim_config config;
    struct ls_diag diag = {0};
    enum ls_err err = load(text, &config, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpstr(config.scene.scene, ==, "grey");
    g_assert_cmpuint(config.scene.seed, ==, 7);
    g_assert_cmpuint(config.controller.n_lights, ==, 12);
    g_assert_cmpuint(config.controller.n_channels, ==, 2);
    g_assert_cmpuint(config.controller.pwm_levels, ==, 256);
    g_assert_cmpint(config.scene.channels[1].kind, ==, SIM_CHANNEL_VERTICAL);
    g_assert_cmpuint(config.scene.n_cameras, ==, 2);
    g_assert_cmpstr(config.cameras[0].address, ==, "127.0.0.9");
    g_assert_cmpuint(config.cameras[0].sensor_width, ==, 64);
    g_assert_cmpuint(config.cameras[0].sensor_height, ==, 32);
    g_assert_cmpuint(config.cameras[0].pixel_format, ==, ls_pixel_by_name("BayerGB12")->code);
    g_assert_cmpfloat(config.scene.views[0].position_m[2], ==, 2.5);
    g_assert_cmpuint(config.cameras[1].pixel_format, ==, ls_pixel_by_name("Mono8")->code);
    g_assert_cmpfloat(config.cameras[1].exposure_offset_us, ==, 3.5);
    g_assert_cmpuint(config.cameras[1].index, ==, 1);
    g_assert_cmpuint(config.controller.heartbeat_ms, ==, 250);
    g_assert_cmpuint(config.controller.n_faults, ==, 1);
    g_assert_cmpint(config.controller.faults[0].kind, ==, SIM_CONTROLLER_STALL);
    g_assert_cmpuint(config.controller.faults[0].at, ==, 5);
    g_assert_cmpuint(config.cameras[1].faults.drop_pulse[0], ==, 4);
    g_assert_cmpuint(config.cameras[1].faults.drop_pulse[1], ==, 5);
    g_assert_cmpfloat(config.cameras[0].faults.packet_loss, ==, 0.01);
    char *log = g_build_filename(g_get_tmp_dir(), "shown.jsonl", NULL);
    g_assert_cmpstr(config.log, ==, log); /* in the file's folder */
    g_free(log);
}

static void test_kinds(void)
{
    static const char *const words[] = {"stall", "refuse", "disconnect", "interlock",
                                        "estop", "dead",   "corrupt"};
    for (int kind = 0; kind <= SIM_CONTROLLER_CORRUPT; kind++) {
        struct sim_config config;
        struct ls_diag diag = {0};
        char *text = g_strdup_printf("faults = ( { kind = \"%s\"; at = 1; } );", words[kind]);
        g_assert_cmpint(load(text, &config, &diag), ==, LS_OK);
        g_assert_cmpint(config.controller.faults[0].kind, ==, kind);
        g_free(text);
    }
}

static void test_refused(void)
{
    static const struct {
        const char *text, *line, *says;
    } wrong[] = {
        {"\nbogus = 1;", ":2:", "unknown key \"bogus\": expected one of: scene cameras"},
        {"scene = { scen = 1; };", ":1:", "unknown key \"scen\""},
        {"scene = {\n lights = 0; };", ":2:", "lights: expected a whole number in 1..4096"},
        {"scene = { lights = 3.5; };", ":1:", "lights: expected a whole number"},
        {"scene = { lights = \"many\"; };", ":1:", "lights: expected a whole number"},
        {"scene = { scene = \"foo\"; };", ":1:", "\"foo\": expected one of: stilllife"},
        {"scene = { replay_linear = 1; };", ":1:", "expected true or false"},
        {"scene = { gain_sigma = -0.1; };", ":1:", "gain_sigma: expected a number in 0..1"},
        {"scene = 3;", ":1:", "expected a group"},
        {"scene = { channels = ( { name = \"W\"; } ); };", ":1:", "a name and a spectrum"},
        {"scene = { channels = (); };", ":1:", "expected a list of 1..16"},
        {"cameras = { width = 8; };", ":1:", "expected a list of 1..4 groups"},
        {"cameras = ( { width = 17; } );", ":1:", "multiples of 4"},
        {"cameras = ( { position_m = [1, 2]; } );", ":1:", "three numbers in metres"},
        {"cameras = ( { pixel_format = \"Mono8\"; } );", ":1:", "expected a BayerRG... format"},
        {"cameras = ( { cfa = \"RGB\"; } );", ":1:", "cfa: \"RGB\": expected one of: RG"},
        {"controller = { max_duty_permille = 1001; };", ":1:", "1..1000"},
        {"controller = { serial = \"a serial that is longer than the register block\"; };",
         ":1:", "at most 31 characters"},
        {"faults = ( { at = 3; } );", ":1:", "fault without a kind"},
        {"faults = ( { kind = \"drop_puls\"; } );", ":1:", "expected one of: stall"},
        {"faults = ( { kind = \"drop_pulse\"; at = 0; } );", ":1:", "at = 1 or more"},
        {"faults = ( { kind = \"drop_pulse\"; at = 1; camera = 1; } );", ":1:", "expected 0..0"},
        {"faults = ( { kind = \"packet_loss\"; value = 2.0; } );", ":1:", "probability"},
        {"log = ;", ":1:", "syntax error"},
        {"log = 1;", ":1:", "log: expected a string"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++) {
        struct sim_config config;
        struct ls_diag diag = {0};
        g_assert_cmpint(load(wrong[i].text, &config, &diag), ==, LS_ERR_INVALID);
        if (!strstr(diag.text, wrong[i].says) || !strstr(diag.text, wrong[i].line))
            g_test_message("%s", diag.text);
        g_assert_nonnull(strstr(diag.text, wrong[i].line));
        g_assert_nonnull(strstr(diag.text, wrong[i].says));
    }
    struct sim_config config;
    struct ls_diag diag = {0};
    g_assert_cmpint(sim_config_load("/nonexistent", &config, &diag), ==, LS_ERR_NOT_FOUND);
}

/** The keys of a group, as its refusal lists them. */
static char **keys_of(const char *text)
{
    struct sim_config config;
    struct ls_diag diag = {0};
    g_assert_cmpint(load(text, &config, &diag), ==, LS_ERR_INVALID);
    const char *list = strstr(diag.text, "one of: ");
    g_assert_nonnull(list);
    return g_strsplit(list + strlen("one of: "), " ", -1);
}

static void test_documented(void)
{
    static const char *const groups[] = {"x_ = 1;",
                                         "scene = { x_ = 1; };",
                                         "scene = { channels = ( { x_ = 1; } ); };",
                                         "cameras = ( { x_ = 1; } );",
                                         "controller = { x_ = 1; };",
                                         "faults = ( { x_ = 1; } );",
                                         "faults = ( { kind = \"x_\"; } );"};
    char *path = g_build_filename(g_getenv("LS_SOURCE_ROOT"), "sim", "README.md", NULL);
    char *page = NULL;
    g_assert_true(g_file_get_contents(path, &page, NULL, NULL));
    for (size_t i = 0; i < G_N_ELEMENTS(groups); i++) {
        char **keys = keys_of(groups[i]);
        for (char **key = keys; *key; key++) {
            char *quoted = g_strdup_printf("`%s`", *key);
            if (!strstr(page, quoted))
                g_test_message("sim/README.md lacks %s", quoted);
            g_assert_nonnull(strstr(page, quoted));
            g_free(quoted);
        }
        g_strfreev(keys);
    }
    g_free(page);
    g_free(path);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/config/an-empty-file-is-the-reference-rig", test_empty);
    g_test_add_func("/config/every-group-is-read", test_values);
    g_test_add_func("/config/fault-words-name-their-faults", test_kinds);
    g_test_add_func("/config/wrong-input-is-refused-with-line-and-expectation", test_refused);
    g_test_add_func("/config/every-key-is-documented", test_documented);
    return g_test_run();
}

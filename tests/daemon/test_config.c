/* Configuration, rig and plan files: what is accepted, and how what is wrong is refused. */
#include "daemon/config.h"
#include "daemon/plan.h"
#include "core/positions.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

static const char daemon_conf[] = "storage = \"takes\"; socket = \"s.sock\"; rig = \"rig.conf\";\n"
                                  "controller = { address = \"127.0.0.1\"; port = 1502; };\n";
static const char camera_conf[] =
    "{ address = \"127.0.0.1\"; pixel_format = \"BayerRG12\"; position_m = [0.0, 0.0, 1.5];\n"
    "  look_at_m = [0, 0, 0]; focal_length_mm = 50; sensor_mm = [11.3, 11.3];\n"
    "  range = [0.1, 0.85]; black_dn = 64; full_scale_dn = 4095; max_fps = 72; }";
static const char positions[] = "# three lights\n0,1.35,0\n1.35,0,0,17\n1.35,0,0\n";

struct fixture {
    char *dir;
};

static void write_file(struct fixture *f, const char *name, const char *text)
{
    char *path = g_build_filename(f->dir, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    g_free(path);
}

static char *rig_text(const char *extra)
{
    return g_strdup_printf("name = \"test\";\nlights = { positions = \"p.csv\"; };\n"
                           "channels = ( { name = \"W\"; }, { name = \"R\"; }, { name = \"V\"; "
                           "kind = \"polariser\"; } );\ncameras = ( %s );\n%s",
                           camera_conf, extra);
}

static void setup(struct fixture *f, gconstpointer unused)
{
    f->dir = g_dir_make_tmp("ls-config-XXXXXX", NULL);
    char *rig = rig_text("");
    write_file(f, "daemon.conf", daemon_conf);
    write_file(f, "rig.conf", rig);
    write_file(f, "p.csv", positions);
    g_free(rig);
}

static void teardown(struct fixture *f, gconstpointer unused)
{
    const char *names[] = {"daemon.conf", "rig.conf", "p.csv"};
    for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
        char *path = g_build_filename(f->dir, names[i], NULL);
        g_unlink(path);
        g_free(path);
    }
    g_rmdir(f->dir);
    g_free(f->dir);
}

static struct ls_config *load(struct fixture *f, struct ls_diag *diag)
{
    struct ls_config *config = NULL;
    char *path = g_build_filename(f->dir, "daemon.conf", NULL);
    enum ls_err err = ls_config_load(path, &config, diag);
    g_assert_true((err == LS_OK) == (config != NULL));
    g_free(path);
    return config;
}

static void assert_refused(struct fixture *f, const char *sentence)
{
    struct ls_diag diag = {0};
    g_assert_null(load(f, &diag));
    if (!strstr(diag.text, sentence))
        g_error("\"%s\" does not say \"%s\"", diag.text, sentence);
}

static void test_good_files_load(struct fixture *f, gconstpointer unused)
{
    struct ls_diag diag = {0};
    struct ls_config *c = load(f, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpuint(c->n_lights, ==, 3);
    g_assert_cmpuint(c->lights[1].address, ==, 17);
    g_assert_cmpuint(c->lights[2].address, ==, 2);
    g_assert_cmpuint(c->n_channels, ==, 3);
    g_assert_true(c->channels[2].polariser);
    g_assert_cmpint(ls_config_channel(c, "R"), ==, 1);
    g_assert_cmpint(ls_config_channel(c, "X"), ==, -1);
    g_assert_true(g_str_has_prefix(c->storage, f->dir));
    g_assert_cmpuint(c->lights_driver.port, ==, 1502);
    g_assert_cmpint(c->cameras[0].driver.exposure, ==, LS_EXPOSURE_AUTO);
    ls_config_destroy(c);
}

static void test_the_work_light_is_a_channel_of_the_rig(struct fixture *f, gconstpointer unused)
{
    struct ls_diag diag = {0};
    char *text = g_strconcat(daemon_conf, "work_light = { channel = \"R\"; level = 900; };", NULL);
    write_file(f, "daemon.conf", text);
    g_free(text);
    struct ls_config *c = load(f, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpuint(c->work_channel, ==, 1);
    g_assert_cmpuint(c->work_level, ==, 900);
    ls_config_destroy(c);
}

static void test_who_may_come_is_read(struct fixture *f, gconstpointer unused)
{
    struct ls_diag diag = {0};
    char *text =
        g_strconcat(daemon_conf,
                    "access = { operator_uids = [0, 1000]; reader_gids = [44]; };\n"
                    "listen = { certificate = \"s.pem\"; key = \"/etc/s.key\"; authority = "
                    "\"a.pem\"; operators = [\"desk\"]; };",
                    NULL);
    struct ls_config *c = load(f, &diag);
    g_assert_null(c->listen.address); /* no port unless asked for */
    g_assert_false(c->access.listed);
    ls_config_destroy(c);
    write_file(f, "daemon.conf", text);
    g_free(text);
    c = load(f, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpstr(c->listen.address, ==, "127.0.0.1");
    g_assert_cmpuint(c->listen.port, ==, 7472);
    g_assert_true(g_str_has_prefix(c->listen.certificate, f->dir));
    g_assert_cmpstr(c->listen.key, ==, "/etc/s.key");
    g_assert_true(c->access.listed);
    const gid_t video[] = {44};
    g_assert_cmpint(ls_access_unix(&c->access, 1000, NULL, 0), ==, LS_ROLE_OPERATOR);
    g_assert_cmpint(ls_access_unix(&c->access, 1001, video, 1), ==, LS_ROLE_READER);
    g_assert_cmpint(ls_access_unix(&c->access, 1001, NULL, 0), ==, LS_ROLE_NONE);
    g_assert_cmpint(ls_access_certificate(&c->access, "desk"), ==, LS_ROLE_OPERATOR);
    ls_config_destroy(c);
}

static void test_wrong_keys_and_values_are_refused(struct fixture *f, gconstpointer unused)
{
    static const struct {
        const char *daemon, *sentence;
    } cases[] = {
        {"stroage = \"x\"; ", "unknown key stroage: expected one of storage, socket"},
        {"ring_slots = 3; ", "ring_slots: 3: expected 16 to 1024"},
        {"ring_slots = 16.5; ", "expected a whole number"},
        {"queue_bytes = 1000; ", "queue_bytes: 1000: expected"},
        {"retries = \"three\"; ", "retries: expected a number"},
        {"retries = ; ", "daemon.conf:"},
        {"merge_threads = 1e30; ", "merge_threads"},
        {"work_light = { channel = \"X\"; level = 9; }; ", "\"X\": the rig has no such channel"},
        {"work_light = { channel = \"R\"; }; ", "level"},
        {"work_light = { channel = \"R\"; level = 65536; }; ", "level: 65536: expected 1 to 65535"},
        {"listen = { port = 0; }; ", "certificate: missing"},
        {"listen = { certificate = \"c\"; authority = \"a\"; }; ", "key: missing"},
        {"listen = { certificate = \"c\"; key = \"k\"; }; ", "authority: missing"},
        {"listen = { certificate = \"c\"; key = \"k\"; authority = \"a\"; readers = [1]; }; ",
         "readers: expected common names"},
        {"access = { operator_uids = [\"root\"]; }; ", "expected numbers of users or groups"},
        {"access = { reader_uids = [-1]; }; ", "expected numbers of users or groups"},
        {"access = { readers = [1]; }; ", "unknown key readers"},
        {"max_connections = 0; ", "max_connections: 0: expected 1 to 4096"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        char *text = g_strconcat(daemon_conf, cases[i].daemon, NULL);
        write_file(f, "daemon.conf", text);
        assert_refused(f, cases[i].sentence);
        g_free(text);
    }
    write_file(f, "daemon.conf", "rig = \"rig.conf\";");
    assert_refused(f, "storage: missing");
}

static void test_without_a_stage_takes_are_only_served(struct fixture *f, gconstpointer unused)
{
    struct ls_diag diag = {0};
    write_file(f, "daemon.conf", "storage = \"takes\"; socket = \"s.sock\"; max_connections = 7;");
    struct ls_config *c = load(f, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpuint(c->n_lights, ==, 0);
    g_assert_cmpuint(c->n_cameras, ==, 0);
    g_assert_cmpuint(c->max_connections, ==, 7);
    ls_config_destroy(c);
    write_file(f, "daemon.conf", "storage = \"takes\"; socket = \"s.sock\"; ring_slots = 32;");
    assert_refused(f, "controller: missing");
    write_file(f, "daemon.conf",
               "storage = \"t\"; socket = \"s\"; controller = { address = \"a\"; };");
    assert_refused(f, "rig: missing");
}

static void test_wrong_rigs_are_refused_with_their_line(struct fixture *f, gconstpointer unused)
{
    char *rig = rig_text("camera = 1;");
    write_file(f, "rig.conf", rig);
    assert_refused(f, "rig.conf:7: unknown key camera");
    g_free(rig);
    rig = rig_text("");
    write_file(f, "rig.conf", rig);
    write_file(f, "p.csv", "0,1,0\nnan,0,1\n");
    assert_refused(f, "p.csv:2: expected x,y,z");
    write_file(f, "p.csv", "0,1,0\n0,0,0\n");
    assert_refused(f, "p.csv:2");
    write_file(f, "p.csv", "# nothing\n");
    assert_refused(f, "no lights in it");
    g_free(rig);
    write_file(f, "daemon.conf",
               "storage = \"t\"; socket = \"s\"; rig = \"none.conf\";\n"
               "controller = { address = \"a\"; };");
    assert_refused(f, "none.conf");
}

static void test_positions_are_converted_to_the_stage_frame(void)
{
    struct ls_diag diag = {0};
    struct ls_positions p;
    const char text[] = "10,20,30\n";
    g_assert_cmpint(
        ls_positions_parse(text, strlen(text), "t", "left,up,away", "cm", 10, &p, &diag), ==,
        LS_OK);
    /* exact up to the rounding of 0.01f */
    g_assert_cmpfloat_with_epsilon(p.xyz_m[0][0], -0.1f, 1e-7);
    g_assert_cmpfloat_with_epsilon(p.xyz_m[0][1], 0.2f, 1e-7);
    g_assert_cmpfloat_with_epsilon(p.xyz_m[0][2], -0.3f, 1e-7);
    ls_positions_finish(&p);
    g_assert_cmpint(
        ls_positions_parse(text, strlen(text), "t", "left,right,up", "cm", 10, &p, &diag), ==,
        LS_ERR_INVALID);
    g_assert_cmpint(
        ls_positions_parse(text, strlen(text), "t", "left,up,away", "ft", 10, &p, &diag), ==,
        LS_ERR_INVALID);
}

static void test_the_measured_rig_loads_coincident_lights_included(void)
{
    const char *data = g_getenv("LS_SHARED_DATA");
    char *path = g_build_filename(data ? data : "/nonexistent",
                                  "rig/ict_lightstage_x_346_positions_cm.csv", NULL);
    char *text = NULL;
    gsize length = 0;
    if (!g_file_get_contents(path, &text, &length, NULL)) {
        g_test_skip("shared data absent: set LS_SHARED_DATA");
    } else {
        struct ls_positions p;
        struct ls_diag diag = {0};
        g_assert_cmpint(
            ls_positions_parse(text, length, path, "left,up,away", "cm", 4096, &p, &diag), ==,
            LS_OK);
        g_assert_cmpuint(p.n, ==, 346);
        unsigned twins = 0;
        for (unsigned i = 0; i < p.n; i++)
            for (unsigned j = 0; j < i; j++)
                twins += !memcmp(p.xyz_m[i], p.xyz_m[j], sizeof p.xyz_m[i]);
        g_assert_cmpuint(twins, ==, 1);
        ls_positions_finish(&p);
    }
    g_free(text);
    g_free(path);
}

static const char good_plan[] = "subject = \"still\"; exposures_us = [250, 1000]; darks = 3;\n"
                                "conditions = ( { kind = \"each\"; channels = [\"W\"]; },\n"
                                "  { kind = \"sphere\"; channels = [\"W\", \"R\"]; } );\n";

static void test_a_plan_puts_darks_first_and_brackets_whole(struct fixture *f, gconstpointer unused)
{
    struct ls_diag diag = {0};
    struct ls_config *c = load(f, &diag);
    struct ls_plan *p = NULL;
    g_assert_cmpint(ls_plan_parse(good_plan, c, &p, &diag), ==, LS_OK);
    g_assert_cmpuint(p->n_conditions, ==, 2 + 3 + 2);
    g_assert_cmpuint(p->n_steps, ==, 2 * 3 + 5 * 2);
    g_assert_true(p->conditions[0].dark);
    g_assert_cmpstr(p->conditions[2].id, ==, "W-0000");
    g_assert_cmpstr(p->conditions[6].id, ==, "sphere-R");
    g_assert_cmpint(p->conditions[4].light, ==, 2);
    g_assert_cmpuint(p->steps[p->conditions[4].first_step + 1].exposure, ==, 1);
    g_assert_cmpuint(p->period_us, >=, 1000000 / 72);
    for (uint32_t s = 0; s < p->n_steps; s++) {
        const struct ls_plan_condition *cond = &p->conditions[p->steps[s].condition];
        g_assert_cmpuint(s - cond->first_step, <, cond->n_steps);
    }
    ls_plan_destroy(p);
    ls_config_destroy(c);
}

/* @n segments of one light each after one each-condition of a channel. */
static struct ls_plan *plan_of(const struct ls_config *config, uint32_t n)
{
    struct ls_diag diag = {0};
    struct ls_plan *p = NULL;
    GString *text = g_string_new("subject = \"still\"; exposures_us = [250, 1000]; darks = 3;\n"
                                 "reference = { every = 0; };\n"
                                 "conditions = (");
    for (uint32_t i = 0; i < n; i++)
        g_string_append_printf(text, "%s{ kind = \"segment\"; channels = [\"W\"]; lights = [0]; }",
                               i ? ", " : " ");
    g_string_append(text, " );\n");
    g_assert_cmpint(ls_plan_parse(text->str, config, &p, &diag), ==, LS_OK);
    g_string_free(text, TRUE);
    return p;
}

static void test_a_plan_is_watched_after_every_fifty_conditions(struct fixture *f,
                                                                gconstpointer unused)
{
    static const uint32_t counts[] = {1, 49, 50, 51, 99, 100, 149, 150, 160};
    struct ls_diag diag = {0};
    struct ls_config *c = load(f, &diag);
    for (size_t k = 0; k < G_N_ELEMENTS(counts); k++) {
        struct ls_plan *p = plan_of(c, counts[k]);
        uint32_t lit = 0, watches = 0, steps = 0;
        for (uint32_t i = 0; i < p->n_conditions; i++) {
            const struct ls_plan_condition *cond = &p->conditions[i];
            char id[32];
            g_snprintf(id, sizeof id, cond->watch ? "watch-%u" : "segment%u-W",
                       cond->watch ? watches : lit);
            g_assert_cmpuint(cond->first_step, ==, steps);
            steps += cond->n_steps;
            if (i < 2) {
                g_assert_true(cond->dark && !cond->watch);
                continue;
            }
            g_assert_cmpstr(cond->id, ==, id);
            g_assert_true(cond->dark == cond->watch);
            watches += cond->watch;
            lit += !cond->watch;
            g_assert_cmpuint(watches, ==, (lit - (cond->watch ? 0 : 1)) / 50);
            if (!cond->watch)
                continue;
            g_assert_cmpuint(cond->exposure, ==, 1);
            g_assert_cmpuint(cond->n_steps, ==, 4);
            g_assert_cmpint(cond->lights.kind, ==, LS_CONDITION_DARK);
            g_assert_cmpuint(p->steps[cond->first_step + 3].exposure, ==, 1);
        }
        g_assert_cmpuint(lit, ==, counts[k]);
        g_assert_cmpuint(watches, ==, counts[k] / 50);
        g_assert_cmpuint(steps, ==, p->n_steps);
        ls_plan_destroy(p);
    }
    ls_config_destroy(c);
}

static void test_wrong_plans_are_refused(struct fixture *f, gconstpointer unused)
{
    static const struct {
        const char *text, *sentence;
    } cases[] = {
        {"exposures_us = [1]; conditions = ();", "subject: missing"},
        {"subject = \"person\"; exposures_us = [1]; conditions = ();", "\"still\" or \"live\""},
        {"subject = \"still\"; exposures_us = [2, 1]; conditions = ();", "shortest first"},
        {"subject = \"still\"; exposures_us = [1]; conditions = ();", "nothing to photograph"},
        {"subject = \"still\"; exposures_us = [1]; conditions = ( { kind = \"each\"; channels = "
         "[\"Z\"]; } );",
         "no such channel"},
        {"subject = \"still\"; exposures_us = [1]; conditions = ( { kind = \"each\"; channels = "
         "[\"W\"]; lights = [3]; } );",
         "light 3: expected 0 to 2"},
        {"subject = \"still\"; exposures_us = [1];\nconditions = ( { kind = \"each\"; channels = "
         "[\"W\"]; lihgts = [3]; } );",
         "plan:2: unknown key lihgts"},
        {"subject = \"still\"; exposures_us = [1]; conditions = ( { kind = \"each\"; channels = "
         "[\"W\", \"W\"]; } );",
         "asked for twice"},
        {"subject = \"still\"; exposures_us = [1]; period_us = 10; conditions = ( { kind = "
         "\"each\"; channels = [\"W\"]; } );",
         "period_us: 10: expected"},
        {"subject = ", "plan:1:"},
    };
    struct ls_diag diag = {0};
    struct ls_config *c = load(f, &diag);
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct ls_plan *p = NULL;
        g_assert_cmpint(ls_plan_parse(cases[i].text, c, &p, &diag), ==, LS_ERR_INVALID);
        if (!strstr(diag.text, cases[i].sentence))
            g_error("\"%s\" does not say \"%s\"", diag.text, cases[i].sentence);
    }
    ls_config_destroy(c);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
#define FIXED(name, fn) g_test_add(name, struct fixture, NULL, setup, fn, teardown)
    FIXED("/config/good-files-load", test_good_files_load);
    FIXED("/config/the-work-light-is-a-channel-of-the-rig",
          test_the_work_light_is_a_channel_of_the_rig);
    FIXED("/config/who-may-come-is-read", test_who_may_come_is_read);
    FIXED("/config/wrong-keys-and-values-are-refused", test_wrong_keys_and_values_are_refused);
    FIXED("/config/without-a-stage-takes-are-only-served",
          test_without_a_stage_takes_are_only_served);
    FIXED("/config/wrong-rigs-are-refused-with-their-line",
          test_wrong_rigs_are_refused_with_their_line);
    g_test_add_func("/config/positions-are-converted-to-the-stage-frame",
                    test_positions_are_converted_to_the_stage_frame);
    g_test_add_func("/config/the-measured-rig-loads-coincident-lights-included",
                    test_the_measured_rig_loads_coincident_lights_included);
    FIXED("/plan/a-plan-puts-darks-first-and-brackets-whole",
          test_a_plan_puts_darks_first_and_brackets_whole);
    FIXED("/plan/a-plan-is-watched-after-every-fifty-conditions",
          test_a_plan_is_watched_after_every_fifty_conditions);
    FIXED("/plan/wrong-plans-are-refused", test_wrong_plans_are_refused);
    return g_test_run();
}

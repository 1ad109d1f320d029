/*
 * The capture stages with the real drivers against the simulated rig as a process: every kept
 * frame's stamp, drawn by the simulator into its pixels, must be what its ticket says.
 */
#include "core/pixel.h"
#include "daemon/capture.h"
#include "daemon/metrics.h"
#include "daemon/rig.h"
#include "daemon/store.h"
#include "daemon/takedir.h"
#include "drivers/lights_wire.h"
#include "sim/stamp.h"
#include "tests/daemon/store_fixture.h"

#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

enum { SIZE = 128, LIGHTS = 12, DARKS = 4, WARM_UP = 5, MAX_CONDITIONS = 64 };

struct scene {
    char *root, *folder;
    char address[32];
    pid_t pid;
    unsigned port;
    struct ls_config *config;
    struct ls_rig rig;
    struct ls_plan *plan;
    struct ls_store *store;
    struct ls_metrics metrics;
    struct ls_capture *capture;
    struct ls_capture_report report;
    struct ls_diag diag;
};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err)
        g_test_message("%s: %s", ls_err_name(err), diag->text);
    g_assert_cmpint(err, ==, LS_OK);
}

static char *write_file(const struct scene *s, const char *name, const char *text)
{
    char *path = g_build_filename(s->root, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    return path;
}

/* ---- the simulator ---- */

static void read_ready(struct scene *s, int fd)
{
    char line[1024] = "";
    for (size_t at = 0; at < sizeof line - 1 && !strchr(line, '\n');) {
        ssize_t n = read(fd, line + at, sizeof line - 1 - at);
        g_assert_cmpint(n, >, 0);
        at += (size_t)n;
    }
    json_t *ready = json_loads(line, 0, NULL);
    g_assert_nonnull(ready);
    s->port = (unsigned)json_integer_value(json_object_get(ready, "modbus_port"));
    json_decref(ready);
}

static void start_simulator(struct scene *s, const char *faults)
{
    const char *program = g_getenv("LS_LIGHTSTAGE_SIM");
    int ready[2];
    char fd[16];
    g_snprintf(s->address, sizeof s->address, "127.%d.%d.9", 64 + getpid() / 250 % 128,
               1 + getpid() % 250);
    char *text = g_strdup_printf(
        "scene = { scene = \"stamp\"; lights = %d; };\n"
        "cameras = ( { address = \"%s\"; width = %d; height = %d; cfa = \"mono\"; } );\n%s\n",
        LIGHTS, s->address, SIZE, SIZE, faults);
    char *path = write_file(s, "sim.conf", text);
    g_assert_no_errno(pipe(ready));
    g_snprintf(fd, sizeof fd, "%d", ready[1]);
    s->pid = fork();
    if (!s->pid) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        execl(program, program, "run", "--config", path, "--ready-fd", fd, NULL);
        _exit(127);
    }
    close(ready[1]);
    read_ready(s, ready[0]);
    close(ready[0]);
    g_free(text);
    g_free(path);
}

/* ---- the daemon's half, without its server ---- */

static void write_configuration(struct scene *s, const char *camera_extra)
{
    GString *positions = g_string_new("");
    for (int i = 0; i < LIGHTS; i++)
        g_string_append_printf(positions, "%.4f,%.4f,%.4f\n", 1.35 * cos(i * 0.5), 0.1 * i,
                               1.35 * sin(i * 0.5));
    char *rig = g_strdup_printf(
        "name = \"twelve\";\n"
        "lights = { positions = \"positions.csv\"; axes = \"right,up,towards\"; unit = \"m\"; };\n"
        "channels = ( { name = \"W\"; kind = \"spectrum\"; }, { name = \"R\"; kind = \"spectrum\"; "
        "},"
        " { name = \"A\"; kind = \"spectrum\"; }, { name = \"G\"; kind = \"spectrum\"; },"
        " { name = \"C\"; kind = \"spectrum\"; }, { name = \"B\"; kind = \"spectrum\"; },"
        " { name = \"V\"; kind = \"polariser\"; }, { name = \"H\"; kind = \"polariser\"; } );\n"
        "cameras = ( { name = \"front\"; address = \"%s\"; width = %d; height = %d;\n"
        "  pixel_format = \"Mono12\"; packet_size = 1500; max_fps = 72;\n"
        "  position_m = [0.0, 0.0, 1.6]; look_at_m = [0.0, 0.0, 0.0]; focal_length_mm = 50;\n"
        "  sensor_mm = [11.26, 11.26]; range = [0.10, 0.85]; black_dn = 64;\n"
        "  full_scale_dn = 4095; electrons_per_dn = 2.0; read_noise_dn = 1.0;\n"
        "  exposure_offset_us = 13.7; %s } );\n",
        s->address, SIZE, SIZE, camera_extra);
    char *daemon =
        g_strdup_printf("storage = \"takes\"; socket = \"socket\"; rig = \"rig.conf\";\n"
                        "controller = { driver = \"modbus\"; address = \"127.0.0.1\"; port = %u;"
                        " timeout_ms = 2000; };\n",
                        s->port);
    g_free(write_file(s, "positions.csv", positions->str));
    g_free(write_file(s, "rig.conf", rig));
    char *path = write_file(s, "daemon.conf", daemon);
    char *takes = g_build_filename(s->root, "takes", NULL);
    g_mkdir(takes, 0700);
    must(ls_config_load(path, &s->config, &s->diag), &s->diag);
    g_string_free(positions, TRUE);
    g_free(rig);
    g_free(daemon);
    g_free(path);
    g_free(takes);
}

static void open_store(struct scene *s)
{
    const char *ids[MAX_CONDITIONS];
    char *takes = g_build_filename(s->root, "takes", NULL);
    g_assert_cmpuint(s->plan->n_conditions, <=, MAX_CONDITIONS);
    for (uint32_t i = 0; i < s->plan->n_conditions; i++)
        ids[i] = s->plan->conditions[i].id;
    const struct ls_store_config config = {.root = takes,
                                           .name = "stamps",
                                           .take_json = "{}",
                                           .utc_s = 1715947200,
                                           .n_cameras = 1,
                                           .n_shots = s->plan->n_steps,
                                           .conditions = ids,
                                           .n_conditions = s->plan->n_conditions,
                                           .keep_raw = true,
                                           .need_bytes = 1 << 20};
    must(ls_store_create(&config, &s->store, &s->diag), &s->diag);
    s->folder = g_strdup(ls_store_folder(s->store));
    g_free(takes);
}

static struct scene *set_up(const char *faults, const char *camera_extra)
{
    struct scene *s = g_new0(struct scene, 1);
    char plan[256];
    s->root = new_root();
    start_simulator(s, faults);
    write_configuration(s, camera_extra);
    g_snprintf(plan, sizeof plan,
               "subject = \"still\"; exposures_us = [500, 2500, 10000]; darks = %d; "
               "keep_raw = true;\nconditions = ( { kind = \"sphere\"; channels = [\"W\"]; }, "
               "{ kind = \"each\"; channels = [\"W\"]; } );\n",
               DARKS);
    must(ls_plan_parse(plan, s->config, &s->plan, &s->diag), &s->diag);
    must(ls_rig_open(s->config, NULL, &s->rig, &s->diag), &s->diag);
    open_store(s);
    const struct ls_capture_setup setup = {.config = s->config,
                                           .plan = s->plan,
                                           .lights = s->rig.lights,
                                           .cameras = s->rig.cameras,
                                           .store = s->store,
                                           .metrics = &s->metrics,
                                           .reference_exposure_s = 0.01};
    must(ls_capture_create(&setup, &s->capture, &s->diag), &s->diag);
    return s;
}

static void clear(struct scene *s)
{
    int status;
    ls_capture_destroy(s->capture);
    (void)ls_store_close(s->store, NULL);
    ls_rig_close(&s->rig);
    ls_plan_destroy(s->plan);
    ls_config_destroy(s->config);
    kill(s->pid, SIGTERM);
    g_assert_cmpint(waitpid(s->pid, &status, 0), ==, s->pid);
    remove_tree(s->root);
    g_free(s->root);
    g_free(s->folder);
    g_free(s);
}

/* ---- tickets against stamps ---- */

static struct sim_stamp read_stamp(const struct scene *s, const struct ls_ticket *ticket)
{
    const struct ls_pixel_format *format = ls_pixel_by_name("Mono12");
    struct sim_stamp stamp;
    uint16_t *dn = g_new(uint16_t, SIZE * SIZE);
    char name[64];
    gchar *bytes;
    gsize n;
    g_snprintf(name, sizeof name, "cam0/raw/%u-%u.raw", ticket->shot, ticket->attempt);
    char *path = g_build_filename(s->folder, name, NULL);
    g_assert_true(g_file_get_contents(path, &bytes, &n, NULL));
    g_assert_cmpuint(n, ==, ls_pixel_payload_bytes(format, SIZE, SIZE));
    ls_pixel_unpack(format, bytes, 0, SIZE * SIZE, dn);
    struct ls_diag diag = {{0}};
    must(sim_stamp_read(dn, SIZE, SIZE, 4095, &stamp, &diag), &diag);
    g_free(dn);
    g_free(bytes);
    g_free(path);
    return stamp;
}

static bool is_true(const struct scene *s, const struct ls_ticket *ticket)
{
    const struct ls_plan_condition *c = &s->plan->conditions[ticket->condition];
    struct sim_stamp stamp = read_stamp(s, ticket);
    /* the stamp counts in 10 ns of true time, the pulse in the controller's, at most 100 ppm off */
    double allowed_us = 0.1 + 100e-6 * ticket->exposure_used_us;
    bool exposure = fabs(stamp.exposure_ns_10 / 100.0 - ticket->exposure_used_us) < allowed_us;
    bool light = c->dark         ? stamp.n_leds == 0
                 : c->light >= 0 ? stamp.n_leds == 1 && stamp.light == c->light
                                 : stamp.n_leds == LIGHTS;
    if (!exposure || !light)
        g_test_message("%s attempt %u: stamp: %u LEDs, light %u, %.2f us; ticket: %.2f us", c->id,
                       ticket->attempt, stamp.n_leds, stamp.light, stamp.exposure_ns_10 / 100.0,
                       ticket->exposure_used_us);
    return exposure && light && stamp.camera == 0;
}

static void expect_complete(struct scene *s)
{
    struct ls_takedir *take;
    struct ls_take_report report;
    must(ls_takedir_open(s->folder, &take, &s->diag), &s->diag);
    must(ls_takedir_verify(take, &report, &s->diag), &s->diag);
    g_assert_cmpstr(report.text, ==, "");
    for (size_t i = 0; i < take->n_alarms; i++)
        g_test_message("%s", take->alarms[i]);
    g_assert_cmpuint(report.shots_ticketed, ==, s->plan->n_steps);
    g_assert_cmpuint(report.pictures_good, ==, s->plan->n_conditions);
    for (size_t i = 0; i < take->n_tickets; i++)
        g_assert_true(is_true(s, &take->tickets[i]));
    ls_take_report_finish(&report);
    ls_takedir_close(take);
}

static void expect_take(const char *faults, const char *camera_extra, bool repairs)
{
    struct scene *s = set_up(faults, camera_extra);
    enum ls_err err = ls_capture_run(s->capture, &s->report, &s->diag);
    must(err, &s->diag);
    g_test_message("%u lost, %u repaired (%s), %.1f fps, residual %.1f us rms, %.1f us max",
                   s->report.final.shots_lost, s->report.final.shots_repaired, s->report.repaired,
                   s->report.frames_per_second, s->report.residual_rms_us,
                   s->report.residual_max_us);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpuint(s->report.final.steps_bound, ==, s->plan->n_steps);
    expect_complete(s);
    if (repairs) {
        g_assert_cmpuint(s->report.final.shots_repaired, >=, 1);
        g_assert_cmpstr(s->report.repaired, !=, "");
    }
    clear(s);
}

static void test_clean(void)
{
    expect_take("", "", false);
}

static void test_dropped(void)
{
    expect_take("faults = ( { kind = \"drop_pulse\"; at = 30; } );", "", true);
}

static void test_lost(void)
{
    expect_take("faults = ( { kind = \"lose_frame\"; at = 31; } );", "", true);
}

static void test_lost_last(void)
{
    char faults[80];
    int last = WARM_UP + 3 * (DARKS + LIGHTS + 1);
    g_snprintf(faults, sizeof faults, "faults = ( { kind = \"lose_frame\"; at = %d; } );", last);
    expect_take(faults, "", true);
}

static void test_packet_loss(void)
{
    expect_take("faults = ( { kind = \"packet_loss\"; value = 0.01; seed = 5; } );", "", false);
}

static void test_late_and_twice(void)
{
    expect_take("faults = ( { kind = \"late_frame\"; at = 35; value = 120; },\n"
                "           { kind = \"duplicate_frame\"; at = 40; } );",
                "", false);
}

static void test_software(void)
{
    expect_take("", "trigger = \"software\"; exposure = \"timed\";", false);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/rig/every-ticket-equals-its-stamp", test_clean);
    g_test_add_func("/rig/a-dropped-pulse-is-repaired", test_dropped);
    g_test_add_func("/rig/a-lost-frame-is-repaired", test_lost);
    g_test_add_func("/rig/a-lost-last-frame-is-repaired", test_lost_last);
    g_test_add_func("/rig/one-percent-of-packets-lost-loses-no-frame", test_packet_loss);
    g_test_add_func("/rig/late-and-doubled-frames-mislabel-nothing", test_late_and_twice);
    g_test_add_func("/rig/a-software-triggered-camera-sees-the-held-light", test_software);
    return g_test_run();
}

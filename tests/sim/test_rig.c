/* The simulated rig as a process, spoken to over its real protocols. */
#include "core/pixel.h"
#include "drivers/camera.h"
#include "drivers/lights.h"
#include "sim/stamp.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

enum { SIZE = 64, STRIDE = 65536, SLOTS = 16, LIGHTS = 12 };

struct process {
    char *folder, *log;
    pid_t pid;
    unsigned port;
    char address[32];
};

static const char *program(void)
{
    return g_getenv("LS_LIGHTSTAGE_SIM");
}

static pid_t spawn(const char *config, int ready_fd)
{
    pid_t pid = fork();
    char fd[16];
    g_snprintf(fd, sizeof fd, "%d", ready_fd);
    if (!pid) {
        execl(program(), program(), "run", "--config", config, "--ready-fd", fd,
              "--die-with-parent", NULL);
        _exit(127);
    }
    return pid;
}

static void read_ready(struct process *p, int fd)
{
    char line[1024] = "";
    json_error_t error;
    for (size_t at = 0; at < sizeof line - 1 && !strchr(line, '\n');) {
        ssize_t n = read(fd, line + at, sizeof line - 1 - at);
        g_assert_cmpint(n, >, 0);
        at += (size_t)n;
    }
    json_t *ready = json_loads(line, 0, &error);
    g_assert_nonnull(ready);
    g_assert_cmpint(json_integer_value(json_object_get(ready, "pid")), ==, p->pid);
    p->port = (unsigned)json_integer_value(json_object_get(ready, "modbus_port"));
    g_assert_cmpstr(json_string_value(json_array_get(json_object_get(ready, "cameras"), 0)), ==,
                    p->address);
    json_decref(ready);
}

static struct process start(const char *extra)
{
    struct process p = {.folder = g_dir_make_tmp("ls-rig-XXXXXX", NULL)};
    int ready[2];
    g_snprintf(p.address, sizeof p.address, "127.%d.%d.7", 64 + getpid() / 250 % 128,
               1 + getpid() % 250);
    char *path = g_build_filename(p.folder, "sim.conf", NULL);
    p.log = g_build_filename(p.folder, "shown.jsonl", NULL);
    char *text = g_strdup_printf("scene = { scene = \"stamp\"; lights = %d; };\n"
                                 "cameras = ( { address = \"%s\"; width = %d; height = %d; "
                                 "cfa = \"mono\"; max_frame_rate_hz = 1000.0; } );\n"
                                 "controller = { min_period_us = 5000; };\n"
                                 "log = \"shown.jsonl\";\n%s\n",
                                 LIGHTS, p.address, SIZE, SIZE, extra);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    g_assert_no_errno(pipe(ready));
    p.pid = spawn(path, ready[1]);
    close(ready[1]);
    read_ready(&p, ready[0]);
    close(ready[0]);
    g_free(text);
    g_unlink(path);
    g_free(path);
    return p;
}

static void clean(struct process *p)
{
    g_unlink(p->log);
    g_rmdir(p->folder);
    g_free(p->log);
    g_free(p->folder);
}

static int stop(struct process *p, int number)
{
    int status;
    kill(p->pid, number);
    g_assert_cmpint(waitpid(p->pid, &status, 0), ==, p->pid);
    return status;
}

static json_t *read_log(const struct process *p)
{
    json_t *lines = json_array();
    char *text = NULL;
    g_assert_true(g_file_get_contents(p->log, &text, NULL, NULL));
    char **split = g_strsplit(text, "\n", -1);
    for (char **line = split; *line && **line; line++) {
        json_t *object = json_loads(*line, 0, NULL);
        g_assert_nonnull(object); /* whole lines, always */
        json_array_append_new(lines, object);
    }
    g_strfreev(split);
    g_free(text);
    return lines;
}

static gint64 integer(json_t *line, const char *key)
{
    json_t *value = json_object_get(line, key);
    g_assert_true(json_is_integer(value));
    return json_integer_value(value);
}

struct stage {
    struct process process;
    struct ls_lights *lights;
    struct ls_camera *camera;
    uint8_t *memory;
};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err)
        g_test_message("%s: %s", ls_err_name(err), diag->text);
    g_assert_cmpint(err, ==, LS_OK);
}

static struct stage open_stage(const char *extra)
{
    struct stage s = {.process = start(extra)};
    struct ls_diag diag = {0};
    struct ls_lights_config lights = {
        .driver = "modbus", .address = "127.0.0.1", .port = s.process.port, .unit = 1};
    struct ls_camera_config camera = {.driver = "aravis",
                                      .address = s.process.address,
                                      .pixel_format = "Mono8",
                                      .packet_size = 9000,
                                      .frame_retention_us = 200000,
                                      .chunks = true,
                                      .trigger = LS_TRIGGER_LINE,
                                      .exposure = LS_EXPOSURE_WIDTH};
    must(ls_lights_open(&lights, &s.lights, &diag), &diag);
    must(ls_camera_open(&camera, &s.camera, &diag), &diag);
    must(ls_camera_apply(s.camera, &camera, &diag), &diag);
    s.memory =
        mmap(NULL, SLOTS * STRIDE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    struct ls_camera_slots slots = {s.memory, STRIDE, SLOTS};
    must(ls_camera_start(s.camera, &slots, &diag), &diag);
    return s;
}

/** End everything; what the simulator logged. */
static json_t *close_stage(struct stage *s)
{
    ls_camera_stop(s->camera, NULL);
    ls_camera_close(s->camera);
    ls_lights_close(s->lights);
    munmap(s->memory, SLOTS * STRIDE);
    g_assert_cmpint(stop(&s->process, SIGTERM), ==, 0);
    json_t *log = read_log(&s->process);
    clean(&s->process);
    return log;
}

/** Each light once in channel 1, after a dark: 13 steps. */
static void fire(struct stage *s)
{
    struct ls_led leds[LIGHTS];
    struct ls_condition conditions[LIGHTS + 1] = {{0}};
    struct ls_step steps[LIGHTS + 1];
    struct ls_diag diag = {0};
    for (uint16_t i = 0; i <= LIGHTS; i++) {
        if (i) {
            leds[i - 1] = (struct ls_led){(uint16_t)(i - 1), 1, 65535};
            conditions[i] = (struct ls_condition){LS_CONDITION_ONE, 1, &leds[i - 1]};
        }
        steps[i] = (struct ls_step){i, 400 + 50u * i, 0, 0};
    }
    struct ls_program program = {conditions, LIGHTS + 1, steps, LIGHTS + 1, 20000};
    must(ls_lights_load(s->lights, &program, NULL, &diag), &diag);
    must(ls_lights_arm(s->lights, &diag), &diag);
    must(ls_lights_grant(s->lights, LIGHTS + 1, &diag), &diag);
}

static struct sim_stamp stamp_of(const struct stage *s, const struct ls_camera_frame *frame)
{
    uint16_t dn[SIZE * SIZE];
    struct sim_stamp stamp;
    struct ls_diag diag = {0};
    ls_pixel_unpack(ls_pixel_by_name("Mono8"), s->memory + (size_t)frame->slot * STRIDE, 0,
                    SIZE * SIZE, dn);
    must(sim_stamp_read(dn, SIZE, SIZE, 255, &stamp, &diag), &diag);
    return stamp;
}

static void test_path(void)
{
    struct stage s = open_stage("");
    fire(&s);
    for (uint32_t i = 0; i <= LIGHTS; i++) {
        struct ls_camera_frame frame;
        enum ls_err err = ls_camera_next(s.camera, 3000000, &frame);
        g_assert_cmpint(err, ==, LS_OK);
        g_assert_cmpint(frame.status, ==, LS_FRAME_OK);
        struct sim_stamp stamp = stamp_of(&s, &frame);
        ls_camera_release(s.camera, frame.slot);
        g_assert_cmpuint(stamp.step, ==, i);
        g_assert_cmpuint(stamp.condition, ==, i);
        g_assert_cmpuint(stamp.kind, ==, i ? LS_CONDITION_ONE : LS_CONDITION_DARK);
        g_assert_cmpuint(stamp.light, ==, i ? i - 1 : 0xffff);
        g_assert_cmpuint(stamp.channel, ==, i ? 1 : 0xff);
        /* pulse + offset; the pulse is within 1 us of what was asked, the clock being whole us */
        g_assert_cmpfloat(fabs(stamp.exposure_ns_10 / 100.0 - (400 + 50.0 * i + 13.7)), <, 1.5);
    }
    json_t *log = close_stage(&s);
    g_assert_cmpuint(json_array_size(log), ==, LIGHTS + 1);
    for (uint32_t i = 0; i <= LIGHTS; i++) {
        json_t *line = json_array_get(log, i);
        g_assert_cmpint(integer(line, "step"), ==, i);
        g_assert_cmpint(integer(line, "frame_id"), ==, i + 1);
        g_assert_cmpint(integer(line, "light"), ==, (gint64)i - 1);
        g_assert_cmpint(integer(line, "channel"), ==, i ? 1 : -1);
        g_assert_cmpstr(json_string_value(json_object_get(line, "fate")), ==, "sent");
    }
    json_decref(log);
}

static void test_dropped(void)
{
    struct stage s = open_stage("faults = ( { kind = \"drop_pulse\"; at = 3; } );");
    struct ls_camera_frame frame;
    fire(&s);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        g_assert_cmpint(ls_camera_next(s.camera, 3000000, &frame), ==, LS_OK);
        g_assert_cmpuint(stamp_of(&s, &frame).step, ==, i < 2 ? i : i + 1);
        ls_camera_release(s.camera, frame.slot);
    }
    json_t *log = close_stage(&s);
    g_assert_cmpuint(json_array_size(log), ==, LIGHTS + 1);
    json_t *third = json_array_get(log, 2);
    g_assert_cmpstr(json_string_value(json_object_get(third, "fate")), ==, "dropped_pulse");
    g_assert_cmpint(integer(third, "frame_id"), ==, 0);
    json_decref(log);
}

static void test_killed(void)
{
    struct process p = start("");
    g_assert_true(WIFSIGNALED(stop(&p, SIGKILL)));
    json_decref(read_log(&p));
    clean(&p);
}

/** A parent that starts the simulator and dies. */
static void test_orphan(void)
{
    int pids[2];
    pid_t pid = 0;
    g_assert_no_errno(pipe(pids));
    pid_t parent = fork();
    if (!parent) {
        struct process p = start("");
        (void)!write(pids[1], &p.pid, sizeof p.pid);
        clean(&p);
        _exit(0);
    }
    g_assert_cmpint(waitpid(parent, NULL, 0), ==, parent);
    g_assert_cmpint(read(pids[0], &pid, sizeof pid), ==, sizeof pid);
    close(pids[1]);
    char byte; /* the simulator inherited the pipe: it ends when the last writer is gone */
    g_assert_cmpint(read(pids[0], &byte, 1), ==, 0);
    close(pids[0]);
}

static void test_refusal(void)
{
    char *out = NULL, *err = NULL;
    int status;
    char *command = g_strdup_printf("%s run --config /nonexistent.conf", program());
    g_assert_true(g_spawn_command_line_sync(command, &out, &err, &status, NULL));
    g_free(command);
    g_assert_cmpint(WEXITSTATUS(status), ==, 1);
    g_assert_nonnull(strstr(err, "/nonexistent.conf"));
    g_free(out);
    g_free(err);
}

/* @line: after the program's name, in a shell. */
static void expect(const char *line, int code, const char *on_out, const char *on_err)
{
    char *out = NULL, *err = NULL;
    char *words[] = {(char *)"/bin/sh", (char *)"-c", NULL, NULL};
    int status = 0;
    words[2] = g_strdup_printf("exec %s %s", program(), line);
    g_assert_true(g_spawn_sync(NULL, words, NULL, G_SPAWN_DEFAULT, NULL, NULL, &out, &err, &status,
                               NULL));
    g_test_message("%s -> %d", line, status);
    g_assert_true(WIFEXITED(status));
    g_assert_cmpint(WEXITSTATUS(status), ==, code);
    g_assert_true(*on_out ? strstr(out, on_out) != NULL : !*out);
    g_assert_true(*on_err ? strstr(err, on_err) != NULL : !*err);
    g_free(words[2]);
    g_free(out);
    g_free(err);
}

static void test_help(void)
{
    expect("--help", 0, "usage: lightstage-sim run", "");
    expect("-h", 0, "usage: lightstage-sim run", "");
    expect("run --help", 0, "usage: lightstage-sim run", "");
    expect("field --help", 0, "field       --lights", "");
    expect("masks --lights 0 --help", 0, "usage: lightstage-sim describe", "");
    expect("", 2, "", "usage:");
    expect("--nonsense", 2, "", "usage:");
    expect("run --nonsense", 2, "", "usage:");
    expect("paint", 2, "", "paint: no such subcommand");
    expect("paint --help", 2, "", "paint: no such subcommand");
    expect("--help >&-", 1, "", "standard output cannot be written");
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/rig/every-frame-carries-the-step-that-was-asked", test_path);
    g_test_add_func("/rig/a-dropped-pulse-leaves-no-frame-and-a-line", test_dropped);
    g_test_add_func("/rig/a-killed-simulator-leaves-whole-lines", test_killed);
    g_test_add_func("/rig/it-dies-with-its-parent", test_orphan);
    g_test_add_func("/rig/a-missing-file-is-named", test_refusal);
    g_test_add_func("/rig/help-is-an-answer-and-a-wrong-word-is-named", test_help);
    return g_test_run();
}

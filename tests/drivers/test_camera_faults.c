/* The Aravis driver when things are not as they should be, and against other people's programs. */
#include "camera_fixture.h"

#include <fcntl.h>
#include <linux/capability.h>
#include <semaphore.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

enum { SECOND_US = 1000000 };

static enum ls_err reapply(struct bench *b, struct ls_diag *diag)
{
    return ls_camera_apply(b->camera, &b->config, diag);
}

static void test_mismatch(void)
{
    struct bench *b = bench_new(30);
    struct ls_diag diag = {0};
    bench_power_up(b);
    b->config.gain = 100; /* the camera clips at 24 */
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "Gain: asked for 100, got 24"));
    b->config.gain = 6;
    b->config.pixel_format = "RGB8";
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "PixelFormat: asked for RGB8, got Mono8"));
    b->config.pixel_format = "Mono8";
    b->config.width = 400;
    b->config.height = 100;
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "Width: asked for 400, got 320"));
    b->config.width = 0;
    b->config.height = 0;
    b->config.black_level = 9; /* fixed at 4 */
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_MISMATCH);
    b->config.black_level = 4;
    g_assert_cmpint(reapply(b, &diag), ==, LS_OK);
    g_assert_cmpfloat(ls_camera_info(b->camera)->gain, ==, 6);
    g_assert_cmpstr(ls_camera_info(b->camera)->unverified, ==, "");
    bench_close(b);
}

static void test_clipped_black(void)
{
    struct bench *b = bench_new(31);
    struct ls_diag diag = {0};
    b->sim_config.black_level_dn = 0;
    bench_plug_in(b);
    g_assert_cmpint(ls_camera_open(&b->config, &b->camera, &diag), ==, LS_OK);
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "BlackLevel"));
    bench_close(b);
}

static void test_bad_config(void)
{
    struct bench *b = bench_new(32);
    struct ls_diag diag = {0};
    struct ls_camera *camera = NULL;
    bench_power_up(b);
    b->config.packet_size = 70000;
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_INVALID);
    b->config.packet_size = 1500;
    b->config.width = 16;
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_INVALID);
    b->config.width = 0;
    b->config.trigger = LS_TRIGGER_SOFTWARE;
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_INVALID);
    b->config.trigger = LS_TRIGGER_LINE;
    g_assert_cmpint(reapply(b, &diag), ==, LS_OK);
    g_assert_cmpint(ls_camera_trigger(b->camera, &diag), ==, LS_ERR_STATE);
    b->config.address = "camera.example";
    g_assert_cmpint(ls_camera_open(&b->config, &camera, &diag), ==, LS_ERR_INVALID);
    b->config.driver = "usb3";
    g_assert_cmpint(ls_camera_open(&b->config, &camera, &diag), ==, LS_ERR_NOT_FOUND);
    bench_close(b);
}

static void test_rolling(void)
{
    struct bench *b = bench_new(33);
    struct ls_diag diag = {0};
    b->sim_config.rolling = true;
    bench_plug_in(b);
    g_assert_cmpint(ls_camera_open(&b->config, &b->camera, &diag), ==, LS_OK);
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_UNSUPPORTED);
    g_assert_nonnull(strstr(diag.text, "Rolling"));
    bench_close(b);
}

static void test_nobody(void)
{
    struct bench *b = bench_new(34);
    struct ls_diag diag = {0};
    double start = bench_seconds();
    g_assert_cmpint(ls_camera_open(&b->config, &b->camera, &diag), ==, LS_ERR_GONE);
    g_assert_nonnull(strstr(diag.text, b->address));
    g_assert_cmpfloat(bench_seconds() - start, <, 5);
    bench_close(b);
}

static void test_two_hosts(void)
{
    struct bench *b = bench_new(35);
    struct ls_diag diag = {0};
    struct ls_camera *second = NULL;
    bench_power_up(b);
    g_assert_cmpint(ls_camera_open(&b->config, &second, &diag), ==, LS_ERR_BUSY);
    g_assert_null(second);
    ls_camera_close(g_steal_pointer(&b->camera));
    g_assert_cmpint(ls_camera_open(&b->config, &b->camera, &diag), ==, LS_OK);
    bench_close(b);
}

/** Sits in next for a minute, unless something ends it. */
struct sitter {
    struct bench *bench;
    sem_t about_to; /* posted on the way in */
    enum ls_err err;
    double seconds;
    pthread_t thread;
};

static void *sit(void *user)
{
    struct sitter *s = user;
    struct ls_camera_frame frame;
    double start = bench_seconds();
    sem_post(&s->about_to);
    s->err = ls_camera_next(s->bench->camera, 60 * SECOND_US, &frame);
    s->seconds = bench_seconds() - start;
    return NULL;
}

static void sit_down(struct sitter *s)
{
    sem_init(&s->about_to, 0, 0);
    g_assert_cmpint(pthread_create(&s->thread, NULL, sit, s), ==, 0);
}

static void test_wake(void)
{
    struct bench *b = bench_new(36);
    struct ls_camera_frame frame;
    bench_power_up(b);
    for (int round = 0; round < 3; round++) {
        struct sitter s = {.bench = b};
        bench_start(b, 4);
        sit_down(&s);
        ls_camera_wake(b->camera);
        pthread_join(s.thread, NULL);
        g_assert_cmpint(s.err, ==, LS_ERR_ABORTED);
        g_assert_cmpint(ls_camera_next(b->camera, SECOND_US, &frame), ==, LS_ERR_ABORTED);
        bench_stop(b, NULL);
        g_assert_cmpint(ls_camera_next(b->camera, SECOND_US, &frame), ==, LS_ERR_STATE);
    }
    bench_start(b, 4); /* and a new start forgets it */
    bench_pulse(b, 0, 100);
    frame = bench_next(b, SECOND_US);
    bench_close(b);
}

static void test_stop(void)
{
    struct bench *b = bench_new(37);
    struct sitter s = {.bench = b};
    bench_power_up(b);
    for (int round = 0; round < 4; round++) {
        bench_start(b, 4);
        bench_pulse(b, 0, 100);
        struct ls_camera_frame held = bench_next(b, SECOND_US);
        sit_down(&s);
        sem_wait(&s.about_to); /* from here either may be first, and both orders must work */
        bench_stop(b, NULL);
        pthread_join(s.thread, NULL);
        g_assert_true(s.err == LS_ERR_ABORTED || s.err == LS_ERR_STATE);
        ls_camera_release(b->camera, held.slot); /* late, and harmless */
    }
    bench_close(b);
}

static void test_reboot(void)
{
    struct bench *b = bench_new(38);
    struct sitter s = {.bench = b};
    struct ls_diag diag = {0};
    b->sim_config.faults.reboot_pulse = 2;
    bench_power_up(b);
    bench_start(b, 4);
    bench_pulse(b, 0, 100);
    ls_camera_release(b->camera, bench_next(b, SECOND_US).slot);
    sit_down(&s);
    bench_pulse(b, 1, 100);
    pthread_join(s.thread, NULL);
    g_assert_cmpint(s.err, ==, LS_ERR_GONE);
    g_assert_cmpfloat(s.seconds, <, 3); /* the heartbeat asks once a second */
    bench_stop(b, NULL);
    g_assert_cmpint(reapply(b, &diag), ==, LS_ERR_GONE);
    bench_close(b);
}

static void test_silence(void)
{
    struct bench *b = bench_new(39);
    struct sitter s = {.bench = b};
    b->sim_config.faults.silent_pulse = 2;
    bench_power_up(b);
    bench_start(b, 4);
    bench_pulse(b, 0, 100);
    ls_camera_release(b->camera, bench_next(b, SECOND_US).slot);
    sit_down(&s);
    bench_pulse(b, 1, 100);
    pthread_join(s.thread, NULL);
    g_assert_cmpint(s.err, ==, LS_ERR_GONE);
    /* asked every 0.4 s, five times in vain; and a busy machine */
    g_test_message("gone after %.2f s", s.seconds);
    g_assert_cmpfloat(s.seconds, <, 3.5);
    double start = bench_seconds();
    bench_stop(b, NULL);
    ls_camera_close(b->camera);
    b->camera = NULL;
    /* less than any one access to a silent camera, which is 3 s */
    g_assert_cmpfloat(bench_seconds() - start, <, 1);
    bench_close(b);
}

static void test_silence_on_a_command(void)
{
    struct bench *b = bench_new(40);
    struct sitter s = {.bench = b};
    struct ls_diag diag = {0};
    uint64_t a, c, d;
    b->sim_config.faults.silent_pulse = 1;
    bench_power_up(b);
    bench_start(b, 4);
    sit_down(&s);
    bench_pulse(b, 0, 100);
    g_assert_cmpint(ls_camera_latch(b->camera, &a, &c, &d, &diag), ==, LS_ERR_GONE);
    pthread_join(s.thread, NULL);
    g_assert_cmpint(s.err, ==, LS_ERR_GONE);
    g_assert_cmpfloat(s.seconds, <, 8); /* six attempts of 0.5 s, and the heartbeat's before them */
    bench_close(b);
}

static void test_receive_path(void)
{
    struct bench *b = bench_new(41);
    bench_power_up(b);
    bench_start(b, 4);
    const struct ls_camera_info *info = ls_camera_info(b->camera);
    if (info->packet_socket)
        g_assert_cmpuint(info->receive_buffer_bytes, ==, 0);
    else
        g_assert_cmpuint(info->receive_buffer_bytes, >, 0);
    g_assert_false(info->realtime);
    bench_stop(b, NULL);
    b->config.rt_priority = 20;
    struct ls_diag diag = {0};
    g_assert_cmpint(reapply(b, &diag), ==, LS_OK);
    bench_start(b, 4);
    g_test_message("packet socket %d, receive buffer %u, realtime %d", info->packet_socket,
                   info->receive_buffer_bytes, info->realtime);
    bench_pulse(b, 0, 100);
    ls_camera_release(b->camera, bench_next(b, SECOND_US).slot);
    bench_close(b);
}

static void allow_packet_sockets(bool allowed)
{
    struct __user_cap_header_struct of_us = {.version = _LINUX_CAPABILITY_VERSION_3};
    struct __user_cap_data_struct sets[2];
    g_assert_no_errno((int)syscall(SYS_capget, &of_us, sets));
    uint32_t raw = 1u << CAP_NET_RAW & sets[0].permitted;
    sets[0].effective = allowed ? sets[0].effective | raw : sets[0].effective & ~raw;
    g_assert_no_errno((int)syscall(SYS_capset, &of_us, sets));
}

/* What Aravis' thread does not read in time waits in the socket, from the first packet on. */
static void test_udp(void)
{
    gchar *text;
    struct bench *b = bench_new(42);
    allow_packet_sockets(false);
    bench_power_up(b);
    bench_start(b, 8);
    allow_packet_sockets(true);
    const struct ls_camera_info *info = ls_camera_info(b->camera);
    g_assert_false(info->packet_socket);
    g_assert_true(g_file_get_contents("/proc/sys/net/core/rmem_max", &text, NULL, NULL));
    g_assert_cmpuint(info->receive_buffer_bytes, ==, MIN(strtoul(text, NULL, 10), 32 << 20));
    for (uint32_t step = 0; step < 8; step++) {
        bench_pulse(b, step, 100);
        bench_logged(b, step);
    }
    for (uint32_t step = 0; step < 8; step++) {
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_true(bench_shows(b, &f, step));
        ls_camera_release(b->camera, f.slot);
    }
    g_free(text);
    bench_close(b);
}

/* --- other people's programs --- */

/** Output of a program, or NULL if it is not installed. */
static char *output_of(const char *const *argv)
{
    char *out = NULL, *err = NULL, *path = g_find_program_in_path(argv[0]);
    GError *error = NULL;
    if (!path)
        return NULL;
    g_free(path);
    if (!g_spawn_sync(NULL, (char **)argv, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, &out, &err, NULL,
                      &error))
        g_error("%s: %s", argv[0], error->message);
    char *both = g_strconcat(out, err, NULL);
    g_free(out);
    g_free(err);
    return both;
}

static void test_arv_tool(void)
{
    struct bench *b = bench_new(42);
    const char *list[] = {"arv-tool-0.8", NULL};
    const char *read[] = {"arv-tool-0.8", "-a",           b->address, "control",
                          "SensorWidth",  "ExposureMode", NULL};
    bench_plug_in(b);
    char *text = output_of(list);
    if (!text) {
        g_test_skip("arv-tool-0.8 is not installed (Debian package aravis-tools-cli)");
    } else {
        g_assert_nonnull(strstr(text, b->address));
        g_free(text);
        text = output_of(read);
        g_assert_nonnull(strstr(text, "SensorWidth = 320"));
        g_assert_nonnull(strstr(text, "ExposureMode = Timed"));
    }
    g_free(text);
    bench_close(b);
}

static void test_arv_camera_test(void)
{
    struct bench *b = bench_new(43);
    const char *stream[] = {
        "arv-camera-test-0.8", "-n", b->address, "--duration", "1", "-f", "60", "-u",
        "ExposureTime",        NULL};
    int completed = 0, failures = -1;
    bench_plug_in(b);
    char *text = output_of(stream);
    if (!text) {
        g_test_skip("arv-camera-test-0.8 is not installed (Debian package aravis-tools)");
    } else {
        const char *at = strstr(text, "n_completed_buffers");
        g_assert_nonnull(at);
        g_assert_cmpint(sscanf(at, "n_completed_buffers = %d", &completed), ==, 1);
        at = strstr(text, "n_failures");
        g_assert_cmpint(sscanf(at, "n_failures = %d", &failures), ==, 1);
        g_assert_cmpint(completed, >=, 30); /* of 60, on a busy machine */
        g_assert_cmpint(failures, ==, 0);
        g_assert_nonnull(strstr(text, "ChunkExposureTime = 1000"));
    }
    g_free(text);
    bench_close(b);
}

static bool open_other(struct bench *b, struct ls_diag *diag)
{
    double end = bench_seconds() + 10;
    while (bench_seconds() < end)
        if (ls_camera_open(&b->config, &b->camera, diag) == LS_OK)
            return true;
    return false;
}

/** The fake camera only listens on an interface's own address, so programs take turns: each locks
 * the executable. */
static int take_turn(const char *program)
{
    char *path = g_find_program_in_path(program);
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    g_free(path);
    if (fd >= 0)
        g_assert_cmpint(flock(fd, LOCK_EX), ==, 0);
    return fd;
}

static void test_debian_fake(void)
{
    struct bench *b = bench_new(44);
    struct ls_diag diag = {0};
    GError *error = NULL;
    GPid pid;
    char *argv[] = {(char *)"arv-fake-gv-camera-0.8", (char *)"-i", (char *)"127.0.0.1", NULL};
    int turn = take_turn(argv[0]);
    b->config.address = argv[2];
    if (!g_spawn_async(NULL, argv, NULL,
                       G_SPAWN_SEARCH_PATH | G_SPAWN_DO_NOT_REAP_CHILD |
                           G_SPAWN_STDOUT_TO_DEV_NULL | G_SPAWN_STDERR_TO_DEV_NULL,
                       NULL, NULL, &pid, &error)) {
        g_clear_error(&error);
        g_test_skip("arv-fake-gv-camera-0.8 is not installed (Debian package aravis-tools)");
        bench_close(b);
        return;
    }
    b->config.trigger = LS_TRIGGER_SOFTWARE;
    b->config.exposure = LS_EXPOSURE_TIMED;
    b->config.exposure_us = 1000;
    b->config.width = b->config.height = 256;
    if (!open_other(b, &diag) || reapply(b, &diag))
        g_error("%s", diag.text);
    const struct ls_camera_info *info = ls_camera_info(b->camera);
    g_test_message("unverified: %s", info->unverified);
    g_assert_nonnull(strstr(info->unverified, "SensorShutterMode"));
    g_assert_nonnull(strstr(info->unverified, "ExposureMode"));
    g_assert_nonnull(strstr(info->unverified, "ChunkModeActive"));
    bench_start(b, 8);
    uint64_t last = 0;
    for (int i = 0; i < 5; i++) {
        g_assert_cmpint(ls_camera_trigger(b->camera, &diag), ==, LS_OK);
        struct ls_camera_frame f = bench_next(b, 5 * SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_cmpuint(f.payload_bytes, ==, 256 * 256);
        g_assert_true(!last || f.frame_id == last + 1);
        last = f.frame_id;
        ls_camera_release(b->camera, f.slot);
    }
    bench_close(b);
    kill(pid, SIGTERM);
    waitpid(pid, NULL, 0);
    close(turn);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/camera/a-setting-that-reads-back-otherwise-is-refused", test_mismatch);
    g_test_add_func("/camera/a-black-level-of-zero-is-refused", test_clipped_black);
    g_test_add_func("/camera/bad-configuration-is-refused-before-the-camera-sees-it",
                    test_bad_config);
    g_test_add_func("/camera/a-rolling-shutter-is-refused", test_rolling);
    g_test_add_func("/camera/nobody-at-the-address-is-gone", test_nobody);
    g_test_add_func("/camera/a-second-host-finds-it-busy", test_two_hosts);
    g_test_add_func("/camera/wake-ends-a-wait-until-the-next-start", test_wake);
    g_test_add_func("/camera/stop-ends-a-wait", test_stop);
    g_test_add_func("/camera/a-rebooted-camera-is-gone-within-three-seconds", test_reboot);
    g_test_add_func("/camera/a-silent-camera-is-gone-after-five-questions", test_silence);
    g_test_add_func("/camera/a-command-to-a-silent-camera-says-gone", test_silence_on_a_command);
    g_test_add_func("/camera/the-receive-path-is-reported", test_receive_path);
    g_test_add_func("/camera/without-a-packet-socket-the-buffer-is-what-the-kernel-grants",
                    test_udp);
    g_test_add_func("/camera/arv-tool-lists-it-and-reads-its-features", test_arv_tool);
    g_test_add_func("/camera/arv-camera-test-streams-from-it", test_arv_camera_test);
    g_test_add_func("/camera/debians-fake-camera-works-by-software-trigger", test_debian_fake);
    return g_test_run();
}

/* The Aravis driver against the simulated camera: frames, times, identity and settings. */
#include "camera_fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { SECOND_US = 1000000 };

/** Fires steps 0..n-1 from a thread of its own, never closer together than the period. */
struct pulser {
    struct bench *bench;
    uint32_t n, period_us;
    double pulse_us;
    uint64_t fired_ns[512];
    pthread_t thread;
};

static void *fire_all(void *user)
{
    struct pulser *p = user;
    struct timespec rest = {0, (long)p->period_us * 1000};
    for (uint32_t step = 0; step < p->n; step++) {
        p->fired_ns[step] = sim_now_ns(); /* before its frame can come */
        bench_pulse_at(p->bench, p->fired_ns[step], step, p->pulse_us);
        nanosleep(&rest, NULL);
    }
    return NULL;
}

static void start_pulses(struct pulser *p)
{
    g_assert_cmpuint(p->n, <=, G_N_ELEMENTS(p->fired_ns));
    g_assert_cmpint(pthread_create(&p->thread, NULL, fire_all, p), ==, 0);
}

static void test_line(void)
{
    struct bench *b = bench_new(1);
    struct pulser p = {.bench = b, .n = 200, .period_us = 4000, .pulse_us = 250};
    struct ls_camera_stats stats;
    bench_power_up(b);
    bench_start(b, 32);
    start_pulses(&p);
    for (uint32_t step = 0; step < p.n; step++) {
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_cmpuint(f.frame_id, ==, step + 1);
        g_assert_cmpuint(f.payload_bytes, ==, 320 * 240);
        g_assert_true(bench_shows(b, &f, step));
        g_assert_cmpuint(f.trigger_counter, ==, step + 1);
        g_assert_cmpuint(f.camera_ns, ==, sim_camera_ticks_at(b->sim, p.fired_ns[step]));
        g_assert_cmpuint(f.host_ns, >, p.fired_ns[step]);
        struct bench_entry entry = bench_logged(b, step);
        g_assert_cmpint(entry.fate, ==, SIM_FATE_SENT);
        g_assert_cmpuint(entry.frame_id, ==, f.frame_id);
        g_assert_cmpuint(entry.ticks, ==, f.camera_ns);
        ls_camera_release(b->camera, f.slot);
    }
    pthread_join(p.thread, NULL);
    bench_stop(b, &stats);
    g_assert_cmpuint(stats.completed, ==, p.n);
    g_assert_cmpuint(stats.failed, ==, 0);
    g_assert_cmpuint(stats.underruns, ==, 0);
    bench_close(b);
}

static void test_width(void)
{
    static const double pulses_us[] = {20, 100, 1000, 20000};
    struct bench *b = bench_new(2);
    bench_power_up(b);
    bench_start(b, 8);
    g_assert_true(ls_camera_info(b->camera)->has_trigger_width);
    for (uint32_t step = 0; step < G_N_ELEMENTS(pulses_us); step++) {
        bench_pulse(b, step, pulses_us[step]);
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        /* both sides add the same two doubles */
        g_assert_cmpfloat(f.chunk_exposure_us, ==, pulses_us[step] + 13.7);
        struct bench_entry entry = bench_logged(b, step);
        g_assert_cmpfloat(entry.exposure.lit_us, ==, pulses_us[step] + 13.7);
        ls_camera_release(b->camera, f.slot);
    }
    bench_close(b);
}

static void test_packet_delay(void)
{
    static const uint32_t delays_ns[] = {0, 300000};
    uint64_t took_ns[2], packets = 0;
    for (int i = 0; i < 2; i++) {
        struct bench *b = bench_new(2);
        b->config.packet_delay_ns = delays_ns[i];
        bench_power_up(b);
        bench_start(b, 8);
        packets = ls_camera_info(b->camera)->payload_bytes / b->config.packet_size;
        bench_pulse(b, 0, 100);
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        uint64_t ended_ns = bench_logged(b, 0).exposure.true_ns + 113700;
        took_ns[i] = f.host_ns - ended_ns;
        ls_camera_release(b->camera, f.slot);
        bench_close(b);
    }
    g_test_message("%.2f ms without a delay, %.2f ms with", took_ns[0] * 1e-6, took_ns[1] * 1e-6);
    g_assert_cmpuint(packets, >, 10);
    g_assert_cmpuint(took_ns[1], >=, packets * delays_ns[1]);
}

static void test_timed(void)
{
    struct bench *b = bench_new(3);
    struct ls_diag diag = {0};
    double exposure_us = 500;
    b->config.exposure = LS_EXPOSURE_TIMED;
    b->config.exposure_us = 1500;
    bench_power_up(b);
    bench_start(b, 8);
    bench_pulse(b, 0, 400);
    struct ls_camera_frame f = bench_next(b, SECOND_US);
    g_assert_cmpfloat(f.chunk_exposure_us, ==, 1500);
    g_assert_cmpfloat(bench_logged(b, 0).exposure.lit_us, ==, 400);
    g_assert_cmpint(ls_camera_set_exposure(b->camera, &exposure_us, &diag), ==, LS_OK);
    g_assert_cmpfloat(exposure_us, ==, 500);
    ls_camera_release(b->camera, f.slot);
    bench_pulse(b, 1, 400);
    f = bench_next(b, SECOND_US);
    g_assert_cmpfloat(f.chunk_exposure_us, ==, 500);
    ls_camera_release(b->camera, f.slot);
    bench_close(b);
}

static void test_software(void)
{
    struct bench *b = bench_new(4);
    struct ls_diag diag = {0};
    b->config.trigger = LS_TRIGGER_SOFTWARE;
    b->config.exposure = LS_EXPOSURE_TIMED;
    b->config.exposure_us = 2000;
    bench_power_up(b);
    bench_start(b, 8);
    for (uint64_t id = 1; id <= 10; id++) {
        g_assert_cmpint(ls_camera_trigger(b->camera, &diag), ==, LS_OK);
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpuint(f.frame_id, ==, id);
        g_assert_true(bench_shows(b, &f, 7)); /* what shown() answers */
        g_assert_cmpfloat(f.chunk_exposure_us, ==, 2000);
        ls_camera_release(b->camera, f.slot);
    }
    bench_close(b);
}

static void test_dropped_pulse(void)
{
    struct bench *b = bench_new(5);
    uint32_t expected = 0;
    b->sim_config.faults.drop_pulse[0] = 3;
    bench_power_up(b);
    bench_start(b, 8);
    for (uint32_t step = 0; step < 6; step++) {
        bench_pulse(b, step, 100);
        if (step == 2)
            continue;
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        expected++;
        g_assert_true(bench_shows(b, &f, step));
        g_assert_cmpuint(f.frame_id, ==, expected);
        g_assert_cmpuint(f.trigger_counter, ==, expected);
        ls_camera_release(b->camera, f.slot);
    }
    g_assert_cmpint(bench_logged(b, 2).fate, ==, SIM_FATE_DROPPED_PULSE);
    bench_close(b);
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static void test_lost_frame(void)
{
    struct bench *b = bench_new(6);
    b->sim_config.faults.lose_frame[0] = 3;
    bench_power_up(b);
    bench_start(b, 8);
    for (uint32_t step = 0; step < 6; step++) {
        bench_pulse(b, step, 100);
        bench_logged(b, step);
        if (step == 2)
            continue;
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_true(bench_shows(b, &f, step));
        g_assert_cmpuint(f.frame_id, ==, step + 1);
        ls_camera_release(b->camera, f.slot);
    }
    g_assert_cmpint(bench_logged(b, 2).fate, ==, SIM_FATE_LOST_FRAME);
    g_assert_cmpuint(bench_logged(b, 2).frame_id, ==, 3);
    bench_close(b);
}

/* From a pulse to its frame, with the leader lost and without, in turn; medians of each. */
static void test_lost_leader(void)
{
    enum { FRAMES = 15 };
    struct bench *b = bench_new(41);
    double ms[2][FRAMES];
    for (int i = 0; i < FRAMES; i++)
        b->sim_config.faults.lose_leader[i] = 2 * (uint64_t)i + 2;
    bench_power_up(b);
    bench_start(b, 8);
    for (uint32_t step = 0; step < 2 * FRAMES; step++) {
        uint64_t at_ns = bench_pulse(b, step, 100);
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_true(bench_shows(b, &f, step));
        ms[step % 2][step / 2] = (double)(f.host_ns - at_ns) * 1e-6;
        ls_camera_release(b->camera, f.slot);
    }
    for (int lost = 0; lost < 2; lost++)
        qsort(ms[lost], FRAMES, sizeof **ms, compare_doubles);
    double cost_ms = ms[1][FRAMES / 2] - ms[0][FRAMES / 2];
    g_test_message("a frame came after %.2f ms, with its leader lost after %.2f", ms[0][FRAMES / 2],
                   ms[1][FRAMES / 2]);
    g_assert_cmpfloat(cost_ms, >, 0.5); /* it was waited for before it was asked for */
    g_assert_cmpfloat(cost_ms, <, 50);  /* ten packet timeouts */
    bench_close(b);
}

static void test_busy_sensor(void)
{
    struct bench *b = bench_new(7);
    struct sim_camera_stats stats;
    uint64_t now;
    b->sim_config.max_frame_rate_hz = 50;
    bench_power_up(b);
    bench_start(b, 8);
    now = sim_now_ns();
    sim_camera_pulse(b->sim, now, 100, 0, 0);
    sim_camera_pulse(b->sim, now + 19000000, 100, 1, 1); /* 1 ms before the sensor is ready */
    sim_camera_pulse(b->sim, now + 40000000, 100, 2, 2);
    struct ls_camera_frame first = bench_next(b, SECOND_US);
    struct ls_camera_frame second = bench_next(b, SECOND_US);
    g_assert_true(bench_shows(b, &second, 2));
    g_assert_cmpuint(second.frame_id, ==, first.frame_id + 1);
    g_assert_cmpuint(second.trigger_counter, ==, first.trigger_counter + 2);
    g_assert_cmpint(bench_logged(b, 1).fate, ==, SIM_FATE_MISSED_TRIGGER);
    sim_camera_stats(b->sim, &stats);
    g_assert_cmpuint(stats.missed_triggers, ==, 1);
    bench_close(b);
}

static void test_packet_loss(void)
{
    struct bench *b = bench_new(8);
    struct pulser p = {.bench = b, .n = 60, .period_us = 20000, .pulse_us = 100};
    struct sim_camera_stats sim;
    struct ls_camera_stats stats;
    b->sim_config.faults.packet_loss = 0.01;
    b->sim_config.faults.seed = 1;
    b->config.frame_retention_us = 500000;
    bench_power_up(b);
    bench_start(b, 32);
    start_pulses(&p);
    for (uint32_t step = 0; step < p.n; step++) {
        struct ls_camera_frame f = bench_next(b, 2 * SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_true(bench_shows(b, &f, step));
        g_assert_cmpuint(f.frame_id, ==, step + 1);
        ls_camera_release(b->camera, f.slot);
    }
    pthread_join(p.thread, NULL);
    bench_stop(b, &stats);
    sim_camera_stats(b->sim, &sim);
    g_test_message("seed 1: %" G_GUINT64_FORMAT " packets lost, %" G_GUINT64_FORMAT " resent",
                   sim.packets_lost, sim.packets_resent);
    /* 60 frames of 53 packets at 1 %: 32 expected; fewer than 8 has a chance below 1e-6 */
    g_assert_cmpuint(sim.packets_lost, >=, 8);
    g_assert_cmpuint(stats.resent_packets, >, 0);
    bench_close(b);
}

static void test_beyond_recovery(void)
{
    struct bench *b = bench_new(19);
    struct ls_camera_stats stats;
    /* nine of ten packets, resent ones too: with one request per packet, 53 never all arrive */
    b->sim_config.faults.packet_loss = 0.9;
    b->sim_config.faults.seed = 2;
    b->config.frame_retention_us = 50000;
    bench_power_up(b);
    bench_start(b, 8);
    bench_pulse(b, 0, 100);
    struct ls_camera_frame f = bench_next(b, 2 * SECOND_US);
    g_assert_cmpint(f.status, ==, LS_FRAME_LOST);
    g_assert_cmpuint(f.payload_bytes, ==, 0);
    g_assert_cmpuint(f.frame_id, ==, 0);
    g_assert_cmpuint(f.camera_ns, ==, 0);
    ls_camera_release(b->camera, f.slot);
    bench_stop(b, &stats);
    g_assert_cmpuint(stats.completed, ==, 0);
    bench_close(b);
}

static void test_duplicate_and_late(void)
{
    struct bench *b = bench_new(9);
    b->sim_config.faults.duplicate_frame[0] = 2;
    b->sim_config.faults.late_frame[0] = 4;
    b->sim_config.faults.late_ms = 60;
    bench_power_up(b);
    bench_start(b, 8);
    for (uint32_t step = 0; step < 5; step++) {
        uint64_t fired_ns = bench_pulse(b, step, 100);
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpuint(f.frame_id, ==, step + 1);
        g_assert_true(bench_shows(b, &f, step));
        g_assert_cmpuint(f.camera_ns, ==, sim_camera_ticks_at(b->sim, fired_ns));
        if (step == 3)
            g_assert_cmpuint(f.host_ns - fired_ns, >=, 60000000);
        ls_camera_release(b->camera, f.slot);
    }
    bench_close(b);
}

static void test_id_wrap(void)
{
    struct bench *b = bench_new(10);
    b->sim_config.first_block = 65533;
    b->sim_config.faults.lose_frame[0] = 4; /* the one numbered 1 on the wire */
    bench_power_up(b);
    bench_start(b, 8);
    for (uint32_t step = 0; step < 8; step++) {
        bench_pulse(b, step, 100);
        bench_logged(b, step);
        if (step == 3)
            continue;
        struct ls_camera_frame f = bench_next(b, SECOND_US);
        g_assert_cmpuint(f.frame_id, ==, 65533 + step);
        g_assert_cmpuint(f.frame_id, ==, bench_logged(b, step).frame_id);
        ls_camera_release(b->camera, f.slot);
    }
    bench_close(b);
}

static void test_starved(void)
{
    struct bench *b = bench_new(11);
    struct ls_camera_frame held[4];
    struct ls_camera_stats stats;
    bench_power_up(b);
    bench_start(b, 4);
    for (uint32_t step = 0; step < 4; step++) {
        bench_pulse(b, step, 100);
        held[step] = bench_next(b, SECOND_US);
    }
    bench_pulse(b, 4, 100); /* nowhere to land */
    bench_logged(b, 4);
    struct ls_camera_frame f;
    g_assert_cmpint(ls_camera_next(b->camera, 50000, &f), ==, LS_ERR_TIMEOUT);
    for (uint32_t step = 0; step < 4; step++) {
        g_assert_true(bench_shows(b, &held[step], step));
        ls_camera_release(b->camera, held[step].slot);
    }
    bench_pulse(b, 5, 100);
    f = bench_next(b, SECOND_US);
    g_assert_cmpuint(f.frame_id, ==, 6);
    g_assert_true(bench_shows(b, &f, 5));
    bench_stop(b, &stats);
    g_assert_cmpuint(stats.underruns, >, 0);
    bench_close(b);
}

static void test_formats(void)
{
    static const struct {
        const char *name;
        uint32_t bits;
    } formats[] = {
        {"Mono8", 8},
        {"Mono12", 16},
        {"Mono16", 16},
        {"Mono12Packed", 12},
        {"BayerRG8", 8},
        {"BayerGR8", 8},
        {"BayerGB8", 8},
        {"BayerBG8", 8},
        {"BayerRG12", 16},
        {"BayerGR12", 16},
        {"BayerGB12", 16},
        {"BayerBG12", 16},
        {"BayerRG12Packed", 12},
        {"BayerGR12Packed", 12},
        {"BayerGB12Packed", 12},
        {"BayerBG12Packed", 12},
    };
    struct bench *b = bench_new(12);
    struct ls_diag diag = {0};
    uint32_t step = 0;
    b->config.width = 64;
    b->config.height = 50;
    b->config.offset_x = 10;
    b->config.offset_y = 6;
    bench_power_up(b);
    for (size_t i = 0; i < G_N_ELEMENTS(formats); i++) {
        b->config.pixel_format = formats[i].name;
        if (ls_camera_apply(b->camera, &b->config, &diag))
            g_error("%s", diag.text);
        g_assert_cmpstr(ls_camera_info(b->camera)->pixel_format, ==, formats[i].name);
        bench_start(b, 4);
        for (int k = 0; k < 3; k++, step++) {
            bench_pulse(b, step, 100);
            struct ls_camera_frame f = bench_next(b, SECOND_US);
            g_assert_cmpint(f.status, ==, LS_FRAME_OK);
            g_assert_cmpuint(f.payload_bytes, ==, 64 * 50 * formats[i].bits / 8);
            g_assert_true(bench_shows(b, &f, step));
            g_assert_cmpfloat(f.chunk_exposure_us, ==, 113.7);
            ls_camera_release(b->camera, f.slot);
        }
        bench_stop(b, NULL);
    }
    bench_close(b);
}

static void test_odd_size(void)
{
    struct bench *b = bench_new(13);
    b->sim_config.sensor_width = 411;
    b->sim_config.sensor_height = 233;
    bench_power_up(b);
    bench_start(b, 4);
    bench_pulse(b, 0, 100);
    struct ls_camera_frame f = bench_next(b, SECOND_US);
    g_assert_cmpuint(f.payload_bytes, ==, 411 * 233);
    g_assert_true(bench_shows(b, &f, 0));
    g_assert_cmpfloat(f.chunk_exposure_us, ==, 113.7);
    bench_close(b);
}

static void test_without_chunks(void)
{
    struct bench *b = bench_new(14);
    b->config.chunks = false;
    bench_power_up(b);
    g_assert_false(ls_camera_info(b->camera)->has_trigger_counter);
    g_assert_cmpuint(ls_camera_info(b->camera)->payload_bytes, ==, 320 * 240);
    bench_start(b, 4);
    bench_pulse(b, 0, 100);
    struct ls_camera_frame f = bench_next(b, SECOND_US);
    g_assert_true(bench_shows(b, &f, 0));
    g_assert_cmpuint(f.trigger_counter, ==, 0);
    bench_close(b);
}

static void test_latch(void)
{
    struct bench *b = bench_new(15);
    struct ls_diag diag = {0};
    uint64_t camera_ns, before_ns, after_ns;
    bench_power_up(b);
    for (int i = 0; i < 20; i++) {
        if (ls_camera_latch(b->camera, &camera_ns, &before_ns, &after_ns, &diag))
            g_error("%s", diag.text);
        g_assert_cmpuint(camera_ns, >=, sim_camera_ticks_at(b->sim, before_ns));
        g_assert_cmpuint(camera_ns, <=, sim_camera_ticks_at(b->sim, after_ns));
    }
    bench_close(b);
}

/** One camera's host: pulses ahead of the frames by its credit and no further, as a daemon grants
 * them. What the machine does meanwhile then costs time, never a frame: no more is on its way than
 * the packet ring holds while its reader does not run. */
struct host {
    struct bench *bench;
    pthread_t thread;
};

enum { TWO_FRAMES = 100, TWO_CREDIT = 8 };

static void *pulse_and_receive(void *user)
{
    struct host *host = user;
    struct bench *b = host->bench;
    uint32_t fired = 0;
    for (uint32_t step = 0; step < TWO_FRAMES; step++) {
        while (fired < TWO_FRAMES && fired < step + TWO_CREDIT) {
            bench_pulse(b, fired, 100);
            bench_logged(b, fired++); /* sent: the sensor is ready for the next */
        }
        struct ls_camera_frame f = bench_next(b, 10 * SECOND_US);
        g_assert_cmpint(f.status, ==, LS_FRAME_OK);
        g_assert_cmpuint(f.frame_id, ==, step + 1);
        g_assert_true(bench_shows(b, &f, step));
        ls_camera_release(b->camera, f.slot);
    }
    return NULL;
}

static void test_two(void)
{
    struct host hosts[2];
    struct ls_camera_stats stats;
    for (unsigned c = 0; c < 2; c++) {
        struct bench *b = hosts[c].bench = bench_new(16 + c);
        bench_power_up(b);
        bench_start(b, 2 * TWO_CREDIT); /* the first streams while the second starts */
        g_assert_cmpint(pthread_create(&hosts[c].thread, NULL, pulse_and_receive, &hosts[c]), ==,
                        0);
    }
    for (unsigned c = 0; c < 2; c++) {
        pthread_join(hosts[c].thread, NULL);
        bench_stop(hosts[c].bench, &stats);
        g_assert_cmpuint(stats.completed, ==, TWO_FRAMES);
        g_assert_cmpuint(stats.underruns, ==, 0);
        bench_close(hosts[c].bench);
    }
}

/** The reference size at full rate: only when asked, and with numbers to report. */
static void test_full_rate(void)
{
    struct bench *b = bench_new(18);
    struct pulser p = {.bench = b, .n = 360, .period_us = 13889, .pulse_us = 200};
    struct ls_camera_stats stats;
    struct timespec cpu0, cpu1;
    if (!g_getenv("LS_TEST_FULL")) {
        g_test_skip("set LS_TEST_FULL=1");
        bench_close(b);
        return;
    }
    b->sim_config.sensor_width = b->sim_config.sensor_height = 2048;
    b->config.packet_size =
        g_getenv("LS_TEST_PACKET") ? (uint32_t)atoi(g_getenv("LS_TEST_PACKET")) : 65000;
    b->whole_pattern = false;
    bench_power_up(b);
    bench_start(b, 24);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu0);
    double start = bench_seconds(), worst_ms = 0;
    start_pulses(&p);
    for (uint32_t step = 0; step < p.n; step++) {
        struct ls_camera_frame f = bench_next(b, 2 * SECOND_US);
        g_assert_true(bench_shows(b, &f, step));
        g_assert_cmpuint(f.frame_id, ==, step + 1);
        worst_ms = MAX(worst_ms, (double)(f.host_ns - p.fired_ns[step]) * 1e-6);
        ls_camera_release(b->camera, f.slot);
    }
    double seconds = bench_seconds() - start;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu1);
    pthread_join(p.thread, NULL);
    bench_stop(b, &stats);
    double cpu = (double)(cpu1.tv_sec - cpu0.tv_sec) + (double)(cpu1.tv_nsec - cpu0.tv_nsec) * 1e-9;
    printf("# packet %u: %u frames of 2048x2048 at %.1f/s, camera and driver together %.0f %% of "
           "a core, slowest frame %.1f ms after its pulse, %s\n",
           b->config.packet_size, p.n, p.n / seconds, 100 * cpu / seconds, worst_ms,
           ls_camera_info(b->camera)->packet_socket ? "packet socket" : "UDP");
    g_assert_cmpuint(stats.completed, ==, p.n);
    bench_close(b);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/camera/line-triggered-frames-arrive-whole-and-identified", test_line);
    g_test_add_func("/camera/trigger-width-exposes-for-the-pulse-plus-the-offset", test_width);
    g_test_add_func("/camera/packets-leave-each-other-the-room-they-were-told", test_packet_delay);
    g_test_add_func("/camera/timed-exposure-follows-its-register", test_timed);
    g_test_add_func("/camera/software-trigger-gives-one-frame-each", test_software);
    g_test_add_func("/camera/a-dropped-pulse-leaves-ids-and-counters-contiguous",
                    test_dropped_pulse);
    g_test_add_func("/camera/a-lost-frame-makes-an-id-gap", test_lost_frame);
    g_test_add_func("/camera/a-lost-leader-costs-its-frame-little", test_lost_leader);
    g_test_add_func("/camera/a-trigger-too-early-is-counted-and-makes-no-frame", test_busy_sensor);
    g_test_add_func("/camera/one-percent-packet-loss-costs-no-frame", test_packet_loss);
    g_test_add_func("/camera/a-frame-beyond-recovery-is-lost-and-says-nothing-else",
                    test_beyond_recovery);
    g_test_add_func("/camera/duplicate-and-late-frames-change-nothing", test_duplicate_and_late);
    g_test_add_func("/camera/frame-ids-run-on-past-16-bits", test_id_wrap);
    g_test_add_func("/camera/no-free-slot-drops-the-frame-and-nothing-else", test_starved);
    g_test_add_func("/camera/every-pixel-format-streams", test_formats);
    g_test_add_func("/camera/an-odd-sensor-size-streams-with-chunks", test_odd_size);
    g_test_add_func("/camera/works-without-chunks", test_without_chunks);
    g_test_add_func("/camera/latch-lies-between-the-host-times-around-it", test_latch);
    g_test_add_func("/camera/two-cameras-at-once-lose-and-mix-nothing", test_two);
    g_test_add_func("/camera/72-frames-a-second-at-4-megapixels", test_full_rate);
    return g_test_run();
}

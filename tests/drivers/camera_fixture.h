/*
 * camera_fixture: the real driver and a simulated camera on an address of this process' own.
 * Layer: tests. Threads: the test's one; the camera's callbacks come from its own thread.
 * Ownership: bench_open / bench_close.
 */
#ifndef LS_TESTS_CAMERA_FIXTURE_H
#define LS_TESTS_CAMERA_FIXTURE_H

#include "drivers/camera.h"
#include "sim/camera.h"

#include <glib.h>
#include <pthread.h>

enum { BENCH_LOG = 4096, BENCH_ADDRESS = 16 };

/** What the camera says truly happened. */
struct bench_entry {
    struct sim_exposure exposure;
    uint64_t frame_id, ticks;
    enum sim_camera_fate fate;
};

struct bench {
    char address[BENCH_ADDRESS];
    struct sim_camera_config sim_config;
    struct ls_camera_config config;
    struct sim_camera *sim;
    struct ls_camera *camera;
    struct ls_camera_slots slots;
    bool whole_pattern;   /* every byte of the picture is checked, else only its stamp */
    pthread_mutex_t lock; /* of the log */
    pthread_cond_t logged;
    struct bench_entry log[BENCH_LOG];
    unsigned n_log;
};

/** A loopback address no other test process uses now; @n tells several apart. */
void bench_address(char address[BENCH_ADDRESS], unsigned n);

/** Defaults: 320x240 Mono8, line trigger, TriggerWidth, chunks, 1500-byte packets, 13.7 us of
 * offset, a clock with its own epoch and +80 ppm. Change sim_config and config before power-up. */
struct bench *bench_new(unsigned n);

/** Create the simulated camera only. */
void bench_plug_in(struct bench *bench);

/** Plug in, open and apply the driver; fails the test if that fails. */
void bench_power_up(struct bench *bench);

/** Make @n_slots and start. */
void bench_start(struct bench *bench, uint32_t n_slots);
void bench_stop(struct bench *bench, struct ls_camera_stats *stats);

/** Stop, close, power down, free. */
void bench_close(struct bench *bench);

/** Fire step @step with condition 1000 + step, @pulse_us wide, now; returns the time. */
uint64_t bench_pulse(struct bench *bench, uint32_t step, double pulse_us);

/** Fire it at @true_ns, which is now. */
void bench_pulse_at(struct bench *bench, uint64_t true_ns, uint32_t step, double pulse_us);

/** The next frame, within @timeout_us; fails the test on any error. */
struct ls_camera_frame bench_next(struct bench *bench, uint64_t timeout_us);

/** Does the frame's slot hold the picture rendered for @step? */
bool bench_shows(const struct bench *bench, const struct ls_camera_frame *frame, uint32_t step);

/** The log entry of @step, waiting for it; fails the test after 5 s. */
struct bench_entry bench_logged(struct bench *bench, uint32_t step);

/** CLOCK_MONOTONIC_RAW seconds. */
double bench_seconds(void);

#endif

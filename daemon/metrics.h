/*
 * metrics: what the daemon has counted since it started: frames, losses, repairs, and how long
 * pictures take from trigger to disk.
 * Layer: daemon. Threads: counted by any, real-time ones among them, and read by any, without
 * locks. Ownership: embedded, no heap; all zero is nothing counted.
 *
 * A frame that comes after its step was given up is "late"; after the program that it belongs to
 * was given up, "no_pulse".
 *
 * A latency runs on the host's CLOCK_MONOTONIC_RAW. Its start, the start of the pulse, is the
 * controller's time of the step mapped to that clock (clock.h), and so within tens of us. A
 * condition counts from the last of its frames, so that the bracket's length is no latency.
 */
#ifndef LS_DAEMON_METRICS_H
#define LS_DAEMON_METRICS_H

#include "core/histogram.h"
#include "daemon/bind.h"
#include "daemon/config.h"

enum ls_latency {
    LS_LATENCY_FRAME,  /* pulse -> the driver has the frame: exposure, readout, network */
    LS_LATENCY_MERGED, /* last frame of a condition -> merged */
    LS_LATENCY_STORED, /* merged -> durable: file in place, journal synced */
    LS_LATENCY_TOTAL,  /* pulse of the last frame -> durable */
    LS_LATENCIES
};

struct ls_camera_metrics {
    struct ls_histogram latencies[LS_LATENCIES]; /* ns */
    /* every frame is bound or discarded, every fired step bound or unbound: bind.h */
    _Atomic uint64_t frames_bound;
    _Atomic uint64_t frames_discarded[LS_BIND_REASONS], steps_unbound[LS_BIND_REASONS];
    _Atomic uint64_t shots_lost;     /* fired in a take without a usable frame, each time */
    _Atomic uint64_t shots_repaired; /* of those, shot again until they were had */
    _Atomic uint64_t settling_pulses; /* fired after its exposure was written, frames discarded */
    _Atomic uint64_t packets_resent, underruns; /* of takes that have ended */
};

struct ls_metrics {
    struct ls_camera_metrics cameras[LS_MAX_CAMERAS];
    _Atomic uint64_t pulses; /* of takes, warm-up aside */
    _Atomic uint64_t takes_complete, takes_incomplete, takes_aborted, takes_failed;
};

/** What is counted when a picture of @camera has become durable; no camera: nothing. */
struct ls_picture_times {
    struct ls_camera_metrics *camera;
    uint64_t pulse_ns, merged_ns; /* host, CLOCK_MONOTONIC_RAW */
};

/** RT-safe. */
static inline void ls_count(_Atomic uint64_t *counter, uint64_t by)
{
    atomic_fetch_add_explicit(counter, by, memory_order_relaxed);
}

/** The time from @from_ns to @to_ns; 0 where clocks put the end before the start. RT-safe. */
void ls_metrics_time(struct ls_camera_metrics *camera, enum ls_latency latency, uint64_t from_ns,
                     uint64_t to_ns);

/** The picture is durable now. */
void ls_metrics_stored(const struct ls_picture_times *times, uint64_t now_ns);

/** "frame", "merged", "stored", "total". */
const char *ls_latency_name(enum ls_latency latency);

/** A word for a reason, as protocol and Prometheus have it: "incomplete", "late", ...; "fine" is of
 * no frame that was discarded. */
const char *ls_metrics_reason(enum ls_bind_reason reason);

#endif

/*
 * metrics_reply: the daemon's counters as the protocol says them.
 * Layer: daemon. Threads: any. Ownership: the reply owns all its message points to, but for the
 * cameras' names, which are the configuration's.
 */
#ifndef LS_DAEMON_METRICS_REPLY_H
#define LS_DAEMON_METRICS_REPLY_H

#include "daemon/config.h"
#include "daemon/metrics.h"
#include "proto/lightstage.pb-c.h"

enum { LS_BELOW_FIRST = 18, LS_BELOWS = 18 /* powers of two, ns: 0.26 ms to 34 s */ };

struct ls_camera_metrics_reply {
    Lightstage__CameraMetrics message;
    Lightstage__Latency latencies[LS_LATENCIES], *latency_pointers[LS_LATENCIES];
    uint64_t below[LS_LATENCIES][LS_BELOWS];
    Lightstage__ReasonCount frames[LS_BIND_REASONS], steps[LS_BIND_REASONS];
    Lightstage__ReasonCount *frame_pointers[LS_BIND_REASONS], *step_pointers[LS_BIND_REASONS];
};

struct ls_metrics_reply {
    Lightstage__MetricsReply message;
    struct ls_camera_metrics_reply cameras[LS_MAX_CAMERAS];
    Lightstage__CameraMetrics *camera_pointers[LS_MAX_CAMERAS];
};

/** What @metrics hold now; the members about clients are the caller's to fill. (transfer full). */
struct ls_metrics_reply *ls_metrics_reply_create(const struct ls_metrics *metrics,
                                                 const struct ls_config *config);

/** NULL is allowed. */
void ls_metrics_reply_free(struct ls_metrics_reply *reply);

#endif

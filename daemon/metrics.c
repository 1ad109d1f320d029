#include "daemon/metrics.h"

void ls_metrics_time(struct ls_camera_metrics *camera, enum ls_latency latency, uint64_t from_ns,
                     uint64_t to_ns)
{
    ls_histogram_add(&camera->latencies[latency], to_ns > from_ns ? to_ns - from_ns : 0);
}

void ls_metrics_stored(const struct ls_picture_times *times, uint64_t now_ns)
{
    if (!times->camera)
        return;
    ls_metrics_time(times->camera, LS_LATENCY_STORED, times->merged_ns, now_ns);
    ls_metrics_time(times->camera, LS_LATENCY_TOTAL, times->pulse_ns, now_ns);
}

const char *ls_latency_name(enum ls_latency latency)
{
    static const char *const names[LS_LATENCIES] = {"frame", "merged", "stored", "total"};
    return names[latency];
}

const char *ls_metrics_reason(enum ls_bind_reason reason)
{
    static const char *const words[LS_BIND_REASONS] = {
        [LS_BIND_FINE] = "fine",
        [LS_BIND_LOST] = "incomplete",
        [LS_BIND_STALE] = "late",
        [LS_BIND_NO_PULSE] = "no_pulse",
        [LS_BIND_TWO_PULSES] = "two_pulses",
        [LS_BIND_IDS] = "ids",
        [LS_BIND_EXPOSURE] = "exposure",
        [LS_BIND_RESIDUAL] = "residual",
        [LS_BIND_CLIPPED] = "clipped",
        [LS_BIND_SUSPECT] = "suspect",
        [LS_BIND_NO_FRAME] = "no_frame",
        [LS_BIND_NO_EVENT] = "no_event",
    };
    return words[reason];
}

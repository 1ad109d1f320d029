#include "daemon/metrics_reply.h"

#include <glib.h>

static void fill_latency(struct ls_camera_metrics_reply *reply, enum ls_latency which,
                         const struct ls_histogram *histogram)
{
    const struct ls_histogram_summary s = ls_histogram_summary(histogram);
    Lightstage__Latency *out = &reply->latencies[which];
    lightstage__latency__init(out);
    out->part = (char *)ls_latency_name(which);
    out->count = s.count;
    out->sum_ns = s.sum;
    out->p50_ns = s.p50;
    out->p99_ns = s.p99;
    out->max_ns = s.max;
    for (uint32_t i = 0; i < LS_BELOWS; i++)
        reply->below[which][i] = ls_histogram_below(histogram, 1ull << (LS_BELOW_FIRST + i));
    out->below = reply->below[which];
    out->n_below = LS_BELOWS;
    reply->latency_pointers[which] = out;
}

/* Every reason but LS_BIND_FINE, which is none. Returns how many. */
static size_t fill_reasons(Lightstage__ReasonCount *out, Lightstage__ReasonCount **pointers,
                           const _Atomic uint64_t *counters)
{
    size_t n = 0;
    for (uint32_t i = LS_BIND_FINE + 1; i < LS_BIND_REASONS; i++, n++) {
        lightstage__reason_count__init(&out[n]);
        out[n].reason = (char *)ls_metrics_reason((enum ls_bind_reason)i);
        out[n].count = atomic_load(&counters[i]);
        pointers[n] = &out[n];
    }
    return n;
}

static void fill_camera(struct ls_camera_metrics_reply *reply, const char *name,
                        const struct ls_camera_metrics *metrics)
{
    Lightstage__CameraMetrics *out = &reply->message;
    lightstage__camera_metrics__init(out);
    out->name = name ? (char *)name : out->name;
    for (uint32_t i = 0; i < LS_LATENCIES; i++)
        fill_latency(reply, (enum ls_latency)i, &metrics->latencies[i]);
    out->latencies = reply->latency_pointers;
    out->n_latencies = LS_LATENCIES;
    out->frames_bound = atomic_load(&metrics->frames_bound);
    out->frames_discarded = reply->frame_pointers;
    out->n_frames_discarded =
        fill_reasons(reply->frames, reply->frame_pointers, metrics->frames_discarded);
    out->steps_unbound = reply->step_pointers;
    out->n_steps_unbound = fill_reasons(reply->steps, reply->step_pointers, metrics->steps_unbound);
    out->shots_lost = atomic_load(&metrics->shots_lost);
    out->shots_repaired = atomic_load(&metrics->shots_repaired);
    out->settling_pulses = atomic_load(&metrics->settling_pulses);
    out->packets_resent = atomic_load(&metrics->packets_resent);
    out->underruns = atomic_load(&metrics->underruns);
}

struct ls_metrics_reply *ls_metrics_reply_create(const struct ls_metrics *metrics,
                                                 const struct ls_config *config)
{
    struct ls_metrics_reply *reply = g_new0(struct ls_metrics_reply, 1);
    Lightstage__MetricsReply *out = &reply->message;
    lightstage__metrics_reply__init(out);
    for (uint32_t i = 0; i < config->n_cameras; i++) {
        fill_camera(&reply->cameras[i], config->cameras[i].name, &metrics->cameras[i]);
        reply->camera_pointers[i] = &reply->cameras[i].message;
    }
    out->cameras = reply->camera_pointers;
    out->n_cameras = config->n_cameras;
    out->pulses = atomic_load(&metrics->pulses);
    out->takes_complete = atomic_load(&metrics->takes_complete);
    out->takes_incomplete = atomic_load(&metrics->takes_incomplete);
    out->takes_aborted = atomic_load(&metrics->takes_aborted);
    out->takes_failed = atomic_load(&metrics->takes_failed);
    return reply;
}

void ls_metrics_reply_free(struct ls_metrics_reply *reply)
{
    g_free(reply);
}

/* What was counted since the daemon started. */
#include "clients/library.h"

/* Where the rest goes of the one block of memory that a caller gets. */
struct room {
    struct lightstage_camera_metrics *camera;
    struct lightstage_latency *latency;
    struct lightstage_reason *reason;
    const void **pointer;
};

static const struct lightstage_latency *const *
put_latencies(struct room *room, Lightstage__Latency *const *from, size_t n)
{
    const void **first = room->pointer;
    for (size_t i = 0; i < n; i++) {
        *room->latency = (struct lightstage_latency){
            .part = from[i]->part,
            .count = from[i]->count,
            .sum_ns = from[i]->sum_ns,
            .p50_ns = from[i]->p50_ns,
            .p99_ns = from[i]->p99_ns,
            .max_ns = from[i]->max_ns,
            .n_below = from[i]->n_below,
            .below = from[i]->below,
        };
        *room->pointer++ = room->latency++;
    }
    return (const struct lightstage_latency *const *)first;
}

static const struct lightstage_reason *const *
put_reasons(struct room *room, Lightstage__ReasonCount *const *from, size_t n)
{
    const void **first = room->pointer;
    for (size_t i = 0; i < n; i++) {
        *room->reason = (struct lightstage_reason){from[i]->reason, from[i]->count};
        *room->pointer++ = room->reason++;
    }
    return (const struct lightstage_reason *const *)first;
}

static void put_camera(struct room *room, const Lightstage__CameraMetrics *c)
{
    *room->camera++ = (struct lightstage_camera_metrics){
        .name = c->name,
        .n_latencies = c->n_latencies,
        .latencies = put_latencies(room, c->latencies, c->n_latencies),
        .n_frames_discarded = c->n_frames_discarded,
        .n_steps_unbound = c->n_steps_unbound,
        .frames_discarded = put_reasons(room, c->frames_discarded, c->n_frames_discarded),
        .steps_unbound = put_reasons(room, c->steps_unbound, c->n_steps_unbound),
        .frames_bound = c->frames_bound,
        .shots_lost = c->shots_lost,
        .shots_repaired = c->shots_repaired,
        .packets_resent = c->packets_resent,
        .underruns = c->underruns,
        .settling_pulses = c->settling_pulses,
    };
}

static void fill(struct lightstage_metrics *metrics, const Lightstage__MetricsReply *r)
{
    metrics->n_cameras = r->n_cameras;
    metrics->pulses = r->pulses;
    metrics->takes_complete = r->takes_complete;
    metrics->takes_incomplete = r->takes_incomplete;
    metrics->takes_aborted = r->takes_aborted;
    metrics->takes_failed = r->takes_failed;
    metrics->take_running = r->take_running;
    metrics->connections = r->connections;
    metrics->stalled_closed = r->stalled_closed;
    metrics->events_skipped = r->events_skipped;
    metrics->credit_waits = r->credit_waits;
    metrics->pictures_skipped = r->pictures_skipped;
}

static void *make_metrics(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__MetricsReply *r = (const Lightstage__MetricsReply *)reply->message;
    size_t cameras = r->n_cameras, latencies = 0, reasons = 0;
    for (size_t i = 0; i < cameras; i++) {
        latencies += r->cameras[i]->n_latencies;
        reasons += r->cameras[i]->n_frames_discarded + r->cameras[i]->n_steps_unbound;
    }
    struct lightstage_metrics *metrics =
        ls_library_keep(reply,
                        sizeof *metrics + cameras * sizeof(struct lightstage_camera_metrics) +
                            latencies * sizeof(struct lightstage_latency) +
                            reasons * sizeof(struct lightstage_reason) +
                            (cameras + latencies + reasons) * sizeof(void *),
                        error);
    if (!metrics)
        return NULL;
    struct room room = {.camera = (struct lightstage_camera_metrics *)(metrics + 1)};
    const struct lightstage_camera_metrics *first = room.camera;
    room.latency = (struct lightstage_latency *)(room.camera + cameras);
    room.reason = (struct lightstage_reason *)(room.latency + latencies);
    room.pointer = (const void **)(room.reason + reasons);
    const void **at = room.pointer;
    room.pointer += cameras;
    for (size_t i = 0; i < cameras; i++) {
        at[i] = first + i;
        put_camera(&room, r->cameras[i]);
    }
    fill(metrics, r);
    metrics->cameras = (const struct lightstage_camera_metrics *const *)at;
    return metrics;
}

uint32_t lightstage_metrics(struct lightstage *stage, struct lightstage_metrics **out,
                            struct lightstage_error *error)
{
    Lightstage__Metrics body = LIGHTSTAGE__METRICS__INIT;
    return ls_library_ask(stage, LS_MESSAGE_METRICS, &body.base, NULL, 0, make_metrics, out, error);
}

void lightstage_metrics_free(struct lightstage_metrics *metrics)
{
    ls_library_release(metrics);
}

#include "clients/prometheus.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BELOW_FIRST = 18 /* Latency.below: 2^18 ns, then its doubles */ };

/* A label's value: what the format would misread is escaped. */
static void put_value(FILE *out, const char *value)
{
    for (; *value; value++)
        if (*value == '\n')
            fputs("\\n", out);
        else if (*value == '"' || *value == '\\')
            fprintf(out, "\\%c", *value);
        else
            fputc(*value, out);
}

static void put_name(FILE *out, const char *metric, const char *camera)
{
    fprintf(out, "lightstage_%s{camera=\"", metric);
    put_value(out, camera);
    fputc('"', out);
}

static void put_label(FILE *out, const char *label, const char *value)
{
    fprintf(out, ",%s=\"", label);
    put_value(out, value);
    fputc('"', out);
}

static void put_head(FILE *out, const char *metric, const char *type, const char *help)
{
    fprintf(out, "# HELP lightstage_%s %s\n# TYPE lightstage_%s %s\n", metric, help, metric, type);
}

static void put_one(FILE *out, const char *metric, const char *type, const char *help,
                    uint64_t value)
{
    put_head(out, metric, type, help);
    fprintf(out, "lightstage_%s %" PRIu64 "\n", metric, value);
}

static void put_take(FILE *out, const char *state, uint64_t n)
{
    fprintf(out, "lightstage_takes_total{state=\"%s\"} %" PRIu64 "\n", state, n);
}

static void put_daemon(FILE *out, const struct lightstage_metrics *m)
{
    put_head(out, "takes_total", "counter", "Takes that ended, by how.");
    put_take(out, "complete", m->takes_complete);
    put_take(out, "incomplete", m->takes_incomplete);
    put_take(out, "aborted", m->takes_aborted);
    put_take(out, "failed", m->takes_failed);
    put_one(out, "take_running", "gauge", "1 while a take runs.", m->take_running);
    put_one(out, "pulses_total", "counter", "Trigger pulses of takes.", m->pulses);
    put_one(out, "connections", "gauge", "Clients now.", m->connections);
    put_one(out, "stalled_closed_total", "counter", "Clients closed because they stopped reading.",
            m->stalled_closed);
    put_one(out, "events_skipped_total", "counter", "Reports that a slow client did not get.",
            m->events_skipped);
    put_one(out, "pictures_skipped_total", "counter",
            "Pictures of what cameras see that a slow client did not get.", m->pictures_skipped);
    put_one(out, "credit_waits_total", "counter",
            "Times that a request waited for its client's credit.", m->credit_waits);
}

/* ---- counters of cameras ---- */

struct counter {
    const char *metric, *help;
    size_t offset; /* of a uint64_t in lightstage_camera_metrics */
};

static void put_counter(FILE *out, const struct lightstage_metrics *m, const struct counter *c)
{
    put_head(out, c->metric, "counter", c->help);
    for (size_t i = 0; i < m->n_cameras; i++) {
        uint64_t value;
        memcpy(&value, (const char *)m->cameras[i] + c->offset, sizeof value);
        put_name(out, c->metric, m->cameras[i]->name);
        fprintf(out, "} %" PRIu64 "\n", value);
    }
}

static void put_counters(FILE *out, const struct lightstage_metrics *m)
{
    static const struct counter counters[] = {
        {"frames_bound_total", "Frames bound to the pulse they show.",
         offsetof(struct lightstage_camera_metrics, frames_bound)},
        {"shots_lost_total", "Shots fired without a usable frame.",
         offsetof(struct lightstage_camera_metrics, shots_lost)},
        {"shots_repaired_total", "Lost shots that were shot again and had.",
         offsetof(struct lightstage_camera_metrics, shots_repaired)},
        {"settling_pulses_total", "Dark pulses after an exposure was written.",
         offsetof(struct lightstage_camera_metrics, settling_pulses)},
        {"packets_resent_total", "Packets lost on the network and sent again.",
         offsetof(struct lightstage_camera_metrics, packets_resent)},
        {"underruns_total", "Packets or frames for which no buffer was free.",
         offsetof(struct lightstage_camera_metrics, underruns)},
    };
    for (size_t i = 0; i < sizeof counters / sizeof *counters; i++)
        put_counter(out, m, &counters[i]);
}

static void put_reasons(FILE *out, const char *metric, const char *camera,
                        const struct lightstage_reason *const *reasons, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        put_name(out, metric, camera);
        put_label(out, "reason", reasons[i]->reason);
        fprintf(out, "} %" PRIu64 "\n", reasons[i]->count);
    }
}

static void put_losses(FILE *out, const struct lightstage_metrics *m)
{
    put_head(out, "frames_discarded_total", "counter", "Frames that were not used, by reason.");
    for (size_t i = 0; i < m->n_cameras; i++)
        put_reasons(out, "frames_discarded_total", m->cameras[i]->name,
                    m->cameras[i]->frames_discarded, m->cameras[i]->n_frames_discarded);
    put_head(out, "steps_unbound_total", "counter", "Pulses without a usable frame, by reason.");
    for (size_t i = 0; i < m->n_cameras; i++)
        put_reasons(out, "steps_unbound_total", m->cameras[i]->name, m->cameras[i]->steps_unbound,
                    m->cameras[i]->n_steps_unbound);
}

/* ---- latencies ---- */

/* `below` counts times shorter than a power of two; the format's border belongs to the bucket. */
static void put_buckets(FILE *out, const char *camera, const struct lightstage_latency *l)
{
    static const char metric[] = "latency_seconds_bucket";
    char border[32];
    for (size_t i = 0; i < l->n_below && i + BELOW_FIRST < 63; i++) {
        snprintf(border, sizeof border, "%.9f", (double)((1ull << (BELOW_FIRST + i)) - 1) * 1e-9);
        put_name(out, metric, camera);
        put_label(out, "part", l->part);
        put_label(out, "le", border);
        fprintf(out, "} %" PRIu64 "\n", l->below[i]);
    }
    put_name(out, metric, camera);
    put_label(out, "part", l->part);
    put_label(out, "le", "+Inf");
    fprintf(out, "} %" PRIu64 "\n", l->count);
    put_name(out, "latency_seconds_sum", camera);
    put_label(out, "part", l->part);
    fprintf(out, "} %.9f\n", (double)l->sum_ns * 1e-9);
    put_name(out, "latency_seconds_count", camera);
    put_label(out, "part", l->part);
    fprintf(out, "} %" PRIu64 "\n", l->count);
}

static void put_quantile(FILE *out, const char *camera, const struct lightstage_latency *l,
                         const char *quantile, uint64_t ns)
{
    put_name(out, "latency_quantile_seconds", camera);
    put_label(out, "part", l->part);
    put_label(out, "quantile", quantile);
    fprintf(out, "} %.9f\n", (double)ns * 1e-9);
}

static void put_latencies(FILE *out, const struct lightstage_metrics *m)
{
    put_head(out, "latency_seconds", "histogram",
             "Pulse to frame, last frame to merged, merged to stored, and in total.");
    for (size_t i = 0; i < m->n_cameras; i++)
        for (size_t k = 0; k < m->cameras[i]->n_latencies; k++)
            put_buckets(out, m->cameras[i]->name, m->cameras[i]->latencies[k]);
    put_head(out, "latency_quantile_seconds", "gauge",
             "The same since the daemon started: median, 99 %, largest; to 1.6 %.");
    for (size_t i = 0; i < m->n_cameras; i++)
        for (size_t k = 0; k < m->cameras[i]->n_latencies; k++) {
            const struct lightstage_latency *l = m->cameras[i]->latencies[k];
            put_quantile(out, m->cameras[i]->name, l, "0.5", l->p50_ns);
            put_quantile(out, m->cameras[i]->name, l, "0.99", l->p99_ns);
            put_quantile(out, m->cameras[i]->name, l, "1", l->max_ns);
        }
}

char *ls_prometheus_text(const struct lightstage_metrics *metrics, size_t *n)
{
    char *text = NULL;
    FILE *out = open_memstream(&text, n);
    if (!out)
        return NULL;
    put_daemon(out, metrics);
    put_counters(out, metrics);
    put_losses(out, metrics);
    put_latencies(out, metrics);
    if (fclose(out) == 0)
        return text;
    free(text);
    return NULL;
}

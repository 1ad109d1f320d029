#include "clients/command.h"
#include "clients/prometheus.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

/* ---- JSON ---- */

static json_t *latency_json(const struct lightstage_latency *l)
{
    return json_pack("{sI sf sf sf}", "count", (json_int_t)l->count, "p50_ms",
                     (double)l->p50_ns * 1e-6, "p99_ms", (double)l->p99_ns * 1e-6, "max_ms",
                     (double)l->max_ns * 1e-6);
}

/* Reasons that occurred. */
static json_t *reasons_json(const struct lightstage_reason *const *reasons, size_t n)
{
    json_t *out = json_object();
    for (size_t i = 0; i < n; i++)
        if (reasons[i]->count)
            json_object_set_new(out, reasons[i]->reason,
                                json_integer((json_int_t)reasons[i]->count));
    return out;
}

static json_t *camera_json(const struct lightstage_camera_metrics *c)
{
    json_t *latencies = json_object();
    for (size_t i = 0; i < c->n_latencies; i++)
        json_object_set_new(latencies, c->latencies[i]->part, latency_json(c->latencies[i]));
    return json_pack("{ss so sI so so sI sI sI sI sI}", "name", c->name, "latencies", latencies,
                     "frames_bound", (json_int_t)c->frames_bound, "frames_discarded",
                     reasons_json(c->frames_discarded, c->n_frames_discarded), "steps_unbound",
                     reasons_json(c->steps_unbound, c->n_steps_unbound), "shots_lost",
                     (json_int_t)c->shots_lost, "shots_repaired", (json_int_t)c->shots_repaired,
                     "settling_pulses", (json_int_t)c->settling_pulses, "packets_resent",
                     (json_int_t)c->packets_resent, "underruns", (json_int_t)c->underruns);
}

static void print_json(const struct lightstage_metrics *m)
{
    json_t *cameras = json_array();
    for (size_t i = 0; i < m->n_cameras; i++)
        json_array_append_new(cameras, camera_json(m->cameras[i]));
    ls_command_print_json(
        json_pack("{so sI sI sI sI sI sb sI}", "cameras", cameras, "pulses", (json_int_t)m->pulses,
                  "takes_complete", (json_int_t)m->takes_complete, "takes_incomplete",
                  (json_int_t)m->takes_incomplete, "takes_aborted", (json_int_t)m->takes_aborted,
                  "takes_failed", (json_int_t)m->takes_failed, "take_running", m->take_running,
                  "pictures_skipped", (json_int_t)m->pictures_skipped));
}

/* ---- text ---- */

static void print_reasons(const char *what, const struct lightstage_reason *const *reasons,
                          size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (reasons[i]->count)
            ls_say("  %" PRIu64 " %s: %s\n", reasons[i]->count, what, reasons[i]->reason);
}

static void print_camera(const struct lightstage_camera_metrics *c)
{
    ls_say("camera %s: %" PRIu64 " frames bound, %" PRIu64 " shots lost, %" PRIu64
           " repaired, %" PRIu64 " packets sent again\n",
           c->name, c->frames_bound, c->shots_lost, c->shots_repaired, c->packets_resent);
    print_reasons("frames discarded", c->frames_discarded, c->n_frames_discarded);
    print_reasons("pulses without a frame", c->steps_unbound, c->n_steps_unbound);
    printf("  %-8s %10s %10s %10s %10s\n", "ms", "count", "p50", "p99", "max");
    for (size_t i = 0; i < c->n_latencies; i++)
        ls_say("  %-8s %10" PRIu64 " %10.2f %10.2f %10.2f\n", c->latencies[i]->part,
               c->latencies[i]->count, (double)c->latencies[i]->p50_ns * 1e-6,
               (double)c->latencies[i]->p99_ns * 1e-6, (double)c->latencies[i]->max_ns * 1e-6);
}

static void print_text(const struct lightstage_metrics *m)
{
    printf("takes: %" PRIu64 " complete, %" PRIu64 " incomplete, %" PRIu64 " aborted, %" PRIu64
           " failed; %" PRIu64 " pulses\n",
           m->takes_complete, m->takes_incomplete, m->takes_aborted, m->takes_failed, m->pulses);
    for (size_t i = 0; i < m->n_cameras; i++)
        print_camera(m->cameras[i]);
}

/* ---- Prometheus ---- */

static int print_prometheus(struct ls_command_context *context, const struct lightstage_metrics *m,
                            const char *path)
{
    size_t n = 0;
    LS_CLEANUP_FREE char *text = ls_prometheus_text(m, &n);
    if (!text)
        return ls_command_failed(context, ls_fail(&context->diag, LS_ERR_NOMEM, "out of memory"));
    if (!path) {
        fputs(text, stdout);
        return LS_EXIT_OK;
    }
    enum ls_err err = ls_command_write_file(path, text, n, &context->diag);
    return err ? ls_command_wrong("%s", context->diag.text) : LS_EXIT_OK;
}

/* ---- the command ---- */

struct options {
    bool prometheus;
    const char *output;
};

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *o)
{
    static const struct option options[] = {{"prometheus", no_argument, NULL, 'p'},
                                            {"output", required_argument, NULL, 'o'},
                                            LS_COMMON_OPTIONS};
    *o = (struct options){0};
    for (int c; (c = ls_command_option(context, &ls_command_metrics, argc, argv, options)) != -1;)
        if (c == 'p')
            o->prometheus = true;
        else if (c == 'o')
            o->output = optarg;
        else
            return LS_EXIT_USAGE;
    if (!ls_command_arguments(&ls_command_metrics, argc, 0))
        return LS_EXIT_USAGE;
    if (o->output && !o->prometheus)
        return ls_command_wrong("metrics: --output goes with --prometheus");
    return LS_EXIT_OK;
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct lightstage_metrics *m = NULL;
    struct options o;
    int code = parse(context, argc, argv, &o);
    if (!code)
        code = ls_command_open(context);
    if (!code)
        code =
            ls_command_answered(context, lightstage_metrics(context->stage, &m, &context->error));
    if (code)
        return code;
    if (o.prometheus)
        code = print_prometheus(context, m, o.output);
    else if (context->json)
        print_json(m);
    else
        print_text(m);
    lightstage_metrics_free(m);
    return code;
}

const struct ls_command ls_command_metrics = {
    "metrics", "What was counted since the daemon started, and how long pictures take",
    "[--prometheus [--output FILE]] [--json]\n"
    "  --prometheus   in the text format of Prometheus, for node_exporter's textfile collector\n"
    "  --output FILE  there, as a whole file, in place of standard output",
    run};

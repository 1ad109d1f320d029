#include "daemon/engine_private.h"

#include "daemon/file.h"

#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const int64_t probe_remember_us = 1000000, probe_wait_us = 250000;

enum { REPORT_PERIOD_MS = 100, CALIBRATION_MAX_BYTES = 256 << 20 };

static enum ls_err parse_calibration(struct ls_engine *e, size_t length, struct ls_diag *diag)
{
    struct ls_diag inner = {0};
    enum ls_err err = ls_calibration_parse(e->calibration_json, length, &e->calibration, &inner);
    return err ? ls_fail(diag, err, "%.200s: %.300s", e->config->calibration_path, inner.text)
               : LS_OK;
}

static enum ls_err load_calibration(struct ls_engine *e, struct ls_diag *diag)
{
    if (!e->config->calibration_path)
        return LS_OK;
    size_t length = 0;
    enum ls_err err = ls_file_read(e->config->calibration_path, CALIBRATION_MAX_BYTES,
                                   &e->calibration_json, &length, diag);
    if (!err)
        err = parse_calibration(e, length, diag);
    if (!err && e->calibration->n_lights != e->config->n_lights)
        err = ls_fail(diag, LS_ERR_MISMATCH, "%s: %u lights, the rig has %u: calibrate this rig",
                      e->config->calibration_path, e->calibration->n_lights, e->config->n_lights);
    return err;
}

enum ls_err ls_engine_create(const struct ls_config *config, ls_take_callback *callback, void *user,
                             struct ls_engine **out, struct ls_diag *diag)
{
    struct ls_engine *e = calloc(1, sizeof *e);
    if (!e)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    e->config = config;
    e->callback = callback;
    e->user = user;
    e->main = g_main_context_ref_thread_default();
    e->preview = ls_preview_create(config);
    e->events = ls_events_create();
    e->errands = ls_errands_create();
    if (e->errands)
        e->probe = ls_probe_create(config, e->errands, probe_remember_us, probe_wait_us);
    enum ls_err err = e->probe && e->preview ? load_calibration(e, diag)
                                             : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (err) {
        ls_engine_destroy(e);
        return err;
    }
    e->context = (struct ls_take_context){config,      e->calibration_json, e->calibration,
                                          &e->metrics, e->preview,          e->events};
    *out = e;
    return LS_OK;
}

void ls_engine_notify(struct ls_engine *e)
{
    if (e->callback)
        e->callback(e->user, &e->status);
}

static void tell_alarms(struct ls_engine *e)
{
    const struct ls_capture_progress *p = &e->status.progress;
    bool pauses = p->cooling && e->thread; /* what has ended does not pause any more */
    ls_events_alarm(e->events, LS_ALARM_HOT, pauses, e->status.id, e->status.message);
    if (p->drift.known && p->drift.alarm)
        ls_events_alarm(e->events, LS_ALARM_DRIFT, true, e->status.id, p->drift.text);
}

static gboolean report_progress(gpointer data)
{
    struct ls_engine *e = data;
    ls_take_progress(e->take, &e->status.progress);
    if (e->status.state == LS_TAKE_PREPARING && e->status.progress.steps_bound)
        e->status.state = LS_TAKE_RUNNING;
    snprintf(e->status.message, sizeof e->status.message, "%s",
             e->status.progress.cooling ? "paused: the dome is hot; it goes on by itself" : "");
    tell_alarms(e);
    ls_engine_notify(e);
    return G_SOURCE_CONTINUE;
}

static void count_take(struct ls_engine *e)
{
    switch (e->end_state) {
    case LS_TAKE_COMPLETE:
        ls_count(&e->metrics.takes_complete, 1);
        break;
    case LS_TAKE_INCOMPLETE:
        ls_count(&e->metrics.takes_incomplete, 1);
        break;
    case LS_TAKE_ABORTED:
        ls_count(&e->metrics.takes_aborted, 1);
        break;
    default:
        ls_count(&e->metrics.takes_failed, 1);
    }
}

/* What a take's threads have freed lies in arenas that the next take's threads may not find again:
 * without this a daemon of 12 MB grows by a fifth over 1,000 takes. */
static void give_memory_back(void)
{
#ifdef __GLIBC__
    malloc_trim(0);
#endif
}

/* The thread has nothing left to do: join it and tell. */
static void reap(struct ls_engine *e)
{
    g_thread_join(e->thread);
    e->thread = NULL;
    g_source_destroy(e->timer);
    g_clear_pointer(&e->timer, g_source_unref);
    ls_take_progress(e->take, &e->status.progress);
    ls_take_destroy(e->take);
    e->take = NULL;
    give_memory_back();
    e->status.state = e->end_state;
    count_take(e);
    e->status.report = e->end_report;
    snprintf(e->status.message, sizeof e->status.message, "%s", e->end_message.text);
    tell_alarms(e);
}

static gboolean take_ended(gpointer data)
{
    struct ls_engine *e = data;
    if (e->take) {
        reap(e);
        ls_engine_notify(e);
    }
    return G_SOURCE_REMOVE;
}

static gpointer take_main(gpointer data)
{
    struct ls_engine *e = data;
    e->end_state = ls_take_run(e->take, &e->end_report, &e->end_message);
    GSource *source = g_idle_source_new();
    g_source_set_priority(source, G_PRIORITY_DEFAULT);
    g_source_set_callback(source, take_ended, e, NULL);
    g_source_attach(source, e->main);
    g_source_unref(source);
    return NULL;
}

void ls_engine_remember(struct ls_engine *e, const char *token)
{
    snprintf(e->tokens[e->n_tokens++ % LS_TOKENS_REMEMBERED], sizeof e->tokens[0], "%s", token);
}

void ls_engine_launch(struct ls_engine *e, struct ls_take *take, const char *token)
{
    e->take = take;
    e->status = (struct ls_take_status){.state = LS_TAKE_PREPARING};
    snprintf(e->status.id, sizeof e->status.id, "%s", ls_take_id(take));
    snprintf(e->status.token, sizeof e->status.token, "%s", token);
    ls_engine_remember(e, token);
    e->timer = g_timeout_source_new(REPORT_PERIOD_MS);
    g_source_set_callback(e->timer, report_progress, e, NULL);
    g_source_attach(e->timer, e->main);
    e->thread = g_thread_new("ls-take", take_main, e);
    ls_engine_notify(e);
}

enum ls_err ls_engine_busy(const struct ls_engine *e, struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_BUSY, "take %s is running: wait for it or abort it", e->status.id);
}

enum ls_err ls_engine_need_rig(const struct ls_engine *e, struct ls_diag *diag)
{
    return e->config->n_lights > 0
               ? LS_OK
               : ls_fail(diag, LS_ERR_UNSUPPORTED,
                         "this daemon serves takes and makes none: its configuration names no rig");
}

/* ---- the live view ---- */

struct ls_preview *ls_engine_preview(struct ls_engine *e)
{
    return e->preview;
}

struct ls_events *ls_engine_events(struct ls_engine *e)
{
    return e->events;
}

enum ls_err ls_engine_frame(struct ls_engine *e, const struct ls_framing_wish *wish,
                            struct ls_diag *diag)
{
    enum ls_err err = ls_engine_need_rig(e, diag);
    if (err)
        return err;
    if (e->take)
        return ls_engine_busy(e, diag);
    if (ls_engine_prepares(e))
        return ls_fail(diag, LS_ERR_BUSY, "a take is being prepared: wait for it or abort it");
    if (e->framing)
        return ls_fail(diag, LS_ERR_BUSY, "another client has the live view under steady light");
    ls_errands_yield(e->errands);
    ls_probe_forget(e->probe);
    e->framing_err = LS_OK;
    return ls_framing_start(e->config, wish, e->preview, e->errands, &e->framing, diag);
}

bool ls_engine_framing(const struct ls_engine *e)
{
    return e->framing && ls_framing_runs(e->framing);
}

/* A live view on its way out, on ls-rig. */
struct leaving {
    struct ls_errand errand;
    struct ls_framing *framing;
};

static void end_framing(struct ls_errand *errand)
{
    struct leaving *leaving = (struct leaving *)errand;
    struct ls_diag why = {{0}};
    if (ls_framing_end(leaving->framing, &why))
        g_warning("the live view: %s", why.text);
    leaving->framing = NULL;
}

static void framing_ended(struct ls_errand *errand)
{
    if (((struct leaving *)errand)->framing) /* stopped before its turn */
        end_framing(errand);
    g_free(errand);
}

static void leave(struct ls_framing *framing, bool dark, struct ls_errands *errands)
{
    struct leaving *leaving = g_new0(struct leaving, 1);
    leaving->errand = (struct ls_errand){.work = end_framing, .done = framing_ended};
    leaving->framing = framing;
    ls_framing_stop(framing, dark);
    ls_errands_put(errands, &leaving->errand);
}

enum ls_err ls_engine_frame_end(struct ls_engine *e, struct ls_diag *diag)
{
    if (e->framing && ls_framing_runs(e->framing))
        leave(e->framing, false, e->errands);
    else if (e->framing)
        e->framing_err = ls_framing_end(e->framing, &e->framing_why);
    e->framing = NULL;
    if (e->framing_err && diag)
        *diag = e->framing_why;
    return e->framing_err;
}

void ls_engine_take_over(struct ls_engine *e, enum ls_err err, const char *why)
{
    if (!e->framing)
        return;
    if (!ls_framing_runs(e->framing)) {
        (void)ls_engine_frame_end(e, NULL);
    } else {
        leave(e->framing, true, e->errands);
        e->framing = NULL;
    }
    if (!e->framing_err)
        e->framing_err = ls_fail(&e->framing_why, err, "%s", why);
}

/* ---- takes ---- */

enum ls_err ls_engine_abort(struct ls_engine *e, struct ls_diag *diag)
{
    bool prepared = ls_engine_stop_visits(e, false);
    if (e->take)
        ls_take_abort(e->take);
    return e->take || prepared ? LS_OK : ls_fail(diag, LS_ERR_STATE, "no take is running");
}

const struct ls_metrics *ls_engine_metrics(const struct ls_engine *e)
{
    return &e->metrics;
}

const struct ls_config *ls_engine_config(const struct ls_engine *e)
{
    return e->config;
}

void ls_engine_destroy(struct ls_engine *e)
{
    if (!e)
        return;
    if (e->take)
        ls_take_abort(e->take); /* first of all */
    (void)ls_engine_frame_end(e, NULL);
    ls_errands_end(e->errands);
    if (e->take) {
        ls_take_abort(e->take); /* also one that was begun meanwhile */
        reap(e);
        ls_engine_notify(e);
    }
    while (g_main_context_find_source_by_user_data(e->main, e))
        g_source_destroy(g_main_context_find_source_by_user_data(e->main, e));
    g_main_context_unref(e->main);
    ls_probe_destroy(e->probe);
    ls_errands_destroy(e->errands);
    ls_preview_destroy(e->preview);
    ls_events_destroy(e->events);
    ls_calibration_destroy(e->calibration);
    free(e->calibration_json);
    free(e);
}

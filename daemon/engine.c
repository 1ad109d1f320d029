#include "daemon/engine.h"

#include "daemon/file.h"
#include "daemon/privileges.h"
#include "daemon/rig.h"
#include "daemon/take.h"
#include "daemon/take_token.h"

#include <glib.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

static const int64_t probe_remember_us = 1000000, probe_wait_us = 250000;

enum {
    REPORT_PERIOD_MS = 100,
    CALIBRATION_MAX_BYTES = 256 << 20,
    TOKENS_REMEMBERED = 256,
};

struct ls_engine {
    const struct ls_config *config;
    char *calibration_json;
    struct ls_calibration *calibration;
    struct ls_metrics metrics;
    struct ls_preview *preview;
    struct ls_framing *framing; /* NULL: none */
    enum ls_err framing_err;    /* what ended it, beside its client */
    struct ls_diag framing_why;
    struct ls_take_context context;
    ls_take_callback *callback;
    void *user;
    GMainContext *main;
    struct ls_probe *probe; /* released before anybody else opens a device */
    struct ls_take *take;   /* NULL: none runs */
    GThread *thread;
    GSource *timer;
    struct ls_take_status status;
    char tokens[TOKENS_REMEMBERED][64]; /* of takes that were started, oldest overwritten */
    unsigned n_tokens;
    /* written by the take's thread before it posts take_ended */
    enum ls_take_state end_state;
    struct ls_capture_report end_report;
    struct ls_diag end_message;
};

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
    e->probe = ls_probe_create(config, probe_remember_us, probe_wait_us);
    e->preview = ls_preview_create(config);
    enum ls_err err = e->probe && e->preview ? load_calibration(e, diag)
                                             : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (err) {
        ls_engine_destroy(e);
        return err;
    }
    e->context = (struct ls_take_context){config, e->calibration_json, e->calibration, &e->metrics,
                                          e->preview};
    *out = e;
    return LS_OK;
}

static void notify(struct ls_engine *e)
{
    if (e->callback)
        e->callback(e->user, &e->status);
}

static gboolean report_progress(gpointer data)
{
    struct ls_engine *e = data;
    ls_take_progress(e->take, &e->status.progress);
    if (e->status.state == LS_TAKE_PREPARING && e->status.progress.steps_bound)
        e->status.state = LS_TAKE_RUNNING;
    snprintf(e->status.message, sizeof e->status.message, "%s",
             e->status.progress.cooling ? "paused: the dome is hot; it goes on by itself" : "");
    notify(e);
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
    e->status.state = e->end_state;
    count_take(e);
    e->status.report = e->end_report;
    snprintf(e->status.message, sizeof e->status.message, "%s", e->end_message.text);
}

static gboolean take_ended(gpointer data)
{
    struct ls_engine *e = data;
    if (e->take) {
        reap(e);
        notify(e);
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

static void remember(struct ls_engine *e, const char *token)
{
    snprintf(e->tokens[e->n_tokens++ % TOKENS_REMEMBERED], sizeof e->tokens[0], "%s", token);
}

static void launch(struct ls_engine *e, struct ls_take *take, const char *token)
{
    e->take = take;
    e->status = (struct ls_take_status){.state = LS_TAKE_PREPARING};
    snprintf(e->status.id, sizeof e->status.id, "%s", ls_take_id(take));
    snprintf(e->status.token, sizeof e->status.token, "%s", token);
    remember(e, token);
    e->timer = g_timeout_source_new(REPORT_PERIOD_MS);
    g_source_set_callback(e->timer, report_progress, e, NULL);
    g_source_attach(e->timer, e->main);
    e->thread = g_thread_new("ls-take", take_main, e);
    notify(e);
}

static bool token_seen(const struct ls_engine *e, const char *token)
{
    for (unsigned i = 0; i < TOKENS_REMEMBERED && i < e->n_tokens; i++)
        if (*token && !strcmp(e->tokens[i], token))
            return true;
    return false;
}

static enum ls_err busy(const struct ls_engine *e, struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_BUSY, "take %s is running: wait for it or abort it", e->status.id);
}

static enum ls_err check_token(const char *token, struct ls_diag *diag)
{
    if (strlen(token) >= sizeof(((struct ls_take_status *)0)->token))
        return ls_fail(diag, LS_ERR_INVALID, "token of %zu bytes: expected at most 63",
                       strlen(token));
    return LS_OK;
}

/* ---- the live view ---- */

struct ls_preview *ls_engine_preview(struct ls_engine *e)
{
    return e->preview;
}

enum ls_err ls_engine_frame(struct ls_engine *e, const struct ls_framing_wish *wish,
                            struct ls_diag *diag)
{
    if (e->take)
        return busy(e, diag);
    if (e->framing)
        return ls_fail(diag, LS_ERR_BUSY, "another client has the live view under steady light");
    ls_probe_release(e->probe);
    e->framing_err = LS_OK;
    return ls_framing_start(e->config, wish, e->preview, &e->framing, diag);
}

bool ls_engine_framing(const struct ls_engine *e)
{
    return e->framing && ls_framing_runs(e->framing);
}

static void end_framing(struct ls_engine *e, bool dark)
{
    if (e->framing)
        e->framing_err = ls_framing_end(e->framing, dark, &e->framing_why);
    e->framing = NULL;
}

enum ls_err ls_engine_frame_end(struct ls_engine *e, struct ls_diag *diag)
{
    end_framing(e, false);
    if (e->framing_err && diag)
        *diag = e->framing_why;
    return e->framing_err;
}

/* The devices are needed for something else: its client learns why when it looks again. */
static void take_over(struct ls_engine *e, enum ls_err err, const char *why)
{
    if (!e->framing)
        return;
    end_framing(e, true);
    if (!e->framing_err)
        e->framing_err = ls_fail(&e->framing_why, err, "%s", why);
}

static void take_over_for_take(struct ls_engine *e)
{
    take_over(e, LS_ERR_BUSY, "a take begins: the live view under steady light ends");
}

/* ---- takes ---- */

enum ls_err ls_engine_preflight(struct ls_engine *e, const char *plan_text,
                                struct ls_preflight *out, struct ls_diag *diag)
{
    if (e->take)
        return busy(e, diag);
    if (e->framing)
        return ls_fail(diag, LS_ERR_BUSY, "the live view has the devices: end it first");
    ls_probe_release(e->probe);
    return ls_take_preflight(&e->context, plan_text, out, diag);
}

enum ls_err ls_engine_start(struct ls_engine *e, const char *name, const char *plan_text,
                            const char *token, bool *already, struct ls_diag *diag)
{
    struct ls_take *take;
    enum ls_err err = check_token(token, diag);
    *already = !err && token_seen(e, token);
    if (err || *already)
        return err;
    if (e->take)
        return busy(e, diag);
    *already = ls_take_token_find(e->config->storage, name, token, &e->status);
    if (*already) {
        remember(e, token);
        notify(e);
        return LS_OK;
    }
    take_over_for_take(e);
    ls_probe_release(e->probe);
    err = ls_take_create(&e->context, name, plan_text, token, &take, diag);
    if (!err)
        launch(e, take, token);
    return err;
}

enum ls_err ls_engine_resume(struct ls_engine *e, const char *take_id, const char *token,
                             struct ls_diag *diag)
{
    struct ls_take *take;
    enum ls_err err = check_token(token, diag);
    if (err || token_seen(e, token))
        return err;
    if (e->take)
        return busy(e, diag);
    take_over_for_take(e);
    ls_probe_release(e->probe);
    err = ls_take_reopen(&e->context, take_id, &take, diag);
    if (!err)
        launch(e, take, token);
    return err;
}

enum ls_err ls_engine_abort(struct ls_engine *e, struct ls_diag *diag)
{
    if (!e->take)
        return ls_fail(diag, LS_ERR_STATE, "no take is running");
    ls_take_abort(e->take);
    return LS_OK;
}

enum ls_err ls_engine_blank(struct ls_engine *e, struct ls_diag *diag)
{
    if (e->take) {
        ls_take_blank(e->take); /* the sequencer blanks first of all */
        return LS_OK;
    }
    take_over(e, LS_ERR_ABORTED, "all lights were turned off: the live view ends");
    ls_probe_release(e->probe);
    struct ls_lights *lights;
    enum ls_err err = ls_lights_open(&e->config->lights_driver, &lights, diag);
    if (err)
        return err;
    err = ls_lights_blank(lights, diag);
    ls_lights_close(lights);
    return err;
}

void ls_engine_status(struct ls_engine *e, struct ls_engine_status *out)
{
    struct statvfs fs;
    *out = (struct ls_engine_status){.n_cameras = e->config->n_cameras, .take = e->status};
    ls_privileges_missing(out->privileges, sizeof out->privileges);
    if (!statvfs(e->config->storage, &fs))
        out->disk_free_bytes = (uint64_t)fs.f_bavail * fs.f_frsize;
    snprintf(out->calibration, sizeof out->calibration, "%s", e->calibration ? "given" : "none");
    if (e->take || e->framing) { /* they hold the devices */
        out->devices.lights_connected = true;
        for (uint32_t i = 0; i < e->config->n_cameras; i++)
            out->devices.cameras[i].connected = true;
        return;
    }
    ls_probe_look(e->probe, &out->devices);
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
    if (e->take) {
        ls_take_abort(e->take);
        reap(e);
        notify(e);
    }
    while (g_main_context_find_source_by_user_data(e->main, e))
        g_source_destroy(g_main_context_find_source_by_user_data(e->main, e));
    g_main_context_unref(e->main);
    (void)ls_engine_frame_end(e, NULL);
    ls_probe_destroy(e->probe);
    ls_preview_destroy(e->preview);
    ls_calibration_destroy(e->calibration);
    free(e->calibration_json);
    free(e);
}

#include "tests/daemon/fake_engine.h"

#include <glib.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PLANNED = 100 };

struct ls_engine {
    const struct ls_config *config;
    ls_take_callback *callback;
    void *user;
    struct ls_take_status take;
    struct fake_engine_state state;
    struct ls_metrics metrics;
    struct ls_preview *preview;
    struct ls_events *events;
    bool framing;
    GMutex lock; /* of the counters that are waited for */
    GCond asked;
};

struct fake_engine_state *fake_engine_state(struct ls_engine *engine)
{
    return &engine->state;
}

void fake_engine_wait(struct ls_engine *engine, unsigned started, unsigned aborted)
{
    gint64 until = g_get_monotonic_time() + 30 * G_TIME_SPAN_SECOND;
    g_mutex_lock(&engine->lock);
    while (engine->state.started < started || engine->state.aborted < aborted)
        if (!g_cond_wait_until(&engine->asked, &engine->lock, until))
            g_error("%u takes begun and %u aborts asked for, expected %u and %u",
                    engine->state.started, engine->state.aborted, started, aborted);
    g_mutex_unlock(&engine->lock);
}

static void note(struct ls_engine *engine, unsigned *counter)
{
    g_mutex_lock(&engine->lock);
    ++*counter;
    g_cond_broadcast(&engine->asked);
    g_mutex_unlock(&engine->lock);
}

static bool running(const struct ls_engine *engine)
{
    return engine->take.state == LS_TAKE_PREPARING || engine->take.state == LS_TAKE_RUNNING;
}

void fake_engine_advance(struct ls_engine *engine, uint32_t steps)
{
    engine->take.state = LS_TAKE_RUNNING;
    engine->take.progress.steps_bound = steps;
    engine->take.progress.frames_per_second = 50;
    engine->callback(engine->user, &engine->take);
}

void fake_engine_end(struct ls_engine *engine, enum ls_take_state state)
{
    engine->take.state = state;
    engine->take.report.seconds = 2;
    snprintf(engine->take.message, sizeof engine->take.message, "ended in state %d", (int)state);
    engine->callback(engine->user, &engine->take);
}

enum ls_err ls_engine_create(const struct ls_config *config, ls_take_callback *callback, void *user,
                             struct ls_engine **out, struct ls_diag *diag)
{
    *out = calloc(1, sizeof **out);
    struct ls_preview *preview = ls_preview_create(config);
    if (!*out || !preview) {
        ls_preview_destroy(preview);
        free(*out);
        return LS_ERR_NOMEM;
    }
    **out = (struct ls_engine){.config = config,
                               .callback = callback,
                               .user = user,
                               .preview = preview,
                               .events = ls_events_create()};
    g_mutex_init(&(*out)->lock);
    g_cond_init(&(*out)->asked);
    return LS_OK;
}

void ls_engine_destroy(struct ls_engine *engine)
{
    if (!engine)
        return;
    g_mutex_clear(&engine->lock);
    g_cond_clear(&engine->asked);
    ls_preview_destroy(engine->preview);
    ls_events_destroy(engine->events);
    free(engine);
}

static void answer(struct ls_request *request, enum ls_err err)
{
    request->err = err;
    request->done(request);
}

void ls_engine_status(struct ls_engine *engine, struct ls_request *request)
{
    struct ls_engine_status *out = &request->status;
    memset(out, 0, sizeof *out);
    out->devices.lights_connected = true;
    snprintf(out->devices.lights_serial, sizeof out->devices.lights_serial, "DOME-1");
    out->devices.lights.state = LS_LIGHTS_IDLE;
    out->devices.lights.temperature_c = 31;
    out->devices.lights.faults = LS_FAULT_INTERLOCK;
    out->n_cameras = 1;
    out->devices.cameras[0].connected = true;
    snprintf(out->devices.cameras[0].model, sizeof out->devices.cameras[0].model, "M");
    snprintf(out->calibration, sizeof out->calibration, "given");
    out->disk_free_bytes = 5000000000;
    out->take = engine->take;
    answer(request, LS_OK);
}

static enum ls_err asked_for(struct ls_engine *engine, struct ls_diag *diag)
{
    enum ls_err err = engine->state.answer;
    engine->state.answer = LS_OK;
    return err ? ls_fail(diag, err, "the test says %s", ls_err_name(err)) : LS_OK;
}

void ls_engine_preflight(struct ls_engine *engine, const char *plan_text,
                         struct ls_request *request)
{
    request->preflight.shots = (uint32_t)strlen(plan_text);
    request->preflight.seconds = 12.5;
    request->engine = engine;
    if (engine->state.silent)
        note(engine, &engine->state.waiting);
    else
        answer(request, asked_for(engine, &request->diag));
}

void ls_engine_withdraw(struct ls_request *request, bool stop)
{
    request->engine->state.waiting--;
    request->engine->state.stopped += stop;
}

static enum ls_err launch(struct ls_engine *engine, const char *id, const char *token,
                          struct ls_diag *diag)
{
    enum ls_err err = asked_for(engine, diag);
    if (err)
        return err;
    if (running(engine))
        return ls_fail(diag, LS_ERR_BUSY, "take %s is running", engine->take.id);
    memset(&engine->take, 0, sizeof engine->take);
    engine->take.state = LS_TAKE_PREPARING;
    engine->take.progress.steps_planned = PLANNED;
    snprintf(engine->take.id, sizeof engine->take.id, "%s", id);
    snprintf(engine->take.token, sizeof engine->take.token, "%s", token);
    engine->callback(engine->user, &engine->take);
    return LS_OK;
}

void ls_engine_start(struct ls_engine *engine, const char *name, const char *plan_text,
                     const char *token, struct ls_request *request)
{
    enum ls_err err = LS_OK;
    request->already = strcmp(engine->take.token, token) == 0;
    if (!request->already) {
        err = launch(engine, "20260102T030405Z-vase-0a0b0c", token, &request->diag);
        if (!err)
            note(engine, &engine->state.started);
    }
    answer(request, err);
}

void ls_engine_resume(struct ls_engine *engine, const char *take_id, const char *token,
                      struct ls_request *request)
{
    enum ls_err err = launch(engine, take_id, token, &request->diag);
    engine->state.resumed += !err;
    answer(request, err);
}

enum ls_err ls_engine_abort(struct ls_engine *engine, struct ls_diag *diag)
{
    if (!running(engine))
        return ls_fail(diag, LS_ERR_STATE, "no take is running");
    note(engine, &engine->state.aborted);
    return LS_OK;
}

void ls_engine_blank(struct ls_engine *engine, struct ls_request *request)
{
    engine->state.blanked++;
    answer(request, LS_OK);
}

struct ls_preview *ls_engine_preview(struct ls_engine *engine)
{
    return engine->preview;
}

struct ls_events *ls_engine_events(struct ls_engine *engine)
{
    return engine->events;
}

enum ls_err ls_engine_frame(struct ls_engine *engine, const struct ls_framing_wish *wish,
                            struct ls_diag *diag)
{
    engine->framing = true;
    engine->state.framed++;
    return LS_OK;
}

enum ls_err ls_engine_frame_end(struct ls_engine *engine, struct ls_diag *diag)
{
    engine->framing = false;
    return LS_OK;
}

bool ls_engine_framing(const struct ls_engine *engine)
{
    return engine->framing;
}

struct ls_metrics *fake_engine_metrics(struct ls_engine *engine)
{
    return &engine->metrics;
}

const struct ls_metrics *ls_engine_metrics(const struct ls_engine *engine)
{
    return &engine->metrics;
}

const struct ls_config *ls_engine_config(const struct ls_engine *engine)
{
    return engine->config;
}

/*
 * visit: what is asked of the engine and needs the devices: its turn comes on ls-rig.
 */
#include "daemon/engine_private.h"

#include "daemon/privileges.h"
#include "daemon/take_token.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/statvfs.h>

struct ls_visit {
    struct ls_errand errand;
    struct ls_engine *engine;
    struct ls_request *request; /* NULL: nobody waits */
    enum { PREFLIGHT, START, RESUME, BLANK } kind;
    char *plan_text, *name, *token; /* name: or the take's */
    struct ls_take *take;           /* what came of it */
    struct ls_preflight preflight;
    bool already, dark; /* dark: stopped by blank */
    enum ls_err err;
    struct ls_diag diag;
};

static struct ls_visit *of(struct ls_errand *errand)
{
    return (struct ls_visit *)errand;
}

static void answer(struct ls_request *request, enum ls_err err)
{
    request->err = err;
    request->engine = NULL;
    request->visit = NULL;
    request->done(request);
}

/* ---- turns ---- */

static bool token_seen(const struct ls_engine *e, const char *token)
{
    for (unsigned i = 0; i < LS_TOKENS_REMEMBERED && i < e->n_tokens; i++)
        if (*token && !strcmp(e->tokens[i], token))
            return true;
    return false;
}

/* Was it begun before, by this daemon or an earlier one? */
static bool is_known(struct ls_visit *v)
{
    struct ls_engine *e = v->engine;
    if (v->kind == PREFLIGHT)
        return false;
    if (token_seen(e, v->token))
        return true;
    if (v->kind != START || e->take ||
        !ls_take_token_find(e->config->storage, v->name, v->token, &e->status))
        return false;
    ls_engine_remember(e, v->token);
    ls_engine_notify(e);
    return true;
}

/* Is there nothing to ask the devices? */
static bool is_settled(struct ls_visit *v)
{
    v->already = is_known(v);
    v->err = v->already || !v->engine->take ? LS_OK : ls_engine_busy(v->engine, &v->diag);
    return v->already || v->err;
}

static bool begin(struct ls_errand *errand)
{
    struct ls_visit *v = of(errand);
    if (v->kind == BLANK && v->engine->take) {
        ls_take_blank(v->engine->take); /* begun before it could be stopped */
        v->err = LS_OK;
        return false;
    }
    if (v->kind != BLANK && is_settled(v))
        return false;
    ls_probe_forget(v->engine->probe);
    return true;
}

static enum ls_err blank(const struct ls_engine *e, struct ls_diag *diag)
{
    struct ls_lights *lights;
    enum ls_err err = ls_lights_open(&e->config->lights_driver, &lights, diag);
    if (err)
        return err;
    err = ls_lights_blank(lights, diag);
    ls_lights_close(lights);
    return err;
}

/* ls-rig */
static void work(struct ls_errand *errand)
{
    struct ls_visit *v = of(errand);
    const struct ls_take_context *context = &v->engine->context;
    const _Atomic bool *stop = &errand->stop;
    switch (v->kind) {
    case PREFLIGHT:
        v->err = ls_take_preflight(context, v->plan_text, stop, &v->preflight, &v->diag);
        break;
    case START:
        v->err = ls_take_create(context, v->name, v->plan_text, v->token, stop, &v->take, &v->diag);
        break;
    case RESUME:
        v->err = ls_take_reopen(context, v->name, stop, &v->take, &v->diag);
        break;
    case BLANK:
        v->err = blank(v->engine, &v->diag);
    }
}

static void done(struct ls_errand *errand)
{
    struct ls_visit *v = of(errand);
    struct ls_request *request = v->request;
    v->engine->visits = g_list_remove(v->engine->visits, v);
    if (v->take)
        ls_engine_launch(v->engine, v->take, v->token);
    if (v->take && v->dark)
        ls_take_blank(v->take);
    else if (v->take && atomic_load(&errand->stop))
        ls_take_abort(v->take); /* too late not to begin */
    if (request) {
        request->diag = v->diag;
        request->preflight = v->preflight;
        request->already = v->already;
        answer(request, v->err);
    }
    g_free(v->plan_text);
    g_free(v->name);
    g_free(v->token);
    g_free(v);
}

static struct ls_visit *visit(struct ls_engine *e, int kind, struct ls_request *request)
{
    struct ls_visit *v = g_new0(struct ls_visit, 1);
    v->errand = (struct ls_errand){.begin = begin, .work = work, .done = done};
    v->engine = e;
    v->kind = kind;
    v->request = request;
    request->engine = e;
    request->visit = v;
    v->err = ls_fail(&v->diag, LS_ERR_ABORTED,
                     "given up: it was aborted, all lights were turned off, or the daemon ends");
    return v;
}

static void put(struct ls_visit *v)
{
    v->engine->visits = g_list_append(v->engine->visits, v);
    ls_errands_put(v->engine->errands, &v->errand);
}

bool ls_engine_stop_visits(struct ls_engine *e, bool dark)
{
    bool any = false;
    for (GList *l = e->visits; l; l = l->next) {
        struct ls_visit *v = l->data;
        if (v->kind == BLANK || (!dark && v->kind == PREFLIGHT))
            continue;
        v->dark |= dark;
        atomic_store(&v->errand.stop, true);
        any = true;
    }
    return any;
}

bool ls_engine_prepares(const struct ls_engine *e)
{
    for (GList *l = e->visits; l; l = l->next) {
        const struct ls_visit *v = l->data;
        if (v->kind == START || v->kind == RESUME)
            return true;
    }
    return false;
}

void ls_engine_withdraw(struct ls_request *request, bool stop)
{
    ls_probe_turn_away(&request->look);
    if (request->visit)
        request->visit->request = NULL;
    if (request->visit && stop)
        atomic_store(&request->visit->errand.stop, true);
    request->visit = NULL;
}

/* ---- what is asked ---- */

/* True: it is answered. */
static bool refused(struct ls_engine *e, struct ls_request *request)
{
    enum ls_err err = ls_engine_need_rig(e, &request->diag);
    if (err)
        answer(request, err);
    return err;
}

void ls_engine_preflight(struct ls_engine *e, const char *plan_text, struct ls_request *request)
{
    if (refused(e, request))
        return;
    if (e->take) {
        answer(request, ls_engine_busy(e, &request->diag));
        return;
    }
    if (e->framing) {
        answer(request,
               ls_fail(&request->diag, LS_ERR_BUSY, "the live view has the devices: end it first"));
        return;
    }
    struct ls_visit *v = visit(e, PREFLIGHT, request);
    v->plan_text = g_strdup(plan_text);
    put(v);
}

static enum ls_err check_token(const char *token, struct ls_diag *diag)
{
    if (strlen(token) >= sizeof(((struct ls_take_status *)0)->token))
        return ls_fail(diag, LS_ERR_INVALID, "token of %zu bytes: expected at most 63",
                       strlen(token));
    return LS_OK;
}

/* A retry neither ends the live view nor waits for its own take. */
static void prepare_take(struct ls_visit *v)
{
    if (is_settled(v)) {
        done(&v->errand);
        return;
    }
    ls_engine_take_over(v->engine, LS_ERR_BUSY,
                        "a take begins: the live view under steady light ends");
    put(v);
}

void ls_engine_start(struct ls_engine *e, const char *name, const char *plan_text,
                     const char *token, struct ls_request *request)
{
    if (refused(e, request))
        return;
    enum ls_err err = check_token(token, &request->diag);
    if (err) {
        answer(request, err);
        return;
    }
    struct ls_visit *v = visit(e, START, request);
    v->plan_text = g_strdup(plan_text);
    v->name = g_strdup(name);
    v->token = g_strdup(token);
    prepare_take(v);
}

void ls_engine_resume(struct ls_engine *e, const char *take_id, const char *token,
                      struct ls_request *request)
{
    if (refused(e, request))
        return;
    enum ls_err err = check_token(token, &request->diag);
    if (err) {
        answer(request, err);
        return;
    }
    struct ls_visit *v = visit(e, RESUME, request);
    v->name = g_strdup(take_id);
    v->token = g_strdup(token);
    prepare_take(v);
}

void ls_engine_blank(struct ls_engine *e, struct ls_request *request)
{
    if (refused(e, request))
        return;
    ls_engine_stop_visits(e, true);
    if (e->take) {
        ls_take_blank(e->take); /* the sequencer blanks first of all */
        answer(request, LS_OK);
        return;
    }
    ls_engine_take_over(e, LS_ERR_ABORTED, "all lights were turned off: the live view ends");
    put(visit(e, BLANK, request));
}

/* ---- status ---- */

static void on_look(struct ls_look *look, const struct ls_devices *found)
{
    struct ls_request *request =
        (struct ls_request *)((char *)look - offsetof(struct ls_request, look));
    request->status.devices = *found;
    request->status.take = request->engine->status; /* of now */
    answer(request, LS_OK);
}

void ls_engine_status(struct ls_engine *e, struct ls_request *request)
{
    struct ls_engine_status *out = &request->status;
    struct statvfs fs;
    *out = (struct ls_engine_status){.n_cameras = e->config->n_cameras, .take = e->status};
    request->engine = e;
    request->look.done = on_look;
    ls_privileges_missing(out->privileges, sizeof out->privileges);
    if (!statvfs(e->config->storage, &fs))
        out->disk_free_bytes = (uint64_t)fs.f_bavail * fs.f_frsize;
    snprintf(out->calibration, sizeof out->calibration, "%s", e->calibration ? "given" : "none");
    if (e->config->n_lights == 0) {
        answer(request, LS_OK);
        return;
    }
    if (!e->take && !e->framing) {
        ls_probe_look(e->probe, &request->look);
        return;
    }
    out->devices.lights_connected = true; /* they hold the devices */
    for (uint32_t i = 0; i < e->config->n_cameras; i++)
        out->devices.cameras[i].connected = true;
    answer(request, LS_OK);
}

/*
 * engine_private: the engine's insides, shared by engine.c (life, takes, the live view) and
 * visit.c (what is asked of it and needs the devices).
 * Layer: daemon. Threads: ls-main, except where said. Ownership: the engine's.
 */
#ifndef LS_DAEMON_ENGINE_PRIVATE_H
#define LS_DAEMON_ENGINE_PRIVATE_H

#include "daemon/engine.h"
#include "daemon/take.h"

#include <glib.h>

enum { LS_TOKENS_REMEMBERED = 256 };

struct ls_engine {
    const struct ls_config *config;
    char *calibration_json;
    struct ls_calibration *calibration;
    struct ls_metrics metrics;
    struct ls_preview *preview;
    struct ls_events *events;
    struct ls_framing *framing; /* NULL: none */
    enum ls_err framing_err;    /* what ended it, beside its client */
    struct ls_diag framing_why;
    struct ls_take_context context; /* read-only, any thread */
    ls_take_callback *callback;
    void *user;
    GMainContext *main;
    struct ls_errands *errands;
    struct ls_probe *probe;
    GList *visits;        /* struct ls_visit: queued or under way */
    struct ls_take *take; /* NULL: none runs */
    GThread *thread;
    GSource *timer;
    struct ls_take_status status;
    char tokens[LS_TOKENS_REMEMBERED][64]; /* of takes that were started, oldest overwritten */
    unsigned n_tokens;
    /* written by the take's thread before it posts take_ended */
    enum ls_take_state end_state;
    struct ls_capture_report end_report;
    struct ls_diag end_message;
};

/** Run @take (transfer full) on its thread, and say so. */
void ls_engine_launch(struct ls_engine *engine, struct ls_take *take, const char *token);

/** That a take runs: LS_ERR_BUSY. */
enum ls_err ls_engine_busy(const struct ls_engine *engine, struct ls_diag *diag);

/** LS_ERR_UNSUPPORTED where there is no rig, else LS_OK. */
LS_MUST_CHECK enum ls_err ls_engine_need_rig(const struct ls_engine *engine, struct ls_diag *diag);

void ls_engine_remember(struct ls_engine *engine, const char *token);
void ls_engine_notify(struct ls_engine *engine);

/** The devices are needed for something else: the live view ends on ls-rig, before what is put
 * there next. Its client learns @why when it looks again. */
void ls_engine_take_over(struct ls_engine *engine, enum ls_err err, const char *why);

/** Stop starts and resumes that are queued or under way; @dark: preflights, too, and no work light
 * comes on. Was there any? */
bool ls_engine_stop_visits(struct ls_engine *engine, bool dark);

/** Is a take being prepared? */
bool ls_engine_prepares(const struct ls_engine *engine);

#endif

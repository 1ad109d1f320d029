/*
 * take: one take being made, from its plan to its folder.
 * Layer: daemon. Threads: preflight, create, reopen and destroy on any, they block on devices; run
 * blocks a thread of its own; abort, progress and id from any. Ownership: configuration and
 * calibration are (transfer none) and outlive the take; devices and store are the take's own.
 */
#ifndef LS_DAEMON_TAKE_H
#define LS_DAEMON_TAKE_H

#include "core/calibration.h"
#include "core/error.h"
#include "daemon/capture.h"
#include "daemon/engine.h"
#include "daemon/events.h"

struct ls_take;

/** What takes are made with. */
struct ls_take_context {
    const struct ls_config *config;
    const char *calibration_json;             /* NULL = none */
    const struct ls_calibration *calibration; /* the same, parsed */
    struct ls_metrics *metrics;               /* of all takes */
    struct ls_preview *preview;               /* offered their frames */
    struct ls_events *events;                 /* told what happens to them */
};

/**
 * Open the devices and check the plan: everything of ls_engine_preflight. Nothing fires, nothing
 * is written. Gives up once *stop is set (NULL: never). Errors: those of ls_plan_parse,
 * ls_rig_open, ls_preflight_check; LS_ERR_ABORTED.
 */
LS_MUST_CHECK enum ls_err ls_take_preflight(const struct ls_take_context *context,
                                            const char *plan_text, const _Atomic bool *stop,
                                            struct ls_preflight *out, struct ls_diag *diag);

/** Preflight, then make the folder, in which @token is kept, and reserve its space; given up before
 * that if *stop is set. Errors as
 * preflight, plus those of ls_store_create. (transfer full). */
LS_MUST_CHECK enum ls_err ls_take_create(const struct ls_take_context *context, const char *name,
                                         const char *plan_text, const char *token,
                                         const _Atomic bool *stop, struct ls_take **out,
                                         struct ls_diag *diag);

/** Go on with the take in storage folder @id: its own plan, only what is not published. Errors:
 * LS_ERR_NOT_FOUND, LS_ERR_STATE (complete), LS_ERR_MISMATCH (another rig), as create. */
LS_MUST_CHECK enum ls_err ls_take_reopen(const struct ls_take_context *context, const char *id,
                                         const _Atomic bool *stop, struct ls_take **out,
                                         struct ls_diag *diag);

/** Folder name. (transfer none). */
const char *ls_take_id(const struct ls_take *take);

/**
 * Photograph, store, close the books. Returns the state the take ended in, writes the report and a
 * sentence for people: what was repaired, what is missing, or why it failed and what to do. The
 * devices are closed then.
 */
enum ls_take_state ls_take_run(struct ls_take *take, struct ls_capture_report *report,
                               struct ls_diag *message);

void ls_take_abort(struct ls_take *take);
/** The same, and no work light comes on. */
void ls_take_blank(struct ls_take *take);
void ls_take_progress(const struct ls_take *take, struct ls_capture_progress *out);

/** Close devices and store. NULL is allowed; not while running. */
void ls_take_destroy(struct ls_take *take);

#endif

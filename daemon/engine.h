/*
 * engine: the rig as one object: devices, at most one take at a time, the takes on disk.
 * Layer: daemon. Threads: every call on ls-main, where none blocks but destroy; devices are opened
 * on ls-rig, one request after another, takes run on a thread of the engine's own and report
 * through the callback, which is invoked on ls-main. Ownership: as stated per call; strings
 * returned in structs live until the next call on the engine.
 */
#ifndef LS_DAEMON_ENGINE_H
#define LS_DAEMON_ENGINE_H

#include "core/error.h"
#include "daemon/capture.h"
#include "daemon/config.h"
#include "daemon/events.h"
#include "daemon/framing.h"
#include "daemon/metrics.h"
#include "daemon/preview.h"
#include "daemon/probe.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_engine;

enum ls_take_state {
    LS_TAKE_NONE,
    LS_TAKE_PREPARING, /* preflight, upload, the controller getting ready */
    LS_TAKE_RUNNING,
    LS_TAKE_COMPLETE,
    LS_TAKE_INCOMPLETE, /* ended with conditions missing after every repair */
    LS_TAKE_ABORTED,
    LS_TAKE_FAILED,
};

/** Where the current (or last) take stands. */
struct ls_take_status {
    enum ls_take_state state;
    char id[128];   /* folder name, "" before it exists */
    char token[64]; /* of the client that started it */
    struct ls_capture_progress progress;
    struct ls_capture_report report; /* once ended */
    char message[512];               /* why it failed, what was repaired or is missing */
};

struct ls_engine_status {
    uint32_t n_cameras;
    struct ls_devices devices;
    char privileges[256]; /* missing ones and what they would help, or "" */
    uint64_t disk_free_bytes;
    char calibration[64]; /* "given", "none" */
    struct ls_take_status take;
};

/** Preflight of a plan: what it will cost. */
struct ls_preflight {
    const char *bracket; /* how exposures are made: daemon/bracket.h */
    uint32_t conditions, steps, shots;
    double seconds;
    uint64_t bytes, disk_free_bytes;
    double dark_noise_share; /* of a relit picture's noise power, the part that the darks bring:
                                N/K / (1 + N/K) for N lights and K darks */
    double energy_j, peak_current_a; /* of the LEDs; energy 0 where the controller tells no power */
    double led_duty;                 /* of the busiest LED: mean over the take, [0, 1] */
    char warnings[2048];             /* newline-separated, "" = none */
};

/** Something asked of the rig, which may have to wait for devices. Zeroed by who asks, with `done`
 * filled in; the engine's from the call until done or ls_engine_withdraw. */
struct ls_request {
    /** ls-main, once, perhaps inside the call; may free it. */
    void (*done)(struct ls_request *request);
    enum ls_err err; /* the answer, and what belongs to it */
    struct ls_diag diag;
    bool already; /* of start and resume: the token was known, nothing was begun */
    struct ls_preflight preflight;
    struct ls_engine_status status;
    struct ls_engine *engine; /* the engine's */
    struct ls_visit *visit;
    struct ls_look look;
};

/** Called on ls-main when a take's status changed and every 100 ms while it runs. */
typedef void ls_take_callback(void *user, const struct ls_take_status *status);

/** Connects to nothing yet: devices are opened at the first call that needs them; without a rig such
 * calls are answered LS_ERR_UNSUPPORTED, but for the status. */
LS_MUST_CHECK enum ls_err ls_engine_create(const struct ls_config *config,
                                           ls_take_callback *callback, void *user,
                                           struct ls_engine **out, struct ls_diag *diag);

/** Ends a running take (LEDs dark, what is stored stays), answers what is asked and frees. Waits
 * for the device that is being opened to answer or to time out. NULL is allowed. */
void ls_engine_destroy(struct ls_engine *engine);

/** While a take or the live view runs its devices count as connected. While another request has
 * them, they are as they were found last. Else they are asked, at most once a second: answered
 * within 250 ms (3 s if nothing is known: after the start, a take and the calls below) with what
 * is known by then. */
void ls_engine_status(struct ls_engine *engine, struct ls_request *request);

/** Errors: LS_ERR_INVALID, LS_ERR_LIMIT, LS_ERR_REFUSED (flashing), LS_ERR_FULL, LS_ERR_BUSY (a
 * take or the live view has the devices), LS_ERR_GONE, LS_ERR_ABORTED (blank; the daemon ends). */
void ls_engine_preflight(struct ls_engine *engine, const char *plan_text,
                         struct ls_request *request);

/**
 * Start a take; answered when its folder is there. @token names this request: the same token again
 * is answered LS_OK without starting anything (`already` set), so a retry after a lost connection
 * does not fire twice. Errors: LS_ERR_BUSY (another take runs), those of preflight; LS_ERR_ABORTED
 * by ls_engine_abort, too.
 */
void ls_engine_start(struct ls_engine *engine, const char *name, const char *plan_text,
                     const char *token, struct ls_request *request);

/** Shoot what a take on disk is missing. Errors as start, LS_ERR_NOT_FOUND, LS_ERR_STATE
 * (complete already), LS_ERR_MISMATCH (the rig has changed since). */
void ls_engine_resume(struct ls_engine *engine, const char *take_id, const char *token,
                      struct ls_request *request);

/** Abort the running take, and those that are being prepared. LS_ERR_STATE if there is none.
 * Returns at once; the end is reported. */
LS_MUST_CHECK enum ls_err ls_engine_abort(struct ls_engine *engine, struct ls_diag *diag);

/** All LEDs off, now; aborts a running take and those that are being prepared, and preflights.
 * Where one of these is being opened: once that device has answered or timed out. */
void ls_engine_blank(struct ls_engine *engine, struct ls_request *request);

/** Nobody waits for the answer any more: @request is who asked's again, done is not called. @stop:
 * and it need not be done; a take that has begun already is aborted. One that is done is allowed.
 */
void ls_engine_withdraw(struct ls_request *request, bool stop);

/** Where frames of takes and of the live view are to be seen. (transfer none). */
struct ls_preview *ls_engine_preview(struct ls_engine *engine);

/** What happens to takes. (transfer none). */
struct ls_events *ls_engine_events(struct ls_engine *engine);

/** The live view under steady light: a camera runs freely and offers its frames, once the requests
 * before it have left the devices. A take ends it, and so does blank. Errors: LS_ERR_BUSY (a take
 * runs or is being prepared, or a live view), those of ls_framing_start. */
LS_MUST_CHECK enum ls_err ls_engine_frame(struct ls_engine *engine,
                                          const struct ls_framing_wish *wish, struct ls_diag *diag);

/** End it, light out; nothing if there is none. One that goes on is told to, and ends on ls-rig.
 * What it ended with before that: as ls_framing_end, LS_ERR_BUSY (a take has begun), LS_ERR_ABORTED
 * (blank). */
enum ls_err ls_engine_frame_end(struct ls_engine *engine, struct ls_diag *diag);

/** Does it go on? */
bool ls_engine_framing(const struct ls_engine *engine);

/** What was counted since create. (transfer none), any thread. */
const struct ls_metrics *ls_engine_metrics(const struct ls_engine *engine);

const struct ls_config *ls_engine_config(const struct ls_engine *engine);

#endif

/*
 * sequencer_run: one program under way, between the parts of the sequencer.
 * Layer: daemon. Threads: ls-seq; the sentences are written once it has ended. Ownership: the
 * sequencer's. RT-safe but for ls_run_explain and ls_run_explain_dark. Errors: as ls_sequencer_run;
 * a failure whose sentence is not written where it happens is explained at the end.
 */
#ifndef LS_DAEMON_SEQUENCER_RUN_H
#define LS_DAEMON_SEQUENCER_RUN_H

#include "daemon/credit.h"
#include "daemon/sequencer.h"

enum { LS_RUN_EVENTS = 64 };

/** What ls-seq knows of it. */
struct ls_run {
    struct ls_sequencer *seq;
    const struct ls_program *program;
    struct ls_diag *diag;
    struct ls_credit credit;
    struct ls_step_event events[LS_RUN_EVENTS];
    struct ls_lights_status status;
    uint32_t granted, seen; /* steps granted; steps with an event, by the highest index */
    bool released;          /* the last granted step, held, was told to end */
    uint64_t safe_us;       /* controller time of the poll before: its events have all been read */
    uint64_t progress_ns;   /* host time of the last event or grant that ended a drought */
    uint64_t first_us;
    uint64_t hot_since_ns, hot_ns; /* host time of a pause's begin, 0 none; when last hot */
    uint64_t compared_ns;          /* host time of the clock's newest pair */
    struct ls_flash_found flash;   /* hz > 0: a live subject saw it */
    enum ls_err err, dark_err;     /* of the program; of the blank after it */
    struct ls_diag dark;
};

/** Of all cameras: the fewest steps settled, the most that may be granted, the smallest window. */
struct ls_run_room {
    uint32_t settled, limit, window;
};

struct ls_run_room ls_run_find_room(const struct ls_run *run);

/** False: its thread does not answer. */
bool ls_run_tell_camera(struct ls_run *run, uint32_t camera,
                        const struct ls_camera_message *message);

/** LS_ERR_BUG: one does not answer. */
LS_MUST_CHECK enum ls_err ls_run_tell_all(struct ls_run *run,
                                          const struct ls_camera_message *message);

/** Let the controller fire up to @n_steps in all; as many as before: a held step ends. */
LS_MUST_CHECK enum ls_err ls_run_grant(struct ls_run *run, uint32_t n_steps);

/** One poll of the controller, everything in it passed on. */
LS_MUST_CHECK enum ls_err ls_run_poll_once(struct ls_run *run);

/** A poll, what would end the program looked at, and a rest. */
LS_MUST_CHECK enum ls_err ls_run_turn(struct ls_run *run);

/** Is it too hot to grant anything? LS_ERR_LIMIT: for too long. */
LS_MUST_CHECK enum ls_err ls_run_watch_heat(struct ls_run *run, bool *hot);

/** The whole program, a step at a time (sequencer.h: stepwise). */
LS_MUST_CHECK enum ls_err ls_run_one_by_one(struct ls_run *run);

/** Why it ended, into run->diag, where no sentence was written. */
void ls_run_explain(struct ls_run *run);

/** The last word on LEDs that could not be blanked, behind whatever went wrong before. */
void ls_run_explain_dark(struct ls_run *run);

#endif

#include "daemon/sequencer.h"

#include "daemon/credit.h"
#include "daemon/realtime.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>

enum {
    POLL_US = 1500, /* step events are read this often, grants follow as often */
    EVENTS = 64,
    PAIR_GAP_NS = 50000000, /* LS_CLOCK_PAIRS of these: the baseline of the clock's drift */
    LOOK_AGAIN_US = 10000,  /* an abort is noticed so late while cameras are being armed */
    COOLED_NS = 1000000000, /* not hot for so long: a take does not flicker on and off */
    ANSWER_US = 5000000,    /* a thread of ours that does not answer for so long is stuck */
};

/* One program under way. */
struct run {
    struct ls_sequencer *seq;
    const struct ls_program *program;
    struct ls_diag *diag;
    struct ls_credit credit;
    struct ls_step_event events[EVENTS];
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

void ls_sequencer_fault_names(uint32_t faults, char *text, size_t size)
{
    static const char *const names[] = {"interlock open", "emergency stop", "over-temperature",
                                        "over-current",   "over-duty",      "heartbeat missed",
                                        "program memory", "over-power"};
    size_t used = 0;
    text[0] = 0;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        if (!(faults & 1u << i) || used + 1 >= size)
            continue;
        int n = snprintf(text + used, size - used, "%s%s", used ? ", " : "", names[i]);
        used += n > 0 ? (size_t)n : 0;
    }
}

static bool tell_camera(struct run *run, uint32_t camera, const struct ls_camera_message *message)
{
    uint64_t until = ls_host_ns() + ANSWER_US * 1000ull;
    while (!ls_camera_thread_tell(run->seq->cameras[camera].thread, message)) {
        if (ls_host_ns() > until)
            return false;
        ls_host_wait(run->seq->heard, LOOK_AGAIN_US);
    }
    return true;
}

static enum ls_err tell_all(struct run *run, const struct ls_camera_message *message)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++)
        if (!tell_camera(run, i, message))
            return LS_ERR_BUG;
    return LS_OK;
}

/* Somebody else's trouble, or a wish to stop. */
static enum ls_err interrupted(const struct ls_sequencer *seq)
{
    if (atomic_load(seq->abort))
        return LS_ERR_ABORTED;
    if (atomic_load(seq->failure))
        return LS_ERR_STATE;
    for (uint32_t i = 0; i < seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(seq->cameras[i].thread, &counts);
        if (counts.failure)
            return LS_ERR_STATE;
    }
    return LS_OK;
}

static double exposure_of(const struct run *run, uint32_t camera, const struct ls_step_event *event)
{
    const struct ls_sequencer_camera *c = &run->seq->cameras[camera];
    return c->timed ? c->exposure_us : event->width_us + c->offset_us;
}

/* A held step that ended although nobody here released it: at its limit, or by a mistake. */
static bool ended_early(const struct run *run, uint32_t step)
{
    return run->program->steps[step].flags & LS_STEP_HOLD && step + 1 >= run->granted &&
           !run->released;
}

/* What a live subject must not see although the plan did not say so: pulses that came late. */
static enum ls_err watch_flashing(struct run *run, const struct ls_step_event *event)
{
    const struct ls_step *step = &run->program->steps[event->step];
    if (run->seq->flashing &&
        ls_flashing_pulse(run->seq->flashing, event->us, event->width_us,
                          &run->program->conditions[step->condition], &run->flash))
        return LS_ERR_REFUSED;
    return LS_OK;
}

static enum ls_err pass_on(struct run *run, const struct ls_step_event *event)
{
    struct ls_camera_message message = {
        .kind = LS_CAMERA_FIRED,
        .event = *event,
        .pulse_ns = (uint64_t)ls_clock_map(run->seq->controller, event->us)};
    if (event->step >= run->program->n_steps || event->step < run->seen)
        return LS_ERR_MISMATCH;
    if (ended_early(run, event->step))
        message.event.flags |= LS_EVENT_CLIPPED;
    ls_count(&run->seq->metrics->pulses, 1);
    if (run->seq->fired++ == 0)
        run->seq->first_us = event->us;
    if (run->seen == 0)
        run->first_us = event->us;
    run->seen = event->step + 1;
    run->seq->last_us = event->us;
    uint64_t alone_us = event->us + run->program->period_us / 2; /* no step starts so soon after */
    run->safe_us = alone_us > run->safe_us ? alone_us : run->safe_us;
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        message.exposure_us = exposure_of(run, i, event);
        if (!tell_camera(run, i, &message))
            return LS_ERR_BUG;
    }
    return watch_flashing(run, event);
}

static void compare_clocks(struct run *run)
{
    const struct ls_lights_status *s = &run->status;
    if (s->host_after_ns < run->compared_ns + PAIR_GAP_NS)
        return;
    (void)ls_clock_add(run->seq->controller, s->now_us, s->host_before_ns, s->host_after_ns);
    run->compared_ns = s->host_after_ns;
}

/* One poll, everything in it passed on. */
static enum ls_err poll_once(struct run *run)
{
    size_t n = 0;
    enum ls_err err =
        ls_lights_poll(run->seq->lights, &run->status, run->events, EVENTS, &n, run->diag);
    for (size_t i = 0; i < n && !err; i++)
        err = pass_on(run, &run->events[i]);
    if (err)
        return err;
    compare_clocks(run);
    if (n > 0)
        run->progress_ns = ls_host_ns();
    if (n < EVENTS) {
        for (uint32_t i = 0; i < run->seq->n_cameras; i++)
            ls_camera_thread_until(run->seq->cameras[i].thread, run->safe_us);
        if (!run->status.holding) /* its event is still to come, of a time gone by */
            run->safe_us = run->status.now_us;
    }
    bool runs = run->status.state == LS_LIGHTS_ARMED || run->status.state == LS_LIGHTS_DONE;
    return runs ? LS_OK : LS_ERR_REFUSED;
}

static enum ls_err check_stall(struct run *run)
{
    bool waiting = run->granted > run->seen && !run->status.holding;
    if (!waiting)
        run->progress_ns = ls_host_ns();
    return ls_host_ns() - run->progress_ns > run->seq->stall_us * 1000 ? LS_ERR_TIMEOUT : LS_OK;
}

static enum ls_err grant(struct run *run, uint32_t n_steps)
{
    enum ls_err err = ls_lights_grant(run->seq->lights, n_steps, run->diag);
    if (!err) {
        run->released = n_steps == run->granted;
        run->granted = n_steps;
    }
    enum ls_err why = err == LS_ERR_REFUSED ? poll_once(run) : LS_OK; /* its state says more */
    return why ? why : err;
}

static void end_cooling(struct run *run)
{
    if (run->hot_since_ns)
        run->seq->cooled_seconds += (double)(ls_host_ns() - run->hot_since_ns) * 1e-9;
    run->hot_since_ns = 0;
    atomic_store(&run->seq->cooling, false);
}

/* Is it too hot to grant anything? LS_ERR_LIMIT: for too long. */
static enum ls_err watch_heat(struct run *run, bool *hot)
{
    uint64_t now = ls_host_ns();
    if (run->status.hot) {
        run->hot_ns = now;
        run->hot_since_ns = run->hot_since_ns ? run->hot_since_ns : now;
        if (run->status.temperature_c > run->seq->hottest_c)
            run->seq->hottest_c = run->status.temperature_c;
        atomic_store(&run->seq->cooling, true);
    } else if (run->hot_since_ns && now - run->hot_ns >= COOLED_NS) {
        end_cooling(run);
    }
    *hot = run->hot_since_ns > 0;
    return *hot && now - run->hot_since_ns > run->seq->cooling_us * 1000 ? LS_ERR_LIMIT : LS_OK;
}

/* Of all cameras: the fewest steps settled, the most that may be granted, the smallest window. */
struct room {
    uint32_t settled, limit, window;
};

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* One step at a time is a window of its own; a held step has its verdict after the next's grant. */
static struct room find_room(const struct run *run)
{
    struct ls_credit_camera cameras[LS_MAX_CAMERAS];
    struct room room = {.settled = run->program->n_steps, .window = UINT32_MAX};
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        cameras[i] =
            (struct ls_credit_camera){.settled = counts.settled,
                                      .window = run->seq->stepwise ? UINT32_MAX : counts.window,
                                      .queued = ls_ring_queued(run->seq->cameras[i].ring)};
        room.settled = least(room.settled, counts.settled);
        room.window = least(room.window, cameras[i].window);
    }
    room.limit = ls_credit_limit(cameras, run->seq->n_cameras, run->program->n_steps);
    return room;
}

static enum ls_err flow(struct run *run)
{
    for (;;) {
        struct room room = find_room(run);
        if (room.settled == run->program->n_steps)
            return LS_OK;
        bool hot;
        enum ls_err err = interrupted(run->seq);
        if (!err)
            err = watch_heat(run, &hot);
        uint32_t want = err || hot ? run->granted
                                   : ls_credit_grant(&run->credit, run->granted, run->status.fired,
                                                     room.limit, room.window, ls_host_ns());
        if (!err && want > run->granted)
            err = grant(run, want);
        if (!err)
            err = poll_once(run);
        if (!err)
            err = check_stall(run);
        if (err)
            return err;
        ls_host_rest(POLL_US);
    }
}

/* ---- stepwise ---- */

static enum ls_err turn(struct run *run)
{
    enum ls_err err = interrupted(run->seq);
    if (!err)
        err = poll_once(run);
    if (!err)
        err = check_stall(run);
    if (!err)
        ls_host_rest(POLL_US);
    return err;
}

static enum ls_err wait_until_cool(struct run *run)
{
    bool hot;
    enum ls_err err = watch_heat(run, &hot);
    if (!err && hot && run->status.holding)
        err = grant(run, run->granted);
    while (!err && hot) {
        err = turn(run);
        if (!err)
            err = watch_heat(run, &hot);
    }
    return err;
}

static enum ls_err wait_for_room(struct run *run, uint32_t step)
{
    while (find_room(run).limit <= step) {
        enum ls_err err = turn(run);
        if (err)
            return err;
    }
    return LS_OK;
}

static bool is_lit(const struct run *run, uint32_t step)
{
    if (run->program->steps[step].flags & LS_STEP_HOLD)
        return run->seen > step || (run->status.holding && run->status.fired == step + 1);
    return run->seen > step;
}

/* While a held step is lit: the cameras without a line. Its event says that the light is off. */
static enum ls_err trigger(struct run *run, uint32_t step)
{
    const struct ls_camera_message opened = {.kind = LS_CAMERA_OPENED, .step = step};
    bool held = run->program->steps[step].flags & LS_STEP_HOLD;
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_sequencer_camera *camera = &run->seq->cameras[i];
        enum ls_err err = LS_OK;
        while (!err && camera->software &&
               ls_host_ns() - camera->triggered_ns < camera->min_interval_us * 1000)
            err = turn(run);
        if (!err && held && run->seen > step)
            return LS_OK;
        if (!err && held && !tell_camera(run, i, &opened))
            err = LS_ERR_BUG;
        if (!err && camera->software)
            err = ls_camera_trigger(camera->camera, run->diag);
        if (err)
            return err;
        if (camera->software)
            camera->triggered_ns = ls_host_ns();
    }
    return LS_OK;
}

static bool has_frame(const struct run *run, uint32_t camera, uint32_t step)
{
    struct ls_camera_counts counts;
    ls_camera_thread_counts(run->seq->cameras[camera].thread, &counts);
    /* a frame pending while the step before is not settled is that step's */
    return counts.settled > step || (counts.settled == step && counts.pending > 0);
}

static bool all_have_frames(const struct run *run, uint32_t step)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++)
        if (!has_frame(run, i, step))
            return false;
    return true;
}

/* A camera bound by order whose frame has not come by now gives the step up. */
static enum ls_err expire(struct run *run, uint32_t step)
{
    const struct ls_camera_message message = {.kind = LS_CAMERA_EXPIRED, .step = step};
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        enum ls_err err = LS_OK;
        if (run->seq->cameras[i].by_time || has_frame(run, i, step))
            continue;
        if (!tell_camera(run, i, &message))
            return LS_ERR_BUG;
        while (!err && !has_frame(run, i, step))
            err = turn(run);
        if (err)
            return err;
    }
    return LS_OK;
}

static bool order_is_lost(const struct run *run)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        if (!run->seq->cameras[i].by_time && counts.suspect)
            return true;
    }
    return false;
}

static enum ls_err release(struct run *run)
{
    return grant(run, run->granted);
}

/* What is late comes while nothing is triggered, and is nobody's. */
static enum ls_err wait_for_order(struct run *run)
{
    const struct ls_camera_message quiet = {.kind = LS_CAMERA_QUIET};
    uint64_t until = ls_host_ns() + run->seq->patience_us * 1000;
    enum ls_err err = LS_OK;
    if (!order_is_lost(run))
        return LS_OK;
    if (run->status.holding)
        err = release(run);
    while (!err && ls_host_ns() < until)
        err = turn(run);
    for (uint32_t i = 0; i < run->seq->n_cameras && !err; i++)
        if (!run->seq->cameras[i].by_time && !tell_camera(run, i, &quiet))
            err = LS_ERR_BUG;
    return err;
}

static enum ls_err wait_for_frames(struct run *run, uint32_t step)
{
    uint64_t until = ls_host_ns() + run->seq->patience_us * 1000;
    while (!all_have_frames(run, step)) {
        enum ls_err err = turn(run);
        if (err)
            return err;
        if (ls_host_ns() > until)
            return expire(run, step);
    }
    /* did the light last as long as the exposure? */
    return run->program->steps[step].flags & LS_STEP_HOLD ? poll_once(run) : LS_OK;
}

static enum ls_err do_step(struct run *run, uint32_t step)
{
    const struct ls_camera_message opened = {.kind = LS_CAMERA_OPENED, .step = step};
    bool held = run->program->steps[step].flags & LS_STEP_HOLD;
    enum ls_err err = wait_for_order(run);
    if (!err)
        err = wait_for_room(run, step);
    if (!err)
        err = wait_until_cool(run);
    if (!err && !held)
        err = tell_all(run, &opened);
    if (!err)
        err = grant(run, step + 1);
    while (!err && !is_lit(run, step))
        err = turn(run);
    if (!err && held && run->seen > step)
        err = expire(run, step);
    else if (!err)
        err = trigger(run, step);
    return err ? err : wait_for_frames(run, step);
}

static enum ls_err one_by_one(struct run *run)
{
    uint32_t n = run->program->n_steps;
    enum ls_err err = LS_OK;
    for (uint32_t step = 0; step < n && !err; step++)
        err = do_step(run, step);
    if (!err && n > 0 && run->program->steps[n - 1].flags & LS_STEP_HOLD)
        err = release(run);
    while (!err && find_room(run).settled < n)
        err = turn(run);
    return err;
}

/* ---- a program ---- */

static bool all_armed(const struct run *run, const uint32_t *programs)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        if (counts.programs == programs[i])
            return false;
    }
    return true;
}

static enum ls_err arm(struct run *run)
{
    const struct ls_camera_message message = {.kind = LS_CAMERA_ARMED,
                                              .step = run->program->n_steps};
    uint32_t programs[LS_MAX_CAMERAS];
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        programs[i] = counts.programs;
    }
    enum ls_err err = tell_all(run, &message);
    uint64_t until = ls_host_ns() + ANSWER_US * 1000ull;
    while (!err && !all_armed(run, programs)) {
        err = ls_host_ns() > until ? LS_ERR_BUG : interrupted(run->seq);
        ls_host_wait(run->seq->heard, LOOK_AGAIN_US);
    }
    return err ? err : ls_lights_arm(run->seq->lights, run->diag);
}

static enum ls_err execute(struct run *run)
{
    enum ls_err err = interrupted(run->seq);
    if (!err)
        err = ls_lights_load(run->seq->lights, run->program, run->seq->abort, run->diag);
    if (!err)
        err = arm(run);
    run->progress_ns = ls_host_ns();
    if (!err)
        err = run->seq->stepwise ? one_by_one(run) : flow(run);
    end_cooling(run);
    if (run->seen > 0)
        run->seq->pulse_seconds += (double)(run->seq->last_us - run->first_us) * 1e-6;
    return err;
}

static void explain(struct run *run)
{
    char faults[160];
    const char *dark = run->dark_err ? "" : "LEDs are dark; ";
    uint32_t step = run->seen;
    if (run->flash.hz > 0) {
        char what[96];
        ls_flashing_describe(&run->flash, run->seq->config, what, sizeof what);
        ls_fail(
            run->diag, run->err,
            "the live subject saw %s at step %u, more than %d flashes a second: %sfind out what "
            "delays the controller, then resume the take",
            what, step, LS_FLASHES_PER_SECOND, dark);
    } else if (run->err == LS_ERR_REFUSED && run->status.state == LS_LIGHTS_FAULT) {
        ls_sequencer_fault_names(run->status.faults, faults, sizeof faults);
        ls_fail(run->diag, run->err,
                "the light controller stopped at step %u and latched a fault (%s): clear its "
                "cause, then resume the take",
                step, faults);
    } else if (run->err == LS_ERR_REFUSED && run->granted > 0 &&
               run->status.state != LS_LIGHTS_ARMED) {
        ls_fail(run->diag, run->err,
                "the light controller was blanked by somebody else at step %u: %sresume the take",
                step, dark);
    } else if (run->err == LS_ERR_LIMIT && !run->diag->text[0]) {
        ls_fail(run->diag, run->err,
                "the dome is too hot, %d C at step %u: for %.0f s it has not cooled below the %u C "
                "from which the controller calls it hot: %slet it cool, then resume the take",
                run->status.temperature_c, step, (double)run->seq->cooling_us * 1e-6,
                ls_lights_info(run->seq->lights)->hot_c, dark);
    } else if (run->err == LS_ERR_TIMEOUT && !run->diag->text[0]) {
        ls_fail(run->diag, run->err,
                "the light controller fired nothing for %.1f s although granted %u steps, %u of "
                "them fired: %scheck it, then resume the take",
                (double)run->seq->stall_us * 1e-6, run->granted, run->seen, dark);
    } else if ((run->err == LS_ERR_TIMEOUT || run->err == LS_ERR_GONE) && run->granted > 0) {
        const struct ls_diag link = *run->diag;
        ls_fail(run->diag, run->err,
                "%.300s (step %u; %scheck its cable and power, then resume the take)", link.text,
                step, dark);
    } else if (run->err == LS_ERR_MISMATCH && !run->diag->text[0]) {
        ls_fail(run->diag, run->err,
                "the light controller reports steps out of order after step %u: %sresume the take",
                step, dark);
    } else if (run->err == LS_ERR_BUG && !run->diag->text[0]) {
        ls_fail(run->diag, run->err, "a camera thread does not answer");
    }
}

/* The last word on the LEDs, behind whatever went wrong before. */
static void explain_dark(struct run *run)
{
    static const char lit[] = "LEDs may be lit until the heartbeat blanks them";
    const struct ls_diag before = *run->diag;
    if (!run->err)
        run->err = ls_fail(run->diag, run->dark_err, "%.400s: %s", run->dark.text, lit);
    else
        ls_fail(run->diag, run->err, "%.260s; and blanking failed (%.150s): %s",
                before.text[0] ? before.text : ls_err_name(run->err), run->dark.text, lit);
}

static void *run_thread(void *data)
{
    struct run *run = data;
    ls_realtime_enter(LS_PRIORITY_SEQ);
    run->err = execute(run);
    run->dark_err = ls_lights_blank(run->seq->lights, &run->dark);
    return NULL;
}

enum ls_err ls_sequencer_run(struct ls_sequencer *sequencer, const struct ls_program *program,
                             struct ls_diag *diag)
{
    struct ls_diag own = {{0}};
    struct run run = {.seq = sequencer, .program = program, .diag = &own};
    uint32_t slots = UINT32_MAX;
    for (uint32_t i = 0; i < sequencer->n_cameras; i++) {
        uint32_t n = ls_ring_slots(sequencer->cameras[i].ring).n;
        slots = n < slots ? n : slots;
    }
    ls_credit_init(&run.credit, program, slots, sequencer->live, sequencer->burst_ns);
    pthread_t thread;
    if (pthread_create(&thread, NULL, run_thread, &run))
        return ls_fail(diag, LS_ERR_OS, "cannot start the sequencer's thread");
    pthread_setname_np(thread, "ls-seq");
    pthread_join(thread, NULL);
    sequencer->burst_ns = run.credit.started_ns;
    if (run.err)
        explain(&run);
    sequencer->maybe_lit = run.dark_err != LS_OK;
    if (run.dark_err)
        explain_dark(&run);
    if (run.err && diag)
        *diag = own;
    return run.err;
}

#include "daemon/sequencer.h"

#include "daemon/realtime.h"
#include "daemon/sequencer_run.h"

#include <pthread.h>

enum {
    POLL_US = 1500,         /* step events are read this often, grants follow as often */
    PAIR_GAP_NS = 50000000, /* LS_CLOCK_PAIRS of these: the baseline of the clock's drift */
    LOOK_AGAIN_US = 10000,  /* an abort is noticed so late while cameras are being armed */
    COOLED_NS = 1000000000, /* not hot for so long: a take does not flicker on and off */
    ANSWER_US = 5000000,    /* a thread of ours that does not answer for so long is stuck */
};

bool ls_run_tell_camera(struct ls_run *run, uint32_t camera,
                        const struct ls_camera_message *message)
{
    uint64_t until = ls_host_ns() + ANSWER_US * 1000ull;
    while (!ls_camera_thread_tell(run->seq->cameras[camera].thread, message)) {
        if (ls_host_ns() > until)
            return false;
        ls_host_wait(run->seq->heard, LOOK_AGAIN_US);
    }
    return true;
}

enum ls_err ls_run_tell_all(struct ls_run *run, const struct ls_camera_message *message)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++)
        if (!ls_run_tell_camera(run, i, message))
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

static double exposure_of(const struct ls_run *run, uint32_t camera,
                          const struct ls_step_event *event)
{
    const struct ls_sequencer_camera *c = &run->seq->cameras[camera];
    return c->timed ? c->exposure_us : event->width_us + c->offset_us;
}

/* A held step that ended although nobody here released it: at its limit, or by a mistake. */
static bool ended_early(const struct ls_run *run, uint32_t step)
{
    return run->program->steps[step].flags & LS_STEP_HOLD && step + 1 >= run->granted &&
           !run->released;
}

/* What a live subject must not see although the plan did not say so: pulses that came late. */
static enum ls_err watch_flashing(struct ls_run *run, const struct ls_step_event *event)
{
    const struct ls_step *step = &run->program->steps[event->step];
    if (run->seq->flashing &&
        ls_flashing_pulse(run->seq->flashing, event->us, event->width_us,
                          &run->program->conditions[step->condition], &run->flash))
        return LS_ERR_REFUSED;
    return LS_OK;
}

static enum ls_err pass_on(struct ls_run *run, const struct ls_step_event *event)
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
        if (!ls_run_tell_camera(run, i, &message))
            return LS_ERR_BUG;
    }
    return watch_flashing(run, event);
}

static void compare_clocks(struct ls_run *run)
{
    const struct ls_lights_status *s = &run->status;
    if (s->host_after_ns < run->compared_ns + PAIR_GAP_NS)
        return;
    /* the poll took its times in this order */
    (void)ls_clock_add(run->seq->controller, s->now_us, s->host_before_ns, s->host_after_ns);
    run->compared_ns = s->host_after_ns;
}

/* One poll, everything in it passed on. */
enum ls_err ls_run_poll_once(struct ls_run *run)
{
    size_t n = 0;
    enum ls_err err =
        ls_lights_poll(run->seq->lights, &run->status, run->events, LS_RUN_EVENTS, &n, run->diag);
    for (size_t i = 0; i < n && !err; i++)
        err = pass_on(run, &run->events[i]);
    if (err)
        return err;
    compare_clocks(run);
    if (n > 0)
        run->progress_ns = ls_host_ns();
    if (n < LS_RUN_EVENTS) {
        for (uint32_t i = 0; i < run->seq->n_cameras; i++)
            ls_camera_thread_until(run->seq->cameras[i].thread, run->safe_us);
        if (!run->status.holding) /* its event is still to come, of a time gone by */
            run->safe_us = run->status.now_us;
    }
    bool runs = run->status.state == LS_LIGHTS_ARMED || run->status.state == LS_LIGHTS_DONE;
    return runs ? LS_OK : LS_ERR_REFUSED;
}

static enum ls_err check_stall(struct ls_run *run)
{
    bool waiting = run->granted > run->seen && !run->status.holding;
    if (!waiting)
        run->progress_ns = ls_host_ns();
    return ls_host_ns() - run->progress_ns > run->seq->stall_us * 1000 ? LS_ERR_TIMEOUT : LS_OK;
}

enum ls_err ls_run_grant(struct ls_run *run, uint32_t n_steps)
{
    enum ls_err err = ls_lights_grant(run->seq->lights, n_steps, run->diag);
    if (!err) {
        run->released = n_steps == run->granted;
        run->granted = n_steps;
    }
    enum ls_err why =
        err == LS_ERR_REFUSED ? ls_run_poll_once(run) : LS_OK; /* its state says more */
    return why ? why : err;
}

static void end_cooling(struct ls_run *run)
{
    if (run->hot_since_ns)
        run->seq->cooled_seconds += (double)(ls_host_ns() - run->hot_since_ns) * 1e-9;
    run->hot_since_ns = 0;
    atomic_store(&run->seq->cooling, false);
}

/* Is it too hot to grant anything? LS_ERR_LIMIT: for too long. */
enum ls_err ls_run_watch_heat(struct ls_run *run, bool *hot)
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

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* One step at a time is a window of its own; a held step has its verdict after the next's grant. */
struct ls_run_room ls_run_find_room(const struct ls_run *run)
{
    struct ls_credit_camera cameras[LS_MAX_CAMERAS];
    struct ls_run_room room = {.settled = run->program->n_steps, .window = UINT32_MAX};
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

static enum ls_err flow(struct ls_run *run)
{
    for (;;) {
        struct ls_run_room room = ls_run_find_room(run);
        if (room.settled == run->program->n_steps)
            return LS_OK;
        bool hot;
        enum ls_err err = interrupted(run->seq);
        if (!err)
            err = ls_run_watch_heat(run, &hot);
        uint32_t want = err || hot ? run->granted
                                   : ls_credit_grant(&run->credit, run->granted, run->status.fired,
                                                     room.limit, room.window, ls_host_ns());
        if (!err && want > run->granted)
            err = ls_run_grant(run, want);
        if (!err)
            err = ls_run_poll_once(run);
        if (!err)
            err = check_stall(run);
        if (err)
            return err;
        ls_host_rest(POLL_US);
    }
}

enum ls_err ls_run_turn(struct ls_run *run)
{
    enum ls_err err = interrupted(run->seq);
    if (!err)
        err = ls_run_poll_once(run);
    if (!err)
        err = check_stall(run);
    if (!err)
        ls_host_rest(POLL_US);
    return err;
}

/* ---- a program ---- */

static bool all_armed(const struct ls_run *run, const uint32_t *programs)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        if (counts.programs == programs[i])
            return false;
    }
    return true;
}

static enum ls_err arm(struct ls_run *run)
{
    const struct ls_camera_message message = {.kind = LS_CAMERA_ARMED,
                                              .step = run->program->n_steps};
    uint32_t programs[LS_MAX_CAMERAS];
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        programs[i] = counts.programs;
    }
    enum ls_err err = ls_run_tell_all(run, &message);
    uint64_t until = ls_host_ns() + ANSWER_US * 1000ull;
    while (!err && !all_armed(run, programs)) {
        err = ls_host_ns() > until ? LS_ERR_BUG : interrupted(run->seq);
        ls_host_wait(run->seq->heard, LOOK_AGAIN_US);
    }
    return err ? err : ls_lights_arm(run->seq->lights, run->diag);
}

static enum ls_err execute(struct ls_run *run)
{
    enum ls_err err = interrupted(run->seq);
    if (!err)
        err = ls_lights_load(run->seq->lights, run->program, run->seq->abort, run->diag);
    if (!err)
        err = arm(run);
    run->progress_ns = ls_host_ns();
    if (!err)
        err = run->seq->stepwise ? ls_run_one_by_one(run) : flow(run);
    end_cooling(run);
    if (run->seen > 0)
        run->seq->pulse_seconds += (double)(run->seq->last_us - run->first_us) * 1e-6;
    return err;
}

static void *run_thread(void *data)
{
    struct ls_run *run = data;
    ls_realtime_enter(LS_PRIORITY_SEQ);
    run->err = execute(run);
    run->dark_err = ls_lights_blank(run->seq->lights, &run->dark);
    return NULL;
}

enum ls_err ls_sequencer_run(struct ls_sequencer *sequencer, const struct ls_program *program,
                             struct ls_diag *diag)
{
    struct ls_diag own = {{0}};
    struct ls_run run = {.seq = sequencer, .program = program, .diag = &own};
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
        ls_run_explain(&run);
    sequencer->maybe_lit = run.dark_err != LS_OK;
    if (run.dark_err)
        ls_run_explain_dark(&run);
    if (run.err && diag)
        *diag = own;
    return run.err;
}

#include "daemon/realtime.h"
#include "daemon/sequencer_run.h"

static enum ls_err wait_until_cool(struct ls_run *run)
{
    bool hot;
    enum ls_err err = ls_run_watch_heat(run, &hot);
    if (!err && hot && run->status.holding)
        err = ls_run_grant(run, run->granted);
    while (!err && hot) {
        err = ls_run_turn(run);
        if (!err)
            err = ls_run_watch_heat(run, &hot);
    }
    return err;
}

static enum ls_err wait_for_room(struct ls_run *run, uint32_t step)
{
    while (ls_run_find_room(run).limit <= step) {
        enum ls_err err = ls_run_turn(run);
        if (err)
            return err;
    }
    return LS_OK;
}

static bool is_lit(const struct ls_run *run, uint32_t step)
{
    if (run->program->steps[step].flags & LS_STEP_HOLD)
        return run->seen > step || (run->status.holding && run->status.fired == step + 1);
    return run->seen > step;
}

/* While a held step is lit: the cameras without a line. Its event says that the light is off. */
static enum ls_err trigger(struct ls_run *run, uint32_t step)
{
    const struct ls_camera_message opened = {.kind = LS_CAMERA_OPENED, .step = step};
    bool held = run->program->steps[step].flags & LS_STEP_HOLD;
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_sequencer_camera *camera = &run->seq->cameras[i];
        enum ls_err err = LS_OK;
        while (!err && camera->software &&
               ls_host_ns() - camera->triggered_ns < camera->min_interval_us * 1000)
            err = ls_run_turn(run);
        if (!err && held && run->seen > step)
            return LS_OK;
        if (!err && held && !ls_run_tell_camera(run, i, &opened))
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

static bool has_frame(const struct ls_run *run, uint32_t camera, uint32_t step)
{
    struct ls_camera_counts counts;
    ls_camera_thread_counts(run->seq->cameras[camera].thread, &counts);
    /* a frame pending while the step before is not settled is that step's */
    return counts.settled > step || (counts.settled == step && counts.pending > 0);
}

static bool all_have_frames(const struct ls_run *run, uint32_t step)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++)
        if (!has_frame(run, i, step))
            return false;
    return true;
}

/* A camera bound by order whose frame has not come by now gives the step up. */
static enum ls_err expire(struct ls_run *run, uint32_t step)
{
    const struct ls_camera_message message = {.kind = LS_CAMERA_EXPIRED, .step = step};
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        enum ls_err err = LS_OK;
        if (run->seq->cameras[i].by_time || has_frame(run, i, step))
            continue;
        if (!ls_run_tell_camera(run, i, &message))
            return LS_ERR_BUG;
        while (!err && !has_frame(run, i, step))
            err = ls_run_turn(run);
        if (err)
            return err;
    }
    return LS_OK;
}

static bool order_is_lost(const struct ls_run *run)
{
    for (uint32_t i = 0; i < run->seq->n_cameras; i++) {
        struct ls_camera_counts counts;
        ls_camera_thread_counts(run->seq->cameras[i].thread, &counts);
        if (!run->seq->cameras[i].by_time && counts.suspect)
            return true;
    }
    return false;
}

static enum ls_err release(struct ls_run *run)
{
    return ls_run_grant(run, run->granted);
}

/* What is late comes while nothing is triggered, and is nobody's. */
static enum ls_err wait_for_order(struct ls_run *run)
{
    const struct ls_camera_message quiet = {.kind = LS_CAMERA_QUIET};
    uint64_t until = ls_host_ns() + run->seq->patience_us * 1000;
    enum ls_err err = LS_OK;
    if (!order_is_lost(run))
        return LS_OK;
    if (run->status.holding)
        err = release(run);
    while (!err && ls_host_ns() < until)
        err = ls_run_turn(run);
    for (uint32_t i = 0; i < run->seq->n_cameras && !err; i++)
        if (!run->seq->cameras[i].by_time && !ls_run_tell_camera(run, i, &quiet))
            err = LS_ERR_BUG;
    return err;
}

static enum ls_err wait_for_frames(struct ls_run *run, uint32_t step)
{
    uint64_t until = ls_host_ns() + run->seq->patience_us * 1000;
    while (!all_have_frames(run, step)) {
        enum ls_err err = ls_run_turn(run);
        if (err)
            return err;
        if (ls_host_ns() > until)
            return expire(run, step);
    }
    /* did the light last as long as the exposure? */
    return run->program->steps[step].flags & LS_STEP_HOLD ? ls_run_poll_once(run) : LS_OK;
}

static enum ls_err do_step(struct ls_run *run, uint32_t step)
{
    const struct ls_camera_message opened = {.kind = LS_CAMERA_OPENED, .step = step};
    bool held = run->program->steps[step].flags & LS_STEP_HOLD;
    enum ls_err err = wait_for_order(run);
    if (!err)
        err = wait_for_room(run, step);
    if (!err)
        err = wait_until_cool(run);
    if (!err && !held)
        err = ls_run_tell_all(run, &opened);
    if (!err)
        err = ls_run_grant(run, step + 1);
    while (!err && !is_lit(run, step))
        err = ls_run_turn(run);
    if (!err && held && run->seen > step)
        err = expire(run, step);
    else if (!err)
        err = trigger(run, step);
    return err ? err : wait_for_frames(run, step);
}

enum ls_err ls_run_one_by_one(struct ls_run *run)
{
    uint32_t n = run->program->n_steps;
    enum ls_err err = LS_OK;
    for (uint32_t step = 0; step < n && !err; step++)
        err = do_step(run, step);
    if (!err && n > 0 && run->program->steps[n - 1].flags & LS_STEP_HOLD)
        err = release(run);
    while (!err && ls_run_find_room(run).settled < n)
        err = ls_run_turn(run);
    return err;
}

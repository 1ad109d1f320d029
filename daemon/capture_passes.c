#include "daemon/capture_private.h"

#include "daemon/bracket.h"

#include <stdio.h>

enum { SETTLING_TRIES = 8 };

static uint32_t find_wanted(struct ls_capture *c, uint32_t round)
{
    const struct ls_plan *plan = c->setup.plan;
    uint32_t n = 0;
    for (uint32_t i = 0; i < plan->n_steps; i++) {
        c->wanted[i] = ls_bracket_in_round(plan, round, i) && ls_merge_stage_wants(c->merge, i);
        n += c->wanted[i];
    }
    return n;
}

static void count_lost(struct ls_capture *c)
{
    for (uint32_t i = 0; i < c->n_cameras; i++)
        for (uint32_t k = 0; k < c->pass.program.n_steps; k++)
            if (c->pass.plan_steps[k] != LS_PASS_NO_STEP &&
                ls_camera_thread_outcome(c->threads[i], k) != LS_BIND_BOUND) {
                ls_merge_stage_lost(c->merge, c->pass.plan_steps[k], i);
                atomic_fetch_add(&c->lost, 1);
                ls_count(&c->setup.metrics->cameras[i].shots_lost, 1);
            }
}

static enum ls_err shoot(struct ls_capture *c, struct ls_diag *diag)
{
    ls_merge_stage_arm(c->merge, c->pass.plan_steps, c->pass.program.n_steps);
    enum ls_err err = ls_sequencer_run(&c->sequencer, &c->pass.program, diag);
    if (err)
        return err;
    ls_merge_stage_drain(c->merge);
    count_lost(c);
    return atomic_load(c->sequencer.failure) ? LS_ERR_STATE : LS_OK;
}

static enum ls_err shoot_wanted(struct ls_capture *c, struct ls_diag *diag)
{
    const struct ls_lights_info *info = ls_lights_info(c->setup.lights);
    enum ls_err err = LS_OK;
    for (uint32_t next = 0; next < c->setup.plan->n_steps && !err;) {
        next = ls_pass_fill(&c->pass, c->setup.plan, info, c->wanted, next, c->held);
        if (c->pass.program.n_steps > 0)
            err = shoot(c, diag);
    }
    return err;
}

static size_t list_reasons(char *text, size_t size, const char *what, const uint32_t *counts)
{
    size_t used = 0;
    for (uint32_t i = 0; i < LS_BIND_REASONS && used < size; i++)
        if (counts[i]) {
            int n = snprintf(text + used, size - used, ", %u %s: %s", counts[i], what,
                             ls_bind_reason_name((enum ls_bind_reason)i));
            used += n > 0 ? (size_t)n : 0;
        }
    return used < size ? used : size;
}

/* What went wrong so far, for the journal. */
static enum ls_err note_repair(struct ls_capture *c, uint32_t n, uint32_t pass,
                               struct ls_diag *diag)
{
    char text[1024];
    size_t used =
        (size_t)snprintf(text, sizeof text, "repair pass %u of %u: %u steps are shot again", pass,
                         c->setup.config->retries, n);
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        struct ls_camera_reasons reasons = ls_camera_thread_reasons(c->threads[i]);
        int name = snprintf(text + used, sizeof text - used, "; camera %.64s so far",
                            ls_capture_camera(c, i)->name);
        used += name > 0 && used + (size_t)name < sizeof text ? (size_t)name : 0;
        used += list_reasons(text + used, sizeof text - used, "steps", reasons.steps);
        used += list_reasons(text + used, sizeof text - used, "frames", reasons.frames);
    }
    return ls_store_alarm(c->setup.store, text, diag);
}

static uint32_t bound_of(const struct ls_capture *c, uint32_t camera)
{
    struct ls_camera_counts counts;
    ls_camera_thread_counts(c->threads[camera], &counts);
    return counts.bound;
}

/* A camera that sent nothing usable in a whole pass is asked something: one that is gone would
 * otherwise be fired at in vain until its own heartbeat tells. */
static enum ls_err ask_silent(struct ls_capture *c, const uint32_t *bound_before,
                              struct ls_diag *diag)
{
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        uint64_t ticks, before, after;
        struct ls_camera *camera = c->setup.cameras[i];
        if (bound_of(c, i) != bound_before[i] || !ls_camera_info(camera)->has_latch)
            continue;
        enum ls_err err = ls_camera_latch(camera, &ticks, &before, &after, NULL);
        if (err == LS_ERR_GONE || err == LS_ERR_TIMEOUT)
            return ls_fail(diag, LS_ERR_GONE,
                           "camera %s is gone: no frame of a whole pass, and no answer; LEDs are "
                           "dark, everything complete is stored; check its cable and power, then "
                           "resume the take",
                           ls_capture_camera(c, i)->name);
    }
    return LS_OK;
}

static enum ls_err shoot_pass(struct ls_capture *c, struct ls_diag *diag)
{
    uint32_t bound[LS_MAX_CAMERAS];
    for (uint32_t i = 0; i < c->n_cameras; i++)
        bound[i] = bound_of(c, i);
    enum ls_err err = shoot_wanted(c, diag);
    return err ? err : ask_silent(c, bound, diag);
}

/* ---- exposures that are registers ---- */

static enum ls_err write_exposures(struct ls_capture *c, uint32_t pulse_us, bool *written,
                                   struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    *written = false;
    for (uint32_t i = 0; i < c->n_cameras && !err; i++) {
        struct ls_sequencer_camera *camera = &c->sequencer.cameras[i];
        if (!camera->timed || camera->asked_us == pulse_us)
            continue;
        camera->exposure_us = camera->asked_us = pulse_us;
        err = ls_camera_set_exposure(camera->camera, &camera->exposure_us, diag);
        *written = true;
    }
    return err;
}

/* The first camera whose frame of the settling pulse did not come as it should; n_cameras: none. */
static uint32_t find_unsettled(const struct ls_capture *c)
{
    uint32_t i = 0;
    while (i < c->n_cameras && ls_camera_thread_outcome(c->threads[i], 0) == LS_BIND_BOUND)
        i++;
    return i;
}

/* Dark pulses, whose frames are discarded, until every camera exposes one as it was told. */
static enum ls_err settle(struct ls_capture *c, uint32_t exposure, struct ls_diag *diag)
{
    uint32_t unsettled = c->n_cameras;
    for (uint32_t i = 0; i < SETTLING_TRIES; i++) {
        ls_pass_fill_settling(&c->pass, c->setup.plan, exposure, c->held);
        enum ls_err err = shoot(c, diag);
        unsettled = err ? c->n_cameras : find_unsettled(c);
        for (uint32_t k = 0; k < c->n_cameras; k++)
            ls_count(&c->setup.metrics->cameras[k].settling_pulses, 1);
        if (err || unsettled == c->n_cameras)
            return err;
    }
    return ls_fail(
        diag, LS_ERR_MISMATCH,
        "camera %s was told to expose for %.6g us, and of %d dark pulses since none gave "
        "a frame that was; everything complete is stored; check its trigger and "
        "network, then resume the take",
        ls_capture_camera(c, unsettled)->name, c->sequencer.cameras[unsettled].exposure_us,
        SETTLING_TRIES);
}

/* What earlier rounds kept is read when a bracket completes. */
static enum ls_err begin_round(struct ls_capture *c, uint32_t round, struct ls_diag *diag)
{
    int exposure = ls_bracket_exposure(c->setup.plan, round);
    bool written;
    if (exposure < 0)
        return LS_OK;
    enum ls_err err = write_exposures(c, c->setup.plan->pulse_us[exposure], &written, diag);
    if (!err && written)
        err = settle(c, (uint32_t)exposure, diag);
    return err ? err : ls_store_flush(c->setup.store, diag);
}

static enum ls_err shoot_round(struct ls_capture *c, uint32_t round, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t pass = 0; pass <= c->setup.config->retries && !err; pass++) {
        uint32_t n = find_wanted(c, round);
        if (n == 0)
            return LS_OK;
        err = pass > 0 ? note_repair(c, n, pass, diag) : begin_round(c, round, diag);
        if (!err)
            err = shoot_pass(c, diag);
    }
    return err;
}

/* Without its darks nothing can be merged. */
static enum ls_err check_darks(struct ls_capture *c, struct ls_diag *diag)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < ls_bracket_first_of_lights(c->setup.plan); i++)
        n += find_wanted(c, i);
    if (n == 0)
        return LS_OK;
    return ls_fail(diag, LS_ERR_TIMEOUT,
                   "%u dark frames could not be had in %u passes, and without them nothing can "
                   "be merged: check trigger and network, then resume the take",
                   n, c->setup.config->retries + 1);
}

enum ls_err ls_capture_shoot_all(struct ls_capture *c, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t round = 0; round < ls_bracket_rounds(c->setup.plan) && !err; round++) {
        if (round == ls_bracket_first_of_lights(c->setup.plan))
            err = check_darks(c, diag);
        if (!err)
            err = shoot_round(c, round, diag);
    }
    return err;
}

#include "daemon/capture_private.h"

#include "daemon/bracket.h"
#include "daemon/exposure_fit.h"
#include "daemon/findings.h"
#include "daemon/realtime.h"
#include "daemon/takedir.h"
#include "daemon/preview.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

/* A resumed take's shots go on counting attempts where the journal stops; what it kept of brackets
 * is used. */
static enum ls_err go_on(struct ls_capture *c, struct ls_diag *diag)
{
    if (!c->setup.condition_done)
        return LS_OK;
    struct ls_takedir *take = NULL;
    uint32_t n = c->setup.plan->n_steps * c->n_cameras;
    c->first_attempt = calloc(n + 1, sizeof *c->first_attempt);
    c->kept = calloc(n + 1, sizeof *c->kept);
    if (!c->first_attempt || !c->kept)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_takedir_open(ls_store_folder(c->setup.store), &take, diag);
    if (err)
        return err;
    for (size_t i = 0; i < take->n_tickets; i++) {
        const struct ls_ticket *ticket = &take->tickets[i];
        if (ticket->shot < n && ticket->attempt >= c->first_attempt[ticket->shot])
            c->first_attempt[ticket->shot] = ticket->attempt + 1;
    }
    if (c->setup.plan->bracket == LS_BRACKET_OUTERMOST)
        err = ls_kept_find(take, c->setup.plan, c->setup.condition_done, c->kept, diag);
    ls_takedir_close(take);
    return err;
}

static bool is_done(const struct ls_capture *c, uint32_t condition)
{
    return c->setup.condition_done && c->setup.condition_done[condition];
}

static bool is_kept(const struct ls_capture *c, uint32_t step)
{
    for (uint32_t k = 0; k < c->n_cameras; k++)
        if (!c->kept || !c->kept[step * c->n_cameras + k].there)
            return false;
    return true;
}

static void count_planned(struct ls_capture *c)
{
    for (uint32_t i = 0; i < c->setup.plan->n_conditions; i++) {
        if (is_done(c, i))
            continue;
        c->conditions_planned++;
        const struct ls_plan_condition *of = &c->setup.plan->conditions[i];
        for (uint32_t k = of->first_step; k < of->first_step + of->n_steps; k++)
            c->steps_planned += !is_kept(c, k);
    }
}

static enum ls_err build(struct ls_capture *c, struct ls_diag *diag)
{
    const struct ls_lights_info *info = ls_lights_info(c->setup.lights);
    c->wanted = calloc(c->setup.plan->n_steps + 1, 1);
    c->rate = calloc(1, sizeof *c->rate);
    if (!c->wanted || !c->rate || ls_pass_init(&c->pass, c->setup.plan, info->max_steps))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    pthread_mutex_init(&c->rate->lock, NULL);
    ls_capture_describe(c);
    enum ls_err err = ls_capture_make_rings(c, diag);
    if (!err)
        err = go_on(c, diag);
    if (err)
        return err;
    count_planned(c);
    const struct ls_merge_stage_config merge = {.setup = &c->setup,
                                                .rings = c->rings,
                                                .first_attempt = c->first_attempt,
                                                .kept = c->kept,
                                                .utc_s = time(NULL)};
    err = ls_merge_stage_create(&merge, &c->merge, diag);
    if (!err)
        c->sequencer.failure = ls_merge_stage_failure(c->merge);
    return err;
}

enum ls_err ls_capture_create(const struct ls_capture_setup *setup, struct ls_capture **out,
                              struct ls_diag *diag)
{
    struct ls_capture *c = calloc(1, sizeof *c);
    if (!c)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    c->setup = *setup;
    sem_init(&c->heard, 0, 0);
    enum ls_err err = build(c, diag);
    if (err) {
        ls_capture_destroy(c);
        return err;
    }
    *out = c;
    return LS_OK;
}

/* What the LEDs fall back to, also if this host dies. Without one, what an earlier daemon left. */
static enum ls_err name_work_light(struct ls_capture *c, struct ls_diag *diag)
{
    const struct ls_config *config = c->setup.config;
    return ls_lights_set_work(c->setup.lights, config->work_channel, config->work_level, diag);
}

/* Only where it may shine: not with the E-stop pressed, say. */
static enum ls_err show_work_light(struct ls_capture *c, struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    if (!c->setup.config->work_level || atomic_load(&c->blank))
        return LS_OK;
    enum ls_err err = ls_lights_work(c->setup.lights, &why);
    c->working = !err;
    if (!err)
        return LS_OK;
    char text[512];
    snprintf(text, sizeof text, "no work light: %.400s", why.text);
    return ls_store_alarm(c->setup.store, text, diag);
}

/* Of cameras whose offset nobody said. */
static enum ls_err measure_offsets(struct ls_capture *c, struct ls_diag *diag)
{
    const struct ls_exposure_fit with = {.config = c->setup.config,
                                         .plan = c->setup.plan,
                                         .lights = c->setup.lights,
                                         .cameras = c->setup.cameras,
                                         .abort = &c->abort};
    if (!ls_exposure_fit_needed(c->setup.config))
        return LS_OK;
    enum ls_err err = ls_exposure_fit_run(&with, c->offsets, diag);
    for (uint32_t i = 0; i < c->n_cameras && !err; i++) {
        if (!ls_exposure_fit_wanted(c->setup.config, i))
            continue;
        c->sequencer.cameras[i].offset_us = c->offsets[i].us;
        err = ls_bracket_check(c->setup.plan, c->setup.config, i, c->offsets[i].us, diag);
    }
    return err;
}

static enum ls_err shoot(struct ls_capture *c, struct ls_diag *diag)
{
    enum ls_err err = name_work_light(c, diag);
    if (!err)
        err = measure_offsets(c, diag);
    if (!err)
        err = ls_capture_start_cameras(c, diag);
    if (!err)
        err = ls_warm_up_run(&c->warm_up, diag);
    if (!err)
        err = ls_capture_start_threads(c, diag);
    if (!err)
        err = ls_capture_shoot_all(c, diag);
    ls_capture_wind_down(c);
    enum ls_err shown = show_work_light(c, err ? NULL : diag);
    return err ? err : shown;
}

enum ls_err ls_capture_run(struct ls_capture *capture, struct ls_capture_report *report,
                           struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    *report = (struct ls_capture_report){0};
    enum ls_err err = capture->steps_planned ? shoot(capture, &why) : LS_OK;
    if (!err && atomic_load(capture->sequencer.failure))
        err = LS_ERR_STATE;
    if (err)
        err = ls_capture_explain(capture, err, &why);
    err = ls_capture_close_books(capture, err, &why);
    ls_capture_fill_report(capture, report);
    if (err && diag)
        *diag = why;
    return err;
}

void ls_capture_abort(struct ls_capture *capture)
{
    atomic_store(&capture->abort, true);
}

void ls_capture_blank(struct ls_capture *capture)
{
    atomic_store(&capture->blank, true);
    ls_capture_abort(capture);
}

void ls_capture_findings(const struct ls_capture *capture, struct ls_findings *out)
{
    const struct ls_clock *controller = &capture->warm_up.controller;
    *out = (struct ls_findings){.n_cameras = capture->n_cameras,
                                .n_exposures = capture->setup.plan->n_exposures,
                                .controller = ls_find_controller(controller)};
    for (uint32_t i = 0; i < capture->n_cameras; i++) {
        out->offsets[i] = capture->offsets[i];
        for (uint32_t e = 0; e < out->n_exposures; e++)
            out->darks[i][e] = ls_find_dark(ls_merge_stage_dark(capture->merge, i, e));
        if (!capture->threads[i])
            continue;
        struct ls_clock clock = ls_camera_thread_clock(capture->threads[i]);
        struct ls_camera_residuals residuals = ls_camera_thread_residuals(capture->threads[i]);
        out->cameras[i] = ls_find_camera(&clock, controller, &residuals);
    }
}

static double measure_rate(struct ls_capture_rate *rate, uint32_t shots)
{
    uint64_t now = ls_host_ns();
    pthread_mutex_lock(&rate->lock);
    if (rate->since_ns == 0)
        rate->since_ns = now;
    double seconds = (double)(now - rate->since_ns) * 1e-9;
    if (seconds >= 1) {
        rate->value = (shots - rate->shots) / seconds;
        rate->since_ns = now;
        rate->shots = shots;
    }
    double value = rate->value;
    pthread_mutex_unlock(&rate->lock);
    return value;
}

void ls_capture_progress(const struct ls_capture *capture, struct ls_capture_progress *out)
{
    struct ls_merge_stage_counts counts;
    ls_merge_stage_counts(capture->merge, &counts);
    *out = (struct ls_capture_progress){.steps_planned = capture->steps_planned,
                                        .steps_bound = counts.steps_bound,
                                        .conditions_planned = capture->conditions_planned,
                                        .conditions_stored = counts.conditions_stored,
                                        .shots_lost = atomic_load(&capture->lost),
                                        .shots_repaired = counts.repaired,
                                        .cooling = atomic_load(&capture->sequencer.cooling),
                                        .frames_per_second =
                                            measure_rate(capture->rate, counts.shots)};
    if (capture->setup.checks)
        ls_checks_drift(capture->setup.checks, &out->drift);
}

void ls_capture_destroy(struct ls_capture *capture)
{
    if (!capture)
        return;
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        ls_camera_thread_destroy(capture->threads[i]);
    ls_merge_stage_destroy(capture->merge);
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++) {
        ls_preview_set_ring(capture->setup.preview, i, NULL, NULL);
        ls_ring_destroy(capture->rings[i]);
    }
    sem_destroy(&capture->heard);
    ls_pass_finish(&capture->pass);
    if (capture->rate)
        pthread_mutex_destroy(&capture->rate->lock);
    free(capture->rate);
    free(capture->wanted);
    free(capture->first_attempt);
    free(capture->kept);
    free(capture);
}

#include "daemon/capture.h"

#include "daemon/camera_thread.h"
#include "daemon/findings.h"
#include "daemon/merge_stage.h"
#include "daemon/passes.h"
#include "daemon/realtime.h"
#include "daemon/sequencer.h"
#include "daemon/store.h"
#include "daemon/takedir.h"
#include "daemon/warm_up.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    MIN_SLOTS = 16,
    MAX_SLOTS = 512,
    MARGIN_US = 300000,  /* what a loaded host may add to a frame's way */
    STALL_US = 10000000, /* the controller may pause this long before it counts as stuck */
    TIGHT_US = 500,      /* a camera's start of exposure against the pulse: delay and jitter */
};

/* Frames per second for whoever watches. */
struct rate {
    pthread_mutex_t lock;
    uint64_t since_ns;
    uint32_t shots;
    double value;
};

struct ls_capture {
    struct ls_capture_setup setup;
    uint32_t n_cameras;
    bool stepwise, held;
    uint64_t patience_us;
    struct ls_ring *rings[LS_MAX_CAMERAS];
    struct ls_camera_thread *threads[LS_MAX_CAMERAS];
    bool started[LS_MAX_CAMERAS];
    struct ls_merge_stage *merge;
    struct ls_sequencer sequencer;
    sem_t heard;
    struct ls_warm_up warm_up;
    struct ls_pass pass;
    uint8_t *wanted;         /* per plan step */
    uint32_t *first_attempt; /* per shot, of a resumed take */
    uint32_t steps_planned, conditions_planned;
    struct ls_camera_stats stats[LS_MAX_CAMERAS]; /* of stopped cameras */
    _Atomic uint32_t lost;
    _Atomic bool abort;
    struct rate *rate;
};

/* ---- create ---- */

static const struct ls_config_camera *config_of(const struct ls_capture *c, uint32_t camera)
{
    return &c->setup.config->cameras[camera];
}

static uint32_t longest_pulse_us(const struct ls_plan *plan)
{
    uint32_t longest = 0;
    for (uint32_t i = 0; i < plan->n_exposures; i++)
        longest = plan->pulse_us[i] > longest ? plan->pulse_us[i] : longest;
    return longest;
}

static uint64_t patience_of(const struct ls_capture *c)
{
    uint64_t retention = 0;
    for (uint32_t i = 0; i < c->n_cameras; i++)
        if (config_of(c, i)->driver.frame_retention_us > retention)
            retention = config_of(c, i)->driver.frame_retention_us;
    const struct ls_plan *plan = c->setup.plan;
    return longest_pulse_us(plan) + 2ull * plan->period_us + retention + MARGIN_US;
}

static uint32_t slots_of(const struct ls_capture *c, uint32_t camera)
{
    uint32_t period = c->setup.plan->period_us ? c->setup.plan->period_us : 1;
    uint32_t retention = config_of(c, camera)->driver.frame_retention_us;
    uint64_t least = MIN_SLOTS + ((uint64_t)retention + period - 1) / period;
    uint64_t n = c->setup.config->ring_slots > least ? c->setup.config->ring_slots : least;
    return (uint32_t)(n > MAX_SLOTS ? MAX_SLOTS : n);
}

static uint64_t min_interval_us(const struct ls_config_camera *config)
{
    return config->max_fps > 0 ? (uint64_t)(1e6 / config->max_fps) + 1 : 0;
}

/* The driver's receive thread runs above ls-cam. */
static int camera_priority(const struct ls_config_camera *config)
{
    return config->driver.rt_priority > 0 ? config->driver.rt_priority - 1 : 0;
}

static void describe_camera(struct ls_capture *c, uint32_t i)
{
    const struct ls_config_camera *config = config_of(c, i);
    const struct ls_camera_info *info = ls_camera_info(c->setup.cameras[i]);
    bool software = config->driver.trigger == LS_TRIGGER_SOFTWARE;
    bool timed = config->driver.exposure == LS_EXPOSURE_TIMED;
    bool by_time = info->tick_hz > 0 && !software;
    c->sequencer.cameras[i] =
        (struct ls_sequencer_camera){.name = config->name,
                                     .camera = c->setup.cameras[i],
                                     .by_time = by_time,
                                     .software = software,
                                     .timed = timed,
                                     .min_interval_us = min_interval_us(config),
                                     .offset_us = config->exposure_offset_us};
    c->warm_up.cameras[i] = (struct ls_warm_up_camera){.name = config->name,
                                                       .camera = c->setup.cameras[i],
                                                       .by_time = by_time,
                                                       .software = software};
    c->held |= software;
    c->stepwise |= !by_time || (timed && c->setup.plan->n_exposures > 1);
}

/* From the end of a step to the event of the next: the controller reports a pulse at its end. */
static uint64_t longest_step_us(const struct ls_plan *plan)
{
    uint64_t pulse = (uint64_t)plan->pulse_us[plan->n_exposures - 1] + plan->settle_us;
    return pulse + plan->period_us;
}

static void describe(struct ls_capture *c)
{
    const struct ls_plan *plan = c->setup.plan;
    c->n_cameras = c->setup.config->n_cameras;
    for (uint32_t i = 0; i < c->n_cameras; i++)
        describe_camera(c, i);
    c->patience_us = patience_of(c);
    c->warm_up.lights = c->sequencer.lights = c->setup.lights;
    c->warm_up.n_cameras = c->sequencer.n_cameras = c->n_cameras;
    c->warm_up.pulse_us = plan->pulse_us[0];
    c->warm_up.period_us = plan->period_us;
    c->warm_up.settle_us = plan->settle_us;
    c->warm_up.patience_us = c->sequencer.patience_us = c->patience_us;
    c->warm_up.abort = c->sequencer.abort = &c->abort;
    c->sequencer.heard = &c->heard;
    c->sequencer.controller = &c->warm_up.controller;
    c->sequencer.stepwise = c->stepwise;
    c->sequencer.live = plan->subject == LS_SUBJECT_LIVE;
    c->sequencer.stall_us = STALL_US + longest_step_us(plan);
}

static enum ls_err make_rings(struct ls_capture *c, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        const struct ls_camera_info *info = ls_camera_info(c->setup.cameras[i]);
        enum ls_err err = ls_ring_create(slots_of(c, i), info->payload_bytes, &c->rings[i], diag);
        if (err)
            return err;
        c->warm_up.cameras[i].ring = c->rings[i];
        c->sequencer.cameras[i].ring = c->rings[i];
    }
    return LS_OK;
}

/* A resumed take's shots go on counting attempts where the journal stops. */
static enum ls_err count_attempts(struct ls_capture *c, struct ls_diag *diag)
{
    if (!c->setup.condition_done)
        return LS_OK;
    struct ls_takedir *take = NULL;
    uint32_t n = c->setup.plan->n_steps * c->n_cameras;
    c->first_attempt = calloc(n + 1, sizeof *c->first_attempt);
    if (!c->first_attempt)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_takedir_open(ls_store_folder(c->setup.store), &take, diag);
    if (err)
        return err;
    for (size_t i = 0; i < take->n_tickets; i++) {
        const struct ls_ticket *ticket = &take->tickets[i];
        if (ticket->shot < n && ticket->attempt >= c->first_attempt[ticket->shot])
            c->first_attempt[ticket->shot] = ticket->attempt + 1;
    }
    ls_takedir_close(take);
    return LS_OK;
}

static bool is_done(const struct ls_capture *c, uint32_t condition)
{
    return c->setup.condition_done && c->setup.condition_done[condition];
}

static void count_planned(struct ls_capture *c)
{
    for (uint32_t i = 0; i < c->setup.plan->n_conditions; i++) {
        if (is_done(c, i))
            continue;
        c->conditions_planned++;
        c->steps_planned += c->setup.plan->conditions[i].n_steps;
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
    describe(c);
    count_planned(c);
    enum ls_err err = make_rings(c, diag);
    if (!err)
        err = count_attempts(c, diag);
    if (err)
        return err;
    const struct ls_merge_stage_config merge = {.setup = &c->setup,
                                                .rings = c->rings,
                                                .first_attempt = c->first_attempt,
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

/* ---- devices up and down ---- */

static enum ls_err start_cameras(struct ls_capture *c, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        struct ls_sequencer_camera *camera = &c->sequencer.cameras[i];
        const struct ls_camera_slots slots = ls_ring_slots(c->rings[i]);
        enum ls_err err = LS_OK;
        if (camera->timed) {
            camera->asked_us = camera->exposure_us = c->setup.plan->pulse_us[0];
            err = ls_camera_set_exposure(camera->camera, &camera->exposure_us, diag);
        }
        ls_ring_queue(c->rings[i]);
        if (!err)
            err = ls_camera_start(camera->camera, &slots, diag);
        if (err)
            return err;
        c->started[i] = true;
    }
    return LS_OK;
}

static struct ls_bind_config bind_config(const struct ls_capture *c, uint32_t i)
{
    const struct ls_camera_info *info = ls_camera_info(c->setup.cameras[i]);
    const struct ls_sequencer_camera *camera = &c->sequencer.cameras[i];
    double window_us = c->setup.plan->period_us / 4.0;
    return (struct ls_bind_config){.by_time = camera->by_time,
                                   .has_counter = info->has_trigger_counter && !camera->software,
                                   .has_exposure = info->has_chunk_exposure,
                                   .window_us = window_us,
                                   .tight_us = fmin(window_us, TIGHT_US),
                                   .event_delay_us =
                                       longest_pulse_us(c->setup.plan) + MARGIN_US / 2.0,
                                   .patience_us = (double)c->patience_us,
                                   .exposure_tolerance_us = 5,
                                   .exposure_tolerance = 0.01};
}

static enum ls_err start_threads(struct ls_capture *c, struct ls_diag *diag)
{
    enum ls_err err = ls_merge_stage_start(c->merge, diag);
    for (uint32_t i = 0; i < c->n_cameras && !err; i++) {
        const struct ls_camera_thread_config config = {
            .index = i,
            .camera = c->setup.cameras[i],
            .ring = c->rings[i],
            .bind = bind_config(c, i),
            .max_steps = c->pass.capacity,
            .clock = c->warm_up.cameras[i].clock,
            .anchor = c->warm_up.cameras[i].anchor,
            .inlet = ls_merge_stage_inlet(c->merge, i),
            .work = ls_merge_stage_work(c->merge),
            .heard = &c->heard,
            .rt_priority = camera_priority(config_of(c, i)),
        };
        err = ls_camera_thread_create(&config, &c->threads[i], diag);
        c->sequencer.cameras[i].thread = c->threads[i];
        if (!err)
            err = ls_camera_thread_start(c->threads[i], diag);
    }
    return err;
}

/* Slots are the drivers' until they stop, so frames are merged first and cameras stopped last. */
static void wind_down(struct ls_capture *c)
{
    for (uint32_t i = 0; i < c->n_cameras; i++)
        if (c->threads[i])
            ls_camera_thread_stop(c->threads[i]);
    ls_merge_stage_drain(c->merge);
    ls_merge_stage_stop(c->merge);
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        if (c->started[i])
            ls_camera_stop(c->setup.cameras[i], &c->stats[i]);
        c->started[i] = false;
    }
}

/* ---- passes ---- */

enum phase { DARKS, LIGHTS }; /* lights: with the watches between them */

static uint32_t find_wanted(struct ls_capture *c, enum phase phase)
{
    const struct ls_plan *plan = c->setup.plan;
    uint32_t n = 0;
    for (uint32_t i = 0; i < plan->n_steps; i++) {
        const struct ls_plan_condition *of = &plan->conditions[plan->steps[i].condition];
        bool first = of->dark && !of->watch;
        c->wanted[i] = first == (phase == DARKS) && ls_merge_stage_wants(c->merge, i);
        n += c->wanted[i];
    }
    return n;
}

static void count_lost(struct ls_capture *c)
{
    for (uint32_t i = 0; i < c->n_cameras; i++)
        for (uint32_t k = 0; k < c->pass.program.n_steps; k++)
            if (ls_camera_thread_outcome(c->threads[i], k) != LS_BIND_BOUND) {
                ls_merge_stage_lost(c->merge, c->pass.plan_steps[k], i);
                atomic_fetch_add(&c->lost, 1);
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
                            config_of(c, i)->name);
        used += name > 0 && used + (size_t)name < sizeof text ? (size_t)name : 0;
        used += list_reasons(text + used, sizeof text - used, "steps", reasons.steps);
        used += list_reasons(text + used, sizeof text - used, "frames", reasons.frames);
    }
    return ls_store_alarm(c->setup.store, text, diag);
}

static enum ls_err shoot_phase(struct ls_capture *c, enum phase phase, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t pass = 0; pass <= c->setup.config->retries && !err; pass++) {
        uint32_t n = find_wanted(c, phase);
        if (n == 0)
            return LS_OK;
        if (pass > 0)
            err = note_repair(c, n, pass, diag);
        if (!err)
            err = shoot_wanted(c, diag);
    }
    return err;
}

/* Without its darks nothing can be merged. */
static enum ls_err shoot_all(struct ls_capture *c, struct ls_diag *diag)
{
    enum ls_err err = shoot_phase(c, DARKS, diag);
    if (err)
        return err;
    uint32_t n = find_wanted(c, DARKS);
    if (n > 0)
        return ls_fail(diag, LS_ERR_TIMEOUT,
                       "%u dark frames could not be had in %u passes, and without them nothing can "
                       "be merged: check trigger and network, then resume the take",
                       n, c->setup.config->retries + 1);
    return shoot_phase(c, LIGHTS, diag);
}

/* ---- the end ---- */

static void append(char *text, size_t size, const char *id, uint32_t shots)
{
    size_t used = strlen(text);
    char item[64];
    int n = snprintf(item, sizeof item, "%s%s (%u shot%s)", used ? ", " : "", id, shots,
                     shots == 1 ? "" : "s");
    if (n > 0 && used + (size_t)n + 6 < size)
        memcpy(text + used, item, (size_t)n + 1);
    else if (used + 6 < size && (used < 3 || strcmp(text + used - 3, "...")))
        strcpy(text + used, ", ...");
}

static uint32_t count_missing(const struct ls_capture *c)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->setup.plan->n_conditions; i++) {
        bool missing = false;
        for (uint32_t k = 0; k < c->n_cameras; k++)
            missing |= !ls_merge_stage_has(c->merge, i, k);
        n += missing;
    }
    return n;
}

static enum ls_err name_missing(struct ls_capture *c, struct ls_diag *diag)
{
    const struct ls_plan *plan = c->setup.plan;
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        for (uint32_t k = 0; k < c->n_cameras; k++) {
            char text[160];
            if (ls_merge_stage_has(c->merge, i, k))
                continue;
            snprintf(text, sizeof text, "missing: cam%u/%s after %u passes", k,
                     plan->conditions[i].id, c->setup.config->retries + 1);
            enum ls_err err = ls_store_alarm(c->setup.store, text, diag);
            if (err)
                return err;
        }
    return LS_OK;
}

static void list_repaired(const struct ls_capture *c, char *text, size_t size)
{
    text[0] = 0;
    for (uint32_t i = 0; i < c->setup.plan->n_conditions; i++)
        if (ls_merge_stage_repaired(c->merge, i))
            append(text, size, c->setup.plan->conditions[i].id,
                   ls_merge_stage_repaired(c->merge, i));
}

/* What was made good on the way, by another shot or by the network. */
static enum ls_err name_repaired(struct ls_capture *c, struct ls_diag *diag)
{
    char repaired[256], text[320];
    enum ls_err err = LS_OK;
    list_repaired(c, repaired, sizeof repaired);
    if (repaired[0]) {
        snprintf(text, sizeof text, "repaired: %s", repaired);
        err = ls_store_alarm(c->setup.store, text, diag);
    }
    for (uint32_t i = 0; i < c->n_cameras && !err; i++) {
        if (!c->stats[i].resent_packets)
            continue;
        snprintf(text, sizeof text, "camera %.64s: %llu packets were lost and sent again",
                 config_of(c, i)->name, (unsigned long long)c->stats[i].resent_packets);
        err = ls_store_alarm(c->setup.store, text, diag);
    }
    return err;
}

static void fill_report(struct ls_capture *c, struct ls_capture_report *report)
{
    double squares = 0;
    uint64_t n = 0;
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        if (!c->threads[i])
            continue;
        struct ls_camera_residuals r = ls_camera_thread_residuals(c->threads[i]);
        report->residual_max_us = fmax(report->residual_max_us, r.max_us);
        squares += r.sum_squares_us2;
        n += r.n;
    }
    report->missing_conditions = count_missing(c);
    report->residual_rms_us = n ? sqrt(squares / (double)n) : 0;
    list_repaired(c, report->repaired, sizeof report->repaired);
    ls_capture_progress(c, &report->final);
    struct ls_merge_stage_counts counts;
    ls_merge_stage_counts(c->merge, &counts);
    const struct ls_sequencer *s = &c->sequencer;
    report->seconds = s->fired ? (double)(s->last_us - s->first_us) * 1e-6 : 0;
    report->frames_per_second = report->seconds > 0 ? counts.shots / report->seconds : 0;
}

/* The sentence of the stage that failed first. */
static enum ls_err explain(struct ls_capture *c, enum ls_err err, struct ls_diag *diag)
{
    const char *leds = c->sequencer.maybe_lit ? "LEDs may be lit until the heartbeat blanks them"
                                              : "LEDs are dark";
    if (err == LS_ERR_ABORTED)
        return ls_fail(diag, err, "aborted: %s, everything complete is stored", leds);
    if (err != LS_ERR_STATE)
        return err;
    enum ls_err merge = (enum ls_err)atomic_load(c->sequencer.failure);
    if (merge) {
        struct ls_diag why = {{0}};
        ls_merge_stage_explain(c->merge, &why);
        return ls_fail(diag, merge, "%s", why.text);
    }
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        struct ls_camera_counts counts = {0};
        if (c->threads[i])
            ls_camera_thread_counts(c->threads[i], &counts);
        if (counts.failure)
            return ls_fail(diag, counts.failure,
                           "camera %s: %s: %s, everything complete is stored; check its cable and "
                           "power, then resume the take",
                           config_of(c, i)->name, ls_err_name(counts.failure), leds);
    }
    return err;
}

static enum ls_err close_books(struct ls_capture *c, enum ls_err err, struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    enum ls_err closing = err ? LS_OK : name_missing(c, &why);
    if (!closing && !err)
        closing = name_repaired(c, &why);
    if (!closing)
        closing = ls_store_flush(c->setup.store, &why);
    if (!err && closing)
        return ls_fail(diag, closing, "%s", why.text);
    return err;
}

enum ls_err ls_capture_run(struct ls_capture *capture, struct ls_capture_report *report,
                           struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    *report = (struct ls_capture_report){0};
    enum ls_err err = start_cameras(capture, &why);
    if (!err)
        err = ls_warm_up_run(&capture->warm_up, &why);
    if (!err)
        err = start_threads(capture, &why);
    if (!err)
        err = shoot_all(capture, &why);
    wind_down(capture);
    if (!err && atomic_load(capture->sequencer.failure))
        err = LS_ERR_STATE;
    if (err)
        err = explain(capture, err, &why);
    err = close_books(capture, err, &why);
    fill_report(capture, report);
    if (err && diag)
        *diag = why;
    return err;
}

void ls_capture_abort(struct ls_capture *capture)
{
    atomic_store(&capture->abort, true);
}

void ls_capture_findings(const struct ls_capture *capture, struct ls_findings *out)
{
    const struct ls_clock *controller = &capture->warm_up.controller;
    *out = (struct ls_findings){.n_cameras = capture->n_cameras,
                                .n_exposures = capture->setup.plan->n_exposures,
                                .controller = ls_find_controller(controller)};
    for (uint32_t i = 0; i < capture->n_cameras; i++) {
        for (uint32_t e = 0; e < out->n_exposures; e++)
            out->darks[i][e] = ls_find_dark(ls_merge_stage_dark(capture->merge, i, e));
        if (!capture->threads[i])
            continue;
        struct ls_clock clock = ls_camera_thread_clock(capture->threads[i]);
        struct ls_camera_residuals residuals = ls_camera_thread_residuals(capture->threads[i]);
        out->cameras[i] = ls_find_camera(&clock, controller, &residuals);
    }
}

static double measure_rate(struct rate *rate, uint32_t shots)
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
                                        .frames_per_second =
                                            measure_rate(capture->rate, counts.shots)};
}

void ls_capture_destroy(struct ls_capture *capture)
{
    if (!capture)
        return;
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        ls_camera_thread_destroy(capture->threads[i]);
    ls_merge_stage_destroy(capture->merge);
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        ls_ring_destroy(capture->rings[i]);
    sem_destroy(&capture->heard);
    ls_pass_finish(&capture->pass);
    if (capture->rate)
        pthread_mutex_destroy(&capture->rate->lock);
    free(capture->rate);
    free(capture->wanted);
    free(capture->first_attempt);
    free(capture);
}

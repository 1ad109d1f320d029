#include "daemon/capture_private.h"

#include "daemon/credit.h"
#include "daemon/preview.h"

#include <math.h>
#include <stdio.h>

enum {
    MIN_SLOTS = 16,
    MAX_SLOTS = 512,
    MARGIN_US = 300000,     /* what a loaded host may add to a frame's way */
    COOLING_US = 600000000, /* a dome that does not cool within ten minutes has a defect */
    STALL_US = 10000000,    /* the controller may pause this long before it counts as stuck */
    JITTER_US = 20, /* a sensor that starts with its next line, 10 us each, is late by up to that */
};

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
        if (ls_capture_camera(c, i)->driver.frame_retention_us > retention)
            retention = ls_capture_camera(c, i)->driver.frame_retention_us;
    const struct ls_plan *plan = c->setup.plan;
    return longest_pulse_us(plan) + 2ull * plan->period_us + retention + MARGIN_US;
}

static uint32_t slots_of(const struct ls_capture *c, uint32_t camera)
{
    uint32_t period = c->setup.plan->period_us ? c->setup.plan->period_us : 1;
    uint32_t retention = ls_capture_camera(c, camera)->driver.frame_retention_us;
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
    const struct ls_config_camera *config = ls_capture_camera(c, i);
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
    c->stepwise |= !by_time;
}

/* From the end of a step to the event of the next: the controller reports a pulse at its end. */
static uint64_t longest_step_us(const struct ls_plan *plan)
{
    uint64_t pulse = (uint64_t)plan->pulse_us[plan->n_exposures - 1] + plan->settle_us;
    return pulse + plan->period_us;
}

void ls_capture_describe(struct ls_capture *c)
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
    c->sequencer.metrics = c->setup.metrics;
    c->sequencer.heard = &c->heard;
    c->sequencer.controller = &c->warm_up.controller;
    c->sequencer.stepwise = c->stepwise;
    c->sequencer.live = plan->subject == LS_SUBJECT_LIVE;
    c->sequencer.config = c->setup.config;
    ls_flashing_init(&c->flashing, plan, c->setup.config, ls_lights_info(c->setup.lights));
    if (c->sequencer.live && !plan->allow_flashing)
        c->sequencer.flashing = &c->flashing;
    c->sequencer.cooling_us = COOLING_US;
    c->sequencer.stall_us = STALL_US + longest_step_us(plan);
}

enum ls_err ls_capture_make_rings(struct ls_capture *c, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        const struct ls_camera_info *info = ls_camera_info(c->setup.cameras[i]);
        enum ls_err err = ls_ring_create(slots_of(c, i), info->payload_bytes, &c->rings[i], diag);
        if (err)
            return err;
        ls_preview_set_ring(c->setup.preview, i, c->rings[i], info);
        c->warm_up.cameras[i].ring = c->rings[i];
        c->sequencer.cameras[i].ring = c->rings[i];
    }
    return LS_OK;
}

/* Frames by way of UDP cost more and are lost sooner: who looks for a take's losses must see it. */
static enum ls_err start_camera(struct ls_capture *c, uint32_t i, struct ls_diag *diag)
{
    struct ls_camera *camera = c->setup.cameras[i];
    const struct ls_camera_slots slots = ls_ring_slots(c->rings[i]);
    bool allowed = ls_camera_info(camera)->packet_socket;
    char text[256];
    enum ls_err err = ls_camera_start(camera, &slots, diag);
    c->started[i] = !err;
    if (err || !allowed || ls_camera_info(camera)->packet_socket)
        return err;
    snprintf(text, sizeof text,
             "camera %.60s: its link is never quiet enough for a packet socket, its frames come by "
             "UDP; give cameras an interface of their own",
             ls_capture_camera(c, i)->name);
    return ls_store_alarm(c->setup.store, text, diag);
}

enum ls_err ls_capture_start_cameras(struct ls_capture *c, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        struct ls_sequencer_camera *camera = &c->sequencer.cameras[i];
        enum ls_err err = LS_OK;
        if (camera->timed) {
            camera->asked_us = camera->exposure_us = c->setup.plan->pulse_us[0];
            err = ls_camera_set_exposure(camera->camera, &camera->exposure_us, diag);
        }
        ls_ring_queue(c->rings[i]);
        if (!err)
            err = start_camera(c, i, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

static struct ls_bind_config bind_config(const struct ls_capture *c, uint32_t i)
{
    const struct ls_camera_info *info = ls_camera_info(c->setup.cameras[i]);
    const struct ls_sequencer_camera *camera = &c->sequencer.cameras[i];
    double window_us = c->setup.plan->period_us / 4.0;
    double early_us = c->setup.plan->pulse_us[0] / 20.0; /* so much of a pulse may be missed */
    return (struct ls_bind_config){.by_time = camera->by_time,
                                   .has_counter = info->has_trigger_counter && !camera->software,
                                   .has_exposure = info->has_chunk_exposure,
                                   .window_us = window_us,
                                   .tight_us = fmin(window_us, fmax(JITTER_US, early_us)),
                                   .event_delay_us =
                                       longest_pulse_us(c->setup.plan) + MARGIN_US / 2.0,
                                   .patience_us = (double)c->patience_us,
                                   .exposure_tolerance_us = 5,
                                   .exposure_tolerance = 0.01};
}

enum ls_err ls_capture_start_threads(struct ls_capture *c, struct ls_diag *diag)
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
            .metrics = &c->setup.metrics->cameras[i],
            .window = ls_credit_first_window(c->patience_us, c->setup.plan->period_us),
            .rt_priority = camera_priority(ls_capture_camera(c, i)),
        };
        err = ls_camera_thread_create(&config, &c->threads[i], diag);
        c->sequencer.cameras[i].thread = c->threads[i];
        if (!err)
            err = ls_camera_thread_start(c->threads[i], diag);
    }
    return err;
}

/* Slots are the drivers' until they stop, so frames are merged first and cameras stopped last. */
void ls_capture_wind_down(struct ls_capture *c)
{
    for (uint32_t i = 0; i < c->n_cameras; i++)
        if (c->threads[i])
            ls_camera_thread_stop(c->threads[i]);
    ls_merge_stage_drain(c->merge);
    ls_merge_stage_stop(c->merge);
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        if (!c->started[i])
            continue;
        ls_camera_stop(c->setup.cameras[i], &c->stats[i]);
        ls_count(&c->setup.metrics->cameras[i].packets_resent, c->stats[i].resent_packets);
        ls_count(&c->setup.metrics->cameras[i].underruns, c->stats[i].underruns);
        c->started[i] = false;
    }
}

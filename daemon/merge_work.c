#include "daemon/merge_work.h"

#include "core/crc32c.h"
#include "daemon/attributes.h"
#include "daemon/bracket.h"
#include "daemon/preview.h"
#include "daemon/realtime.h"
#include "daemon/store.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BAND_ROWS = 16 }; /* fewer are not worth a hand-over */

void ls_merge_fail(struct ls_merge_stage *stage, enum ls_err err, const struct ls_diag *diag)
{
    pthread_mutex_lock(&stage->lock);
    if (!atomic_load(&stage->failure)) {
        stage->diag = *diag;
        atomic_store(&stage->failure, err);
    }
    pthread_cond_broadcast(&stage->idle);
    pthread_mutex_unlock(&stage->lock);
}

static void give_back(struct ls_merge_stage *stage, const struct ls_merge_job *job)
{
    static const struct ls_diag bug = {"a slot of the ring was not ours to give back"};
    if (ls_ring_give_back(stage->config.rings[job->camera], job->bound.frame.slot))
        ls_merge_fail(stage, LS_ERR_BUG, &bug);
    else
        ls_camera_release(stage->config.setup->cameras[job->camera], job->bound.frame.slot);
}

static const struct ls_plan_condition *condition_of(const struct ls_merge_stage *stage,
                                                    uint32_t plan_step)
{
    const struct ls_plan *plan = stage->config.setup->plan;
    return &plan->conditions[plan->steps[plan_step].condition];
}

static struct ls_camera_metrics *metrics_of(const struct ls_merge_stage *stage, uint32_t camera)
{
    return &stage->config.setup->metrics->cameras[camera];
}

/* ---- tickets ---- */

static uint32_t attempt_of(const struct ls_merge_stage *stage, uint32_t plan_step, uint32_t shot)
{
    uint32_t before = stage->config.first_attempt ? stage->config.first_attempt[shot] : 0;
    uint32_t tries = stage->attempts[plan_step];
    return before + (tries ? tries - 1 : 0);
}

static struct ls_ticket ticket_of(const struct ls_merge_stage *stage,
                                  const struct ls_merge_job *job, uint32_t crc)
{
    const struct ls_plan *plan = stage->config.setup->plan;
    const struct ls_plan_step *step = &plan->steps[job->plan_step];
    const struct ls_bound_frame *b = &job->bound;
    uint32_t shot = job->plan_step * stage->n_cameras + job->camera;
    return (struct ls_ticket){.shot = shot,
                              .step = job->plan_step,
                              .camera = job->camera,
                              .attempt = attempt_of(stage, job->plan_step, shot),
                              .condition = step->condition,
                              .exposure = step->exposure,
                              .repeat = step->repeat,
                              .pulse_us = plan->pulse_us[step->exposure],
                              .controller_step = b->step,
                              .width_us = b->event.width_us,
                              .controller_us = b->event.us,
                              .frame_id = b->frame.frame_id,
                              .camera_ns = b->frame.camera_ns,
                              .host_ns = b->frame.host_ns,
                              .status = b->frame.status,
                              .trigger_counter = b->frame.trigger_counter,
                              .chunk_exposure_us = b->frame.chunk_exposure_us,
                              .exposure_used_us = b->exposure_us,
                              .residual_us = b->residual_us,
                              .raw_crc32c = crc,
                              .raw_bytes = b->frame.payload_bytes};
}

static uint32_t crc_of(const struct ls_merge_job *job, const void *raw)
{
    return ls_crc32c(0, raw, job->bound.frame.payload_bytes);
}

/* Ticket and, if asked for, the bytes themselves. */
static enum ls_err record(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                          const void *raw, uint32_t crc, struct ls_ticket *ticket,
                          struct ls_diag *diag)
{
    struct ls_store *store = stage->config.setup->store;
    size_t n = job->bound.frame.payload_bytes;
    *ticket = ticket_of(stage, job, crc);
    enum ls_err err = LS_OK;
    if (stage->config.setup->plan->keep_raw)
        err = ls_store_raw(store, job->camera, ticket->shot, ticket->attempt, raw, n, diag);
    return err ? err : ls_store_ticket(store, ticket, diag);
}

/* Under the lock. */
static void count_in(struct ls_merge_stage *stage, const struct ls_merge_job *job)
{
    struct ls_merge_camera *camera = &stage->cameras[job->camera];
    camera->shots[job->plan_step] = LS_SHOT_IN;
    if (++stage->cameras_in[job->plan_step] == stage->n_cameras)
        atomic_fetch_add(&stage->steps_bound, 1);
    atomic_fetch_add(&stage->shots_in, 1);
    uint8_t *lost = &stage->lost[job->plan_step * stage->n_cameras + job->camera];
    if (*lost) {
        *lost = 0;
        atomic_fetch_add(&stage->repairs, 1);
        ls_count(&metrics_of(stage, job->camera)->shots_repaired, 1);
        stage->repaired[stage->config.setup->plan->steps[job->plan_step].condition]++;
    }
}

/* ---- publishing ---- */

/* Merged now: since its latest frame, whose pulse began at @pulse_ns. */
static struct ls_picture_times count_merged(const struct ls_merge_stage *stage, uint32_t camera,
                                            uint64_t pulse_ns, uint64_t arrived_ns)
{
    const struct ls_picture_times times = {metrics_of(stage, camera), pulse_ns, ls_host_ns()};
    ls_metrics_time(times.camera, LS_LATENCY_MERGED, arrived_ns, times.merged_ns);
    return times;
}

static enum ls_err publish(struct ls_merge_stage *stage, uint32_t camera, uint32_t condition,
                           double longest_exposure_s, struct ls_exr_mosaic *mosaic,
                           const struct ls_picture_times *times, struct ls_diag *diag)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    struct ls_exr_attrs attrs = {0};
    const struct ls_picture_facts about = {.config = setup->config,
                                           .plan = setup->plan,
                                           .info = ls_camera_info(setup->cameras[camera]),
                                           .camera = camera,
                                           .condition = condition,
                                           .take = ls_store_id(setup->store),
                                           .utc_s = stage->config.utc_s,
                                           .reference_exposure_s = setup->reference_exposure_s,
                                           .longest_exposure_s = longest_exposure_s};
    ls_picture_attributes(&about, &attrs);
    mosaic->width = stage->cameras[camera].width;
    mosaic->height = stage->cameras[camera].height;
    mosaic->attrs = &attrs;
    const struct ls_store_picture picture = {.condition = setup->plan->conditions[condition].id,
                                             .camera = camera,
                                             .mosaic = *mosaic,
                                             .times = *times};
    enum ls_err err = ls_store_publish(setup->store, &picture, diag);
    ls_exr_attrs_finish(&attrs);
    /* A resumed take may have it of some cameras: the first one stands. */
    return err == LS_ERR_EXISTS && setup->condition_done ? LS_OK : err;
}

static void count_published(struct ls_merge_stage *stage, uint32_t camera, uint32_t condition)
{
    pthread_mutex_lock(&stage->lock);
    stage->cameras[camera].published[condition] = 1;
    if (++stage->cameras_have[condition] == stage->n_cameras)
        atomic_fetch_add(&stage->conditions_stored, 1);
    pthread_mutex_unlock(&stage->lock);
}

/* ---- darks ---- */

static enum ls_err finish_dark(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                               struct ls_diag *diag)
{
    struct ls_merge_camera *camera = &stage->cameras[job->camera];
    const struct ls_plan *plan = stage->config.setup->plan;
    uint32_t condition = plan->steps[job->plan_step].condition;
    uint32_t exposure = plan->conditions[condition].exposure;
    struct ls_diag why = {{0}};
    enum ls_err err = ls_dark_stage_close(&camera->darks, exposure, &why);
    if (err)
        return ls_fail(diag, err, "%s of camera %s: %.400s", plan->conditions[condition].id,
                       stage->config.setup->config->cameras[job->camera].name, why.text);
    struct ls_exr_mosaic mosaic = {.floats = camera->darks.exposures[exposure].mean_dn,
                                   .validity = camera->darks.exposures[exposure].validity};
    const struct ls_picture_times times =
        count_merged(stage, job->camera, job->bound.pulse_ns, job->bound.frame.host_ns);
    err = publish(stage, job->camera, condition, job->bound.exposure_us * 1e-6, &mosaic, &times,
                  diag);
    if (!err)
        count_published(stage, job->camera, condition);
    return err;
}

/* ---- watches ---- */

static enum ls_err report_drift(struct ls_merge_stage *stage, uint32_t camera, uint32_t condition,
                                const struct ls_dark_drift *drift, struct ls_diag *diag)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    const struct ls_plan_condition *c = &setup->plan->conditions[condition];
    char text[320];
    if (fabs(drift->difference_dn) <= drift->allowed_dn)
        return LS_OK;
    snprintf(text, sizeof text,
             "dark drift: camera %.64s: %s is %+.3f DN from dark-%u (allowed %.3f DN): its black "
             "level or the ambient light changed; let the camera warm up, keep stray light out, "
             "and take again what must be exact in the shadows",
             setup->config->cameras[camera].name, c->id, drift->difference_dn, c->exposure,
             drift->allowed_dn);
    return ls_store_alarm(setup->store, text, diag);
}

static void end_watch(struct ls_merge_stage *stage, struct ls_merge_camera *camera)
{
    pthread_mutex_lock(&stage->lock);
    camera->watch.under_way = false;
    camera->watch.adding = 0;
    pthread_mutex_unlock(&stage->lock);
    sem_post(&stage->work);
}

static enum ls_err finish_watch(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                                struct ls_diag *diag)
{
    struct ls_merge_camera *camera = &stage->cameras[job->camera];
    uint32_t condition = stage->config.setup->plan->steps[job->plan_step].condition;
    uint32_t exposure = stage->config.setup->plan->conditions[condition].exposure;
    struct ls_dark_drift drift;
    LS_CLEANUP_FREE float *mean = malloc((size_t)camera->width * camera->height * sizeof *mean);
    if (!mean)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a watch");
    enum ls_err err = ls_dark_stage_close_watch(&camera->darks, exposure, mean, &drift, diag);
    if (err)
        return err;
    end_watch(stage, camera);
    struct ls_exr_mosaic mosaic = {.floats = mean};
    const struct ls_picture_times times =
        count_merged(stage, job->camera, job->bound.pulse_ns, job->bound.frame.host_ns);
    err = publish(stage, job->camera, condition, job->bound.exposure_us * 1e-6, &mosaic, &times,
                  diag);
    if (err)
        return err;
    count_published(stage, job->camera, condition);
    return report_drift(stage, job->camera, condition, &drift, diag);
}

static enum ls_err take_dark(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                             struct ls_diag *diag)
{
    struct ls_merge_camera *camera = &stage->cameras[job->camera];
    const void *raw = ls_ring_payload(stage->config.rings[job->camera], job->bound.frame.slot);
    const struct ls_plan_condition *c = condition_of(stage, job->plan_step);
    uint32_t condition = stage->config.setup->plan->steps[job->plan_step].condition;
    bool watch = job->kind == LS_JOB_WATCH;
    struct ls_ticket ticket;
    enum ls_err err = watch ? ls_dark_stage_watch(&camera->darks, raw, diag)
                            : ls_dark_stage_add(&camera->darks, c->exposure, raw, diag);
    if (!err)
        err = record(stage, job, raw, crc_of(job, raw), &ticket, diag);
    give_back(stage, job);
    if (err)
        return err;
    pthread_mutex_lock(&stage->lock);
    count_in(stage, job);
    bool last = ++camera->darks_in[condition] == c->n_steps;
    if (watch && !last)
        camera->watch.adding--;
    pthread_mutex_unlock(&stage->lock);
    if (!last)
        return LS_OK;
    return watch ? finish_watch(stage, job, diag) : finish_dark(stage, job, diag);
}

/* ---- lights ---- */

static void describe_merge(struct ls_merge_stage *stage, struct ls_accumulator *a)
{
    const struct ls_config_camera *c = &stage->config.setup->config->cameras[a->camera];
    struct ls_merge_camera *camera = &stage->cameras[a->camera];
    const struct ls_plan *plan = stage->config.setup->plan;
    const struct ls_plan_condition *condition = &plan->conditions[a->condition];
    a->params =
        (struct ls_merge_params){.format = camera->format,
                                 .width = camera->width,
                                 .height = camera->height,
                                 .n_exposures = condition->n_steps,
                                 .range_low = c->range_low,
                                 .range_high = c->range_high,
                                 .full_scale_dn = c->full_scale_dn,
                                 .clip_dn = c->full_scale_dn,
                                 .electrons_per_dn = c->electrons_per_dn,
                                 .read_noise_dn = c->read_noise_dn,
                                 .defects = camera->darks.defects.index,
                                 .n_defects = camera->darks.defects.n,
                                 .reference_exposure_s = stage->config.setup->reference_exposure_s};
    a->spans = (struct ls_merge_spans){.half = a->half, .validity = a->validity};
    for (uint32_t i = 0; i < condition->n_steps; i++) {
        uint32_t exposure = plan->steps[condition->first_step + i].exposure;
        a->params.exposure_s[i] = a->exposure_s[i];
        a->spans.raw[i] = a->raw[i];
        a->spans.dark[i] = camera->darks.exposures[exposure].mean_dn;
    }
}

static uint32_t band_count(const struct ls_merge_stage *stage, uint32_t height)
{
    uint32_t n = height / BAND_ROWS, most = 2 * stage->n_threads;
    n = n > most ? most : n;
    return n ? n : 1;
}

static enum ls_err start_merge(struct ls_merge_stage *stage, struct ls_accumulator *a,
                               struct ls_diag *diag)
{
    describe_merge(stage, a);
    enum ls_err err = ls_merge_check(&a->params, diag);
    if (err)
        return err;
    pthread_mutex_lock(&stage->lock);
    a->n_bands = band_count(stage, a->params.height);
    pthread_mutex_unlock(&stage->lock);
    for (uint32_t i = 0; i < stage->n_threads; i++)
        sem_post(&stage->work);
    return LS_OK;
}

static void offer(const struct ls_merge_stage *stage, const struct ls_merge_job *job,
                  const void *raw)
{
    const struct ls_merge_camera *camera = &stage->cameras[job->camera];
    ls_preview_offer(stage->config.setup->preview, job->camera, camera->format, camera->width,
                     camera->height, raw, job->bound.frame.frame_id, job->bound.exposure_us);
}

/* The rest of its bracket comes in later rounds. */
static enum ls_err keep(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                        struct ls_diag *diag)
{
    const void *raw = ls_ring_payload(stage->config.rings[job->camera], job->bound.frame.slot);
    struct ls_ticket ticket;
    enum ls_err err = record(stage, job, raw, crc_of(job, raw), &ticket, diag);
    offer(stage, job, raw);
    give_back(stage, job);
    if (err)
        return err;
    pthread_mutex_lock(&stage->lock);
    stage->cameras[job->camera].kept[job->plan_step] =
        (struct ls_kept_shot){true, ticket.attempt, ticket.raw_crc32c, ticket.exposure_used_us};
    count_in(stage, job);
    pthread_mutex_unlock(&stage->lock);
    return LS_OK;
}

/* What waited on disk for this frame. */
static enum ls_err read_kept(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                             const struct ls_plan_condition *c, struct ls_diag *diag)
{
    const struct ls_merge_camera *camera = &stage->cameras[job->camera];
    struct ls_accumulator *a = job->accumulator;
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < c->n_steps && !err; i++) {
        uint32_t step = c->first_step + i;
        if (step == job->plan_step)
            continue;
        err = ls_kept_read(ls_store_folder(stage->config.setup->store), job->camera,
                           step * stage->n_cameras + job->camera, &camera->kept[step], a->raw[i],
                           camera->payload_bytes, diag);
        a->exposure_s[i] = camera->kept[step].exposure_us * 1e-6;
    }
    return err;
}

static enum ls_err copy_in(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                           struct ls_diag *diag)
{
    struct ls_accumulator *a = job->accumulator;
    const struct ls_plan_condition *c = condition_of(stage, job->plan_step);
    uint32_t i = job->plan_step - c->first_step;
    uint32_t crc = ls_crc32c_copy(
        0, a->raw[i], ls_ring_payload(stage->config.rings[job->camera], job->bound.frame.slot),
        job->bound.frame.payload_bytes);
    give_back(stage, job);
    a->exposure_s[i] = job->bound.exposure_us * 1e-6;
    struct ls_ticket ticket;
    bool kept = ls_bracket_keeps(stage->config.setup->plan, c);
    enum ls_err err = record(stage, job, a->raw[i], crc, &ticket, diag);
    if (!err && kept)
        err = read_kept(stage, job, c, diag);
    if (err)
        return err;
    offer(stage, job, a->raw[i]);
    pthread_mutex_lock(&stage->lock);
    count_in(stage, job);
    a->copying--;
    if (kept)
        a->filled = c->n_steps - 1;
    if (job->bound.pulse_ns >= a->pulse_ns) {
        a->pulse_ns = job->bound.pulse_ns;
        a->arrived_ns = job->bound.frame.host_ns;
    }
    bool last = ++a->filled == c->n_steps;
    if (last) /* now: a full one that still counts as filling could be given to another condition */
        a->state = LS_ACCUMULATOR_MERGING;
    pthread_mutex_unlock(&stage->lock);
    return last ? start_merge(stage, a, diag) : LS_OK;
}

/* What the picture says about the rig. */
static enum ls_err check(struct ls_merge_stage *stage, const struct ls_accumulator *a,
                         struct ls_diag *diag)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    const struct ls_merge_camera *camera = &stage->cameras[a->camera];
    const struct ls_picture_view view = {a->half, a->validity, camera->width, camera->height,
                                         camera->format->cfa};
    struct ls_diag alarm = {{0}};
    if (!setup->checks)
        return LS_OK;
    enum ls_err err =
        ls_checks_picture(setup->checks, a->camera, a->condition, &view, &alarm, diag);
    return !err && alarm.text[0] ? ls_store_alarm(setup->store, alarm.text, diag) : err;
}

static enum ls_err publish_merged(struct ls_merge_stage *stage, struct ls_accumulator *a,
                                  struct ls_diag *diag)
{
    double longest = 0;
    for (uint32_t i = 0; i < a->params.n_exposures; i++)
        longest = a->exposure_s[i] > longest ? a->exposure_s[i] : longest;
    struct ls_exr_mosaic mosaic = {.half = a->half, .validity = a->validity};
    const struct ls_picture_times times =
        count_merged(stage, a->camera, a->pulse_ns, a->arrived_ns);
    enum ls_err err = publish(stage, a->camera, a->condition, longest, &mosaic, &times, diag);
    if (!err)
        err = check(stage, a, diag);
    if (err)
        return err;
    count_published(stage, a->camera, a->condition);
    pthread_mutex_lock(&stage->lock);
    ls_accumulator_free(a);
    pthread_mutex_unlock(&stage->lock);
    sem_post(&stage->work);
    return LS_OK;
}

static enum ls_err merge_band(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                              struct ls_diag *diag)
{
    struct ls_accumulator *a = job->accumulator;
    uint32_t height = a->params.height;
    uint32_t first = (uint32_t)((uint64_t)height * job->band / a->n_bands);
    uint32_t end = (uint32_t)((uint64_t)height * (job->band + 1) / a->n_bands);
    ls_merge_rows(&a->params, &a->spans, first, end - first);
    pthread_mutex_lock(&stage->lock);
    bool last = ++a->bands_done == a->n_bands;
    pthread_mutex_unlock(&stage->lock);
    return last ? publish_merged(stage, a, diag) : LS_OK;
}

void ls_merge_do(struct ls_merge_stage *stage, const struct ls_merge_job *job)
{
    struct ls_diag diag = {{0}};
    enum ls_err err = LS_OK;
    switch (job->kind) {
    case LS_JOB_NONE:
        break;
    case LS_JOB_DISCARD:
        give_back(stage, job);
        break;
    case LS_JOB_DARK:
    case LS_JOB_WATCH:
        err = take_dark(stage, job, &diag);
        break;
    case LS_JOB_KEEP:
        err = keep(stage, job, &diag);
        break;
    case LS_JOB_COPY:
        err = copy_in(stage, job, &diag);
        break;
    case LS_JOB_BAND:
        err = merge_band(stage, job, &diag);
        break;
    }
    if (err)
        ls_merge_fail(stage, err, &diag);
}

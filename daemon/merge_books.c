#include "daemon/merge_private.h"

#include "daemon/attributes.h"
#include "daemon/realtime.h"
#include "daemon/store.h"

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

void ls_merge_give_back(struct ls_merge_stage *stage, const struct ls_merge_job *job)
{
    static const struct ls_diag bug = {"a slot of the ring was not ours to give back"};
    if (ls_ring_give_back(stage->config.rings[job->camera], job->bound.frame.slot))
        ls_merge_fail(stage, LS_ERR_BUG, &bug);
    else
        ls_camera_release(stage->config.setup->cameras[job->camera], job->bound.frame.slot);
}

static struct ls_camera_metrics *metrics_of(const struct ls_merge_stage *stage, uint32_t camera)
{
    return &stage->config.setup->metrics->cameras[camera];
}

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

enum ls_err ls_merge_record(struct ls_merge_stage *stage, const struct ls_merge_job *job,
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

void ls_merge_count_in(struct ls_merge_stage *stage, const struct ls_merge_job *job)
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

struct ls_picture_times ls_merge_count_merged(const struct ls_merge_stage *stage, uint32_t camera,
                                              uint64_t pulse_ns, uint64_t arrived_ns)
{
    const struct ls_picture_times times = {metrics_of(stage, camera), pulse_ns, ls_host_ns()};
    ls_metrics_time(times.camera, LS_LATENCY_MERGED, arrived_ns, times.merged_ns);
    return times;
}

enum ls_err ls_merge_publish(struct ls_merge_stage *stage, uint32_t camera, uint32_t condition,
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

void ls_merge_count_published(struct ls_merge_stage *stage, uint32_t camera, uint32_t condition)
{
    pthread_mutex_lock(&stage->lock);
    stage->cameras[camera].published[condition] = 1;
    if (++stage->cameras_have[condition] == stage->n_cameras)
        atomic_fetch_add(&stage->conditions_stored, 1);
    pthread_mutex_unlock(&stage->lock);
}

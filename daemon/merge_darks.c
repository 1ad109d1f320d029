#include "daemon/merge_private.h"

#include "core/crc32c.h"
#include "daemon/store.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Of the dark or watch whose last frame is the job's. */
static enum ls_err publish_mean(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                                struct ls_exr_mosaic *mosaic, struct ls_diag *diag)
{
    uint32_t condition = stage->config.setup->plan->steps[job->plan_step].condition;
    const struct ls_picture_times times =
        ls_merge_count_merged(stage, job->camera, job->bound.pulse_ns, job->bound.frame.host_ns);
    enum ls_err err = ls_merge_publish(stage, job->camera, condition, job->bound.exposure_us * 1e-6,
                                       mosaic, &times, diag);
    if (!err)
        ls_merge_count_published(stage, job->camera, condition);
    return err;
}

static enum ls_err finish_dark(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                               struct ls_diag *diag)
{
    struct ls_merge_camera *camera = &stage->cameras[job->camera];
    const struct ls_plan_condition *c = ls_merge_condition(stage, job->plan_step);
    struct ls_diag why = {{0}};
    enum ls_err err = ls_dark_stage_close(&camera->darks, c->exposure, &why);
    if (err)
        return ls_fail(diag, err, "%s of camera %s: %.400s", c->id,
                       stage->config.setup->config->cameras[job->camera].name, why.text);
    struct ls_exr_mosaic mosaic = {.floats = camera->darks.exposures[c->exposure].mean_dn,
                                   .validity = camera->darks.exposures[c->exposure].validity};
    return publish_mean(stage, job, &mosaic, diag);
}

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
    err = publish_mean(stage, job, &mosaic, diag);
    return err ? err : report_drift(stage, job->camera, condition, &drift, diag);
}

enum ls_err ls_merge_dark(struct ls_merge_stage *stage, const struct ls_merge_job *job,
                          struct ls_diag *diag)
{
    struct ls_merge_camera *camera = &stage->cameras[job->camera];
    const void *raw = ls_ring_payload(stage->config.rings[job->camera], job->bound.frame.slot);
    const struct ls_plan_condition *c = ls_merge_condition(stage, job->plan_step);
    uint32_t condition = stage->config.setup->plan->steps[job->plan_step].condition;
    bool watch = job->kind == LS_JOB_WATCH;
    struct ls_ticket ticket;
    enum ls_err err = watch ? ls_dark_stage_watch(&camera->darks, raw, diag)
                            : ls_dark_stage_add(&camera->darks, c->exposure, raw, diag);
    if (!err)
        err = ls_merge_record(stage, job, raw, ls_crc32c(0, raw, job->bound.frame.payload_bytes),
                              &ticket, diag);
    ls_merge_give_back(stage, job);
    if (err)
        return err;
    pthread_mutex_lock(&stage->lock);
    ls_merge_count_in(stage, job);
    bool last = ++camera->darks_in[condition] == c->n_steps;
    if (watch && !last)
        camera->watch.adding--;
    pthread_mutex_unlock(&stage->lock);
    if (!last)
        return LS_OK;
    return watch ? finish_watch(stage, job, diag) : finish_dark(stage, job, diag);
}

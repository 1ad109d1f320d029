#include "daemon/merge_private.h"

#include "core/crc32c.h"
#include "daemon/bracket.h"
#include "daemon/preview.h"
#include "daemon/store.h"

enum { BAND_ROWS = 16 }; /* fewer are not worth a hand-over */

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
    enum ls_err err = ls_merge_record(
        stage, job, raw, ls_crc32c(0, raw, job->bound.frame.payload_bytes), &ticket, diag);
    offer(stage, job, raw);
    ls_merge_give_back(stage, job);
    if (err)
        return err;
    pthread_mutex_lock(&stage->lock);
    stage->cameras[job->camera].kept[job->plan_step] =
        (struct ls_kept_shot){true, ticket.attempt, ticket.raw_crc32c, ticket.exposure_used_us};
    ls_merge_count_in(stage, job);
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
    const struct ls_plan_condition *c = ls_merge_condition(stage, job->plan_step);
    uint32_t i = job->plan_step - c->first_step;
    uint32_t crc = ls_crc32c_copy(
        0, a->raw[i], ls_ring_payload(stage->config.rings[job->camera], job->bound.frame.slot),
        job->bound.frame.payload_bytes);
    ls_merge_give_back(stage, job);
    a->exposure_s[i] = job->bound.exposure_us * 1e-6;
    struct ls_ticket ticket;
    bool kept = ls_bracket_keeps(stage->config.setup->plan, c);
    enum ls_err err = ls_merge_record(stage, job, a->raw[i], crc, &ticket, diag);
    if (!err && kept)
        err = read_kept(stage, job, c, diag);
    if (err)
        return err;
    offer(stage, job, a->raw[i]);
    pthread_mutex_lock(&stage->lock);
    ls_merge_count_in(stage, job);
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
        ls_merge_count_merged(stage, a->camera, a->pulse_ns, a->arrived_ns);
    enum ls_err err =
        ls_merge_publish(stage, a->camera, a->condition, longest, &mosaic, &times, diag);
    if (!err)
        err = check(stage, a, diag);
    if (err)
        return err;
    ls_merge_count_published(stage, a->camera, a->condition);
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
        ls_merge_give_back(stage, job);
        break;
    case LS_JOB_DARK:
    case LS_JOB_WATCH:
        err = ls_merge_dark(stage, job, &diag);
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

#include "daemon/merge_private.h"

#include <stdlib.h>
#include <string.h>

enum {
    MIN_ACCUMULATORS = 2,
    MAX_ACCUMULATORS = 16,
};

static enum ls_err init_darks(struct ls_merge_stage *stage, uint32_t index, struct ls_diag *diag)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    struct ls_merge_camera *camera = &stage->cameras[index];
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < setup->plan->n_conditions && !err; i++) {
        const struct ls_plan_condition *c = &setup->plan->conditions[i];
        if (!c->dark || c->watch)
            continue;
        const float *mean =
            setup->darks ? setup->darks[index * setup->plan->n_exposures + c->exposure] : NULL;
        if (setup->condition_done && setup->condition_done[i] && mean)
            err = ls_dark_stage_adopt(&camera->darks, c->exposure, c->repeats, mean, diag);
        else
            err = ls_dark_stage_expect(&camera->darks, c->exposure, diag);
    }
    return err || !setup->defects
               ? err
               : ls_dark_stage_know(&camera->darks, &setup->defects[index], diag);
}

static void adopt_done(struct ls_merge_stage *stage, struct ls_merge_camera *camera)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    for (uint32_t i = 0; setup->condition_done && i < setup->plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &setup->plan->conditions[i];
        if (!setup->condition_done[i])
            continue;
        camera->published[i] = 1;
        memset(camera->shots + c->first_step, LS_SHOT_IN, c->n_steps);
    }
}

/* Shots of earlier runs that wait on disk. */
static enum ls_err adopt_kept(struct ls_merge_stage *stage, uint32_t index)
{
    const struct ls_plan *plan = stage->config.setup->plan;
    struct ls_merge_camera *camera = &stage->cameras[index];
    if (plan->bracket != LS_BRACKET_OUTERMOST)
        return LS_OK;
    camera->kept = calloc(plan->n_steps + 1, sizeof *camera->kept);
    if (!camera->kept)
        return LS_ERR_NOMEM;
    for (uint32_t i = 0; stage->config.kept && i < plan->n_steps; i++) {
        camera->kept[i] = stage->config.kept[i * stage->n_cameras + index];
        if (!camera->kept[i].there)
            continue;
        camera->shots[i] = LS_SHOT_IN;
        stage->cameras_in[i]++;
    }
    return LS_OK;
}

static uint32_t pool_size(const struct ls_merge_stage *stage, size_t bytes_each)
{
    uint64_t memory = stage->config.memory_bytes ? stage->config.memory_bytes : 1u << 30;
    uint64_t n = memory / stage->n_cameras / bytes_each;
    return n < MIN_ACCUMULATORS ? MIN_ACCUMULATORS
                                : (uint32_t)(n > MAX_ACCUMULATORS ? MAX_ACCUMULATORS : n);
}

enum ls_err ls_merge_camera_init(struct ls_merge_stage *stage, uint32_t index, struct ls_diag *diag)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    const struct ls_camera_info *info = ls_camera_info(setup->cameras[index]);
    struct ls_merge_camera *camera = &stage->cameras[index];
    uint32_t n_exposures = setup->plan->n_exposures;
    camera->format = ls_pixel_by_name(info->pixel_format);
    ls_dark_stage_init(&camera->darks, camera->format, info->width, info->height,
                       setup->config->cameras[index].black_check);
    if (!camera->format)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "camera %s: pixel format %s is not supported",
                       setup->config->cameras[index].name, info->pixel_format);
    camera->width = info->width;
    camera->height = info->height;
    camera->payload_bytes = ls_pixel_payload_bytes(camera->format, info->width, info->height);
    size_t n_px = (size_t)info->width * info->height;
    size_t each = ls_accumulator_bytes(camera->payload_bytes, n_px, n_exposures);
    camera->shots = calloc(setup->plan->n_steps + 1, 1);
    camera->published = calloc(setup->plan->n_conditions + 1, 1);
    camera->darks_in = calloc(setup->plan->n_conditions + 1, sizeof *camera->darks_in);
    if (!camera->shots || !camera->published || !camera->darks_in ||
        ls_queue_init(&camera->inlet, sizeof(struct ls_bound_frame),
                      ls_ring_slots(stage->config.rings[index]).n) ||
        ls_accumulators_init(&camera->pool, pool_size(stage, each), n_exposures,
                             camera->payload_bytes, n_px) ||
        adopt_kept(stage, index))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory: %zu bytes per condition of camera %s",
                       each, setup->config->cameras[index].name);
    adopt_done(stage, camera);
    return init_darks(stage, index, diag);
}

void ls_merge_camera_finish(struct ls_merge_camera *camera)
{
    ls_queue_finish(&camera->inlet);
    ls_accumulators_finish(&camera->pool);
    ls_dark_stage_finish(&camera->darks);
    free(camera->shots);
    free(camera->kept);
    free(camera->published);
    free(camera->darks_in);
}

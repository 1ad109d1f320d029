#include "daemon/merge_private.h"

#include "daemon/bracket.h"
#include "daemon/passes.h"

static void give_up(struct ls_merge_stage *stage, struct ls_merge_camera *camera,
                    uint32_t condition)
{
    const struct ls_plan_condition *c = &stage->config.setup->plan->conditions[condition];
    for (uint32_t i = c->first_step; i < c->first_step + c->n_steps; i++) {
        if (camera->shots[i] != LS_SHOT_IN)
            continue;
        camera->shots[i] = LS_SHOT_OPEN;
        if (stage->cameras_in[i]-- == stage->n_cameras)
            atomic_fetch_sub(&stage->steps_bound, 1);
    }
}

static bool usable(const struct ls_merge_stage *stage, const struct ls_merge_camera *camera)
{
    const struct ls_bound_frame *bound = &camera->held;
    return bound->step < stage->n_program && stage->plan_steps[bound->step] != LS_PASS_NO_STEP &&
           bound->frame.payload_bytes == camera->payload_bytes &&
           camera->shots[stage->plan_steps[bound->step]] == LS_SHOT_OPEN &&
           !atomic_load(&stage->failure);
}

static bool claim_watch(struct ls_merge_stage *stage, struct ls_merge_camera *camera,
                        uint32_t condition)
{
    bool other = camera->watch.under_way && camera->watch.condition != condition;
    if (other && camera->watch.adding > 0)
        return false;
    if (other) {
        give_up(stage, camera, camera->watch.condition);
        camera->darks_in[camera->watch.condition] = 0;
        ls_dark_stage_drop_watch(&camera->darks);
    }
    camera->watch.under_way = true;
    camera->watch.condition = condition;
    camera->watch.adding++;
    return true;
}

static bool claim_accumulator(struct ls_merge_stage *stage, struct ls_merge_camera *camera,
                              uint32_t condition, struct ls_merge_job *job)
{
    int64_t given_up;
    job->accumulator = ls_accumulators_claim(&camera->pool, condition, &given_up);
    if (!job->accumulator)
        return false;
    if (given_up >= 0)
        give_up(stage, camera, (uint32_t)given_up);
    job->accumulator->camera = job->camera;
    job->accumulator->claimed |=
        1u << (job->plan_step - stage->config.setup->plan->conditions[condition].first_step);
    job->accumulator->copying++;
    return true;
}

/* Is it kept on disk, as others of its bracket are still missing? Frames of one bracket are never
 * under way together, so that one of them finds all others in. */
static bool waits_on_disk(const struct ls_merge_stage *stage, const struct ls_merge_camera *camera,
                          const struct ls_plan_condition *c, uint32_t plan_step)
{
    if (!ls_bracket_keeps(stage->config.setup->plan, c))
        return false;
    for (uint32_t i = c->first_step; i < c->first_step + c->n_steps; i++)
        if (i != plan_step && camera->shots[i] != LS_SHOT_IN)
            return true;
    return false;
}

/* False: the frame has to wait for an accumulator, or for the watch before it. */
static bool place(struct ls_merge_stage *stage, uint32_t index, struct ls_merge_job *job)
{
    struct ls_merge_camera *camera = &stage->cameras[index];
    *job = (struct ls_merge_job){.kind = LS_JOB_DISCARD, .camera = index, .bound = camera->held};
    if (!usable(stage, camera))
        return true;
    job->plan_step = stage->plan_steps[camera->held.step];
    uint32_t condition = stage->config.setup->plan->steps[job->plan_step].condition;
    const struct ls_plan_condition *c = &stage->config.setup->plan->conditions[condition];
    job->kind = c->watch                                          ? LS_JOB_WATCH
                : c->dark                                         ? LS_JOB_DARK
                : waits_on_disk(stage, camera, c, job->plan_step) ? LS_JOB_KEEP
                                                                  : LS_JOB_COPY;
    if (c->watch && !claim_watch(stage, camera, condition))
        return false;
    if (job->kind == LS_JOB_COPY && !claim_accumulator(stage, camera, condition, job))
        return false;
    camera->shots[job->plan_step] = LS_SHOT_CLAIMED;
    return true;
}

static bool pick_frame(struct ls_merge_stage *stage, struct ls_merge_job *job)
{
    for (uint32_t i = 0; i < stage->n_cameras; i++) {
        struct ls_merge_camera *camera = &stage->cameras[i];
        if (!camera->holds)
            camera->holds = ls_queue_pop(&camera->inlet, &camera->held);
        if (camera->holds && place(stage, i, job)) {
            camera->holds = false;
            return true;
        }
    }
    return false;
}

/* Of the condition that has waited longest. */
static bool pick_band(struct ls_merge_stage *stage, struct ls_merge_job *job)
{
    struct ls_accumulator *first = NULL;
    for (uint32_t i = 0; i < stage->n_cameras; i++) {
        struct ls_accumulator *a = ls_accumulators_waiting(&stage->cameras[i].pool);
        if (a && (!first || a->arrived_ns < first->arrived_ns))
            first = a;
    }
    if (!first)
        return false;
    *job = (struct ls_merge_job){.kind = LS_JOB_BAND,
                                 .camera = first->camera,
                                 .accumulator = first,
                                 .band = first->bands_taken++};
    return true;
}

/* Frames first: they hold slots of the ring. */
bool ls_merge_choose(struct ls_merge_stage *stage, struct ls_merge_job *job)
{
    return pick_frame(stage, job) || (!atomic_load(&stage->failure) && pick_band(stage, job));
}

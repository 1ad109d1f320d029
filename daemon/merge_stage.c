#include "daemon/merge_stage.h"

#include "daemon/bracket.h"
#include "daemon/merge_work.h"
#include "daemon/passes.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    MIN_ACCUMULATORS = 2,
    MAX_ACCUMULATORS = 16,
};

/* ---- choosing work; under the lock ---- */

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
static bool pick(struct ls_merge_stage *stage, struct ls_merge_job *job)
{
    return pick_frame(stage, job) || (!atomic_load(&stage->failure) && pick_band(stage, job));
}

/* ---- threads ---- */

/* Every frame handed in is posted, and what a job frees is seen by the thread that ran it, which
 * looks for work again before it comes here: nothing is left lying. */
static void wait_for_work(struct ls_merge_stage *stage)
{
    while (sem_wait(&stage->work) && errno == EINTR)
        ;
}

static void *run(void *data)
{
    struct ls_merge_stage *stage = data;
    struct ls_merge_job job;
    pthread_mutex_lock(&stage->lock);
    while (!stage->stopping) {
        bool found = pick(stage, &job);
        stage->busy += found;
        pthread_mutex_unlock(&stage->lock);
        if (found)
            ls_merge_do(stage, &job);
        else
            wait_for_work(stage);
        pthread_mutex_lock(&stage->lock);
        stage->busy -= found;
        if (stage->busy == 0)
            pthread_cond_broadcast(&stage->idle);
    }
    pthread_mutex_unlock(&stage->lock);
    return NULL;
}

enum ls_err ls_merge_stage_start(struct ls_merge_stage *stage, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < stage->n_threads; i++) {
        char name[16];
        if (pthread_create(&stage->threads[i], NULL, run, stage)) {
            ls_merge_stage_stop(stage);
            return ls_fail(diag, LS_ERR_OS, "cannot start merge thread %u", i);
        }
        snprintf(name, sizeof name, "ls-merge-%u", i % 100);
        pthread_setname_np(stage->threads[i], name);
        stage->n_running++;
    }
    return LS_OK;
}

static bool has_work(struct ls_merge_stage *stage)
{
    for (uint32_t i = 0; i < stage->n_cameras; i++) {
        struct ls_merge_camera *camera = &stage->cameras[i];
        if (camera->holds || !ls_queue_is_empty(&camera->inlet))
            return true;
        for (uint32_t k = 0; k < camera->pool.n; k++)
            if (camera->pool.items[k].state == LS_ACCUMULATOR_MERGING)
                return true;
    }
    return stage->busy > 0;
}

void ls_merge_stage_drain(struct ls_merge_stage *stage)
{
    pthread_mutex_lock(&stage->lock);
    while (has_work(stage) && !atomic_load(&stage->failure))
        pthread_cond_wait(&stage->idle, &stage->lock);
    pthread_mutex_unlock(&stage->lock);
}

void ls_merge_stage_stop(struct ls_merge_stage *stage)
{
    pthread_mutex_lock(&stage->lock);
    stage->stopping = true;
    pthread_mutex_unlock(&stage->lock);
    for (uint32_t i = 0; i < stage->n_running; i++)
        sem_post(&stage->work);
    for (uint32_t i = 0; i < stage->n_running; i++)
        pthread_join(stage->threads[i], NULL);
    stage->n_running = 0;
}

/* ---- life ---- */

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

static enum ls_err init_camera(struct ls_merge_stage *stage, uint32_t index, struct ls_diag *diag)
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

static enum ls_err init_counts(struct ls_merge_stage *stage, struct ls_diag *diag)
{
    const struct ls_capture_setup *setup = stage->config.setup;
    stage->attempts = calloc(setup->plan->n_steps + 1, sizeof *stage->attempts);
    stage->cameras_in = calloc(setup->plan->n_steps + 1, 1);
    stage->cameras_have = calloc(setup->plan->n_conditions + 1, 1);
    stage->lost = calloc((size_t)setup->plan->n_steps * stage->n_cameras + 1, 1);
    stage->repaired = calloc(setup->plan->n_conditions + 1, sizeof *stage->repaired);
    stage->threads = calloc(stage->n_threads, sizeof *stage->threads);
    if (!stage->attempts || !stage->cameras_in || !stage->cameras_have || !stage->repaired ||
        !stage->lost || !stage->threads)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    return LS_OK;
}

enum ls_err ls_merge_stage_create(const struct ls_merge_stage_config *config,
                                  struct ls_merge_stage **out, struct ls_diag *diag)
{
    struct ls_merge_stage *stage = calloc(1, sizeof *stage);
    if (!stage)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    stage->config = *config;
    stage->n_cameras = config->setup->config->n_cameras;
    uint32_t n_threads = config->setup->config->merge_threads;
    stage->n_threads = n_threads ? n_threads : 1;
    pthread_mutex_init(&stage->lock, NULL);
    pthread_cond_init(&stage->idle, NULL);
    sem_init(&stage->work, 0, 0);
    enum ls_err err = init_counts(stage, diag);
    for (uint32_t i = 0; i < stage->n_cameras && !err; i++)
        err = init_camera(stage, i, diag);
    if (err) {
        ls_merge_stage_destroy(stage);
        return err;
    }
    *out = stage;
    return LS_OK;
}

void ls_merge_stage_destroy(struct ls_merge_stage *stage)
{
    if (!stage)
        return;
    ls_merge_stage_stop(stage);
    for (uint32_t i = 0; i < stage->n_cameras; i++) {
        struct ls_merge_camera *camera = &stage->cameras[i];
        ls_queue_finish(&camera->inlet);
        ls_accumulators_finish(&camera->pool);
        ls_dark_stage_finish(&camera->darks);
        free(camera->shots);
        free(camera->kept);
        free(camera->published);
        free(camera->darks_in);
    }
    free(stage->attempts);
    free(stage->cameras_in);
    free(stage->cameras_have);
    free(stage->repaired);
    free(stage->lost);
    free(stage->threads);
    sem_destroy(&stage->work);
    pthread_cond_destroy(&stage->idle);
    pthread_mutex_destroy(&stage->lock);
    free(stage);
}

/* ---- asking ---- */

struct ls_queue *ls_merge_stage_inlet(struct ls_merge_stage *stage, uint32_t camera)
{
    return &stage->cameras[camera].inlet;
}

sem_t *ls_merge_stage_work(struct ls_merge_stage *stage)
{
    return &stage->work;
}

void ls_merge_stage_arm(struct ls_merge_stage *stage, const uint32_t *plan_steps, uint32_t n)
{
    pthread_mutex_lock(&stage->lock);
    stage->plan_steps = plan_steps;
    stage->n_program = n;
    for (uint32_t i = 0; i < n; i++)
        if (plan_steps[i] != LS_PASS_NO_STEP)
            stage->attempts[plan_steps[i]]++;
    pthread_mutex_unlock(&stage->lock);
}

bool ls_merge_stage_wants(const struct ls_merge_stage *stage, uint32_t plan_step)
{
    for (uint32_t i = 0; i < stage->n_cameras; i++)
        if (stage->cameras[i].shots[plan_step] != LS_SHOT_IN)
            return true;
    return false;
}

bool ls_merge_stage_has(const struct ls_merge_stage *stage, uint32_t condition, uint32_t camera)
{
    return stage->cameras[camera].published[condition];
}

const struct ls_dark_exposure *ls_merge_stage_dark(const struct ls_merge_stage *stage,
                                                   uint32_t camera, uint32_t exposure)
{
    const struct ls_dark_exposure *e = &stage->cameras[camera].darks.exposures[exposure];
    return e->mean_dn ? e : NULL;
}

const _Atomic int *ls_merge_stage_failure(const struct ls_merge_stage *stage)
{
    return &stage->failure;
}

void ls_merge_stage_explain(const struct ls_merge_stage *stage, struct ls_diag *diag)
{
    *diag = stage->diag;
}

void ls_merge_stage_counts(const struct ls_merge_stage *stage, struct ls_merge_stage_counts *out)
{
    *out =
        (struct ls_merge_stage_counts){.steps_bound = atomic_load(&stage->steps_bound),
                                       .conditions_stored = atomic_load(&stage->conditions_stored),
                                       .shots = atomic_load(&stage->shots_in),
                                       .repaired = atomic_load(&stage->repairs)};
}

void ls_merge_stage_lost(struct ls_merge_stage *stage, uint32_t plan_step, uint32_t camera)
{
    if (stage->cameras[camera].shots[plan_step] != LS_SHOT_IN)
        stage->lost[plan_step * stage->n_cameras + camera] = 1;
}

uint32_t ls_merge_stage_repaired(const struct ls_merge_stage *stage, uint32_t condition)
{
    return stage->repaired[condition];
}

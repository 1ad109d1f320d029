#include "daemon/merge_private.h"

#include "daemon/passes.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

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
        bool found = ls_merge_choose(stage, &job);
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
        err = ls_merge_camera_init(stage, i, diag);
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
    for (uint32_t i = 0; i < stage->n_cameras; i++)
        ls_merge_camera_finish(&stage->cameras[i]);
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

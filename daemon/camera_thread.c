#include "daemon/camera_thread.h"

#include "daemon/credit.h"
#include "daemon/realtime.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

enum {
    MESSAGES = 4096,
    WAIT_US = 2000,         /* how late a step event may be noticed while no frame comes */
    PAIR_GAP_NS = 50000000, /* LS_CLOCK_PAIRS of these: the baseline of the clock's drift */
};

#define PARTING 20e-6 /* drift left over by the fit: clocks not compared part by this share */

/* What is known of a step beside its event. */
struct told {
    double exposure_us;
    uint64_t pulse_ns;
    uint32_t under_way; /* steps without a verdict then, with this one */
};

struct ls_camera_thread {
    struct ls_camera_thread_config config;
    struct ls_bind *bind;
    struct ls_queue messages;
    _Atomic uint64_t until_us;
    _Atomic bool stopping, suspect, crowded; /* crowded: a message found no room */
    _Atomic uint32_t programs, settled, pending, bound, unusable, window;
    _Atomic int failure;
    struct ls_camera_residuals residuals;
    uint64_t compared_ns; /* controller time of the clock's newest pair */
    struct ls_camera_reasons reasons;
    struct told *told; /* per step */
    pthread_t pthread;
    bool running;
};

static void fail(struct ls_camera_thread *thread, enum ls_err err)
{
    atomic_store(&thread->failure, err);
    atomic_store(&thread->stopping, true);
}

static void discard(struct ls_camera_thread *thread, uint32_t slot)
{
    if (ls_ring_give_back(thread->config.ring, slot))
        fail(thread, LS_ERR_BUG);
    else
        ls_camera_release(thread->config.camera, slot);
}

static void learn(struct ls_camera_thread *thread, const struct ls_bind_verdict *verdict)
{
    struct ls_camera_residuals *r = &thread->residuals;
    uint64_t ns = verdict->event.us * 1000;
    if (ns > thread->compared_ns + PAIR_GAP_NS) {
        /* before and after are the same */
        (void)ls_clock_add(&thread->config.clock, verdict->frame.camera_ns, ns, ns);
        thread->compared_ns = ns;
    }
    r->max_us = fmax(r->max_us, fabs(verdict->residual_us));
    r->sum_squares_us2 += verdict->residual_us * verdict->residual_us;
    r->n++;
}

static void measure_latency(struct ls_camera_thread *thread, const struct told *told,
                            uint64_t arrival_ns)
{
    uint64_t ns = arrival_ns > told->pulse_ns ? arrival_ns - told->pulse_ns : 0;
    atomic_store(&thread->window, ls_credit_window((uint64_t)thread->config.bind.patience_us,
                                                   told->under_way, ns / 1000));
}

static void hand_on(struct ls_camera_thread *thread, const struct ls_bind_verdict *verdict)
{
    const struct told *told = &thread->told[verdict->step];
    const struct ls_bound_frame bound = {.step = verdict->step,
                                         .frame = verdict->frame,
                                         .event = verdict->event,
                                         .exposure_us = told->exposure_us,
                                         .residual_us = verdict->residual_us,
                                         .pulse_ns = told->pulse_ns};
    measure_latency(thread, told, bound.frame.host_ns);
    if (thread->config.bind.by_time)
        learn(thread, verdict);
    if (ls_ring_hand(thread->config.ring, verdict->slot) ||
        !ls_queue_push(thread->config.inlet, &bound)) {
        fail(thread, LS_ERR_BUG);
        return;
    }
    sem_post(thread->config.work);
    atomic_fetch_add(&thread->bound, 1);
    ls_count(&thread->config.metrics->frames_bound, 1);
    ls_metrics_time(thread->config.metrics, LS_LATENCY_FRAME, bound.pulse_ns, bound.frame.host_ns);
}

static void obey(struct ls_camera_thread *thread, const struct ls_bind_verdict *verdict)
{
    if (verdict->outcome == LS_BIND_BOUND) {
        hand_on(thread, verdict);
        return;
    }
    if (verdict->step != LS_BIND_NO_STEP) {
        thread->reasons.steps[verdict->reason]++;
        ls_count(&thread->config.metrics->steps_unbound[verdict->reason], 1);
        atomic_fetch_add(&thread->unusable, 1);
    }
    if (verdict->slot != LS_BIND_NO_SLOT) {
        thread->reasons.frames[verdict->reason]++;
        ls_count(&thread->config.metrics->frames_discarded[verdict->reason], 1);
        discard(thread, verdict->slot);
    }
}

static void obey_all(struct ls_camera_thread *thread)
{
    struct ls_bind_verdict verdict;
    while (ls_bind_next(thread->bind, &verdict))
        obey(thread, &verdict);
    atomic_store(&thread->suspect, ls_bind_suspect(thread->bind));
    atomic_store(&thread->pending, ls_bind_pending(thread->bind));
    atomic_store(&thread->settled, ls_bind_settled(thread->bind));
}

static void arm(struct ls_camera_thread *thread, uint32_t n_steps)
{
    struct ls_bind_verdict verdict;
    if (n_steps > thread->config.max_steps) {
        fail(thread, LS_ERR_BUG);
        return;
    }
    while (ls_bind_flush(thread->bind, &verdict))
        obey(thread, &verdict);
    ls_bind_arm(thread->bind, n_steps);
    atomic_store(&thread->settled, 0);
    atomic_store(&thread->pending, 0);
    atomic_fetch_add(&thread->programs, 1);
    sem_post(thread->config.heard);
}

static void hear(struct ls_camera_thread *thread, const struct ls_camera_message *message)
{
    switch (message->kind) {
    case LS_CAMERA_ARMED:
        arm(thread, message->step);
        break;
    case LS_CAMERA_FIRED:
        if (message->event.step < thread->config.max_steps)
            thread->told[message->event.step] =
                (struct told){message->exposure_us, message->pulse_ns,
                              message->event.step + 1 - ls_bind_settled(thread->bind)};
        if (ls_bind_event(thread->bind, &message->event, message->exposure_us))
            fail(thread, LS_ERR_MISMATCH);
        break;
    case LS_CAMERA_OPENED:
        ls_bind_open(thread->bind, message->step);
        break;
    case LS_CAMERA_EXPIRED:
        ls_bind_expire(thread->bind, message->step);
        break;
    case LS_CAMERA_QUIET:
        ls_bind_quiet(thread->bind);
        break;
    }
}

/* `until` is read before the events it promises, so that all of them are known when it counts. */
static void hear_all(struct ls_camera_thread *thread)
{
    struct ls_camera_message message;
    uint64_t until_us = atomic_load(&thread->until_us);
    while (ls_queue_pop(&thread->messages, &message)) {
        hear(thread, &message);
        obey_all(thread);
    }
    if (atomic_exchange(&thread->crowded, false))
        sem_post(thread->config.heard);
    ls_bind_until(thread->bind, until_us);
}

static void accept_frame(struct ls_camera_thread *thread, const struct ls_camera_frame *frame)
{
    double mapped_us = 0, slack_us = 0;
    if (thread->config.bind.by_time && frame->status == LS_FRAME_OK)
        mapped_us = ls_clock_map(&thread->config.clock, frame->camera_ns) / 1e3;
    if (mapped_us > (double)thread->compared_ns / 1e3)
        slack_us = (mapped_us - (double)thread->compared_ns / 1e3) * PARTING;
    if (ls_ring_take(thread->config.ring, frame->slot) ||
        ls_bind_frame(thread->bind, frame, mapped_us, slack_us))
        fail(thread, LS_ERR_BUG);
}

static void *run(void *data)
{
    struct ls_camera_thread *thread = data;
    struct ls_camera_frame frame;
    ls_realtime_enter(thread->config.rt_priority);
    while (!atomic_load(&thread->stopping)) {
        enum ls_err err = ls_camera_next(thread->config.camera, WAIT_US, &frame);
        if (err == LS_OK && !thread->config.bind.by_time)
            hear_all(thread); /* its step was opened before it came */
        if (err == LS_OK)
            accept_frame(thread, &frame);
        else if (err != LS_ERR_TIMEOUT && !atomic_load(&thread->stopping))
            fail(thread, err);
        hear_all(thread);
        obey_all(thread);
    }
    return NULL;
}

enum ls_err ls_camera_thread_create(const struct ls_camera_thread_config *config,
                                    struct ls_camera_thread **out, struct ls_diag *diag)
{
    struct ls_camera_thread *thread = calloc(1, sizeof *thread);
    if (!thread)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    thread->config = *config;
    uint32_t n_slots = ls_ring_slots(config->ring).n;
    enum ls_err err = ls_bind_create(&config->bind, config->max_steps, n_slots, &thread->bind);
    if (!err)
        err = ls_queue_init(&thread->messages, sizeof(struct ls_camera_message), MESSAGES);
    thread->told = calloc(config->max_steps ? config->max_steps : 1, sizeof *thread->told);
    if (err || !thread->told) {
        ls_camera_thread_destroy(thread);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    }
    ls_bind_anchor(thread->bind, &config->anchor);
    thread->compared_ns = config->clock.ref0;
    atomic_store(&thread->window, config->window);
    *out = thread;
    return LS_OK;
}

enum ls_err ls_camera_thread_start(struct ls_camera_thread *thread, struct ls_diag *diag)
{
    if (pthread_create(&thread->pthread, NULL, run, thread))
        return ls_fail(diag, LS_ERR_OS, "camera %u: cannot start its thread", thread->config.index);
    char name[16];
    snprintf(name, sizeof name, "ls-cam-%u", thread->config.index % 100);
    pthread_setname_np(thread->pthread, name);
    thread->running = true;
    return LS_OK;
}

bool ls_camera_thread_tell(struct ls_camera_thread *thread, const struct ls_camera_message *message)
{
    bool told = ls_queue_push(&thread->messages, message);
    if (!told)
        atomic_store(&thread->crowded, true);
    return told;
}

void ls_camera_thread_until(struct ls_camera_thread *thread, uint64_t us)
{
    atomic_store(&thread->until_us, us);
}

void ls_camera_thread_counts(const struct ls_camera_thread *thread, struct ls_camera_counts *out)
{
    uint32_t settled = atomic_load(&thread->settled); /* first: what it tells is in the others */
    *out = (struct ls_camera_counts){.programs = atomic_load(&thread->programs),
                                     .settled = settled,
                                     .pending = atomic_load(&thread->pending),
                                     .window = atomic_load(&thread->window),
                                     .suspect = atomic_load(&thread->suspect),
                                     .bound = atomic_load(&thread->bound),
                                     .unusable = atomic_load(&thread->unusable),
                                     .failure = (enum ls_err)atomic_load(&thread->failure)};
}

enum ls_bind_outcome ls_camera_thread_outcome(const struct ls_camera_thread *thread, uint32_t step)
{
    return ls_bind_outcome(thread->bind, step);
}

struct ls_camera_reasons ls_camera_thread_reasons(const struct ls_camera_thread *thread)
{
    return thread->reasons;
}

void ls_camera_thread_stop(struct ls_camera_thread *thread)
{
    if (!thread->running)
        return;
    atomic_store(&thread->stopping, true);
    ls_camera_wake(thread->config.camera);
    pthread_join(thread->pthread, NULL);
    thread->running = false;
}

struct ls_camera_residuals ls_camera_thread_residuals(const struct ls_camera_thread *thread)
{
    return thread->residuals;
}

struct ls_clock ls_camera_thread_clock(const struct ls_camera_thread *thread)
{
    return thread->config.clock;
}

void ls_camera_thread_destroy(struct ls_camera_thread *thread)
{
    if (!thread)
        return;
    ls_camera_thread_stop(thread);
    ls_queue_finish(&thread->messages);
    ls_bind_destroy(thread->bind);
    free(thread->told);
    free(thread);
}

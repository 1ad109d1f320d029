#include "sim/showing.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>

enum { HISTORY = 1024 };

struct span {
    uint64_t start_ns, end_ns;
    uint32_t condition, step;
};

struct sim_showing {
    pthread_mutex_t lock;
    struct span spans[HISTORY];
    uint64_t n_spans;
    struct sim_shown *shown;
    uint32_t n_shown;
    struct span work; /* the last time that the work light was on; condition: as it is shown */
    double work_duty;
};

enum ls_err sim_showing_create(struct sim_showing **out, struct ls_diag *diag)
{
    *out = calloc(1, sizeof **out);
    if (!*out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    pthread_mutex_init(&(*out)->lock, NULL);
    return LS_OK;
}

void sim_showing_destroy(struct sim_showing *showing)
{
    if (!showing)
        return;
    pthread_mutex_destroy(&showing->lock);
    free(showing->shown);
    free(showing);
}

static enum ls_err describe(const struct sim_condition *c, struct sim_shown *out)
{
    LS_CLEANUP_FREE uint16_t *regs = calloc(3 * (size_t)c->n_leds + 1, sizeof *regs);
    if (!regs)
        return LS_ERR_NOMEM;
    for (uint32_t k = 0; k < c->n_leds; k++) {
        regs[3 * k] = c->leds[k].light;
        regs[3 * k + 1] = c->leds[k].channel;
        regs[3 * k + 2] = (uint16_t)lrintf(c->leds[k].duty * 65535);
    }
    *out = (struct sim_shown){.kind = c->kind, .n_leds = c->n_leds};
    if (c->n_leds)
        out->first = c->leds[0];
    out->hash = ls_wire_crc32c(regs, 3 * (size_t)c->n_leds);
    return LS_OK;
}

enum ls_err sim_showing_commit(struct sim_showing *showing, const struct sim_condition *conditions,
                               uint32_t n, struct ls_diag *diag)
{
    struct sim_shown *shown = calloc(n, sizeof *shown);
    enum ls_err err = shown ? LS_OK : LS_ERR_NOMEM;
    for (uint32_t i = 0; !err && i < n; i++)
        err = describe(&conditions[i], &shown[i]);
    if (err) {
        free(shown);
        return ls_fail(diag, err, "out of memory");
    }
    pthread_mutex_lock(&showing->lock);
    free(showing->shown);
    showing->shown = shown;
    showing->n_shown = n;
    pthread_mutex_unlock(&showing->lock);
    return LS_OK;
}

void sim_showing_begin(struct sim_showing *showing, const struct sim_pulse *pulse)
{
    uint64_t end = pulse->true_ns + (uint64_t)(pulse->pulse_us * 1e3);
    pthread_mutex_lock(&showing->lock);
    showing->spans[showing->n_spans++ % HISTORY] = (struct span){
        pulse->true_ns, pulse->hold ? UINT64_MAX : end, pulse->condition, pulse->step};
    pthread_mutex_unlock(&showing->lock);
}

void sim_showing_end(struct sim_showing *showing, uint64_t true_ns)
{
    pthread_mutex_lock(&showing->lock);
    if (showing->n_spans) {
        struct span *last = &showing->spans[(showing->n_spans - 1) % HISTORY];
        if (last->end_ns > true_ns)
            last->end_ns = true_ns > last->start_ns ? true_ns : last->start_ns;
    }
    pthread_mutex_unlock(&showing->lock);
}

void sim_showing_work(struct sim_showing *showing, uint64_t true_ns, uint32_t channel, double duty)
{
    pthread_mutex_lock(&showing->lock);
    if (duty > 0) {
        showing->work =
            (struct span){true_ns, UINT64_MAX, SIM_CONDITION_WORK + channel, UINT32_MAX};
        showing->work_duty = duty;
    } else if (showing->work.end_ns > true_ns) {
        showing->work.end_ns = true_ns;
    }
    pthread_mutex_unlock(&showing->lock);
}

static uint64_t overlap(const struct span *span, uint64_t start_ns, uint64_t end_ns)
{
    uint64_t from = span->start_ns > start_ns ? span->start_ns : start_ns;
    uint64_t to = span->end_ns < end_ns ? span->end_ns : end_ns;
    return to > from ? to - from : 0;
}

void sim_showing_in(struct sim_showing *showing, uint64_t start_ns, uint64_t end_ns,
                    uint32_t *condition, uint32_t *step, double *lit_us)
{
    uint64_t longest = 0;
    double share = 1;
    *condition = *step = UINT32_MAX;
    pthread_mutex_lock(&showing->lock);
    uint64_t n = showing->n_spans < HISTORY ? showing->n_spans : HISTORY;
    for (uint64_t i = 0; i < n; i++) {
        uint64_t lit = overlap(&showing->spans[i], start_ns, end_ns);
        if (lit <= longest)
            continue;
        longest = lit;
        *condition = showing->spans[i].condition;
        *step = showing->spans[i].step;
    }
    uint64_t worked = overlap(&showing->work, start_ns, end_ns);
    if (longest == 0 && worked > 0) {
        longest = worked;
        share = showing->work_duty;
        *condition = showing->work.condition;
    }
    pthread_mutex_unlock(&showing->lock);
    *lit_us = (double)longest * share / 1e3;
}

struct sim_shown sim_showing_describe(struct sim_showing *showing, uint32_t index)
{
    struct sim_shown dark = {.kind = LS_WIRE_CONDITION_DARK};
    pthread_mutex_lock(&showing->lock);
    struct sim_shown shown = index < showing->n_shown ? showing->shown[index] : dark;
    pthread_mutex_unlock(&showing->lock);
    return shown;
}

#include "daemon/accumulator.h"

#include <stdlib.h>
#include <string.h>

size_t ls_accumulator_bytes(size_t payload_bytes, size_t n_px, uint32_t n_exposures)
{
    return payload_bytes * n_exposures + n_px * (sizeof(uint8_t) + sizeof(uint16_t));
}

/* Written once, so that no page fault falls into the take. */
static void *touched(size_t bytes)
{
    void *memory = malloc(bytes);
    if (memory)
        memset(memory, 0, bytes);
    return memory;
}

static enum ls_err fill_in(struct ls_accumulator *a, uint32_t n_exposures, size_t payload_bytes,
                           size_t n_px)
{
    for (uint32_t i = 0; i < n_exposures; i++) {
        a->raw[i] = touched(payload_bytes);
        if (!a->raw[i])
            return LS_ERR_NOMEM;
    }
    a->validity = touched(n_px);
    a->half = touched(n_px * sizeof *a->half);
    return a->validity && a->half ? LS_OK : LS_ERR_NOMEM;
}

enum ls_err ls_accumulators_init(struct ls_accumulators *pool, uint32_t n, uint32_t n_exposures,
                                 size_t payload_bytes, size_t n_px)
{
    *pool = (struct ls_accumulators){.n_exposures = n_exposures};
    pool->items = calloc(n, sizeof *pool->items);
    if (!pool->items)
        return LS_ERR_NOMEM;
    pool->n = n;
    for (uint32_t i = 0; i < n; i++)
        if (fill_in(&pool->items[i], n_exposures, payload_bytes, n_px)) {
            ls_accumulators_finish(pool);
            return LS_ERR_NOMEM;
        }
    return LS_OK;
}

void ls_accumulators_finish(struct ls_accumulators *pool)
{
    for (uint32_t i = 0; i < pool->n; i++) {
        struct ls_accumulator *a = &pool->items[i];
        for (uint32_t k = 0; k < LS_MAX_EXPOSURES; k++)
            free(a->raw[k]);
        free(a->validity);
        free(a->half);
    }
    free(pool->items);
    *pool = (struct ls_accumulators){0};
}

struct ls_accumulator *ls_accumulators_find(struct ls_accumulators *pool, uint32_t condition)
{
    for (uint32_t i = 0; i < pool->n; i++)
        if (pool->items[i].state == LS_ACCUMULATOR_FILLING && pool->items[i].condition == condition)
            return &pool->items[i];
    return NULL;
}

static struct ls_accumulator *oldest(struct ls_accumulators *pool)
{
    struct ls_accumulator *found = NULL;
    for (uint32_t i = 0; i < pool->n; i++) {
        struct ls_accumulator *a = &pool->items[i];
        if (a->state == LS_ACCUMULATOR_FREE)
            return a;
        if (a->state == LS_ACCUMULATOR_FILLING && a->copying == 0 &&
            (!found || a->used < found->used))
            found = a;
    }
    return found;
}

struct ls_accumulator *ls_accumulators_claim(struct ls_accumulators *pool, uint32_t condition,
                                             int64_t *given_up)
{
    *given_up = -1;
    struct ls_accumulator *a = ls_accumulators_find(pool, condition);
    if (!a) {
        a = oldest(pool);
        if (!a)
            return NULL;
        if (a->state == LS_ACCUMULATOR_FILLING)
            *given_up = a->condition;
        ls_accumulator_free(a);
        a->state = LS_ACCUMULATOR_FILLING;
        a->condition = condition;
    }
    a->used = ++pool->clock;
    return a;
}

struct ls_accumulator *ls_accumulators_waiting(const struct ls_accumulators *pool)
{
    struct ls_accumulator *first = NULL;
    for (uint32_t k = 0; k < pool->n; k++) {
        struct ls_accumulator *a = &pool->items[k];
        if (a->state == LS_ACCUMULATOR_MERGING && a->bands_taken < a->n_bands &&
            (!first || a->arrived_ns < first->arrived_ns))
            first = a;
    }
    return first;
}

void ls_accumulator_free(struct ls_accumulator *accumulator)
{
    accumulator->state = LS_ACCUMULATOR_FREE;
    accumulator->claimed = accumulator->copying = accumulator->filled = 0;
    accumulator->pulse_ns = accumulator->arrived_ns = 0;
    accumulator->n_bands = accumulator->bands_taken = accumulator->bands_done = 0;
}

#include "core/left_out.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum ls_err ls_left_out_init(struct ls_left_out *left, const float *weights, uint32_t n_pictures,
                             uint32_t n_sums)
{
    *left = (struct ls_left_out){
        .n_pictures = n_pictures,
        .n_sums = n_sums,
        .weights = weights,
        .reach = calloc(n_pictures + 1u, sizeof *left->reach),
        .skip = calloc(n_pictures + 1u, sizeof *left->skip),
        .order = calloc(n_pictures + 1u, sizeof *left->order),
        .total = calloc(n_sums + 1u, sizeof *left->total),
    };
    if (left->reach && left->skip && left->order && left->total)
        return LS_OK;
    ls_left_out_finish(left);
    return LS_ERR_NOMEM;
}

static double bound_of(const struct ls_left_out *left, uint32_t q, uint32_t picture)
{
    float w = left->weights[(size_t)q * left->n_pictures + picture];
    return fabs((double)w) * left->reach[picture];
}

static int by_bound(const void *a, const void *b)
{
    const struct ls_left_out_place *x = a, *y = b;
    if (x->most != y->most)
        return x->most < y->most ? -1 : 1;
    return x->picture < y->picture ? -1 : x->picture > y->picture;
}

static bool try(struct ls_left_out *left, uint32_t picture, double max_error)
{
    for (uint32_t q = 0; q < left->n_sums; q++)
        if (!(left->total[q] + bound_of(left, q, picture) <= max_error))
            return false;
    for (uint32_t q = 0; q < left->n_sums; q++) {
        left->total[q] += bound_of(left, q, picture);
        left->bound = fmax(left->bound, left->total[q]);
    }
    return true;
}

void ls_left_out_choose(struct ls_left_out *left, double max_error)
{
    memset(left->total, 0, sizeof *left->total * left->n_sums);
    for (uint32_t i = 0; i < left->n_pictures; i++) {
        left->order[i] = (struct ls_left_out_place){0, i};
        for (uint32_t q = 0; q < left->n_sums; q++)
            left->order[i].most = fmax(left->order[i].most, bound_of(left, q, i));
    }
    qsort(left->order, left->n_pictures, sizeof *left->order, by_bound);
    for (uint32_t i = 0; i < left->n_pictures; i++) {
        uint32_t picture = left->order[i].picture;
        left->skip[picture] = try(left, picture, max_error);
    }
}

void ls_left_out_finish(struct ls_left_out *left)
{
    free(left->reach);
    free(left->skip);
    free(left->order);
    free(left->total);
    *left = (struct ls_left_out){0};
}

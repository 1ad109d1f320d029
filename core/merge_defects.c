#include "core/merge_defects.h"

#include <math.h>

size_t ls_merge_first_defect(const struct ls_merge_params *p, size_t pixel)
{
    size_t low = 0, high = p->n_defects;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (p->defects[middle] < pixel)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static int is_defect(const struct ls_merge_params *p, size_t pixel)
{
    size_t k = ls_merge_first_defect(p, pixel);
    return k < p->n_defects && p->defects[k] == pixel;
}

/* The good same-colour neighbours `ring` periods left, right, above and below, as bits 0..3. */
static unsigned good_neighbours(const struct ls_merge_params *p, size_t pixel, unsigned ring,
                                size_t at[4])
{
    size_t d = (size_t)ring * ls_cfa_period_px(p->format->cfa);
    size_t x = pixel % p->width, y = pixel / p->width;
    int inside[4] = {x >= d, x + d < p->width, y >= d, y + d < p->height};
    unsigned good = 0;

    at[0] = pixel - d;
    at[1] = pixel + d;
    at[2] = pixel - d * p->width;
    at[3] = pixel + d * p->width;
    for (unsigned k = 0; k < 4; k++)
        if (inside[k] && !is_defect(p, at[k]))
            good |= 1u << k;
    return good;
}

static uint8_t worse(uint8_t a, uint8_t b)
{
    static const uint8_t rank[] = {
        [LS_VALIDITY_OK] = 0,
        [LS_VALIDITY_DARK] = 1,
        [LS_VALIDITY_GAP] = 2,
        [LS_VALIDITY_SATURATED] = 3,
    };
    return rank[a] >= rank[b] ? a : b;
}

/* Of two whole pairs keep the one along the weaker gradient. */
static unsigned pick_pair(unsigned good, const float e[4])
{
    if (good != 0xf)
        return good;
    return fabsf(e[0] - e[1]) <= fabsf(e[2] - e[3]) ? 0x3 : 0xc;
}

static void replace(const struct ls_merge_work *w, size_t pixel, const struct ls_merge_group *g,
                    unsigned good)
{
    const struct ls_merge_spans *s = w->spans;
    float e = 0, variance = 0;
    uint8_t validity = LS_VALIDITY_OK;
    int n = 0;

    good = pick_pair(good, g->e);
    for (unsigned k = 0; k < 4; k++) {
        if (!(good >> k & 1))
            continue;
        e += g->e[k];
        variance += g->variance[k];
        validity = worse(validity, g->validity[k]);
        n++;
    }
    e /= (float)n;
    s->validity[pixel] = validity;
    if (s->e)
        s->e[pixel] = e;
    if (s->half)
        ls_merge_store_half(&e, 1, w->params->reference_exposure_s, s->half + pixel,
                            s->validity + pixel);
    if (s->variance)
        s->variance[pixel] = variance / (float)(n * n);
}

/* Neighbours are merged afresh, so that a band needs no other band's output. */
void ls_merge_correct(const struct ls_merge_work *work, size_t pixel)
{
    for (unsigned ring = 1; ring <= LS_MERGE_DEFECT_RINGS; ring++) {
        struct ls_merge_group g = {0};
        size_t at[4];
        unsigned good = good_neighbours(work->params, pixel, ring, at);
        if (!good)
            continue;
        for (unsigned k = 0; k < 4; k++)
            if (good >> k & 1)
                ls_merge_group_load(work, &g, at[k], 1, k);
        ls_merge_group_run(work, &g);
        replace(work, pixel, &g, good);
        return;
    }
}

/*
 * merge_lanes: the text of the merge kernels; each instruction set includes it once and names its
 * instance. See merge.h for the steps, merge_kernels.h for the contract.
 * Layer: core, inside the merge only. Threads: any. Ownership: none.
 */
#ifndef LS_CORE_MERGE_LANES_H
#define LS_CORE_MERGE_LANES_H

#include "core/lanes.h"
#include "core/merge_kernels.h"

/* Clang spends 95 s a file on the checks of a sanitizer in kernels unrolled like these; the checks
 * stay, the optimiser does not. */
#if defined(__clang__)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#pragma clang optimize off
#endif
#endif

enum { EXPOSURES = LS_MERGE_MAX_EXPOSURES, BLOCK = 64 };

/* The model in every lane. */
struct model_lanes {
    floats t[EXPOSURES], floor_t[EXPOSURES];
    floats low, high, clip, shot, scale, reference_s;
};

LANES_INLINE struct model_lanes model_lanes(const struct ls_merge_model *m, uint32_t n)
{
    struct model_lanes c = {.low = lanes_all(m->low),
                            .high = lanes_all(m->high),
                            .clip = lanes_all(m->clip),
                            .shot = lanes_all(m->shot),
                            .scale = lanes_all(m->scale),
                            .reference_s = lanes_all(m->reference_s)};
    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        c.t[i] = lanes_all(m->t[i]);
        c.floor_t[i] = lanes_all(m->floor_t[i]);
    }
    return c;
}

/* The weights at an estimate E = sum / norm up to a common factor, which the mean does not see, and
 * without forming E: floor_t norm + shot max(sum, 0) is norm sigma^2 / t. Returns that factor over
 * norm. Products save a division per exposure. */
LANES_INLINE floats weigh(const struct model_lanes *c, floats sum, floats norm, uint32_t n,
                          bool products, floats w[EXPOSURES])
{
    floats shot = c->shot * lanes_positive(sum), v[EXPOSURES];

    LANES_UNROLL for (uint32_t i = 0; i < n; i++) v[i] = c->floor_t[i] * norm + shot;
    if (!products) {
        LANES_UNROLL for (uint32_t i = 0; i < n; i++) w[i] = 1 / v[i];
        return lanes_all(1);
    }
    if (n == 3) {
        w[0] = v[1] * v[2];
        w[1] = v[0] * v[2];
        w[2] = v[0] * v[1];
        return v[0] * w[0];
    }
    w[0] = n == 2 ? v[1] : lanes_all(1);
    w[1] = v[0];
    return n == 2 ? v[0] * v[1] : v[0];
}

/* A block of pixels between the two looks at it. */
struct pooled {
    floats e[BLOCK / LANES];
    floats y[EXPOSURES][BLOCK / LANES];    /* samples minus darks */
    floats dark[EXPOSURES][BLOCK / LANES]; /* NaN where the sample is clipped */
};

/* Steps 1 and 2 for group k of a block. Without a sample that is not clipped e is 0 / 0. */
LANES_INLINE void pool(const struct model_lanes *c, const struct ls_merge_lines *l, size_t p,
                       uint32_t n, bool wide, bool products, struct pooled *b, size_t k)
{
    floats y[EXPOSURES], t[EXPOSURES], w[EXPOSURES], sum = {0}, norm = {0};

    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        floats x = wide ? lanes_load_u16((const uint8_t *)l->x[i] + 2 * p)
                        : lanes_load_u8((const uint8_t *)l->x[i] + p);
        floats dark = lanes_load(l->dark[i] + p);
        ints clipped = x >= c->clip;
        b->y[i][k] = x - dark;
        b->dark[i][k] = (floats)((ints)dark | clipped);
        y[i] = lanes_drop(clipped, b->y[i][k]);
        t[i] = lanes_drop(clipped, c->t[i]);
        sum = i ? sum + y[i] : y[i];
        norm = i ? norm + t[i] : t[i];
    }
    weigh(c, sum, norm, n, products, w);
    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        sum = i ? sum + w[i] * y[i] : w[i] * y[i];
        norm = i ? norm + w[i] * t[i] : w[i] * t[i];
    }
    b->e[k] = sum / norm;
}

/* What merging a group of lanes gives. */
struct merged {
    floats sum, norm, variance; /* e = sum / norm; before their scales */
    ints validity;
    bool plain; /* validity is LS_VALIDITY_OK in every lane */
};

/* What is left where no exposure is in range: the longest that is not high, or the shortest. */
LANES_INLINE void fall_back(const struct ls_merge_model *m, const struct model_lanes *c,
                            const struct pooled *b, size_t k, const floats expected[EXPOSURES],
                            uint32_t n, bool variance, struct merged *out)
{
    floats y_back = b->y[0][k], t_back = c->t[0];
    ints in = out->norm > 0, any_high = {0}, any_low = {0};

    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        ints not_high = expected[i] <= c->high;
        any_high |= ~not_high;
        any_low |= not_high;
        y_back = lanes_select(not_high, b->y[i][k], y_back);
        t_back = lanes_select(not_high, c->t[i], t_back);
    }
    out->validity = ~in & ((any_high & 1) | (any_low & 2));
    if (variance) {
        floats back = (m->noise + c->shot * lanes_positive(y_back)) / t_back / t_back;
        out->variance = lanes_select(in, out->variance, back);
    }
    out->sum = lanes_select(in, out->sum, y_back);
    out->norm = lanes_select(in, out->norm, t_back);
}

/* Steps 3 and 4. */
LANES_INLINE struct merged choose(const struct ls_merge_model *m, const struct model_lanes *c,
                                  const struct pooled *b, size_t k, uint32_t n, bool products,
                                  bool variance)
{
    floats w[EXPOSURES], expected[EXPOSURES], sum = {0}, norm = {0};
    struct merged out = {0};

    floats factor = weigh(c, b->e[k], lanes_all(1), n, products, w);
    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        expected[i] = b->dark[i][k] + b->e[k] * c->t[i];
        ints in = (expected[i] <= c->high) & (expected[i] >= c->low);
        floats weight = lanes_keep(in, w[i]);
        sum = i ? sum + weight * b->y[i][k] : weight * b->y[i][k];
        norm = i ? norm + weight * c->t[i] : weight * c->t[i];
    }
    out.sum = sum;
    out.norm = norm;
    if (variance)
        out.variance = factor / norm;
    out.plain = lanes_are_all_set(norm > 0);
    if (!out.plain)
        fall_back(m, c, b, k, expected, n, variance, &out);
    return out;
}

/* What is beyond half's range becomes its edge, what is no number 0, and both saturated. */
LANES_INLINE floats limit(floats stored, struct merged *out)
{
    ints fits = lanes_magnitude(stored) <= LS_HALF_MAX;
    floats edge = lanes_select(stored > 0, lanes_all(LS_HALF_MAX), lanes_all(-LS_HALF_MAX));

    out->validity = (out->validity & fits) | (LS_VALIDITY_SATURATED & ~fits);
    out->plain = false;
    return lanes_select(fits, stored, lanes_keep(stored == stored, edge));
}

/* Returns which lanes the halves can hold as they are; all, if @limited. */
LANES_INLINE ints put(const struct ls_merge_model *m, const struct model_lanes *c,
                      const struct ls_merge_lines *l, size_t p, struct merged out, bool limited)
{
    floats e = c->scale * (out.sum / out.norm), stored = e * c->reference_s;

    if (l->e)
        lanes_store(l->e + p, e);
    if (l->variance)
        lanes_store(l->variance + p, m->scale2 * out.variance);
    if (limited)
        stored = limit(stored, &out);
    if (l->half)
        lanes_store_half(l->half + p, lanes_to_half(stored));
    if (!out.plain)
        lanes_store_u8(l->validity + p, out.validity);
    return lanes_magnitude(stored) <= LS_HALF_MAX;
}

/* The pooled estimates of a block before the choices: both wait for a division, and many pixels can
 * wait at once. Halves out of range are rare: one look at the whole block finds them, then it is
 * done again. n, wide and products are constants in every instance. */
LANES_INLINE void merge_run(const struct ls_merge_model *m, const struct ls_merge_lines *lines,
                            size_t count, uint32_t n, bool wide, bool products)
{
    const struct model_lanes c = model_lanes(m, n);
    const struct ls_merge_lines l = *lines; /* a copy, which no output can be part of */
    struct pooled b;

    for (size_t first = 0; first < count; first += BLOCK) {
        size_t end = count - first < BLOCK ? count : first + BLOCK;
        bool limited = false, done;
        for (size_t p = first, k = 0; p < end; p += LANES, k++)
            pool(&c, &l, p, n, wide, products, &b, k);
        do {
            ints fits = ~(ints){0};
            memset(l.validity + first, LS_VALIDITY_OK, end - first);
            for (size_t p = first, k = 0; p < end; p += LANES, k++) {
                struct merged out = choose(m, &c, &b, k, n, products, l.variance);
                fits &= put(m, &c, &l, p, out, limited);
            }
            done = !l.half || lanes_are_all_set(fits);
            limited = true;
        } while (!done);
    }
}

#define MERGE_CASE(n, products)                         \
    case n:                                             \
        if (m->wide)                                    \
            merge_run(m, l, count, n, true, products);  \
        else                                            \
            merge_run(m, l, count, n, false, products); \
        return;

LANES_INLINE void merge_any(const struct ls_merge_model *m, const struct ls_merge_lines *l,
                            size_t count)
{
    if (m->products)
        switch (m->n) {
            MERGE_CASE(1, true)
            MERGE_CASE(2, true)
            MERGE_CASE(3, true)
        }
    switch (m->n) {
        MERGE_CASE(1, false)
        MERGE_CASE(2, false)
        MERGE_CASE(3, false)
        MERGE_CASE(4, false)
        MERGE_CASE(5, false)
        MERGE_CASE(6, false)
        MERGE_CASE(7, false)
        MERGE_CASE(8, false)
    }
}

#endif

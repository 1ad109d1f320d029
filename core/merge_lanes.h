/*
 * merge_lanes: the text of the merge kernels; each instruction set includes it once and names its
 * instance. See merge.h for the steps, merge_kernels.h for the contract.
 * Layer: core, inside the merge only. Threads: any. Ownership: none.
 */
#ifndef LS_CORE_MERGE_LANES_H
#define LS_CORE_MERGE_LANES_H

#include "core/lanes.h"
#include "core/merge_kernels.h"

enum { EXPOSURES = LS_MERGE_MAX_EXPOSURES };

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

/* What merging a group of lanes gives. */
struct merged {
    floats e, variance; /* full scale / s; before its scale */
    floats stored;      /* e @reference exposure */
    bool plain;         /* every lane is in range, and within half's */
    ints validity;      /* unless plain */
};

/* Samples minus darks of a group of lanes, and which of them are not clipped. */
struct samples {
    floats y[EXPOSURES], dark[EXPOSURES];
    ints live[EXPOSURES];
};

LANES_INLINE void load(const struct model_lanes *c, const struct ls_merge_lines *l, size_t p,
                       uint32_t n, bool wide, struct samples *s)
{
    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        floats x = wide ? lanes_load_u16((const uint8_t *)l->x[i] + 2 * p)
                        : lanes_load_u8((const uint8_t *)l->x[i] + p);
        s->dark[i] = lanes_load(l->dark[i] + p);
        s->live[i] = x < c->clip;
        s->y[i] = x - s->dark[i];
    }
}

/* Steps 1 and 2. Without a live sample the result is 0 / 0, and used for nothing. */
LANES_INLINE floats pool(const struct model_lanes *c, const struct samples *s, uint32_t n,
                         bool products)
{
    floats w[EXPOSURES], sum = {0}, norm = {0};

    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        floats y = lanes_keep(s->live[i], s->y[i]), t = lanes_keep(s->live[i], c->t[i]);
        sum = i ? sum + y : y;
        norm = i ? norm + t : t;
    }
    weigh(c, sum, norm, n, products, w);
    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        floats weight = lanes_keep(s->live[i], w[i]);
        sum = i ? sum + weight * s->y[i] : weight * s->y[i];
        norm = i ? norm + weight * c->t[i] : weight * c->t[i];
    }
    return sum / norm;
}

/* What is left where no exposure is in range: the longest that is not high, or the shortest. */
LANES_INLINE void fall_back(const struct ls_merge_model *m, const struct model_lanes *c,
                            const struct samples *s, const floats expected[EXPOSURES], uint32_t n,
                            bool variance, floats *sum, floats *norm, struct merged *out)
{
    floats y_back = s->y[0], t_back = c->t[0];
    ints in = *norm > 0, any_high = {0}, any_low = {0};

    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        ints high = ~s->live[i] | (expected[i] > c->high);
        any_high |= high;
        any_low |= ~high;
        y_back = lanes_select(high, y_back, s->y[i]);
        t_back = lanes_select(high, t_back, c->t[i]);
    }
    out->validity = ~in & ((any_high & 1) | (any_low & 2));
    if (variance) {
        floats back = (m->noise + c->shot * lanes_positive(y_back)) / t_back / t_back;
        out->variance = lanes_select(in, out->variance, back);
    }
    *sum = lanes_select(in, *sum, y_back);
    *norm = lanes_select(in, *norm, t_back);
}

LANES_INLINE void divide(const struct model_lanes *c, floats sum, floats norm, struct merged *out)
{
    out->e = c->scale * (sum / norm);
    out->stored = out->e * c->reference_s;
}

/* Steps 3 and 4. Where nothing is in range, sum / norm is 0 / 0: one look at what is to be stored
 * finds that, and what is beyond half's range, together. */
LANES_INLINE struct merged choose(const struct ls_merge_model *m, const struct model_lanes *c,
                                  const struct samples *s, floats e, uint32_t n, bool products,
                                  bool variance)
{
    floats w[EXPOSURES], expected[EXPOSURES], sum = {0}, norm = {0};
    struct merged out = {0};

    floats factor = weigh(c, e, lanes_all(1), n, products, w);
    LANES_UNROLL for (uint32_t i = 0; i < n; i++)
    {
        expected[i] = s->dark[i] + e * c->t[i];
        ints in = s->live[i] & (expected[i] <= c->high) & (expected[i] >= c->low);
        floats weight = lanes_keep(in, w[i]);
        sum = i ? sum + weight * s->y[i] : weight * s->y[i];
        norm = i ? norm + weight * c->t[i] : weight * c->t[i];
    }
    if (variance)
        out.variance = factor / norm;
    divide(c, sum, norm, &out);
    out.plain = lanes_are_all_set(lanes_magnitude(out.stored) <= LS_HALF_MAX);
    if (out.plain)
        return out;
    fall_back(m, c, s, expected, n, variance, &sum, &norm, &out);
    divide(c, sum, norm, &out);
    return out;
}

/* What is beyond half's range becomes its edge, and saturated. */
LANES_INLINE void limit(struct merged *out)
{
    floats v = out->stored;
    ints fits = lanes_magnitude(v) <= LS_HALF_MAX;
    floats edge = lanes_select(v > 0, lanes_all(LS_HALF_MAX), lanes_all(-LS_HALF_MAX));

    out->stored = lanes_select(fits, v, lanes_keep(v == v, edge));
    out->validity = (out->validity & fits) | (LS_VALIDITY_SATURATED & ~fits);
}

LANES_INLINE void put(const struct ls_merge_model *m, const struct ls_merge_lines *l, size_t p,
                      struct merged out)
{
    if (l->e)
        lanes_store(l->e + p, out.e);
    if (l->variance)
        lanes_store(l->variance + p, m->scale2 * out.variance);
    if (l->half && !out.plain)
        limit(&out);
    if (l->half)
        lanes_store_half(l->half + p, lanes_to_half(out.stored));
    if (out.plain)
        memset(l->validity + p, LS_VALIDITY_OK, LANES);
    else
        lanes_store_u8(l->validity + p, out.validity);
}

/* The pooled estimates of a block before the choices: both wait for a division, and many pixels can
 * wait at once. n, wide and products are constants in every instance. */
LANES_INLINE void merge_run(const struct ls_merge_model *m, const struct ls_merge_lines *lines,
                            size_t count, uint32_t n, bool wide, bool products)
{
    enum { BLOCK = 256 };
    const struct model_lanes c = model_lanes(m, n);
    const struct ls_merge_lines l = *lines; /* a copy, which no output can be part of */

    for (size_t first = 0; first < count; first += BLOCK) {
        size_t end = count - first < BLOCK ? count : first + BLOCK;
        floats e[BLOCK / LANES];
        struct samples s;
        for (size_t p = first, k = 0; p < end; p += LANES, k++) {
            load(&c, &l, p, n, wide, &s);
            e[k] = pool(&c, &s, n, products);
        }
        for (size_t p = first, k = 0; p < end; p += LANES, k++) {
            load(&c, &l, p, n, wide, &s);
            put(m, &l, p, choose(m, &c, &s, e[k], n, products, l.variance));
        }
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

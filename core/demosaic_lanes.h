/*
 * demosaic_lanes: the text of the demosaic kernels; each instruction set includes it once and names
 * its instance. See demosaic_kernels.h for the contract.
 * Layer: core, inside the demosaic only. Threads: any. Ownership: none.
 *
 * The gradient-corrected filters. Let C be the known sample, N S W E its neighbours, NN .. EE the
 * next of the same colour, X the sum of the four diagonal ones. Each missing colour is its bilinear
 * value plus a gain times a second derivative of the known colour, which is 0 on any ramp:
 *
 *   green at red or blue:    (N+S+W+E)/4 + a L4,  L4 = C - (NN+SS+WW+EE)/4
 *   blue at red, red at blue:  X/4       + c L4
 *   red or blue at green, its own row: (W+E)/2 + b L9, L9 = C - (X+WW+EE)/5 + (NN+SS)/10
 *                         its own column: the same turned by a quarter.
 *
 * L9 weighs the greens of the cell so that 1 - 6/5 + 2/10 = 0. The gains minimise the mean square
 * error over natural pictures, rounded to eighths by the paper: a = 1/2, b = 5/8, c = 3/4. In
 * eighths:
 *
 *   green at red:  4 C + 2 (N+S+W+E) -     (NN+SS+WW+EE)
 *   blue at red:   6 C + 2 X         - 3/2 (NN+SS+WW+EE)
 *   red at green:  5 C + 4 (W+E) - X - (WW+EE) + 1/2 (NN+SS)
 *
 * Each row sums to 8, so a constant is kept. Every pixel is treated as a green one and as a
 * coloured one, and the half of it that was wrong is dropped: the five sums are shared, and that
 * costs less than sorting the samples of a row by colour and weaving the results together again.
 */
#ifndef LS_CORE_DEMOSAIC_LANES_H
#define LS_CORE_DEMOSAIC_LANES_H

#include "core/demosaic_kernels.h"
#include "core/lanes.h"
#include "core/promote_tile_lanes.h"

/* The row's own colour (red or blue), green, and the colour of the rows between. */
struct colours {
    floats own, green, other;
};

/* The sums that both kinds of pixel use. */
struct around {
    floats c, h, v, x, hh, vv;
};

LANES_INLINE struct around look_around(const float *const r[LS_DEMOSAIC_ROWS], size_t p,
                                       bool gradient)
{
    struct around a = {
        .c = lanes_load(r[2] + p),
        .h = lanes_load(r[2] + p - 1) + lanes_load(r[2] + p + 1),
        .v = lanes_load(r[1] + p) + lanes_load(r[3] + p),
        .x = (lanes_load(r[1] + p - 1) + lanes_load(r[1] + p + 1)) +
             (lanes_load(r[3] + p - 1) + lanes_load(r[3] + p + 1)),
    };
    if (gradient) {
        a.hh = lanes_load(r[2] + p - 2) + lanes_load(r[2] + p + 2);
        a.vv = lanes_load(r[0] + p) + lanes_load(r[4] + p);
    }
    return a;
}

/* The colour of the rows between is a filter of the same five sums at both kinds of pixel: its taps
 * lie in the lanes. */
struct taps {
    ints green; /* which lanes are green pixels */
    floats c, v, x, hh, vv;
};

LANES_INLINE floats green_or(ints green, float a, float b)
{
    return lanes_select(green, lanes_all(a), lanes_all(b));
}

LANES_INLINE struct taps taps(bool green_first, bool gradient)
{
    static const int32_t every_other[LS_DEMOSAIC_SLACK + 1] = {-1, 0,  -1, 0,  -1, 0,  -1, 0, -1,
                                                               0,  -1, 0,  -1, 0,  -1, 0,  -1};
    ints green;
    memcpy(&green, every_other + !green_first, sizeof green);
    struct taps t = {.green = green,
                     .v = green_or(green, 0.5f, 0),
                     .x = green_or(green, gradient ? -0.125f : 0, 0.25f)};
    if (gradient) {
        t.c = green_or(green, 0.625f, 0.75f);
        t.hh = green_or(green, 0.0625f, -0.1875f);
        t.vv = green_or(green, -0.125f, -0.1875f);
    }
    return t;
}

LANES_INLINE struct colours filter(const struct ls_demosaic_line *l, size_t p, const struct taps *t,
                                   enum ls_demosaic_filter kind)
{
    if (kind == LS_DEMOSAIC_FILTER_COPY) {
        floats c = lanes_load(l->row[2] + p);
        return (struct colours){c, c, c};
    }
    bool gradient = kind == LS_DEMOSAIC_FILTER_GRADIENT;
    struct around a = look_around(l->row, p, gradient);
    floats own = a.h * 0.5f, green = (a.v + a.h) * 0.25f, other = a.v * t->v + a.x * t->x;
    if (gradient) {
        own = (5 * a.c + 4 * a.h - a.x - a.hh + 0.5f * a.vv) * 0.125f;
        green = (4 * a.c + 2 * (a.v + a.h) - (a.hh + a.vv)) * 0.125f;
        other = a.c * t->c + other + a.hh * t->hh + a.vv * t->vv;
    }
    return (struct colours){.own = lanes_select(t->green, own, a.c),
                            .green = lanes_select(t->green, a.c, green),
                            .other = other};
}

LANES_INLINE halves finite_half(floats v)
{
    return lanes_to_half(lanes_clamp_half(v));
}

/* LANES pixels onto those at @to. */
LANES_INLINE void grow(float *to, const float *ratio, float scale, floats r, floats g, floats b)
{
    floats woven[3];
    lanes_weave(r, g, b, woven);
    for (int k = 0; k < 3; k++, to += LANES) {
        floats v = scale * woven[k];
        if (ratio)
            v *= lanes_load(ratio + k * LANES);
        lanes_store(to, lanes_load(to) + v);
    }
}

/* The last pixels of a line, by way of a buffer. */
LANES_INLINE void grow_rest(float *to, const float *ratio, float scale, size_t n, floats r,
                            floats g, floats b)
{
    float all[2][3 * LANES] = {{0}};
    memcpy(all[0], to, 3 * n * sizeof *to);
    if (ratio)
        memcpy(all[1], ratio, 3 * n * sizeof *ratio);
    grow(all[0], ratio ? all[1] : NULL, scale, r, g, b);
    memcpy(to, all[0], 3 * n * sizeof *to);
}

/* LANES pixels, promoted, to @to. */
LANES_INLINE void promote(uint16_t *to, const uint16_t *ratio, float gain, floats r, floats g,
                          floats b)
{
    halves woven[3];
    ints finite;
    lanes_weave_half(finite_half(r), finite_half(g), finite_half(b), woven);
    for (int k = 0; k < 3; k++, to += LANES, ratio += LANES)
        lanes_store_half(
            to, promote_lanes(lanes_from_half(woven[k]) * gain, lanes_load_half(ratio), &finite));
}

/* The same where all of it lies in half's range, which costs the clamps nothing: what does not, and
 * what is no number, has the largest exponent to the end, whatever it is multiplied by. Those set
 * the first bits of @beyond. */
LANES_INLINE void promote_within(uint16_t *to, const uint16_t *ratio, float gain, floats r,
                                 floats g, floats b, halves *beyond)
{
    halves woven[3];
    lanes_weave_half(lanes_to_half(r), lanes_to_half(g), lanes_to_half(b), woven);
    for (int k = 0; k < 3; k++, to += LANES, ratio += LANES) {
        halves v = lanes_to_half(lanes_from_half(woven[k]) * gain * lanes_load_half(ratio));
        *beyond |= (v & 0x7fff) + 0x0400;
        lanes_store_half(to, v);
    }
}

/* The last pixels of a line, by way of a buffer. */
LANES_INLINE void promote_rest(uint16_t *to, const uint16_t *ratio, float gain, size_t n, floats r,
                               floats g, floats b)
{
    uint16_t all[2][3 * LANES] = {{0}};
    memcpy(all[0], ratio, 3 * n * sizeof *ratio);
    promote(all[1], all[0], gain, r, g, b);
    memcpy(to, all[1], 3 * n * sizeof *to);
}

/* LANES pixels from pixel p of the planes on. */
LANES_INLINE void put(void *const plane[3], size_t p, enum ls_demosaic_form form, floats r,
                      floats g, floats b)
{
    switch (form) {
    case LS_DEMOSAIC_PLANES:
        lanes_store((float *)plane[0] + p, r);
        lanes_store((float *)plane[1] + p, g);
        lanes_store((float *)plane[2] + p, b);
        return;
    case LS_DEMOSAIC_WOVEN:
        lanes_store_woven((float *)plane[0] + 3 * p, r, g, b);
        return;
    case LS_DEMOSAIC_HALF_PLANES:
        lanes_store_half((uint16_t *)plane[0] + p, finite_half(r));
        lanes_store_half((uint16_t *)plane[1] + p, finite_half(g));
        lanes_store_half((uint16_t *)plane[2] + p, finite_half(b));
        return;
    case LS_DEMOSAIC_HALF_WOVEN:
        lanes_store_woven_half((uint16_t *)plane[0] + 3 * p, finite_half(r), finite_half(g),
                               finite_half(b));
        return;
    case LS_DEMOSAIC_ADD: /* not here */
    case LS_DEMOSAIC_PROMOTED:
        return;
    }
}

/* The last pixels of a line, fewer than LANES: by way of a buffer. */
LANES_INLINE void put_rest(void *const plane[3], size_t p, size_t n, enum ls_demosaic_form form,
                           floats r, floats g, floats b)
{
    bool woven = form == LS_DEMOSAIC_WOVEN || form == LS_DEMOSAIC_HALF_WOVEN;
    size_t each = form == LS_DEMOSAIC_PLANES || form == LS_DEMOSAIC_WOVEN ? 4 : 2;
    float buffer[3][LANES];
    void *const lines[3] = {buffer[0], buffer[1], buffer[2]};

    put(lines, 0, form, r, g, b);
    if (woven)
        memcpy((char *)plane[0] + 3 * p * each, buffer, 3 * n * each);
    for (int c = 0; !woven && c < 3; c++)
        memcpy((char *)plane[c] + p * each, buffer[c], n * each);
}

LANES_INLINE void run_line(const struct ls_demosaic_line *line, enum ls_demosaic_filter kind,
                           enum ls_demosaic_form form)
{
    const struct ls_demosaic_line l = *line; /* a copy, which no output can be part of */
    const struct taps t = taps(l.green_first, kind == LS_DEMOSAIC_FILTER_GRADIENT);

    for (size_t p = 0; p < l.n; p += LANES) {
        struct colours c = filter(&l, p, &t, kind);
        floats red = l.red_row ? c.own : c.other, blue = l.red_row ? c.other : c.own;
        const float *ratio = l.ratio ? l.ratio + 3 * p : NULL;
        if (form == LS_DEMOSAIC_ADD && l.n - p >= LANES)
            grow((float *)l.plane[0] + 3 * p, ratio, l.scale, red, c.green, blue);
        else if (form == LS_DEMOSAIC_ADD)
            grow_rest((float *)l.plane[0] + 3 * p, ratio, l.scale, l.n - p, red, c.green, blue);
        else if (form == LS_DEMOSAIC_PROMOTED && l.n - p >= LANES)
            promote((uint16_t *)l.plane[0] + 3 * p, l.half_ratio + 3 * p, l.scale, red, c.green,
                    blue);
        else if (form == LS_DEMOSAIC_PROMOTED)
            promote_rest((uint16_t *)l.plane[0] + 3 * p, l.half_ratio + 3 * p, l.scale, l.n - p,
                         red, c.green, blue);
        else if (l.n - p >= LANES)
            put(l.plane, p, form, red, c.green, blue);
        else
            put_rest(l.plane, p, l.n - p, form, red, c.green, blue);
    }
}

/* Whole vectors of a promoted line. False: some of it lies beyond half's range, all of it is to be
 * made again. */
LANES_INLINE bool run_within(const struct ls_demosaic_line *line, enum ls_demosaic_filter kind)
{
    const struct ls_demosaic_line l = *line;
    const struct taps t = taps(l.green_first, kind == LS_DEMOSAIC_FILTER_GRADIENT);
    halves beyond = {0};

    if (l.n % LANES)
        return false;
    for (size_t p = 0; p < l.n; p += LANES) {
        struct colours c = filter(&l, p, &t, kind);
        floats red = l.red_row ? c.own : c.other, blue = l.red_row ? c.other : c.own;
        promote_within((uint16_t *)l.plane[0] + 3 * p, l.half_ratio + 3 * p, l.scale, red, c.green,
                       blue, &beyond);
    }
    uint16_t any = 0;
    for (int k = 0; k < LANES; k++)
        any |= beyond[k];
    return any < 0x8000;
}

#define DEMOSAIC_FORMS(kind)                            \
    switch (line->form) {                               \
    case LS_DEMOSAIC_PLANES:                            \
        run_line(line, kind, LS_DEMOSAIC_PLANES);       \
        return;                                         \
    case LS_DEMOSAIC_WOVEN:                             \
        run_line(line, kind, LS_DEMOSAIC_WOVEN);        \
        return;                                         \
    case LS_DEMOSAIC_HALF_PLANES:                       \
        run_line(line, kind, LS_DEMOSAIC_HALF_PLANES);  \
        return;                                         \
    case LS_DEMOSAIC_HALF_WOVEN:                        \
        run_line(line, kind, LS_DEMOSAIC_HALF_WOVEN);   \
        return;                                         \
    case LS_DEMOSAIC_ADD:                               \
        run_line(line, kind, LS_DEMOSAIC_ADD);          \
        return;                                         \
    case LS_DEMOSAIC_PROMOTED:                          \
        if (!run_within(line, kind))                    \
            run_line(line, kind, LS_DEMOSAIC_PROMOTED); \
        return;                                         \
    }

LANES_INLINE void demosaic_line(const struct ls_demosaic_line *line)
{
    switch (line->filter) {
    case LS_DEMOSAIC_FILTER_GRADIENT:
        DEMOSAIC_FORMS(LS_DEMOSAIC_FILTER_GRADIENT)
        return;
    case LS_DEMOSAIC_FILTER_BILINEAR:
        DEMOSAIC_FORMS(LS_DEMOSAIC_FILTER_BILINEAR)
        return;
    case LS_DEMOSAIC_FILTER_COPY:
        DEMOSAIC_FORMS(LS_DEMOSAIC_FILTER_COPY)
        return;
    }
}

#endif

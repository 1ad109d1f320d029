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

/* From two rows above to two below. */
struct rows {
    const float *north2, *north, *at, *south, *south2;
};

LANES_INLINE struct around look_around(struct rows r, size_t p, bool gradient)
{
    struct around a = {
        .c = lanes_load(r.at + p),
        .h = lanes_load(r.at + p - 1) + lanes_load(r.at + p + 1),
        .v = lanes_load(r.north + p) + lanes_load(r.south + p),
        .x = (lanes_load(r.north + p - 1) + lanes_load(r.north + p + 1)) +
             (lanes_load(r.south + p - 1) + lanes_load(r.south + p + 1)),
    };
    if (gradient) {
        a.hh = lanes_load(r.at + p - 2) + lanes_load(r.at + p + 2);
        a.vv = lanes_load(r.north2 + p) + lanes_load(r.south2 + p);
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

/* One of a line's rows. */
struct row {
    struct rows rows;
    struct taps taps;
    bool red_row;
    void *plane[3];
    const float *ratio;
    const uint16_t *half_ratio;
};

LANES_INLINE struct row row_of(const struct ls_demosaic_line *l, enum ls_demosaic_filter kind,
                               bool second)
{
    const float *const *row = l->row + second;
    size_t step = second ? l->step : 0, ratio_step = second ? l->ratio_step : 0;
    return (struct row){
        .rows = {row[0], row[1], row[2], row[3], row[4]},
        .taps = taps(l->green_first != second, kind == LS_DEMOSAIC_FILTER_GRADIENT),
        .red_row = l->red_row != second,
        .plane = {(char *)l->plane[0] + step, (char *)l->plane[1] + step,
                  (char *)l->plane[2] + step},
        .ratio = l->ratio ? l->ratio + ratio_step : NULL,
        .half_ratio = l->half_ratio ? l->half_ratio + ratio_step : NULL,
    };
}

LANES_INLINE struct colours filter(const struct row *l, size_t p, enum ls_demosaic_filter kind)
{
    if (kind == LS_DEMOSAIC_FILTER_COPY) {
        floats c = lanes_load(l->rows.at + p);
        return (struct colours){c, c, c};
    }
    bool gradient = kind == LS_DEMOSAIC_FILTER_GRADIENT;
    const struct taps *t = &l->taps;
    struct around a = look_around(l->rows, p, gradient);
    floats own = a.h * 0.5f, green = (a.v + a.h) * 0.25f, other = lanes_fma(a.x, t->x, a.v * t->v);
    if (gradient) {
        own = lanes_fma(a.h, lanes_all(0.5f), a.c * 0.625f);
        own = lanes_fma(a.x + a.hh, lanes_all(-0.125f), own);
        own = lanes_fma(a.vv, lanes_all(0.0625f), own);
        green = lanes_fma(a.v + a.h, lanes_all(0.25f), a.c * 0.5f);
        green = lanes_fma(a.hh + a.vv, lanes_all(-0.125f), green);
        other = lanes_fma(a.c, t->c, other);
        other = lanes_fma(a.hh, t->hh, other);
        other = lanes_fma(a.vv, t->vv, other);
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

/* The same of woven halves where all of it lies in half's range, which costs the clamps nothing:
 * what does not, and what is no number, has the largest exponent to the end, whatever it is
 * multiplied by. *most: the largest magnitude so far. */
LANES_INLINE void promote_within(uint16_t *to, const uint16_t *ratio, float gain,
                                 const halves woven[3], halves *most)
{
    for (int k = 0; k < 3; k++, to += LANES, ratio += LANES) {
        halves v = lanes_to_half(lanes_from_half(woven[k]) * gain * lanes_load_half(ratio));
        *most = lanes_max_half(*most, v & 0x7fff);
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

LANES_INLINE void run_row(const struct ls_demosaic_line *line, enum ls_demosaic_filter kind,
                          enum ls_demosaic_form form, bool second)
{
    const struct row l = row_of(line, kind, second);
    const size_t n = line->n;
    const float scale = line->scale;

    for (size_t p = 0; p < n; p += LANES) {
        struct colours c = filter(&l, p, kind);
        floats red = l.red_row ? c.own : c.other, blue = l.red_row ? c.other : c.own;
        const float *ratio = l.ratio ? l.ratio + 3 * p : NULL;
        if (form == LS_DEMOSAIC_ADD && n - p >= LANES)
            grow((float *)l.plane[0] + 3 * p, ratio, scale, red, c.green, blue);
        else if (form == LS_DEMOSAIC_ADD)
            grow_rest((float *)l.plane[0] + 3 * p, ratio, scale, n - p, red, c.green, blue);
        else if (form == LS_DEMOSAIC_PROMOTED && n - p >= LANES)
            promote((uint16_t *)l.plane[0] + 3 * p, l.half_ratio + 3 * p, scale, red, c.green,
                    blue);
        else if (form == LS_DEMOSAIC_PROMOTED)
            promote_rest((uint16_t *)l.plane[0] + 3 * p, l.half_ratio + 3 * p, scale, n - p, red,
                         c.green, blue);
        else if (n - p >= LANES)
            put(l.plane, p, form, red, c.green, blue);
        else
            put_rest(l.plane, p, n - p, form, red, c.green, blue);
    }
}

LANES_INLINE void run_line(const struct ls_demosaic_line *line, enum ls_demosaic_filter kind,
                           enum ls_demosaic_form form)
{
    run_row(line, kind, form, false);
    if (line->two)
        run_row(line, kind, form, true);
}

LANES_INLINE void weave_filtered(const struct row *l, size_t p, enum ls_demosaic_filter kind,
                                 halves woven[3])
{
    struct colours c = filter(l, p, kind);
    floats red = l->red_row ? c.own : c.other, blue = l->red_row ? c.other : c.own;
    lanes_weave_half(lanes_to_half(red), lanes_to_half(c.green), lanes_to_half(blue), woven);
}

/* Whole vectors of promoted rows, each while the next is filtered: either waits long for itself.
 * False: some of it lies beyond half's range, all of it is to be made again. */
LANES_INLINE bool run_within(const struct ls_demosaic_line *line, enum ls_demosaic_filter kind,
                             int n_rows)
{
    const struct row l[2] = {row_of(line, kind, false), row_of(line, kind, n_rows == 2)};
    const size_t n = line->n;
    const float gain = line->scale;
    halves most = {0}, now[2][3], next[2][3];

    for (int r = 0; r < n_rows; r++)
        weave_filtered(&l[r], 0, kind, now[r]);
    for (size_t p = LANES; p < n; p += LANES) {
        for (int r = 0; r < n_rows; r++)
            weave_filtered(&l[r], p, kind, next[r]);
        for (int r = 0; r < n_rows; r++) {
            size_t at = 3 * (p - LANES);
            promote_within((uint16_t *)l[r].plane[0] + at, l[r].half_ratio + at, gain, now[r],
                           &most);
            for (int k = 0; k < 3; k++)
                now[r][k] = next[r][k];
        }
    }
    for (int r = 0; r < n_rows; r++)
        promote_within((uint16_t *)l[r].plane[0] + 3 * (n - LANES),
                       l[r].half_ratio + 3 * (n - LANES), gain, now[r], &most);
    uint16_t beyond = 0;
    for (int k = 0; k < LANES; k++)
        beyond |= most[k] >= 0x7c00;
    return !beyond;
}

LANES_INLINE bool run_promoted(const struct ls_demosaic_line *line, enum ls_demosaic_filter kind)
{
    if (line->n % LANES || line->n == 0)
        return false;
    return line->two ? run_within(line, kind, 2) : run_within(line, kind, 1);
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
        if (!run_promoted(line, kind))                  \
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

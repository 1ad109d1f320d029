#include "core/demosaic.h"

#include <stdbool.h>
#include <string.h>

/*
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
 * Each row sums to 8, so a constant is kept.
 */

enum { HALO = LS_DEMOSAIC_HALO, CHUNK = 256, LINE = CHUNK + 2 * HALO };

/* Five mirrored rows around an output row. */
struct lines {
    float row[2 * HALO + 1][LINE];
};

static uint32_t mirror(int64_t i, uint32_t n)
{
    if (n == 1)
        return 0;
    while (i < 0 || i >= n)
        i = i < 0 ? -i : 2 * ((int64_t)n - 1) - i;
    return (uint32_t)i;
}

static void load_row(const struct ls_demosaic_source *s, uint32_t x, uint32_t n, uint32_t y,
                     float *line)
{
    const float *row = s->data + (size_t)(y - s->window.y) * s->stride;

    if (x >= HALO && x + n + HALO <= s->image_width) {
        memcpy(line, row + (x - HALO - s->window.x), (n + 2 * HALO) * sizeof *line);
        return;
    }
    for (uint32_t i = 0; i < n + 2 * HALO; i++)
        line[i] = row[mirror((int64_t)x + i - HALO, s->image_width) - s->window.x];
}

static inline float cross(const struct lines *l, uint32_t i)
{
    return (l->row[1][i] + l->row[3][i]) + (l->row[2][i - 1] + l->row[2][i + 1]);
}

static inline float diagonals(const struct lines *l, uint32_t i)
{
    return (l->row[1][i - 1] + l->row[1][i + 1]) + (l->row[3][i - 1] + l->row[3][i + 1]);
}

static inline float far_row(const struct lines *l, uint32_t i)
{
    return l->row[2][i - 2] + l->row[2][i + 2];
}

static inline float far_column(const struct lines *l, uint32_t i)
{
    return l->row[0][i] + l->row[4][i];
}

/* A row of output: where each colour goes, and how far apart its pixels are. */
struct out {
    float *known, *row, *column; /* red or blue sites: known, green, opposite */
    size_t step;
};

static void green_sites(const struct lines *l, uint32_t first, uint32_t n, bool gradient,
                        struct out o)
{
    for (uint32_t p = first; p < n; p += 2) {
        uint32_t i = p + HALO;
        float c = l->row[2][i];
        float h = l->row[2][i - 1] + l->row[2][i + 1], v = l->row[1][i] + l->row[3][i];
        o.known[p * o.step] = c;
        if (gradient) {
            float x = diagonals(l, i), hh = far_row(l, i), vv = far_column(l, i);
            o.row[p * o.step] = (5 * c + 4 * h - x - hh + 0.5f * vv) * 0.125f;
            o.column[p * o.step] = (5 * c + 4 * v - x - vv + 0.5f * hh) * 0.125f;
        } else {
            o.row[p * o.step] = h * 0.5f;
            o.column[p * o.step] = v * 0.5f;
        }
    }
}

static void colour_sites(const struct lines *l, uint32_t first, uint32_t n, bool gradient,
                         struct out o)
{
    for (uint32_t p = first; p < n; p += 2) {
        uint32_t i = p + HALO;
        float c = l->row[2][i], near = cross(l, i), x = diagonals(l, i);
        o.known[p * o.step] = c;
        if (gradient) {
            float far = far_row(l, i) + far_column(l, i);
            o.row[p * o.step] = (4 * c + 2 * near - far) * 0.125f;
            o.column[p * o.step] = (6 * c + 2 * x - 1.5f * far) * 0.125f;
        } else {
            o.row[p * o.step] = near * 0.25f;
            o.column[p * o.step] = x * 0.25f;
        }
    }
}

static void demosaic_row(const struct lines *l, enum ls_cfa cfa, uint32_t x, uint32_t y, uint32_t n,
                         bool gradient, float *const plane[3], size_t step)
{
    uint32_t green = ls_cfa_channel(cfa, x, y) == 1 ? 0 : 1, colour = 1 - green;
    unsigned own = ls_cfa_channel(cfa, x + colour, y);

    green_sites(l, green, n, gradient, (struct out){plane[1], plane[own], plane[2 - own], step});
    colour_sites(l, colour, n, gradient, (struct out){plane[own], plane[1], plane[2 - own], step});
}

static void copy_row(const float *row, uint32_t n, float *const plane[3], size_t step)
{
    for (uint32_t p = 0; p < n; p++)
        plane[0][p * step] = plane[1][p * step] = plane[2][p * step] = row[p];
}

static bool inside(struct ls_demosaic_region inner, struct ls_demosaic_region outer)
{
    return inner.x >= outer.x && inner.y >= outer.y &&
           (uint64_t)inner.x + inner.width <= (uint64_t)outer.x + outer.width &&
           (uint64_t)inner.y + inner.height <= (uint64_t)outer.y + outer.height;
}

struct ls_demosaic_region ls_demosaic_needs(struct ls_demosaic_region r, uint32_t image_width,
                                            uint32_t image_height)
{
    uint32_t x0 = r.x > HALO ? r.x - HALO : 0, y0 = r.y > HALO ? r.y - HALO : 0;
    uint64_t x1 = (uint64_t)r.x + r.width + HALO, y1 = (uint64_t)r.y + r.height + HALO;

    x1 = x1 < image_width ? x1 : image_width;
    y1 = y1 < image_height ? y1 : image_height;
    return (struct ls_demosaic_region){x0, y0, (uint32_t)(x1 - x0), (uint32_t)(y1 - y0)};
}

enum ls_err ls_demosaic(const struct ls_demosaic_source *source, struct ls_demosaic_region region,
                        enum ls_demosaic_method method, const struct ls_demosaic_target *target)
{
    struct ls_demosaic_region image = {0, 0, source->image_width, source->image_height};

    if (!inside(region, image) || !inside(source->window, image) ||
        !inside(ls_demosaic_needs(region, image.width, image.height), source->window))
        return LS_ERR_INVALID;
    for (uint32_t j = 0; j < region.height; j++) {
        for (uint32_t at = 0; at < region.width; at += CHUNK) {
            struct lines l;
            uint32_t n = region.width - at < CHUNK ? region.width - at : CHUNK;
            uint32_t x = region.x + at, y = region.y + j;
            size_t to = j * target->row_step + at * target->pixel_step;
            float *const plane[3] = {target->plane[0] + to, target->plane[1] + to,
                                     target->plane[2] + to};
            for (int k = 0; k <= 2 * HALO; k++)
                load_row(source, x, n, mirror((int64_t)y + k - HALO, image.height), l.row[k]);
            if (source->cfa == LS_CFA_NONE)
                copy_row(&l.row[HALO][HALO], n, plane, target->pixel_step);
            else
                demosaic_row(&l, source->cfa, x, y, n, method == LS_DEMOSAIC_GRADIENT, plane,
                             target->pixel_step);
        }
    }
    return LS_OK;
}

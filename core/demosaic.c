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

enum { HALO = LS_DEMOSAIC_HALO, ROWS = 2 * HALO + 1, CHUNK = 256, HALF = CHUNK / 2 + HALO };

/* Five mirrored rows around an output row, their even and odd columns apart: the sites of a colour
 * and their neighbours then lie side by side. */
struct lines {
    float side[2][ROWS][HALF];
};

/* What the filters make of the even or the odd sites of a row: the known colour, the one that its
 * row has too, the one of the column alone. At red and blue sites "row" is green and "column" the
 * opposite colour. */
struct sites {
    float known[HALF], row[HALF], column[HALF];
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
                     uint32_t k, struct lines *l)
{
    const float *row = s->data + (size_t)(y - s->window.y) * s->stride;
    uint32_t first = x < HALO ? HALO - x : 0, end = n + 2 * HALO; /* of what lies in the image */
    uint32_t inside = s->image_width + HALO - x < end ? s->image_width + HALO - x : end;
    float line[2 * HALF];

    memcpy(line + first, row + (x + first - HALO - s->window.x), (inside - first) * sizeof *line);
    for (uint32_t i = 0; i < first; i++)
        line[i] = row[mirror((int64_t)x + i - HALO, s->image_width) - s->window.x];
    for (uint32_t i = inside; i < end; i++)
        line[i] = row[mirror((int64_t)x + i - HALO, s->image_width) - s->window.x];
    for (uint32_t i = 0; i < (end + 1) / 2; i++) {
        l->side[0][k][i] = line[2 * i];
        l->side[1][k][i] = line[2 * i + 1];
    }
}

/* Site m of a side is its sample m + 1; to its left and right are samples m + side and m + side + 1
 * of the other one. */
static void green_sites(const struct lines *restrict l, uint32_t side, uint32_t n, bool gradient,
                        struct sites *restrict out)
{
    const float(*own)[HALF] = l->side[side], (*other)[HALF] = l->side[1 - side];
    for (uint32_t m = 0; m < n; m++) {
        uint32_t left = m + side, right = left + 1;
        float c = own[2][m + 1];
        float h = other[2][left] + other[2][right], v = own[1][m + 1] + own[3][m + 1];
        float x = (other[1][left] + other[1][right]) + (other[3][left] + other[3][right]);
        float hh = own[2][m] + own[2][m + 2], vv = own[0][m + 1] + own[4][m + 1];
        out->known[m] = c;
        out->row[m] = gradient ? (5 * c + 4 * h - x - hh + 0.5f * vv) * 0.125f : h * 0.5f;
        out->column[m] = gradient ? (5 * c + 4 * v - x - vv + 0.5f * hh) * 0.125f : v * 0.5f;
    }
}

static void colour_sites(const struct lines *restrict l, uint32_t side, uint32_t n, bool gradient,
                         struct sites *restrict out)
{
    const float(*own)[HALF] = l->side[side], (*other)[HALF] = l->side[1 - side];
    for (uint32_t m = 0; m < n; m++) {
        uint32_t left = m + side, right = left + 1;
        float c = own[2][m + 1];
        float near = (own[1][m + 1] + own[3][m + 1]) + (other[2][left] + other[2][right]);
        float x = (other[1][left] + other[1][right]) + (other[3][left] + other[3][right]);
        float far = (own[2][m] + own[2][m + 2]) + (own[0][m + 1] + own[4][m + 1]);
        out->known[m] = c;
        out->row[m] = gradient ? (4 * c + 2 * near - far) * 0.125f : near * 0.25f;
        out->column[m] = gradient ? (6 * c + 2 * x - 1.5f * far) * 0.125f : x * 0.25f;
    }
}

/* One row of a plane from its even and odd sites. */
static void weave(const float *restrict even, const float *restrict odd, uint32_t n,
                  float *restrict plane, size_t step)
{
    for (uint32_t m = 0; step == 1 && m < n / 2; m++) {
        plane[2 * m] = even[m];
        plane[2 * m + 1] = odd[m];
    }
    for (uint32_t m = 0; step != 1 && m < n / 2; m++) {
        plane[2 * m * step] = even[m];
        plane[(2 * m + 1) * step] = odd[m];
    }
    if (n % 2)
        plane[(n - 1) * step] = even[n / 2];
}

static void demosaic_row(const struct lines *l, enum ls_cfa cfa, uint32_t x, uint32_t y, uint32_t n,
                         bool gradient, float *const plane[3], size_t step)
{
    uint32_t green = ls_cfa_channel(cfa, x, y) == 1 ? 0 : 1, colour = 1 - green;
    unsigned own = ls_cfa_channel(cfa, x + colour, y);
    struct sites site[2]; /* even, odd */
    const struct sites *g = &site[green], *c = &site[colour];

    green_sites(l, green, (n + 1 - green) / 2, gradient, &site[green]);
    colour_sites(l, colour, (n + 1 - colour) / 2, gradient, &site[colour]);
    const float *part[2][3]; /* of the even and odd sites, by colour */
    part[green][1] = g->known;
    part[green][own] = g->row;
    part[green][2 - own] = g->column;
    part[colour][1] = c->row;
    part[colour][own] = c->known;
    part[colour][2 - own] = c->column;
    for (int k = 0; k < 3; k++)
        weave(part[0][k], part[1][k], n, plane[k], step);
}

static void copy_row(const struct lines *l, uint32_t n, float *const plane[3], size_t step)
{
    for (int k = 0; k < 3; k++)
        weave(&l->side[0][HALO][HALO / 2], &l->side[1][HALO][HALO / 2], n, plane[k], step);
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
            for (uint32_t k = 0; k < ROWS; k++)
                load_row(source, x, n, mirror((int64_t)y + k - HALO, image.height), k, &l);
            if (source->cfa == LS_CFA_NONE)
                copy_row(&l, n, plane, target->pixel_step);
            else
                demosaic_row(&l, source->cfa, x, y, n, method == LS_DEMOSAIC_GRADIENT, plane,
                             target->pixel_step);
        }
    }
    return LS_OK;
}

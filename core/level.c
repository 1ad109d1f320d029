#include "core/level.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

uint32_t ls_level_size(uint32_t n, uint32_t level)
{
    uint32_t s = 1u << level;
    return n / s + (n % s != 0);
}

struct ls_demosaic_region ls_level_region(struct ls_demosaic_region region, uint32_t level)
{
    uint32_t x = region.x >> level, y = region.y >> level;
    return (struct ls_demosaic_region){x, y, ls_level_size(region.x + region.width, level) - x,
                                       ls_level_size(region.y + region.height, level) - y};
}

static uint32_t smaller(uint64_t a, uint32_t b)
{
    return a < b ? (uint32_t)a : b;
}

struct ls_demosaic_region ls_level_needs(struct ls_demosaic_region region, uint32_t level,
                                         uint32_t width, uint32_t height)
{
    uint32_t x = region.x << level, y = region.y << level;
    return (struct ls_demosaic_region){x, y, smaller((uint64_t)region.width << level, width - x),
                                       smaller((uint64_t)region.height << level, height - y)};
}

enum ls_err ls_level_rows_init(struct ls_level_rows *rows, uint32_t level,
                               const struct ls_demosaic_region *needs, uint32_t components,
                               struct ls_diag *diag)
{
    size_t n = (size_t)ls_level_size(needs->width, level) * components;
    *rows = (struct ls_level_rows){.level = level,
                                   .components = components,
                                   .width = needs->width,
                                   .rows_left = needs->height};
    rows->sums = calloc(n + 1, sizeof *rows->sums);
    return rows->sums ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a row of a picture");
}

static void add_row(struct ls_level_rows *rows, const float *in)
{
    uint32_t s = 1u << rows->level;
    double *sum = rows->sums;
    for (uint32_t x = 0; x < rows->width; x += s, sum += rows->components)
        for (uint32_t end = smaller((uint64_t)x + s, rows->width), k = x; k < end; k++)
            for (uint32_t c = 0; c < rows->components; c++)
                sum[c] += (double)*in++;
}

static void finish_row(struct ls_level_rows *rows, float *out)
{
    uint32_t s = 1u << rows->level;
    double *sum = rows->sums;
    for (uint32_t x = 0; x < rows->width; x += s)
        for (uint32_t c = 0; c < rows->components; c++)
            *out++ = (float)(*sum++ / (rows->n_added * smaller(s, rows->width - x)));
    memset(rows->sums, 0, (size_t)(sum - rows->sums) * sizeof *sum);
    rows->n_added = 0;
}

uint32_t ls_level_rows_add(struct ls_level_rows *rows, const float *in, uint32_t n, float *out)
{
    size_t row = (size_t)rows->width * rows->components;
    size_t out_row = (size_t)ls_level_size(rows->width, rows->level) * rows->components;
    uint32_t made = 0;
    assert(n <= rows->rows_left);
    for (; n > 0; n--, in += row) {
        add_row(rows, in);
        rows->rows_left--;
        if (++rows->n_added < 1u << rows->level && rows->rows_left > 0)
            continue;
        finish_row(rows, out);
        out += out_row;
        made++;
    }
    return made;
}

void ls_level_rows_finish(struct ls_level_rows *rows)
{
    free(rows->sums);
    *rows = (struct ls_level_rows){0};
}

#include "clients/tiled_band.h"

#include "core/level.h"

#include <stdlib.h>
#include <string.h>

enum { SIDE = 64 };

static const size_t most_bytes = (size_t)4 << 30; /* of one picture */

/* Of a picture: where it is cut. */
struct cut {
    struct ls_demosaic_region region; /* the level's pixels */
    uint32_t n;                       /* tiles that touch it */
    size_t pixel_bytes;
};

static uint32_t tiles_of(uint32_t from, uint32_t n)
{
    return (from + n - 1) / SIDE - from / SIDE + 1;
}

static struct cut cut_of(const struct ls_tiled_band *t, const struct lightstage_band *picture)
{
    struct cut cut = {.region = ls_level_region(t->region, t->level)};
    cut.n = tiles_of(cut.region.x, cut.region.width) * tiles_of(cut.region.y, cut.region.height);
    cut.pixel_bytes = picture->components * (picture->sample == LIGHTSTAGE_HALF ? 2u : 4u);
    return cut;
}

/* Zeros for a picture. */
static enum ls_err begin(struct ls_tiled_band *t, const struct cut *cut, struct ls_diag *diag)
{
    size_t bytes = (size_t)cut->region.width * cut->region.height * cut->pixel_bytes;
    if (bytes > most_bytes)
        return ls_fail(diag, LS_ERR_LIMIT, "%u x %u pixels are more than fit", cut->region.width,
                       cut->region.height);
    if (bytes != t->room) {
        free(t->rows);
        t->rows = malloc(bytes);
        t->room = t->rows ? bytes : 0;
    }
    if (!t->rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
    memset(t->rows, 0, bytes);
    return LS_OK;
}

/* What lies in the region of the tile at (x0, y0). */
static void place(struct ls_tiled_band *t, const struct cut *cut, uint32_t x0, uint32_t y0,
                  const uint8_t *values)
{
    const struct ls_demosaic_region *r = &cut->region;
    uint32_t left = x0 > r->x ? x0 : r->x, top = y0 > r->y ? y0 : r->y;
    uint32_t right = x0 + SIDE < r->x + r->width ? x0 + SIDE : r->x + r->width;
    uint32_t bottom = y0 + SIDE < r->y + r->height ? y0 + SIDE : r->y + r->height;
    for (uint32_t y = top; y < bottom && left < right; y++)
        memcpy(t->rows + ((size_t)(y - r->y) * r->width + left - r->x) * cut->pixel_bytes,
               values + ((size_t)(y - y0) * SIDE + left - x0) * cut->pixel_bytes,
               (right - left) * cut->pixel_bytes);
}

enum ls_err ls_tiled_band_take(struct ls_tiled_band *t, const struct lightstage_tile *tile,
                               bool *there, struct lightstage_band *band, struct ls_diag *diag)
{
    const struct cut cut = cut_of(t, tile->picture);
    const uint32_t across = (tile->picture->width + SIDE - 1) / SIDE;
    bool first = tile->index % cut.n == 0, last = tile->index % cut.n == cut.n - 1;
    enum ls_err err = first ? begin(t, &cut, diag) : LS_OK;
    if (err)
        return err;
    if (!t->rows || t->room != (size_t)cut.region.width * cut.region.height * cut.pixel_bytes ||
        cut.region.x + cut.region.width > tile->picture->width ||
        cut.region.y + cut.region.height > tile->picture->height)
        return ls_fail(diag, LS_ERR_INVALID, "the daemon sent tiles that do not fit the picture");
    if (tile->values)
        place(t, &cut, tile->number % across * SIDE, tile->number / across * SIDE, tile->values);
    *there = first || last;
    *band = *tile->picture;
    band->width = cut.region.width;
    band->height = cut.region.height;
    band->n_rows = last ? cut.region.height : 0;
    band->values = t->rows;
    band->values_bytes = last ? t->room : 0;
    band->report = first ? band->report : NULL;
    band->spectrum = first ? band->spectrum : NULL;
    return LS_OK;
}

void ls_tiled_band_finish(struct ls_tiled_band *t)
{
    free(t->rows);
    memset(t, 0, sizeof *t);
}

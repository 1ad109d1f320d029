#include "daemon/tiles_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = LS_EXR_TILE_PX };

enum ls_err ls_tiles_out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for tiles of a picture");
}

enum ls_err ls_tiles_read(const Lightstage__Fetch *fetch, const uint8_t *payload, size_t n,
                          struct ls_stored_tiles *stored, struct ls_memfds *memfds,
                          struct ls_tiles *out, struct ls_diag *diag)
{
    *out = (struct ls_tiles){.wanted = fetch->tiles,
                             .half = fetch->sample == LIGHTSTAGE__SAMPLE__HALF,
                             .max_error = fetch->max_error,
                             .stored = stored,
                             .first = fetch->first_tile};
    if (!(fetch->max_error >= 0) || !isfinite(fetch->max_error))
        return ls_fail(diag, LS_ERR_INVALID, "fetch: max_error: expected 0 or more");
    if (!fetch->tiles)
        return n > 0 || fetch->first_tile > 0 || fetch->memfd || fetch->max_error > 0
                   ? ls_fail(diag, LS_ERR_INVALID,
                             "fetch: hashes, first_tile, memfd and max_error are of tiles; ask for "
                             "tiles")
                   : LS_OK;
    if (fetch->memfd && !memfds)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a memfd travels over a Unix socket only, and this connection is "
                       "none; leave memfd out");
    if (fetch->memfd && fetch->credit_bytes == 0)
        return ls_fail(diag, LS_ERR_INVALID,
                       "fetch: with memfd, credit_bytes says how much memory may be filled before "
                       "a Credit; expected more than 0");
    out->memfds = fetch->memfd ? memfds : NULL;
    if (fetch->variance || fetch->validity)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: variance and validity come with rows, not with tiles");
    if (n % sizeof *out->have)
        return ls_fail(diag, LS_ERR_INVALID,
                       "fetch: a payload of %zu bytes: expected 8 for each tile's hash", n);
    out->have = n > 0 ? malloc(n) : NULL;
    if (n > 0 && !out->have)
        return ls_tiles_out_of_memory(diag);
    if (n > 0)
        memcpy(out->have, payload, n);
    out->n_have = n / sizeof *out->have;
    return LS_OK;
}

static void forget_picture(struct ls_tiles *tiles)
{
    free(tiles->number);
    free(tiles->hash);
    free(tiles->unchanged);
    free(tiles->rows);
    free(tiles->off);
    if (tiles->has_fd)
        close(tiles->fd);
    tiles->has_fd = false;
    tiles->number = NULL;
    tiles->hash = NULL;
    tiles->unchanged = NULL;
    tiles->rows = NULL;
    tiles->off = NULL;
    tiles->bounds = (struct ls_tiles_bounds){0};
    tiles->n_rows = tiles->filled = 0;
}

void ls_tiles_finish(struct ls_tiles *tiles)
{
    forget_picture(tiles);
    free(tiles->have);
    memset(tiles, 0, sizeof *tiles);
}

/* ---- which ---- */

uint32_t ls_tiles_count(const struct ls_tiles *tiles)
{
    return tiles->n_x * tiles->n_y;
}

static void number_tiles(struct ls_tiles *tiles)
{
    uint32_t across = (tiles->width + SIDE - 1) / SIDE;
    for (uint32_t i = 0; i < ls_tiles_count(tiles); i++)
        tiles->number[i] = (tiles->y0 + i / tiles->n_x) * across + tiles->x0 + i % tiles->n_x;
}

/* Whole tiles, from the row of the next on. */
static struct ls_demosaic_region rows_of(const struct ls_tiles *tiles)
{
    uint32_t y = tiles->next / tiles->n_x, x_end = SIDE * (tiles->x0 + tiles->n_x),
             y_end = SIDE * (tiles->y0 + tiles->n_y);
    struct ls_demosaic_region r = {.x = SIDE * tiles->x0, .y = SIDE * (tiles->y0 + y)};
    r.width = (x_end < tiles->width ? x_end : tiles->width) - r.x;
    r.height = y < tiles->n_y ? (y_end < tiles->height ? y_end : tiles->height) - r.y : 0;
    return r;
}

enum ls_err ls_tiles_begin(struct ls_tiles *tiles, uint32_t width, uint32_t height,
                           size_t pixel_bytes, struct ls_demosaic_region *region,
                           struct ls_diag *diag)
{
    tiles->begun += ls_tiles_count(tiles); /* of the one before */
    forget_picture(tiles);
    tiles->width = width;
    tiles->height = height;
    tiles->pixel_bytes = pixel_bytes;
    tiles->x0 = region->x / SIDE;
    tiles->y0 = region->y / SIDE;
    tiles->n_x = (region->x + region->width + SIDE - 1) / SIDE - tiles->x0;
    tiles->n_y = (region->y + region->height + SIDE - 1) / SIDE - tiles->y0;
    uint32_t n = ls_tiles_count(tiles);
    uint64_t before = tiles->first > tiles->begun ? tiles->first - tiles->begun : 0;
    tiles->next = tiles->told = before < n ? (uint32_t)before : n;
    *region = rows_of(tiles);
    tiles->number = calloc(n, sizeof *tiles->number);
    tiles->hash = calloc(n, sizeof *tiles->hash);
    tiles->unchanged = calloc(n, sizeof *tiles->unchanged);
    tiles->off = tiles->max_error > 0 ? calloc(n, sizeof *tiles->off) : NULL;
    if (!tiles->number || !tiles->hash || !tiles->unchanged ||
        (tiles->max_error > 0 && !tiles->off))
        return ls_tiles_out_of_memory(diag);
    number_tiles(tiles);
    return LS_OK;
}

bool ls_tiles_end(const struct ls_tiles *tiles)
{
    return tiles->told == ls_tiles_count(tiles);
}

bool ls_tiles_is_sent(const struct ls_tiles *tiles, uint32_t i)
{
    return tiles->hash[i] && !tiles->unchanged[i];
}

bool ls_tiles_note(struct ls_tiles *tiles, uint64_t hash)
{
    uint32_t i = tiles->next++;
    uint64_t at = tiles->begun + i;
    tiles->hash[i] = hash;
    tiles->unchanged[i] = hash && at < tiles->n_have && tiles->have[at] == hash;
    if (!hash)
        tiles->error_bound = fmax(tiles->error_bound, tiles->off[i]);
    return !ls_tiles_is_sent(tiles, i);
}

size_t ls_tiles_tile_bytes(const struct ls_tiles *tiles)
{
    return (size_t)SIDE * SIDE * tiles->pixel_bytes;
}

uint32_t ls_tiles_count_whole(const struct ls_tiles *tiles)
{
    return (tiles->width + SIDE - 1) / SIDE * ((tiles->height + SIDE - 1) / SIDE);
}

static enum ls_err pass_memfd(const struct ls_tiles *tiles, uint32_t n, struct ls_chunk *chunk,
                              Lightstage__FetchReply *body, struct ls_diag *diag)
{
    enum ls_err err = ls_memfd_share(tiles->fd, &chunk->fd, diag);
    chunk->passes = !err;
    body->memfd = true;
    body->memfd_bytes = ls_tiles_count_whole(tiles) * ls_tiles_tile_bytes(tiles);
    for (uint32_t i = 0; i < n; i++)
        chunk->handed_bytes +=
            ls_tiles_is_sent(tiles, tiles->told + i) ? ls_tiles_tile_bytes(tiles) : 0;
    return err;
}

enum ls_err ls_tiles_list(struct ls_tiles *tiles, struct ls_chunk *chunk,
                          Lightstage__FetchReply *body, struct ls_diag *diag)
{
    uint32_t known = tiles->next - tiles->told,
             n = tiles->memfds && known > LS_TILES_MOST_LISTED ? LS_TILES_MOST_LISTED : known;
    body->width = tiles->width;
    body->height = tiles->height;
    body->first_row = body->n_rows = 0;
    body->first_tile = (uint32_t)(tiles->begun + tiles->told);
    body->n_tile = body->n_tile_hash = n;
    body->tile = tiles->number + tiles->told;
    body->tile_hash = tiles->hash + tiles->told;
    if (memchr(tiles->unchanged + tiles->told, 1, n * sizeof *tiles->unchanged)) {
        body->n_tile_unchanged = n;
        body->tile_unchanged = tiles->unchanged + tiles->told;
    }
    enum ls_err err = tiles->memfds ? pass_memfd(tiles, n, chunk, body, diag) : LS_OK;
    tiles->told += n;
    return err;
}

enum ls_err ls_tiles_tell(struct ls_tiles *tiles, struct ls_chunk *chunk,
                          Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    *there = tiles->next == ls_tiles_count(tiles) && tiles->told < tiles->next;
    return *there ? ls_tiles_list(tiles, chunk, body, diag) : LS_OK;
}

/* What is made for the client. */
#include "daemon/tiles_private.h"

#include <glib.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = LS_EXR_TILE_PX, MADE_BYTES = 3 << 20 };

/* ---- by rows ---- */

/* Room for @n rows of tiles, of which those there are keep their place. */
static enum ls_err make_room(struct ls_tiles *tiles, uint32_t n, struct ls_diag *diag)
{
    size_t row = tiles->n_x * ls_tiles_tile_bytes(tiles);
    if (n <= tiles->n_rows)
        return LS_OK;
    uint8_t *grown = realloc(tiles->rows, n * row);
    if (!grown)
        return ls_tiles_out_of_memory(diag);
    memset(grown + tiles->n_rows * row, 0, (n - tiles->n_rows) * row);
    tiles->rows = grown;
    tiles->n_rows = n;
    return LS_OK;
}

/* One row of pixels into the tiles it crosses; @y: from the first row kept. */
static void spread(struct ls_tiles *tiles, uint32_t y, const uint8_t *row, uint32_t width)
{
    size_t line = SIDE * tiles->pixel_bytes, left = width * tiles->pixel_bytes;
    uint8_t *tile = tiles->rows + (size_t)(y / SIDE) * tiles->n_x * ls_tiles_tile_bytes(tiles);
    for (tile += y % SIDE * line; left > 0; tile += ls_tiles_tile_bytes(tiles)) {
        size_t n = left < line ? left : line;
        memcpy(tile, row, n);
        row += n;
        left -= n;
    }
}

enum ls_err ls_tiles_add(struct ls_tiles *tiles, struct ls_demosaic_region band, const void *values,
                         struct ls_diag *diag)
{
    size_t row = band.width * tiles->pixel_bytes;
    enum ls_err err = make_room(tiles, (tiles->filled + band.height + SIDE - 1) / SIDE, diag);
    for (uint32_t y = 0; y < band.height && !err; y++)
        spread(tiles, tiles->filled + y, (const uint8_t *)values + y * row, band.width);
    if (!err)
        tiles->filled += band.height;
    return err;
}

/* Rows of tiles that are there in full: the last ones may end where the picture does. */
static uint32_t complete_rows(const struct ls_tiles *tiles)
{
    uint32_t y = SIDE * (tiles->y0 + tiles->next / tiles->n_x) + tiles->filled;
    return y >= tiles->height ? tiles->n_rows : tiles->filled / SIDE;
}

/* Those that are sent move up to @to. Returns their end. */
static uint8_t *close_up(struct ls_tiles *tiles, uint32_t n_rows, uint8_t *to)
{
    const uint8_t *tile = to;
    uint32_t end = (tiles->next / tiles->n_x + n_rows) * tiles->n_x;
    for (tile += tiles->next % tiles->n_x * ls_tiles_tile_bytes(tiles); tiles->next < end;
         tile += ls_tiles_tile_bytes(tiles)) {
        if (ls_tiles_note(tiles, ls_tiles_hash(tiles, tiles->next, tile)))
            continue;
        if (tile != to)
            memmove(to, tile, ls_tiles_tile_bytes(tiles));
        to += ls_tiles_tile_bytes(tiles);
    }
    return to;
}

/* The tiles from @from on, closed up at @bytes, go to their places. */
static enum ls_err put_into_memfd(struct ls_tiles *tiles, uint32_t from, const uint8_t *bytes,
                                  struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (!tiles->has_fd)
        err = ls_memfd_create(ls_tiles_count_whole(tiles) * ls_tiles_tile_bytes(tiles), &tiles->fd,
                              diag);
    tiles->has_fd = !err;
    for (uint32_t i = from; i < tiles->next && !err; i++) {
        if (!ls_tiles_is_sent(tiles, i))
            continue;
        err = ls_memfd_write(tiles->fd, tiles->number[i] * ls_tiles_tile_bytes(tiles), bytes,
                             ls_tiles_tile_bytes(tiles), diag);
        bytes += ls_tiles_tile_bytes(tiles);
    }
    return err || tiles->next < ls_tiles_count(tiles) ? err : ls_memfd_seal(tiles->fd, diag);
}

/* The tiles from @from on are the payload: listed, or gone into the memfd. */
static enum ls_err finish_made(struct ls_tiles *tiles, uint32_t from, struct ls_chunk *chunk,
                               Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    *there = true;
    if (!tiles->memfds)
        return ls_tiles_list(tiles, chunk, body, diag);
    enum ls_err err = put_into_memfd(tiles, from, chunk->payload, diag);
    ls_chunk_finish(chunk);
    return err ? err : ls_tiles_tell(tiles, chunk, body, there, diag);
}

enum ls_err ls_tiles_take(struct ls_tiles *tiles, struct ls_chunk *chunk,
                          Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    uint32_t n = complete_rows(tiles), rest = tiles->n_rows - n, from = tiles->next;
    size_t row = tiles->n_x * ls_tiles_tile_bytes(tiles);
    *there = false;
    if (n == 0)
        return LS_OK;
    chunk->payload = tiles->rows;
    tiles->rows = rest > 0 ? g_memdup2(chunk->payload + n * row, rest * row) : NULL;
    chunk->payload_bytes = (size_t)(close_up(tiles, n, chunk->payload) - chunk->payload);
    tiles->n_rows = rest;
    tiles->filled = rest > 0 ? tiles->filled - SIDE * n : 0;
    return finish_made(tiles, from, chunk, body, there, diag);
}

/* ---- one by one ---- */

struct making {
    struct ls_tiles *tiles;
    ls_tiles_maker *make;
    void *user;
    uint32_t from;
    uint8_t *bytes; /* of all */
};

static struct ls_demosaic_region region_of(const struct ls_tiles *tiles, uint32_t number)
{
    uint32_t across = (tiles->width + SIDE - 1) / SIDE;
    uint32_t x = number % across * SIDE, y = number / across * SIDE;
    return (struct ls_demosaic_region){x, y, tiles->width - x < SIDE ? tiles->width - x : SIDE,
                                       tiles->height - y < SIDE ? tiles->height - y : SIDE};
}

/* A tile that the picture's edge cuts. */
static enum ls_err make_part(const struct making *m, struct ls_demosaic_region r, uint8_t *tile,
                             struct ls_diag *diag)
{
    size_t line = SIDE * m->tiles->pixel_bytes, row = r.width * m->tiles->pixel_bytes;
    LS_CLEANUP_FREE uint8_t *part = malloc(r.height * row);
    if (!part)
        return ls_tiles_out_of_memory(diag);
    enum ls_err err = m->make(m->user, r, part, diag);
    memset(tile, 0, SIDE * line);
    for (uint32_t y = 0; y < r.height && !err; y++)
        memcpy(tile + y * line, part + y * row, row);
    return err;
}

static enum ls_err make_one(void *user, uint32_t item, unsigned thread, struct ls_diag *diag)
{
    const struct making *m = user;
    struct ls_tiles *tiles = m->tiles;
    const struct ls_demosaic_region r = region_of(tiles, tiles->number[m->from + item]);
    uint8_t *tile = m->bytes + item * ls_tiles_tile_bytes(tiles);
    if (ls_tiles_leaves_out(tiles, m->from + item))
        return LS_OK;
    enum ls_err err = r.width == SIDE && r.height == SIDE ? m->make(m->user, r, tile, diag)
                                                          : make_part(m, r, tile, diag);
    tiles->hash[m->from + item] = err ? 0 : ls_tiles_hash(tiles, m->from + item, tile);
    return err;
}

/* Those that are sent move up. Returns their bytes. */
static size_t keep_sent(struct ls_tiles *tiles, uint32_t n, uint8_t *bytes)
{
    uint8_t *to = bytes;
    for (uint32_t i = 0; i < n; i++, bytes += ls_tiles_tile_bytes(tiles)) {
        if (ls_tiles_note(tiles, tiles->hash[tiles->next]))
            continue;
        if (bytes != to)
            memcpy(to, bytes, ls_tiles_tile_bytes(tiles));
        to += ls_tiles_tile_bytes(tiles);
    }
    return n * ls_tiles_tile_bytes(tiles) - (size_t)(bytes - to);
}

enum ls_err ls_tiles_make(struct ls_tiles *tiles, const struct ls_crew *crew, ls_tiles_maker *make,
                          void *user, struct ls_chunk *chunk, Lightstage__FetchReply *body,
                          bool *there, struct ls_diag *diag)
{
    size_t most = MADE_BYTES / ls_tiles_tile_bytes(tiles),
           left = ls_tiles_count(tiles) - tiles->next;
    uint32_t n = (uint32_t)(most < left ? most : left);
    enum ls_err err = ls_tiles_tell(tiles, chunk, body, there, diag);
    if (err || *there)
        return err;
    struct making making = {tiles, make, user, tiles->next, malloc(n * ls_tiles_tile_bytes(tiles))};
    if (!making.bytes)
        return ls_tiles_out_of_memory(diag);
    chunk->payload = making.bytes;
    err = ls_crew_run(crew, n, make_one, &making, diag);
    if (err)
        return err;
    chunk->payload_bytes = keep_sent(tiles, n, making.bytes);
    return finish_made(tiles, making.from, chunk, body, there, diag);
}

#include "daemon/tiles.h"

#include <glib.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = LS_EXR_TILE_PX, LENT_BYTES = 1 << 20, MADE_BYTES = 1 << 20, MOST_LISTED = 4096 };

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for tiles of a picture");
}

enum ls_err ls_tiles_read(const Lightstage__Fetch *fetch, const uint8_t *payload, size_t n,
                          struct ls_stored_tiles *stored, struct ls_memfds *memfds,
                          struct ls_tiles *out, struct ls_diag *diag)
{
    *out = (struct ls_tiles){.wanted = fetch->tiles, .stored = stored, .first = fetch->first_tile};
    if (!fetch->tiles)
        return n > 0 || fetch->first_tile > 0 || fetch->memfd
                   ? ls_fail(diag, LS_ERR_INVALID,
                             "fetch: hashes, first_tile and memfd are of tiles; ask for tiles")
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
        return out_of_memory(diag);
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
    if (tiles->has_fd)
        close(tiles->fd);
    tiles->has_fd = false;
    tiles->number = NULL;
    tiles->hash = NULL;
    tiles->unchanged = NULL;
    tiles->rows = NULL;
    tiles->n_rows = tiles->filled = 0;
}

void ls_tiles_finish(struct ls_tiles *tiles)
{
    forget_picture(tiles);
    free(tiles->have);
    memset(tiles, 0, sizeof *tiles);
}

/* ---- which ---- */

static uint32_t count(const struct ls_tiles *tiles)
{
    return tiles->n_x * tiles->n_y;
}

static void number_tiles(struct ls_tiles *tiles)
{
    uint32_t across = (tiles->width + SIDE - 1) / SIDE;
    for (uint32_t i = 0; i < count(tiles); i++)
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
    tiles->begun += count(tiles); /* of the one before */
    forget_picture(tiles);
    tiles->width = width;
    tiles->height = height;
    tiles->pixel_bytes = pixel_bytes;
    tiles->x0 = region->x / SIDE;
    tiles->y0 = region->y / SIDE;
    tiles->n_x = (region->x + region->width + SIDE - 1) / SIDE - tiles->x0;
    tiles->n_y = (region->y + region->height + SIDE - 1) / SIDE - tiles->y0;
    uint32_t n = count(tiles);
    uint64_t before = tiles->first > tiles->begun ? tiles->first - tiles->begun : 0;
    tiles->next = tiles->told = before < n ? (uint32_t)before : n;
    *region = rows_of(tiles);
    tiles->number = calloc(n, sizeof *tiles->number);
    tiles->hash = calloc(n, sizeof *tiles->hash);
    tiles->unchanged = calloc(n, sizeof *tiles->unchanged);
    if (!tiles->number || !tiles->hash || !tiles->unchanged)
        return out_of_memory(diag);
    number_tiles(tiles);
    return LS_OK;
}

bool ls_tiles_end(const struct ls_tiles *tiles)
{
    return tiles->told == count(tiles);
}

/* The next tile has this hash: does the client have it? */
static bool note(struct ls_tiles *tiles, uint64_t hash)
{
    uint64_t at = tiles->begun + tiles->next;
    bool known = at < tiles->n_have && tiles->have[at] == hash;
    tiles->hash[tiles->next] = hash;
    tiles->unchanged[tiles->next] = known;
    tiles->next++;
    return known;
}

static size_t tile_bytes(const struct ls_tiles *tiles)
{
    return (size_t)SIDE * SIDE * tiles->pixel_bytes;
}

static uint32_t count_whole(const struct ls_tiles *tiles)
{
    return (tiles->width + SIDE - 1) / SIDE * ((tiles->height + SIDE - 1) / SIDE);
}

static enum ls_err pass_memfd(const struct ls_tiles *tiles, uint32_t n, struct ls_chunk *chunk,
                              Lightstage__FetchReply *body, struct ls_diag *diag)
{
    enum ls_err err = ls_memfd_share(tiles->fd, &chunk->fd, diag);
    chunk->passes = !err;
    body->memfd = true;
    body->memfd_bytes = count_whole(tiles) * tile_bytes(tiles);
    for (uint32_t i = 0; i < n; i++)
        chunk->handed_bytes += tiles->unchanged[tiles->told + i] ? 0 : tile_bytes(tiles);
    return err;
}

static enum ls_err list(struct ls_tiles *tiles, struct ls_chunk *chunk,
                        Lightstage__FetchReply *body, struct ls_diag *diag)
{
    uint32_t known = tiles->next - tiles->told,
             n = tiles->memfds && known > MOST_LISTED ? MOST_LISTED : known;
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

/* ---- what is made for the client ---- */

/* Room for @n rows of tiles, of which those there are keep their place. */
static enum ls_err make_room(struct ls_tiles *tiles, uint32_t n, struct ls_diag *diag)
{
    size_t row = tiles->n_x * tile_bytes(tiles);
    if (n <= tiles->n_rows)
        return LS_OK;
    uint8_t *grown = realloc(tiles->rows, n * row);
    if (!grown)
        return out_of_memory(diag);
    memset(grown + tiles->n_rows * row, 0, (n - tiles->n_rows) * row);
    tiles->rows = grown;
    tiles->n_rows = n;
    return LS_OK;
}

/* One row of pixels into the tiles it crosses; @y: from the first row kept. */
static void spread(struct ls_tiles *tiles, uint32_t y, const uint8_t *row, uint32_t width)
{
    size_t line = SIDE * tiles->pixel_bytes, left = width * tiles->pixel_bytes;
    uint8_t *tile = tiles->rows + (size_t)(y / SIDE) * tiles->n_x * tile_bytes(tiles);
    for (tile += y % SIDE * line; left > 0; tile += tile_bytes(tiles)) {
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
    for (tile += tiles->next % tiles->n_x * tile_bytes(tiles); tiles->next < end;
         tile += tile_bytes(tiles)) {
        if (note(tiles, ls_tile_hash(tile, tile_bytes(tiles))))
            continue;
        if (tile != to)
            memmove(to, tile, tile_bytes(tiles));
        to += tile_bytes(tiles);
    }
    return to;
}

/* The tiles from @from on, closed up at @bytes, go to their places. */
static enum ls_err put_into_memfd(struct ls_tiles *tiles, uint32_t from, const uint8_t *bytes,
                                  struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (!tiles->has_fd)
        err = ls_memfd_create(count_whole(tiles) * tile_bytes(tiles), &tiles->fd, diag);
    tiles->has_fd = !err;
    for (uint32_t i = from; i < tiles->next && !err; i++) {
        if (tiles->unchanged[i])
            continue;
        err = ls_memfd_write(tiles->fd, tiles->number[i] * tile_bytes(tiles), bytes,
                             tile_bytes(tiles), diag);
        bytes += tile_bytes(tiles);
    }
    return err || tiles->next < count(tiles) ? err : ls_memfd_seal(tiles->fd, diag);
}

enum ls_err ls_tiles_tell(struct ls_tiles *tiles, struct ls_chunk *chunk,
                          Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    *there = tiles->next == count(tiles) && tiles->told < tiles->next;
    return *there ? list(tiles, chunk, body, diag) : LS_OK;
}

/* The tiles from @from on are the payload: listed, or gone into the memfd. */
static enum ls_err finish_made(struct ls_tiles *tiles, uint32_t from, struct ls_chunk *chunk,
                               Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    *there = true;
    if (!tiles->memfds)
        return list(tiles, chunk, body, diag);
    enum ls_err err = put_into_memfd(tiles, from, chunk->payload, diag);
    ls_chunk_finish(chunk);
    return err ? err : ls_tiles_tell(tiles, chunk, body, there, diag);
}

enum ls_err ls_tiles_take(struct ls_tiles *tiles, struct ls_chunk *chunk,
                          Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    uint32_t n = complete_rows(tiles), rest = tiles->n_rows - n, from = tiles->next;
    size_t row = tiles->n_x * tile_bytes(tiles);
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
        return out_of_memory(diag);
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
    uint8_t *tile = m->bytes + item * tile_bytes(tiles);
    enum ls_err err = r.width == SIDE && r.height == SIDE ? m->make(m->user, r, tile, diag)
                                                          : make_part(m, r, tile, diag);
    tiles->hash[m->from + item] = err ? 0 : ls_tile_hash(tile, tile_bytes(tiles));
    return err;
}

/* Those that the client has not got move up. Returns their bytes. */
static size_t keep_unknown(struct ls_tiles *tiles, uint32_t n, uint8_t *bytes)
{
    uint8_t *to = bytes;
    for (uint32_t i = 0; i < n; i++, bytes += tile_bytes(tiles)) {
        if (note(tiles, tiles->hash[tiles->next]))
            continue;
        if (bytes != to)
            memcpy(to, bytes, tile_bytes(tiles));
        to += tile_bytes(tiles);
    }
    return n * tile_bytes(tiles) - (size_t)(bytes - to);
}

enum ls_err ls_tiles_make(struct ls_tiles *tiles, const struct ls_crew *crew, ls_tiles_maker *make,
                          void *user, struct ls_chunk *chunk, Lightstage__FetchReply *body,
                          bool *there, struct ls_diag *diag)
{
    size_t most = MADE_BYTES / tile_bytes(tiles), left = count(tiles) - tiles->next;
    uint32_t n = (uint32_t)(most < left ? most : left);
    enum ls_err err = ls_tiles_tell(tiles, chunk, body, there, diag);
    if (err || *there)
        return err;
    struct making making = {tiles, make, user, tiles->next, malloc(n * tile_bytes(tiles))};
    if (!making.bytes)
        return out_of_memory(diag);
    chunk->payload = making.bytes;
    err = ls_crew_run(crew, n, make_one, &making, diag);
    if (err)
        return err;
    chunk->payload_bytes = keep_unknown(tiles, n, making.bytes);
    return finish_made(tiles, making.from, chunk, body, there, diag);
}

/* ---- what is stored ---- */

struct lent_tiles {
    struct ls_lent lent;
    struct ls_tiles_holder holder;
    uint8_t *padded; /* tiles at the picture's edges */
    struct iovec span[];
};

static void give_back(struct ls_lent *lent)
{
    struct lent_tiles *self = (struct lent_tiles *)lent;
    self->holder.release(self->holder.owner, self->holder.what);
    free(self->padded);
    free(self);
}

static size_t count_edges(const struct ls_tiles *tiles, const struct ls_picture_map *map,
                          uint32_t end)
{
    size_t n = 0;
    for (uint32_t i = tiles->next; i < end; i++)
        n += !ls_picture_map_tile_is_whole(map, tiles->number[i]);
    return n;
}

/* Spans of what the client has not got, until they are enough. */
static void fill(struct ls_tiles *tiles, const struct ls_picture_map *map,
                 struct ls_tile_hashes *hashes, uint32_t end, struct lent_tiles *self)
{
    uint8_t *room = self->padded;
    while (tiles->next < end && self->lent.n_bytes < LENT_BYTES) {
        uint32_t number = tiles->number[tiles->next];
        bool whole = ls_picture_map_tile_is_whole(map, number);
        uint64_t hash = ls_tile_hashes_get(hashes, number);
        const uint8_t *bytes = ls_picture_map_tile(map, number, room);
        if (!hash)
            hash = ls_tile_hash(bytes, tile_bytes(tiles));
        if (ls_picture_map_sound(map))
            ls_tile_hashes_note(hashes, number, hash);
        if (note(tiles, hash))
            continue;
        room += whole ? 0 : tile_bytes(tiles);
        self->span[self->lent.n_spans++] = (struct iovec){(void *)bytes, tile_bytes(tiles)};
        self->lent.n_bytes += tile_bytes(tiles);
    }
}

static void note_all(struct ls_tiles *tiles, const struct ls_picture_map *map,
                     struct ls_tile_hashes *hashes)
{
    uint8_t room[2 * SIDE * SIDE];
    while (tiles->next < count(tiles)) {
        uint32_t number = tiles->number[tiles->next];
        uint64_t hash = ls_tile_hashes_get(hashes, number);
        if (!hash)
            hash = ls_tile_hash(ls_picture_map_tile(map, number, room), sizeof room);
        if (ls_picture_map_sound(map))
            ls_tile_hashes_note(hashes, number, hash);
        note(tiles, hash);
    }
}

static enum ls_err hand_over(struct ls_tiles *tiles, const struct ls_picture_map *map,
                             struct ls_chunk *chunk, Lightstage__FetchReply *body,
                             struct ls_diag *diag)
{
    enum ls_err err = tiles->has_fd ? LS_OK : ls_memfds_get(tiles->memfds, map, &tiles->fd, diag);
    if (err)
        return err;
    tiles->has_fd = true;
    struct ls_tile_hashes *hashes = ls_stored_tiles_get(tiles->stored, map);
    note_all(tiles, map, hashes);
    ls_tile_hashes_put(hashes);
    return list(tiles, chunk, body, diag);
}

enum ls_err ls_tiles_lend(struct ls_tiles *tiles, const struct ls_picture_map *map,
                          const struct ls_tiles_holder *holder, struct ls_chunk *chunk,
                          Lightstage__FetchReply *body, struct ls_diag *diag)
{
    if (tiles->memfds) {
        enum ls_err err = hand_over(tiles, map, chunk, body, diag);
        holder->release(holder->owner, holder->what);
        return err;
    }
    uint32_t left = count(tiles) - tiles->next, most = left < MOST_LISTED ? left : MOST_LISTED;
    size_t n = LENT_BYTES / tile_bytes(tiles);
    size_t edges = count_edges(tiles, map, tiles->next + most);
    struct lent_tiles *self = calloc(1, sizeof *self + n * sizeof *self->span);
    uint8_t *padded = malloc((edges < n ? edges : n) * tile_bytes(tiles) + tile_bytes(tiles));
    struct ls_tile_hashes *hashes = ls_stored_tiles_get(tiles->stored, map);
    if (!self || !padded) {
        ls_tile_hashes_put(hashes);
        free(self);
        free(padded);
        holder->release(holder->owner, holder->what);
        return out_of_memory(diag);
    }
    *self = (struct lent_tiles){
        .lent = {.spans = self->span, .give_back = give_back}, .holder = *holder, .padded = padded};
    fill(tiles, map, hashes, tiles->next + most, self);
    ls_tile_hashes_put(hashes);
    chunk->lent = &self->lent;
    return list(tiles, chunk, body, diag);
}

/* What is stored. */
#include "daemon/tiles_private.h"

#include <stdlib.h>

enum { SIDE = LS_EXR_TILE_PX, LENT_BYTES = 1 << 20 };

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

/* Of the next tile, 0 if it is left out; it goes to @room, if it has to be looked at and is cut. */
static uint64_t hash_of(struct ls_tiles *tiles, const struct ls_picture_map *map,
                        struct ls_tile_hashes *hashes, uint8_t *room)
{
    uint32_t i = tiles->next, number = tiles->number[i];
    bool judged = tiles->max_error == 0 || tiles->bounds.most;
    if (ls_tiles_leaves_out(tiles, i))
        return 0;
    uint64_t hash = judged ? ls_tile_hashes_get(hashes, number) : 0;
    if (hash)
        return hash;
    hash = ls_tiles_hash(tiles, i, ls_picture_map_tile(map, number, room));
    if (hash && ls_picture_map_sound(map))
        ls_tile_hashes_note(hashes, number, hash);
    return hash;
}

/* Spans of what is sent, until they are enough. */
static void fill(struct ls_tiles *tiles, const struct ls_picture_map *map,
                 struct ls_tile_hashes *hashes, uint32_t end, struct lent_tiles *self)
{
    uint8_t *room = self->padded;
    while (tiles->next < end && self->lent.n_bytes < LENT_BYTES) {
        uint32_t number = tiles->number[tiles->next];
        if (ls_tiles_note(tiles, hash_of(tiles, map, hashes, room)))
            continue;
        const uint8_t *bytes = ls_picture_map_tile(map, number, room);
        room += ls_picture_map_tile_is_whole(map, number) ? 0 : ls_tiles_tile_bytes(tiles);
        self->span[self->lent.n_spans++] =
            (struct iovec){(void *)bytes, ls_tiles_tile_bytes(tiles)};
        self->lent.n_bytes += ls_tiles_tile_bytes(tiles);
    }
}

static void note_all(struct ls_tiles *tiles, const struct ls_picture_map *map,
                     struct ls_tile_hashes *hashes)
{
    uint8_t room[2 * SIDE * SIDE];
    while (tiles->next < ls_tiles_count(tiles))
        ls_tiles_note(tiles, hash_of(tiles, map, hashes, room));
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
    return ls_tiles_list(tiles, chunk, body, diag);
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
    uint32_t left = ls_tiles_count(tiles) - tiles->next,
             most = left < LS_TILES_MOST_LISTED ? left : LS_TILES_MOST_LISTED;
    size_t n = LENT_BYTES / ls_tiles_tile_bytes(tiles);
    size_t edges = count_edges(tiles, map, tiles->next + most);
    struct lent_tiles *self = calloc(1, sizeof *self + n * sizeof *self->span);
    uint8_t *padded =
        malloc((edges < n ? edges : n) * ls_tiles_tile_bytes(tiles) + ls_tiles_tile_bytes(tiles));
    struct ls_tile_hashes *hashes = ls_stored_tiles_get(tiles->stored, map);
    if (!self || !padded) {
        ls_tile_hashes_put(hashes);
        free(self);
        free(padded);
        holder->release(holder->owner, holder->what);
        return ls_tiles_out_of_memory(diag);
    }
    *self = (struct lent_tiles){
        .lent = {.spans = self->span, .give_back = give_back}, .holder = *holder, .padded = padded};
    fill(tiles, map, hashes, tiles->next + most, self);
    ls_tile_hashes_put(hashes);
    chunk->lent = &self->lent;
    return ls_tiles_list(tiles, chunk, body, diag);
}

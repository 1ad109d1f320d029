/*
 * stored_tiles: the hashes of stored pictures' tiles, once each.
 * Layer: daemon. Threads: any. Ownership: the cache keeps those asked for last, a number of bytes;
 * every get is matched by a put.
 */
#ifndef LS_DAEMON_STORED_TILES_H
#define LS_DAEMON_STORED_TILES_H

#include "daemon/picture_map.h"

#include <stddef.h>
#include <stdint.h>

/** XXH3, 64 bit, of a tile's bytes as they are sent; 1 in place of 0, which says "none". */
uint64_t ls_tile_hash(const void *tile, size_t bytes);

struct ls_stored_tiles;

/** For hashes of up to @max_bytes, 8 for each tile. (transfer full). */
struct ls_stored_tiles *ls_stored_tiles_create(size_t max_bytes);

/** Nobody holds hashes any more. NULL is allowed. */
void ls_stored_tiles_destroy(struct ls_stored_tiles *stored);

/** Of one picture. */
struct ls_tile_hashes;

/** What is known of the file that is mapped. @stored NULL: nothing, and it is not kept. */
struct ls_tile_hashes *ls_stored_tiles_get(struct ls_stored_tiles *stored,
                                           const struct ls_picture_map *map);
void ls_tile_hashes_put(struct ls_tile_hashes *hashes);

/** Of tile @number; 0 = not known yet. */
uint64_t ls_tile_hashes_get(const struct ls_tile_hashes *hashes, uint32_t number);

/** Remember it; only what was read of a sound map (ls_picture_map_sound). */
void ls_tile_hashes_note(struct ls_tile_hashes *hashes, uint32_t number, uint64_t hash);

#endif

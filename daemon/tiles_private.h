/*
 * tiles_private: what the ways in which tiles come share: tiles.c (which, and how they are listed),
 * tiles_made.c (made for the client), tiles_lent.c (as they are stored), tiles_left_out.c (not at
 * all).
 * Layer: daemon. Threads: one at a time per object. Ownership: tiles.h.
 */
#ifndef LS_DAEMON_TILES_PRIVATE_H
#define LS_DAEMON_TILES_PRIVATE_H

#include "daemon/tiles.h"

enum { LS_TILES_MOST_LISTED = 4096 }; /* in a frame without their bytes */

/** Returns LS_ERR_NOMEM. */
enum ls_err ls_tiles_out_of_memory(struct ls_diag *diag);

/** How many are asked for of the picture at hand; how many it has. */
uint32_t ls_tiles_count(const struct ls_tiles *tiles);
uint32_t ls_tiles_count_whole(const struct ls_tiles *tiles);

/** Bytes of one. */
size_t ls_tiles_tile_bytes(const struct ls_tiles *tiles);

/** The next tile has this hash, and is known from now on: must it not be sent? 0: it is left out.
 */
bool ls_tiles_note(struct ls_tiles *tiles, uint64_t hash);

/** Of those known, and of this picture. */
bool ls_tiles_is_sent(const struct ls_tiles *tiles, uint32_t i);

/** May tile @i of the picture be left out, by what is known before it is made? Then its hash is 0.
 * Any thread, for each tile one. */
bool ls_tiles_leaves_out(struct ls_tiles *tiles, uint32_t i);

/** The hash of tile @i, which lies at @bytes of any alignment: 0 if it is left out. Any thread, for
 * each tile one. */
uint64_t ls_tiles_hash(struct ls_tiles *tiles, uint32_t i, const uint8_t *bytes);

/** Those known and not yet listed go into @body, with a memfd as many as a frame has room for; the
 * memfd goes with @chunk. Errors: those of ls_memfd_share. */
LS_MUST_CHECK enum ls_err ls_tiles_list(struct ls_tiles *tiles, struct ls_chunk *chunk,
                                        Lightstage__FetchReply *body, struct ls_diag *diag);

#endif

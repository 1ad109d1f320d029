/*
 * tiles: fetched pictures in tiles of 64 x 64 pixels: which come next, and which the client has.
 * Layer: daemon. Threads: one at a time per object. Ownership: embedded in a job; finish frees.
 *
 * A tile is [64][64][components]; what lies beyond the picture is 0. It is told by its number in
 * the picture, row by row from the top left, and by the XXH3 hash, 64 bit, of its bytes (1 in place
 * of 0). Tiles of a request are counted from 0 through all of its pictures, of each those that its
 * region touches. Under a max_error, those of which no sample is farther from 0 do not come, and
 * have the hash 0; what is no number counts as 0 there.
 */
#ifndef LS_DAEMON_TILES_H
#define LS_DAEMON_TILES_H

#include "core/demosaic.h"
#include "core/error.h"
#include "daemon/crew.h"
#include "daemon/memfds.h"
#include "daemon/outbox.h"
#include "daemon/picture_map.h"
#include "daemon/stored_tiles.h"
#include "proto/lightstage.pb-c.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** What is known of the tiles of a picture beside their bytes; both are called by any thread. */
struct ls_tiles_bounds {
    /** No |sample| of tile @number is larger, told before it is made. NULL: nobody knows. */
    double (*most)(const void *user, uint32_t number);
    /** What the client is off by, if it lacks a tile whose largest |sample| is @most. NULL: @most.
     */
    double (*off)(const void *user, uint32_t number, double most);
    const void *user;
};

struct ls_tiles {
    bool wanted, half;
    double max_error, error_bound;  /* error_bound: of all that were left out so far */
    struct ls_stored_tiles *stored; /* the service's; NULL: nothing is kept */
    struct ls_memfds *memfds;       /* asked for; else NULL */
    uint64_t *have;                 /* [n_have] hashes of the request's tiles, 0 = none */
    size_t n_have;
    uint64_t first;

    /* the picture at hand */
    uint32_t width, height;    /* px, whole */
    uint32_t x0, y0, n_x, n_y; /* what is asked of it, in tiles */
    size_t pixel_bytes;
    uint64_t begun;      /* number, through the request, of its first tile */
    uint32_t next, told; /* of its tiles: known up to, listed up to */
    uint32_t *number;    /* [n_x * n_y] */
    uint64_t *hash;
    protobuf_c_boolean *unchanged;
    struct ls_tiles_bounds bounds; /* the job's, after begin; zeroed: nothing is known */
    double *off;                   /* of those that are left out; NULL without max_error */
    bool has_fd;
    int fd;                  /* memfd of the picture; sealed once all of it is known */
    uint8_t *rows;           /* [n_rows][n_x] tiles, from the row of `next` on */
    uint32_t n_rows, filled; /* rows of tiles there is room for, of pixels that are there */
};

/** What @fetch asks for; its payload is @n bytes of hashes. Errors: LS_ERR_INVALID (half a hash,
 * hashes or max_error without tiles, a memfd without credit, a max_error that is none),
 * LS_ERR_UNSUPPORTED (tiles with variance or validity; a memfd, and @memfds is NULL), LS_ERR_NOMEM.
 * @out: finish it. */
LS_MUST_CHECK enum ls_err ls_tiles_read(const Lightstage__Fetch *fetch, const uint8_t *payload,
                                        size_t n, struct ls_stored_tiles *stored,
                                        struct ls_memfds *memfds, struct ls_tiles *out,
                                        struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_tiles_finish(struct ls_tiles *tiles);

/** The next picture, of @width x @height and @pixel_bytes, of which *region is wanted. *region
 * becomes what must be read for its tiles: of no height where all come before the first that is
 * asked for, and the picture is done with. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_tiles_begin(struct ls_tiles *tiles, uint32_t width, uint32_t height,
                                         size_t pixel_bytes, struct ls_demosaic_region *region,
                                         struct ls_diag *diag);

/** Is every tile of the picture told? */
bool ls_tiles_end(const struct ls_tiles *tiles);

/** The next rows of the region, as they are sent: [band.height][band.width] pixels. LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_tiles_add(struct ls_tiles *tiles, struct ls_demosaic_region band,
                                       const void *values, struct ls_diag *diag);

/** Put the tiles that are complete into the payload of @chunk, unless the client has them, and list
 * them in @body, which points into @tiles; or, asked for a memfd, put them there, and list them
 * when the picture is complete. *there: some are listed. Errors: those of daemon/memfds.h. */
LS_MUST_CHECK enum ls_err ls_tiles_take(struct ls_tiles *tiles, struct ls_chunk *chunk,
                                        Lightstage__FetchReply *body, bool *there,
                                        struct ls_diag *diag);

/** List more of a complete picture whose list one frame does not hold: only a memfd's. *there:
 * there was more. Errors: those of ls_memfd_share. */
LS_MUST_CHECK enum ls_err ls_tiles_tell(struct ls_tiles *tiles, struct ls_chunk *chunk,
                                        Lightstage__FetchReply *body, bool *there,
                                        struct ls_diag *diag);

/** Fill out[region.height][region.width] with the pixels of @region, which lies inside one tile, as
 * they are sent. Several threads at once. */
typedef enum ls_err ls_tiles_maker(void *user, struct ls_demosaic_region region, uint8_t *out,
                                   struct ls_diag *diag);

/** The next tiles, about 3 MiB, each made by itself, by a crew: in place of add and take. *there
 * and errors: as ls_tiles_take; those of @make. */
LS_MUST_CHECK enum ls_err ls_tiles_make(struct ls_tiles *tiles, const struct ls_crew *crew,
                                        ls_tiles_maker *make, void *user, struct ls_chunk *chunk,
                                        Lightstage__FetchReply *body, bool *there,
                                        struct ls_diag *diag);

/** Who holds a mapped picture until what is lent of it is written. */
struct ls_tiles_holder {
    void (*release)(void *owner, void *what); /* any thread */
    void *owner, *what;
};

/**
 * The next tiles of a picture that is sent as it is stored: lent from @map, in place of add and
 * take; or handed over in a memfd. About 1 MiB, or a list of at most 4096. @holder is released when
 * they are written, or on an error. LS_ERR_INVALID: the file cannot be read; LS_ERR_NOMEM; those of
 * ls_memfds_get.
 * A file that is cut short after that ends the connection: its frame has begun. */
LS_MUST_CHECK enum ls_err ls_tiles_lend(struct ls_tiles *tiles, const struct ls_picture_map *map,
                                        const struct ls_tiles_holder *holder,
                                        struct ls_chunk *chunk, Lightstage__FetchReply *body,
                                        struct ls_diag *diag);

#endif

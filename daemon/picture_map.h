/*
 * picture_map: one published picture, mapped read-only, its tiles in place.
 * Layer: daemon. Threads: opened by one, then read-only, any. Ownership: unmapped by finish; the
 * descriptor is closed as soon as the file is mapped (Modbus selects: they must stay few).
 */
#ifndef LS_DAEMON_PICTURE_MAP_H
#define LS_DAEMON_PICTURE_MAP_H

#include "core/error.h"
#include "core/exr.h"
#include "daemon/map_guard.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** Which file, and which state of it. No padding: compared byte for byte. */
struct ls_picture_id {
    uint64_t device, inode, bytes;
    int64_t changed_ns;
};

struct ls_picture_map {
    char *path;
    void *base;
    size_t bytes;
    struct ls_exr_tiles tiles;
    struct ls_picture_id id;
    struct ls_map_guard guard; /* must not move once open */
};

/**
 * Map @folder/@file, which must be a picture of @width x @height halves in 64 x 64 tiles. Errors:
 * LS_ERR_INVALID (gone, unreadable or not what was published: the take is damaged), LS_ERR_OS,
 * those of ls_exr_map_tiles.
 */
LS_MUST_CHECK enum ls_err ls_picture_map_open(struct ls_picture_map *map, const char *folder,
                                              const char *file, uint32_t width, uint32_t height,
                                              struct ls_diag *diag);

/** Could all that was read so far be read? False once a page was missing under the mapping (the
 * file was cut short, the disk failed): zeros were read in its place. */
bool ls_picture_map_sound(const struct ls_picture_map *map);

/** Is the file still there, as long as when it was mapped? Looks at the folder, not at the pages:
 * it also sees a file cut within its last page. */
bool ls_picture_map_whole(const struct ls_picture_map *map);

/** Copy pixels [x, x + width) x [y, y + height), inside the picture, times @gain. Row stride
 * @width. */
void ls_picture_map_read(const struct ls_picture_map *map, uint32_t x, uint32_t y, uint32_t width,
                         uint32_t height, float gain, float *out);

/** As ls_picture_map_read, the stored bits. */
void ls_picture_map_read_half(const struct ls_picture_map *map, uint32_t x, uint32_t y,
                              uint32_t width, uint32_t height, uint16_t *out);

/** Is tile @number 64 x 64 pixels, not cut at the picture's edge? */
bool ls_picture_map_tile_is_whole(const struct ls_picture_map *map, uint32_t number);

/** The halves [64][64] of a tile, 0 beyond the picture: in place (any alignment) where it is whole,
 * else in @room. */
const uint8_t *ls_picture_map_tile(const struct ls_picture_map *map, uint32_t number,
                                   uint8_t *room);

/** The validity (core/merge.h) of the same pixels, a byte each: all ok where the file has no such
 * part. LS_ERR_INVALID: it is not of this picture, or its values are no validity; LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_picture_map_validity(const struct ls_picture_map *map, uint32_t x,
                                                  uint32_t y, uint32_t width, uint32_t height,
                                                  uint8_t *out, struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_picture_map_finish(struct ls_picture_map *map);

#endif

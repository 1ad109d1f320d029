/*
 * exr: OpenEXR files as spans of bytes: write what a take holds, read what people bring, map tiles.
 * Layer: core (OpenEXR's C library through its stream callbacks; no descriptors). Threads: any,
 * every call has its own context. Ownership: stated per call; byte spans given are never kept
 * except by ls_exr_map_tiles, which points into them.
 *
 * Written files: uncompressed unless a part is packed, 64 x 64 tiles, one level, increasing y, one
 * or several parts. A tile's pixels lie together, row after row, little-endian; edge tiles are
 * narrower or lower and carry no padding. Values pass through unchanged: negative ones too.
 */
#ifndef LS_CORE_EXR_H
#define LS_CORE_EXR_H

#include "core/error.h"
#include "core/image.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { LS_EXR_TILE_PX = 64 };

/** How a sample is stored in the file. */
enum ls_exr_type { LS_EXR_HALF, LS_EXR_FLOAT };

/** How a sample lies in the caller's memory. */
enum ls_exr_from {
    LS_EXR_FROM_HALF,  /* uint16_t, IEEE binary16 bits */
    LS_EXR_FROM_FLOAT, /* float; to half rounds to nearest even, past 65504 to infinity */
    LS_EXR_FROM_U8,    /* uint8_t, stored as its number: exact in half */
};

/* ---- attributes ---- */

enum ls_exr_attr_kind {
    LS_EXR_ATTR_STRING,
    LS_EXR_ATTR_INT,
    LS_EXR_ATTR_FLOAT,
    LS_EXR_ATTR_V2F,
    LS_EXR_ATTR_V3F,
    LS_EXR_ATTR_M44F,           /* row-major, for row vectors as OpenEXR has it */
    LS_EXR_ATTR_CHROMATICITIES, /* red x y, green x y, blue x y, white x y */
    LS_EXR_ATTR_TIMECODE,       /* SMPTE 12M time-and-flags word, user word */
};

struct ls_exr_attr {
    char name[64];
    enum ls_exr_attr_kind kind;
    char *text;     /* STRING */
    int32_t i;      /* INT */
    float f[16];    /* FLOAT 1, V2F 2, V3F 3, CHROMATICITIES 8, M44F 16 of them */
    uint32_t tc[2]; /* TIMECODE */
};

/** A list of attributes in the order they were set. Zero-initialise. Errors of the setters are
 * kept in `err` and returned by ls_exr_write, so a list is filled without checks. */
struct ls_exr_attrs {
    struct ls_exr_attr *items;
    size_t n, capacity;
    enum ls_err err;
    char err_name[64]; /* the attribute that could not be set */
};

/** Set an attribute; the same name again replaces it. Names: 1 to 31 characters, no control
 * characters; else `err` = LS_ERR_INVALID. Values are copied. */
void ls_exr_attrs_string(struct ls_exr_attrs *attrs, const char *name, const char *value);
void ls_exr_attrs_int(struct ls_exr_attrs *attrs, const char *name, int32_t value);
void ls_exr_attrs_float(struct ls_exr_attrs *attrs, const char *name, float value);
void ls_exr_attrs_v2f(struct ls_exr_attrs *attrs, const char *name, const float value[2]);
void ls_exr_attrs_v3f(struct ls_exr_attrs *attrs, const char *name, const float value[3]);
void ls_exr_attrs_m44f(struct ls_exr_attrs *attrs, const char *name, const float value[16]);
void ls_exr_attrs_chromaticities(struct ls_exr_attrs *attrs, const char *name,
                                 const float value[8]);
void ls_exr_attrs_timecode(struct ls_exr_attrs *attrs, const char *name, uint32_t time_and_flags,
                           uint32_t user);

/** NULL if absent. (transfer none). */
const struct ls_exr_attr *ls_exr_attrs_find(const struct ls_exr_attrs *attrs, const char *name);

/** Free and zero. Zeroed lists are allowed. */
void ls_exr_attrs_finish(struct ls_exr_attrs *attrs);

/* ---- writing ---- */

/** One channel of a part, in any order; OpenEXR's alphabetical order is made on writing. */
struct ls_exr_channel {
    const char *name; /* "Y", "R", "white.R" */
    enum ls_exr_type type;
    enum ls_exr_from source;
    const void *pixels;        /* of the top left pixel */
    size_t pixel_stride_bytes; /* to the next pixel of a row, e.g. 12 for interleaved RGB floats */
    size_t row_stride_bytes;
};

struct ls_exr_part {
    const char *name; /* mandatory and unique with several parts, else NULL is allowed */
    uint32_t width, height;
    int32_t x, y; /* top left of the data window; its region of a larger picture */
    uint32_t display_width, display_height; /* of the whole picture; 0 x 0 = width x height.
                                               The same in every part */
    const struct ls_exr_channel *channels;
    size_t n_channels;
    const struct ls_exr_attrs *attrs; /* NULL = none */
    bool packed;                      /* each tile losslessly compressed (ZIP), bit for bit */
};

/**
 * Write a whole file into memory. *bytes: (transfer full), free(). Errors: LS_ERR_INVALID (sizes,
 * names, attributes), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_exr_write(const struct ls_exr_part *parts, size_t n_parts,
                                       uint8_t **bytes, size_t *n_bytes, struct ls_diag *diag);

/** A mosaic as takes store it: exactly one of half and floats is given. */
struct ls_exr_mosaic {
    uint32_t width, height;
    const uint16_t *half;    /* (height, width), or NULL */
    const float *floats;     /* (height, width), or NULL */
    const uint8_t *validity; /* (height, width), 0 ok 1 saturated 2 dark 3 gap; NULL = all ok */
    const struct ls_exr_attrs *attrs; /* of the first part; NULL = none */
};

/**
 * First part "mosaic", channel Y; second part "validity", channel Y as half, only if @validity has
 * a value other than 0. Else as ls_exr_write.
 */
LS_MUST_CHECK enum ls_err ls_exr_write_mosaic(const struct ls_exr_mosaic *mosaic, uint8_t **bytes,
                                              size_t *n_bytes, struct ls_diag *diag);

/**
 * The same bytes into the caller's memory. Errors as before; LS_ERR_NOMEM also if @capacity is less
 * than they need, which ls_exr_mosaic_room is not.
 */
LS_MUST_CHECK enum ls_err ls_exr_write_mosaic_to(const struct ls_exr_mosaic *mosaic, uint8_t *bytes,
                                                 size_t capacity, size_t *n_bytes,
                                                 struct ls_diag *diag);

/** An upper bound of this mosaic's file in bytes, attributes up to 16 KiB. RT-safe. */
uint64_t ls_exr_mosaic_room(const struct ls_exr_mosaic *mosaic);

/**
 * An interleaved picture of 1 (Y) or 3 (R G B) channels as one part. @type: how it is stored.
 */
LS_MUST_CHECK enum ls_err ls_exr_write_image(const struct ls_image *image, enum ls_exr_type type,
                                             const struct ls_exr_attrs *attrs, uint8_t **bytes,
                                             size_t *n_bytes, struct ls_diag *diag);

/** An upper bound of a mosaic file's size in bytes, validity part included, attributes up to
 * 16 KiB. RT-safe. */
uint64_t ls_exr_mosaic_bytes_max(uint32_t width, uint32_t height, enum ls_exr_type type);

/* ---- reading ---- */

/**
 * Read R G B or Y as floats from any scanline or tiled file (one or several parts; NONE, RLE, ZIPS,
 * ZIP, PIZ, PXR24, B44, B44A; half, float or uint).
 *
 * @layer: NULL = the first part that has R G B, else Y, else a single channel of any name; "x" =
 * channels x.R x.G x.B, else x.Y, else the part named "x". The picture is the data window; of a
 * tiled file with levels, the full resolution.
 * @limit_bytes: most memory for pixels and working buffers together.
 * @attrs: filled with the part's attributes of the kinds above; may be NULL; finish it.
 *
 * Refused with a sentence: DWAA and DWAB, deep data, luminance-chroma and other subsampling, an
 * `envmap` that is a cube, an `Orientation` or `EXPOSURE` other than 1 (LS_ERR_UNSUPPORTED);
 * anything truncated or inconsistent (LS_ERR_INVALID); too large (LS_ERR_LIMIT); a layer that is
 * not there (LS_ERR_NOT_FOUND). Infinities and NaN pass through. @image: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_exr_read(const void *bytes, size_t n_bytes, const char *layer,
                                      size_t limit_bytes, struct ls_image *image,
                                      struct ls_exr_attrs *attrs, struct ls_diag *diag);

/** One single-channel part as stored, without conversion. */
struct ls_exr_plane {
    uint32_t width, height;
    enum ls_exr_type type;
    void *samples; /* (height, width) of uint16_t half bits or float */
};

/**
 * Read a part's only channel bit for bit, whatever its layout and compression. @part: name, or
 * NULL = the first. Limits, refusals and errors as ls_exr_read. plane->samples: (transfer full),
 * free().
 */
LS_MUST_CHECK enum ls_err ls_exr_read_plane(const void *bytes, size_t n_bytes, const char *part,
                                            size_t limit_bytes, struct ls_exr_plane *plane,
                                            struct ls_diag *diag);

/* ---- mapping ---- */

/** The tiles of one single-channel uncompressed part, in place. */
struct ls_exr_tiles {
    uint32_t width, height;  /* px */
    uint32_t tile_w, tile_h; /* px, of a full tile */
    uint32_t n_x, n_y;       /* tiles across and down */
    enum ls_exr_type type;
    const uint8_t **tile; /* n_y * n_x pointers, row-major. Unaligned! Each points at
                             rows of ls_exr_tile_width pixels without padding */
};

/**
 * Point at every tile's pixels inside the file @bytes, which must outlive @tiles. Every pointer
 * and its tile's whole length have been checked to lie inside the span and not to overlap.
 * @part: name, or NULL = the first. Errors: LS_ERR_NOT_FOUND (no such part), LS_ERR_UNSUPPORTED
 * (compressed, scanlines, levels, more than one channel), LS_ERR_INVALID (truncated,
 * inconsistent), LS_ERR_NOMEM. @tiles: finish it.
 */
LS_MUST_CHECK enum ls_err ls_exr_map_tiles(const void *bytes, size_t n_bytes, const char *part,
                                           struct ls_exr_tiles *tiles, struct ls_diag *diag);

/** Pixels across tile column @tx, down tile row @ty. RT-safe. */
static inline uint32_t ls_exr_tile_width(const struct ls_exr_tiles *tiles, uint32_t tx)
{
    uint32_t left = tiles->width - tx * tiles->tile_w;
    return left < tiles->tile_w ? left : tiles->tile_w;
}

static inline uint32_t ls_exr_tile_height(const struct ls_exr_tiles *tiles, uint32_t ty)
{
    uint32_t left = tiles->height - ty * tiles->tile_h;
    return left < tiles->tile_h ? left : tiles->tile_h;
}

/** Free the pointers, not the span. Zeroed is allowed. */
void ls_exr_tiles_finish(struct ls_exr_tiles *tiles);

#endif

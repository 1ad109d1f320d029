/*
 * exr_source: an OpenEXR file in memory, opened for reading with every limit set.
 * Layer: core, internal to the exr_* files. Threads: one per source. Ownership: the span stays the
 * caller's and outlives the source; the source must not move while it is open.
 */
#ifndef LS_CORE_EXR_SOURCE_H
#define LS_CORE_EXR_SOURCE_H

#include "core/exr.h"

#include <OpenEXR/openexr.h>

enum { LS_EXR_MAX_PX = 65536 };

struct ls_exr_source {
    exr_context_t context;
    const uint8_t *bytes;
    size_t n;
    char message[256]; /* what the library said last */
};

/** The window and layout of one part. */
struct ls_exr_layout {
    int32_t x, y; /* of the data window's top left */
    uint32_t width, height;
    exr_compression_t compression;
    uint32_t tiled;                    /* 1 = tiles, 0 = scanlines */
    uint32_t tile_w, tile_h;           /* tiled only */
    uint32_t n_levels;                 /* tiled only */
    const exr_attr_chlist_t *channels; /* (transfer none), until close */
};

/** Parse the header. LS_ERR_INVALID if it is not a whole OpenEXR header. */
LS_MUST_CHECK enum ls_err ls_exr_source_open(struct ls_exr_source *source, const void *bytes,
                                             size_t n_bytes, struct ls_diag *diag);

void ls_exr_source_close(struct ls_exr_source *source);

/** Turn a library's result into an error with its sentence. */
enum ls_err ls_exr_source_fail(const struct ls_exr_source *source, exr_result_t result,
                               const char *doing, struct ls_diag *diag);

/** Check and describe a part: deep data LS_ERR_UNSUPPORTED; a window that is empty, absurd, or has
 * more chunks than the file has room for LS_ERR_INVALID. */
LS_MUST_CHECK enum ls_err ls_exr_source_layout(const struct ls_exr_source *source, int part,
                                               struct ls_exr_layout *layout, struct ls_diag *diag);

/** Append the part's attributes of the kinds of ls_exr_attr_kind to @attrs; others, and names
 * longer than 31 characters, are passed over. */
LS_MUST_CHECK enum ls_err ls_exr_source_attrs(const struct ls_exr_source *source, int part,
                                              struct ls_exr_attrs *attrs, struct ls_diag *diag);

/** Set one attribute of a part that is being written. */
exr_result_t ls_exr_attr_put(exr_context_t context, int part, const struct ls_exr_attr *attr);

/** The part of this name, or -1. */
int ls_exr_source_part(const struct ls_exr_source *source, const char *name);

#endif

/*
 * exr_decode: the chunks of one part, decompressed by OpenEXR's library and spread by ourselves.
 * Layer: core, internal to the exr_* files. Threads: one per source. Ownership: everything is the
 * caller's.
 *
 * The library reads and decompresses only. Its unpacking is not used: release 3.1.5 picks a routine
 * by the number of channels in the file and lets it write through the NULL of a channel that nobody
 * asked for (half samples B, G, Y of which Y is read as float).
 */
#ifndef LS_CORE_EXR_DECODE_H
#define LS_CORE_EXR_DECODE_H

#include "core/exr_source.h"

enum { LS_EXR_MAX_PICKED = 3 };

/** What to decode, and where to. The sample of picked channel c of pixel (x, y) goes to
 * pixels + ((y * width + x) * n + c) * ls_exr_sample_bytes(type). */
struct ls_exr_target {
    int part;
    struct ls_exr_layout layout;
    int picked[LS_EXR_MAX_PICKED]; /* indices of the part's channels */
    uint32_t n;                    /* picked ones */
    exr_pixel_type_t type; /* FLOAT: any sample is widened; HALF: the picked ones are half */
    size_t limit_bytes;    /* for working buffers */
    uint8_t *pixels;       /* layout.width * layout.height * n samples */
};

/** Bytes of one sample in a file and in pixels. RT-safe. */
static inline size_t ls_exr_sample_bytes(exr_pixel_type_t type)
{
    return type == EXR_PIXEL_HALF ? 2 : 4;
}

/**
 * Fill @target's pixels. The part's channels are known types without subsampling and its
 * compression is one of those that ls_exr_read names. LS_ERR_INVALID: damaged;
 * LS_ERR_LIMIT: a chunk needs more than the limit; the pixels are then partly filled.
 */
LS_MUST_CHECK enum ls_err ls_exr_decode(const struct ls_exr_source *source,
                                        const struct ls_exr_target *target, struct ls_diag *diag);

#endif

/*
 * exr_part: what the writers of OpenEXR files share: a part declared, its tiles packed.
 * Layer: core, inside the writers only. Threads: one per context. Ownership: the caller's.
 */
#ifndef LS_CORE_EXR_PART_H
#define LS_CORE_EXR_PART_H

#include "core/exr_source.h"

enum { LS_EXR_MAX_CHANNELS = 64 };

/** Bytes of a sample in the file, and of a pixel. */
size_t ls_exr_sample_bytes(enum ls_exr_type type);
size_t ls_exr_part_pixel_bytes(const struct ls_exr_part *part);

/** LS_ERR_INVALID naming what is wrong; the channels' pixels are not looked at. */
LS_MUST_CHECK enum ls_err ls_exr_part_check(const struct ls_exr_part *part, size_t n_parts,
                                            struct ls_diag *diag);

/** An error handler for contexts that write: results say enough, and the library holds the
 * context's lock while it calls, so that nothing can be asked of it. */
void ls_exr_part_quiet(exr_const_context_t context, exr_result_t code, const char *message);

exr_result_t ls_exr_part_declare(exr_context_t context, const struct ls_exr_part *part, int *index);

/** The row of tiles whose first row is @y; the channels' pixels begin at row @from. @tile: room for
 * the bytes of one. */
exr_result_t ls_exr_part_write_row(exr_context_t context, int index, const struct ls_exr_part *part,
                                   uint32_t y, uint32_t from, uint8_t *tile);

#endif

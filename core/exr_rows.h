/*
 * exr_rows: an OpenEXR picture written from top to bottom, as its rows come.
 * Layer: core (no descriptors: bytes go to a callback). Threads: one at a time per picture.
 * Ownership: as stated.
 *
 * The file is what ls_exr_write_image would make of the whole picture: uncompressed, 64 x 64 tiles.
 * Memory: 64 rows.
 */
#ifndef LS_CORE_EXR_ROWS_H
#define LS_CORE_EXR_ROWS_H

#include "core/exr.h"

#include <stdbool.h>

struct ls_exr_rows;

/** Put @n bytes at @offset of the file; backwards, too. false: it cannot be, and who is called
 * knows why. */
typedef bool ls_exr_put(void *user, const void *bytes, size_t n, uint64_t offset);

struct ls_exr_rows_of {
    uint32_t width, height, n_channels; /* 1: Y, 3: R G B */
    int32_t x, y;                       /* as of struct ls_exr_part */
    uint32_t display_width, display_height;
    enum ls_exr_type type;
    const struct ls_exr_attrs *attrs; /* read by begin alone; NULL = none */
    ls_exr_put *put;
    void *user;
};

/** Write the header. *out: (transfer full). Errors: LS_ERR_INVALID (sizes, attributes, put said
 * no), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_exr_rows_begin(const struct ls_exr_rows_of *of,
                                            struct ls_exr_rows **out, struct ls_diag *diag);

/** The next rows, pixels[n_rows][width][n_channels]. Errors: LS_ERR_INVALID (more than there are,
 * put said no). */
LS_MUST_CHECK enum ls_err ls_exr_rows_add(struct ls_exr_rows *rows, const float *pixels,
                                          uint32_t n_rows, struct ls_diag *diag);

/** All rows are there: the file is whole after this. Errors: LS_ERR_INVALID (rows are missing, put
 * said no). */
LS_MUST_CHECK enum ls_err ls_exr_rows_end(struct ls_exr_rows *rows, struct ls_diag *diag);

/** At any time; NULL is allowed. */
void ls_exr_rows_destroy(struct ls_exr_rows *rows);

#endif

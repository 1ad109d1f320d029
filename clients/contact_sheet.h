/*
 * contact_sheet: a small picture of each light, numbered, in one PNG to look at.
 * Layer: clients. Threads: the main thread. Ownership: owns its pixels; finish it.
 *
 * Rows from left to right in the order in which pictures are added, each with its light's number
 * below. All have one exposure, by which the 99th percentile of their largest channel becomes 0.8
 * before the sRGB curve: brighter lights are brighter here, too. A pixel is the mean of bin x bin
 * ones; there are at most 128 pixels to a side, and fewer where the sheet would exceed 2^24.
 */
#ifndef LS_CLIENTS_CONTACT_SHEET_H
#define LS_CLIENTS_CONTACT_SHEET_H

#include "core/error.h"
#include "core/image.h"

#include <stddef.h>
#include <stdint.h>

struct ls_contact_sheet {
    size_t n, added;        /* pictures, and how many are there */
    const double (*m)[3];   /* what takes their colours to Rec. 709; NULL: nothing, or none known */
    uint32_t *lights;       /* [n] */
    struct ls_image image;  /* nothing before the first picture */
    uint32_t columns, rows; /* cells */
    uint32_t bin;
    uint32_t width, height;           /* px, of a small picture */
    uint32_t cell_width, cell_height; /* px, with number and gaps */
};

/** @n: >= 1. @m outlives the sheet. LS_ERR_NOMEM. @sheet: finish it in any case. */
LS_MUST_CHECK enum ls_err ls_contact_sheet_begin(struct ls_contact_sheet *sheet, size_t n,
                                                 const double (*m)[3], struct ls_diag *diag);

/** The next picture; all are of one size. LS_ERR_INVALID (another size, one too many),
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_contact_sheet_add(struct ls_contact_sheet *sheet,
                                               const struct ls_image *picture, uint32_t light,
                                               struct ls_diag *diag);

/** Number and write. *scale: what linear values have been multiplied by. Errors: those of
 * ls_picture_file_png. */
LS_MUST_CHECK enum ls_err ls_contact_sheet_write(struct ls_contact_sheet *sheet, const char *path,
                                                 float *scale, struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_contact_sheet_finish(struct ls_contact_sheet *sheet);

#endif

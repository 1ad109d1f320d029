/*
 * picture_sums: a stored mosaic in brief, and how far the light of two pictures of the same scene
 * differs.
 * Layer: core. Threads: any. Ownership: finish frees the blocks.
 *
 * The picture is cut into at most LS_SUMS_GRID x LS_SUMS_GRID blocks. Per block and colour of the
 * filter (R G B, or the one of a mono sensor) stands the sum of the stored values, and whether a
 * pixel of it was saturated or in a gap of the bracket, which no sum can stand for.
 */
#ifndef LS_CORE_PICTURE_SUMS_H
#define LS_CORE_PICTURE_SUMS_H

#include "core/error.h"
#include "core/pixel.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_SUMS_GRID = 32, LS_SUMS_COLOURS = 3 };

struct ls_picture_view {
    const uint16_t *half;    /* (height, width) */
    const uint8_t *validity; /* enum ls_validity, or NULL: all valid */
    uint32_t width, height;
    enum ls_cfa cfa;
};

struct ls_picture_sums {
    uint32_t n_colours, n_blocks;
    float *sum;                    /* [colour * n_blocks + block]; NAN: not to be trusted */
    double total[LS_SUMS_COLOURS]; /* over the pixels looked at that were not saturated */
    uint64_t n_px, n_saturated;    /* looked at; of those saturated in every exposure */
};

/**
 * Add up. Of every @every pairs of rows one is looked at, 1: all. Half values that are not finite
 * count as saturated. Takes 1 ns a pixel looked at. @out: (transfer full). Errors: LS_ERR_INVALID
 * (an empty picture, every 0), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_picture_sums_make(const struct ls_picture_view *picture,
                                               uint32_t every, struct ls_picture_sums *out,
                                               struct ls_diag *diag);

/** Zeroed ones are allowed. */
void ls_picture_sums_finish(struct ls_picture_sums *sums);

struct ls_light_drift {
    double change; /* of the light, relative to the first picture: 0.01 = 1 % more */
    double error;  /* standard error of that */
};

/**
 * By how much the light of @now differs from that of @first, which were made alike, in a colour:
 * r = sum b / sum a over the blocks both can be trusted in, less those with |b - r a| above eight
 * times the median of all: what moved is not the light's. The standard error is sqrt(sum (b - r
 * a)^2) / sum a of those kept. False where there is nothing to compare: fewer than 2 such blocks,
 * or no light.
 */
bool ls_picture_drift(const struct ls_picture_sums *first, const struct ls_picture_sums *now,
                      uint32_t colour, struct ls_light_drift *out);

#endif

/*
 * demosaic_kernels: one or two rows of demosaic.h, once per instruction set. All return the same
 * bits. Layer: core, inside the demosaic, its tests and benches. Threads: any; pure. Ownership:
 * none.
 */
#ifndef LS_CORE_DEMOSAIC_KERNELS_H
#define LS_CORE_DEMOSAIC_KERNELS_H

#include "core/cpu.h"
#include "core/demosaic.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    LS_DEMOSAIC_ROWS = 2 * LS_DEMOSAIC_HALO + 1,
    LS_DEMOSAIC_SLACK = 16, /* the most lanes of any instruction set */
};

enum ls_demosaic_filter {
    LS_DEMOSAIC_FILTER_GRADIENT,
    LS_DEMOSAIC_FILTER_BILINEAR,
    LS_DEMOSAIC_FILTER_COPY, /* the sample in all three colours */
};

/** How RGB lies in memory. */
enum ls_demosaic_form {
    LS_DEMOSAIC_PLANES,
    LS_DEMOSAIC_WOVEN, /* r g b r g b .. from plane[0] on */
    LS_DEMOSAIC_HALF_PLANES,
    LS_DEMOSAIC_HALF_WOVEN,
    LS_DEMOSAIC_ADD,      /* woven: += (scale rgb) ratio */
    LS_DEMOSAIC_PROMOTED, /* woven halves: as core/promote_tile.h of them, scale and half_ratio */
};

/** A run of pixels of one row, or of two, and the rows around it. Two cost less than twice one: of
 * the sums around a pixel each row needs some of the other's. */
struct ls_demosaic_line {
    /* of the first pixel, from two rows above; readable from -LS_DEMOSAIC_HALO to n +
     * LS_DEMOSAIC_HALO + LS_DEMOSAIC_SLACK, of which what lies beyond n + LS_DEMOSAIC_HALO has no
     * effect */
    const float *row[LS_DEMOSAIC_ROWS + 1];
    uint32_t n;
    bool two;         /* rows; else one, and row[LS_DEMOSAIC_ROWS] is not read */
    bool green_first; /* the first pixel is green; of a second row: the other way round */
    bool red_row;     /* the row's other pixels are red, else blue; of a second row: likewise */
    enum ls_demosaic_filter filter;
    enum ls_demosaic_form form;
    void *plane[3];             /* of the first pixel; n pixels are written, no more */
    size_t step;                /* bytes to the second row's */
    float scale;                /* of ADD, PROMOTED */
    const float *ratio;         /* of ADD, [n][3], or NULL = 1 */
    const uint16_t *half_ratio; /* of PROMOTED, [n][3] */
    size_t ratio_step;          /* to the second row's, of either */
};

struct ls_demosaic_kernels {
    void (*line)(const struct ls_demosaic_line *line);
};

extern const struct ls_demosaic_kernels ls_demosaic_kernels_c, ls_demosaic_kernels_avx2,
    ls_demosaic_kernels_avx512;

/** (transfer none). RT-safe. */
const struct ls_demosaic_kernels *ls_demosaic_kernels(enum ls_isa isa);

/** ls_demosaic with the kernels of one instruction set (tests, benches). RT-safe. */
LS_MUST_CHECK enum ls_err ls_demosaic_with(enum ls_isa isa, const struct ls_demosaic_source *source,
                                           struct ls_demosaic_region region,
                                           enum ls_demosaic_method method,
                                           const struct ls_demosaic_target *target);

#endif

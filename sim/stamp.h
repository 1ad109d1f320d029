/*
 * stamp: what was really in force during an exposure, drawn into its pixels.
 * Layer: sim. Threads: any; no shared state. Ownership: the caller owns every buffer.
 *
 * A 16 x 16 grid of square blocks, each at least 2 x 2 px, from the top left corner, one bit per
 * block, row by row: 28 bytes of record (little-endian), 4 bytes of CRC-32. A block is dark (0.2 of
 * full scale) or light (0.7): far beyond any noise. Images under 32 x 32 px cannot carry one.
 */
#ifndef LS_SIM_STAMP_H
#define LS_SIM_STAMP_H

#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

enum { SIM_STAMP_GRID = 16, SIM_STAMP_BYTES = 32 };

/** Of a dark and of a light block, of full scale. */
extern const float sim_stamp_level[2];

struct sim_stamp {
    uint16_t kind;   /* LS_WIRE_CONDITION_* */
    uint16_t n_leds; /* lit; saturates */
    uint16_t light;  /* of the first lit LED; 0xffff = none */
    uint8_t channel; /* of the first lit LED; 0xff = none */
    uint8_t camera;
    uint32_t condition;      /* UINT32_MAX = dark */
    uint32_t step;           /* UINT32_MAX = not a step */
    uint32_t exposure_ns_10; /* exposure in units of 10 ns */
    uint32_t lit_ns_10;      /* how long of it the LEDs were on, units of 10 ns */
    uint32_t sequence;
};

/** The bits of the grid, row by row, lowest bit first. */
void sim_stamp_encode(const struct sim_stamp *stamp, uint8_t bytes[SIM_STAMP_BYTES]);

/** Side of a block. */
uint32_t sim_stamp_block_px(uint32_t width, uint32_t height);

/** Draw as fractions of full scale into a row-major @width x @height image.
 * LS_ERR_INVALID if it is too small. */
LS_MUST_CHECK enum ls_err sim_stamp_draw(const struct sim_stamp *stamp, uint32_t width,
                                         uint32_t height, float *image, struct ls_diag *diag);

/**
 * Read a stamp from unpacked raw values (row-major, @full_scale_dn their maximum), by the mean of
 * each block's middle. LS_ERR_MISMATCH if the CRC fails, LS_ERR_INVALID if the image is too small.
 */
LS_MUST_CHECK enum ls_err sim_stamp_read(const uint16_t *dn, uint32_t width, uint32_t height,
                                         uint32_t full_scale_dn, struct sim_stamp *out,
                                         struct ls_diag *diag);

#endif

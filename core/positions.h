/*
 * positions: light positions from CSV text into the stage frame.
 * Layer: core. Threads: any. Ownership: arrays belong to the ls_positions.
 *
 * One light per row: x,y,z and optionally the controller's address (default: the row number).
 * '#' starts a comment. Coincident lights are allowed. `axes` names what the three columns point
 * to, in the stage frame of a camera on +z looking along -z: "right" +x, "left" -x, "up" +y,
 * "down" -y, "towards" (the camera) +z, "away" -z. The stage frame is right-handed whatever the
 * source; a source with mirrored axes is converted, not refused.
 */
#ifndef LS_CORE_POSITIONS_H
#define LS_CORE_POSITIONS_H

#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

struct ls_positions {
    uint32_t n;
    float (*xyz_m)[3];
    uint32_t *address;
};

/**
 * Parse @length bytes of CSV; @name stands for the source in messages. @unit: "m", "cm" or "mm".
 * Errors: LS_ERR_INVALID (name and line), LS_ERR_LIMIT (more than @max lights), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_positions_parse(const char *text, size_t length, const char *name,
                                             const char *axes, const char *unit, uint32_t max,
                                             struct ls_positions *out, struct ls_diag *diag);

void ls_positions_finish(struct ls_positions *positions);

#endif

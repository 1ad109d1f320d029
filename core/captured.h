/*
 * captured: an environment as captured on set: the picture of a mirror ball and colour charts that
 * faced several ways.
 * Layer: core. Threads: any, read-only once made. Ownership: freed with ls_captured_destroy.
 *
 * Source: LeGendre, Yu and Debevec (their five "Nano" charts). The ball says how much light comes
 * from where, the charts what its spectrum does to colours. The chart of a cone of directions about
 * w is the mean of the charts with weight max(n . w, 0)^2, n their normals; where all are 0, the
 * nearest chart, which is counted. It is scaled, channel by channel, so that its neutrals read
 * reflectance x L(cone), L from the ball.
 *
 * Accuracy: under light of one spectrum, targets are within 1e-10 of white of what the chart reads
 * of it. Of two spectra from left and right (lobes of sharpness 4) each side's own is within 3 %
 * of white, where the other side's is more than four times as far off: a chart sees half of the
 * world, which is the method's error, no rounding.
 */
#ifndef LS_CORE_CAPTURED_H
#define LS_CORE_CAPTURED_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    LS_CAPTURED_MAX_CHARTS = 64,
    LS_CAPTURED_MAX_PATCHES = 256,
    LS_CAPTURED_MAX_BYTES = 4 << 20,
    LS_CAPTURED_PATH_BYTES = 1024,
};

struct ls_captured_chart {
    double normal[3]; /* unit, stage frame */
    double (*rgb)[3]; /* [n_patches], camera-raw, linear, one exposure for all */
    bool *saturated;  /* [n_patches] */
};

struct ls_captured {
    /* of the ball; the picture is the caller's to load */
    char picture[LS_CAPTURED_PATH_BYTES];
    double centre_px[2], radius_px, camera_direction[3];
    bool has_reflectivity, has_blind;
    double reflectivity[3], blind_deg;
    char polariser[16]; /* before the camera: "none", "vertical", "horizontal" */
    /* of the charts */
    size_t n_patches, n_charts;
    double *neutral; /* [n_patches], reflectance of a neutral patch, 0 = not a neutral */
    struct ls_captured_chart *chart;
};

/**
 * Parse
 *   {"format": 1,
 *    "ball": {"picture": file, "centre_px": [x, y], "radius_px": r, "camera_direction": [x, y, z],
 *             "polariser": "none"|"vertical"|"horizontal",
 *             "reflectivity": [r, g, b] (optional), "blind_deg": half-angle (optional)},
 *    "neutrals": [{"patch": index, "reflectance": rho}, ...],
 *    "charts": [{"normal": [x, y, z], "rgb": [[r, g, b], ... one per patch],
 *                "saturated": [indices] (optional)}, ...]}
 * Patches are numbered from 0. A chart whose neutrals are all saturated, or a saturated patch that
 * is not a neutral, is refused: its colours cannot be known. LS_ERR_INVALID names key and what was
 * expected; LS_ERR_UNSUPPORTED (another format), LS_ERR_LIMIT, LS_ERR_NOMEM. (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_captured_parse_json(const char *text, size_t bytes,
                                                 struct ls_captured **out, struct ls_diag *diag);

/** Is JSON @text one of these rather than lobes: does it have a "ball"? */
bool ls_captured_is(const char *text, size_t bytes);

/** NULL is allowed. */
void ls_captured_destroy(struct ls_captured *probe);

/**
 * What the chart reads of the light @cell[3] (radiance x sr, camera-raw, from the ball) that comes
 * from @direction (unit): targets[n_patches][3]. A neutral that one of the charts had saturated
 * reads reflectance x cell; where that leaves no neutral to scale by, the nearest chart stands
 * alone.
 * Returns false if no chart faces the direction and the nearest was taken. RT-safe.
 */
bool ls_captured_targets(const struct ls_captured *probe, const double direction[3],
                         const double cell[3], double *targets);

#endif

/*
 * field_segments: which of a take's pictures divide the dome, and which are its head light.
 * Layer: daemon. Threads: any. Ownership: the caller's, embedded.
 */
#ifndef LS_DAEMON_FIELD_SEGMENTS_H
#define LS_DAEMON_FIELD_SEGMENTS_H

#include "core/relight.h"
#include "core/segments.h"
#include "daemon/field_source.h"

#include <stdint.h>

/* A blend sums the field twice per segment, all at once. */
enum { LS_FIELD_MAX_SEGMENTS = LS_ACCUMULATE_MAX_SUMS / 2 };

struct ls_field_segments {
    uint32_t n;
    struct ls_picture pictures[LS_FIELD_MAX_SEGMENTS];
    double factor[LS_FIELD_MAX_SEGMENTS]; /* ls_field_source_factor */
    uint32_t segment[LS_MAX_LIGHTS];      /* of each light */
};

/**
 * The pictures of a channel that show every light exactly once: those of one pattern "segments-N",
 * or all that name their lights; the finest such division. Errors: LS_ERR_NOT_FOUND (the plan asks
 * for none), LS_ERR_STATE (not all there, not a division, not calibrated: the sentence says),
 * LS_ERR_LIMIT (more than LS_FIELD_MAX_SEGMENTS).
 */
LS_MUST_CHECK enum ls_err ls_field_segments_find(const struct ls_field_source *source,
                                                 uint32_t channel, struct ls_field_segments *out,
                                                 struct ls_diag *diag);

/** F of Eq. 2 as a sum of pictures, and the lights it shows. */
struct ls_field_headlight {
    uint32_t n;
    struct ls_picture pictures[LS_HEADLIGHT_LIGHTS];
    double factor[LS_HEADLIGHT_LIGHTS];
    const uint32_t *lights; /* rows of the rig; of the condition, or `nearest` */
    uint32_t n_lights;
    uint32_t nearest[LS_HEADLIGHT_LIGHTS];
};

/** The head light's picture; where there is none, those of the LS_HEADLIGHT_LIGHTS lights nearest
 * to the camera, if the channel was photographed light by light. Errors as ls_field_segments_find.
 * *out must not move. */
LS_MUST_CHECK enum ls_err ls_field_headlight_find(const struct ls_field_source *source,
                                                  uint32_t channel, struct ls_field_headlight *out,
                                                  struct ls_diag *diag);

#endif

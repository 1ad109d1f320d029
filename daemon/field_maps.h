/*
 * field_maps: what promotes a take's field, pixel by pixel, made once and kept beside the take.
 * Layer: daemon. Threads: any; of one take, one makes maps at a time. Ownership: a source's; a map
 * lives as long as its source.
 *
 * Maps lie in nameless files of the storage folder (daemon/map_file.h). They do not depend on bands
 * or threads.
 */
#ifndef LS_DAEMON_FIELD_MAPS_H
#define LS_DAEMON_FIELD_MAPS_H

#include "core/error.h"
#include "daemon/field_source.h"
#include "daemon/job.h"

#include <stdint.h>

enum ls_field_map_kind {
    LS_MAP_SPHERE,    /* Eq. 1, the field under the spectrum's own strengths as denominator */
    LS_MAP_PAPER,     /* Eq. 1, the photographed white sphere as denominator */
    LS_MAP_HEADLIGHT, /* Eq. 2 */
    LS_MAP_LINEAR, /* core/linear.h; mono: core/mono_blend.h, unless the matrix of several spectra
                      is estimated to be less off */
    LS_MAP_SEPARATED, /* core/separate.h's remainder; + 1: ideal polarisation, + 2: plain conductors
                       */
    LS_MAP_KINDS = LS_MAP_SEPARATED + 4,
};

struct ls_field_map {
    const float *values; /* [height][width][depth] */
    uint32_t depth;      /* ratios: n_channels; matrices: n_channels x n_inputs; blends: segments */
    /* of LINEAR */
    uint32_t n_segments;
    uint32_t n_inputs;      /* 0: a blend of ratios */
    uint32_t inputs[6];     /* spectra of which each light was photographed; white first */
    double *phi;            /* blend: [n_lights][n_segments] */
    double left_out_error;  /* ls_linear_estimate of segments predicted from the others */
    double left_out_share;  /* of the picture's pixels it rests on; 0 = no estimate */
    uint32_t n_checked;     /* lights photographed alone too, up to LS_LINEAR_MAX_CHECKS */
    double checked_error;   /* relative RMS of what the map makes of them, all pixels */
    double highlight_error; /* where such a light is a highlight (core/linear.h) */
    double highlight_share; /* of those lights' pixels that are; 0 = no such error */
    /* of SEPARATED */
    uint32_t n_inseparable; /* lights */
};

/** (transfer full). LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_field_maps_create(struct ls_field_maps **out, struct ls_diag *diag);

/** Could the map of spectrum @s be made? LS_ERR_NOT_FOUND: the plan never asked for the pictures it
 * needs; LS_ERR_STATE: they are not all there, or their pattern is not calibrated. The sentence
 * says which, and what makes them. Reads nothing. */
LS_MUST_CHECK enum ls_err ls_field_maps_possible(const struct ls_field_source *source,
                                                 enum ls_field_map_kind kind, uint32_t s,
                                                 struct ls_diag *diag);

/**
 * The map of spectrum @s (not 0); the first call makes it, and those of every other spectrum that
 * the same pass over the field serves (of matrices: the same division of the dome); later ones
 * return at once, even while others are made. While another makes maps of this take, an @asker that
 * a pool steps (daemon/job.h) gets LS_ERR_BUSY and is woken when they are made or given up, so that
 * it holds no thread; any other waits here. Making ends with LS_ERR_ABORTED soon after @asker (or
 * NULL) is cancelled; nothing is left half made. Other errors: those of ls_field_maps_possible,
 * ls_field_source_sound, ls_map_file_create and core. (transfer none).
 */
LS_MUST_CHECK enum ls_err ls_field_maps_get(struct ls_field_source *source,
                                            enum ls_field_map_kind kind, uint32_t s,
                                            const struct ls_job *asker,
                                            const struct ls_field_map **out, struct ls_diag *diag);

/** The nearest halves of a map of ratios, tile after tile of 64 x 64 pixels as a picture's are,
 * each [64][64][n_channels] long and, where the picture's edge cuts it, [height][width][n_channels]
 * of that. Made by the first call, 6 bytes a pixel (mono: 2) in a file beside the map's. NULL:
 * there is no room for it. (transfer none). */
const uint16_t *ls_field_maps_halves(struct ls_field_source *source,
                                     const struct ls_field_map *map);

/** NULL is allowed. */
void ls_field_maps_destroy(struct ls_field_maps *maps);

#endif

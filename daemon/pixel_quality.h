/*
 * pixel_quality: what is known of each pixel of a photographed picture, behind its values.
 * Layer: daemon. Threads: any. Ownership: the chunk's.
 *
 * Validity is stored with the picture. Variance is told from the picture, the bracket and the
 * camera that take.json names (core/merge_variance.h), with the rig file's black level for every
 * pixel's.
 */
#ifndef LS_DAEMON_PIXEL_QUALITY_H
#define LS_DAEMON_PIXEL_QUALITY_H

#include "core/demosaic.h"
#include "core/error.h"
#include "daemon/job.h"
#include "daemon/picture_map.h"
#include "daemon/take_facts.h"
#include "proto/lightstage.pb-c.h"

#include <stdbool.h>

struct ls_pixel_quality {
    bool variance, validity;
};

struct ls_pixel_quality ls_pixel_quality_of(const Lightstage__Fetch *fetch);

/** Is something asked for that no take could serve? LS_ERR_UNSUPPORTED. */
LS_MUST_CHECK enum ls_err ls_pixel_quality_check(const Lightstage__Fetch *fetch,
                                                 struct ls_diag *diag);

/**
 * Append to @chunk's payload what is wanted of pixels @region of @map, and say so in @body. @gain:
 * what the stored values were multiplied by to be those sent. Errors: LS_ERR_STATE (take.json does
 * not say the camera's range or black), LS_ERR_NOMEM, those of ls_picture_map_validity.
 */
LS_MUST_CHECK enum ls_err
ls_pixel_quality_append(struct ls_pixel_quality wanted, const struct ls_picture_map *map,
                        const struct ls_take_facts *facts, struct ls_demosaic_region region,
                        double gain, struct ls_chunk *chunk, Lightstage__FetchReply *body,
                        struct ls_diag *diag);

#endif

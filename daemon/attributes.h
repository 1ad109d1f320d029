/*
 * attributes: what a stored picture says of itself in its OpenEXR header (conventions of the
 * project's files: OpenEXR's own names where it has one, else `lightstage/...`).
 * Layer: daemon. Threads: any; reads configuration and plan only. Ownership: the caller finishes
 * the list.
 */
#ifndef LS_DAEMON_ATTRIBUTES_H
#define LS_DAEMON_ATTRIBUTES_H

#include "core/exr.h"
#include "daemon/config.h"
#include "daemon/plan.h"
#include "drivers/camera.h"

#include <stdint.h>

/** One picture: a condition as one camera saw it. Everything is (transfer none). */
struct ls_picture_facts {
    const struct ls_config *config;
    const struct ls_plan *plan;
    const struct ls_camera_info *info;
    uint32_t camera, condition;
    const char *take;
    int64_t utc_s;
    double reference_exposure_s;
    double longest_exposure_s; /* of the bracket, as used; of a dark: its exposure */
};

/** Fill an empty list; errors stay in attrs->err, as ls_exr_attrs has it. */
void ls_picture_attributes(const struct ls_picture_facts *picture, struct ls_exr_attrs *attrs);

#endif

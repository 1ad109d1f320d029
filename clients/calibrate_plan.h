/*
 * calibrate_plan: the plan of a take of the grey sphere.
 * Layer: clients. Threads: any. Ownership: the caller's.
 */
#ifndef LS_CLIENTS_CALIBRATE_PLAN_H
#define LS_CLIENTS_CALIBRATE_PLAN_H

#include "clients/lightstage.h"
#include "core/error.h"

#include <stdint.h>

struct ls_calibrate_plan {
    const char *exposures_us; /* "100, 800, 6400" */
    uint32_t darks, segments; /* segments 0 = none */
    const char *shown;        /* text of a plan whose patterns are wanted too, or NULL */
    const char *shown_name;   /* the file it came from */
};

/**
 * Every light and the full sphere in each channel of @rig; segments and head light in each
 * spectrum. And every condition of `shown` that lights several LEDs, at its level, in place of
 * those of its kind and channel: what a take of that plan will want a factor of. *text: (transfer
 * full). Errors: LS_ERR_INVALID naming the file and line; LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_calibrate_plan_text(const struct ls_calibrate_plan *plan,
                                                 const struct lightstage_rig *rig, char **text,
                                                 struct ls_diag *diag);

#endif

/*
 * calibrate_probe: takes of the two shiny spheres, which stand where the grey one stood.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_PROBE_H
#define LS_CLIENTS_CALIBRATE_PROBE_H

#include "clients/calibrate_grey.h"
#include "clients/calibrate_take.h"
#include "core/polarisation.h"

#include <stdint.h>

/** A chrome ball under each white light. */
struct ls_chrome {
    uint32_t n_seen;           /* lights whose highlight was found */
    double rms_deg, worst_deg; /* of unflagged lights, from the rig file's directions */
    double shading_deg;        /* rms from the directions the grey sphere gave */
    uint32_t n_mirror;         /* lights that gave a reflectivity */
    double reflectivity[3];    /* the middle one, per colour */
    double spread[3];          /* two thirds of the lights lie within */
};

/** A black glossy sphere under each light, polarised both ways. */
struct ls_gloss {
    uint32_t n_lights, n_measured; /* the others come from the half vector */
    uint32_t n_saturated;          /* of those: highlights too bright */
    uint32_t n_inseparable;
    double *a_v, *a_h, *sigma; /* [light]; sigma 0 = not measured */
    double model_rms;          /* measured a_V minus that of the half vector */
};

/** @reflectance: of the grey sphere. LS_ERR_NOT_FOUND: no mirror there; LS_ERR_STATE: pictures are
 * missing; those of ls_calibrate_fetch. */
LS_MUST_CHECK enum ls_err ls_calibrate_chrome(const struct ls_calibrate_take *take,
                                              const struct ls_grey *grey, double reflectance,
                                              struct ls_chrome *out);

/** Errors as ls_calibrate_chrome. Finish @out. */
LS_MUST_CHECK enum ls_err ls_calibrate_gloss(const struct ls_calibrate_take *take,
                                             const struct ls_grey *grey, struct ls_gloss *out);

void ls_gloss_finish(struct ls_gloss *gloss);

#endif

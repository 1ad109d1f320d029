/*
 * take_facts: what take.json says that serving its pictures needs.
 * Layer: daemon. Threads: any, read-only once made. Ownership: owns everything; see destroy.
 */
#ifndef LS_DAEMON_TAKE_FACTS_H
#define LS_DAEMON_TAKE_FACTS_H

#include "core/calibration.h"
#include "core/error.h"
#include "core/pixel.h"
#include "daemon/config.h"
#include "daemon/plan.h"

#include <stdbool.h>
#include <stdint.h>

enum ls_fact_kind {
    LS_FACT_OTHER,
    LS_FACT_DARK,
    LS_FACT_ONE,
    LS_FACT_SPHERE,
    LS_FACT_SEGMENT,
    LS_FACT_HEADLIGHT,
    LS_FACT_MULTIPLEX, /* a row of the S-matrix of core/bases.h */
};

struct ls_condition_fact {
    char id[64];
    enum ls_fact_kind kind;
    bool watch;           /* DARK: no light has it subtracted */
    uint32_t light;       /* ONE */
    uint32_t channel;     /* all but DARK and OTHER; index into channels */
    double duty;          /* of full level, (0, 1] */
    char pattern[16];     /* its class in the calibration: "sphere", "segments-14", "lights-25" */
    uint32_t *lights;     /* SEGMENT, HEADLIGHT, MULTIPLEX: those lit, rows of the rig, ascending */
    uint32_t n_lights;    /* 0 otherwise */
    uint32_t part, parts; /* MULTIPLEX: the row, the matrix's order */
    uint32_t repeats;
};

struct ls_take_facts {
    uint32_t n_lights, n_channels;
    float (*position_m)[3];
    struct {
        char name[32];
        bool polariser;
    } channels[LS_MAX_CHANNELS];
    uint32_t n_conditions;
    struct ls_condition_fact *conditions;
    uint32_t n_exposures;
    double exposure_s[LS_MAX_EXPOSURES];
    double reference_exposure_s;
    uint32_t pwm_levels; /* a light's duty is a whole number of these parts; 0: not said */
    /* of the camera asked for */
    float camera_position_m[3]; /* zero where the take does not say */
    enum ls_cfa cfa;
    double full_scale_dn, electrons_per_dn, read_noise_dn;
    double black_dn, range_low, range_high; /* NAN where the take does not say */
    struct ls_calibration *calibration;     /* NULL: none was given */
};

/**
 * Read @take_json for one camera. *out: (transfer full). Errors: LS_ERR_INVALID (naming the key),
 * LS_ERR_NOT_FOUND (no such camera), LS_ERR_LIMIT, LS_ERR_NOMEM, and those of ls_calibration_parse.
 */
LS_MUST_CHECK enum ls_err ls_take_facts_read(const char *take_json, uint32_t camera,
                                             struct ls_take_facts **out, struct ls_diag *diag);

/** Index of a channel by name, or -1. */
int ls_take_facts_channel(const struct ls_take_facts *facts, const char *name);

/** NULL is allowed. */
void ls_take_facts_destroy(struct ls_take_facts *facts);

#endif

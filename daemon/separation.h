/*
 * separation: a take's polarised pictures as core's separated field.
 * Layer: daemon. Threads: read-only once made, any. Ownership: the caller's; see finish. Points
 * into its source.
 *
 * The factors a of each light are the calibration's, measured on a black glossy sphere; where it
 * has none for this camera, those of the half vector on a middling subject, which may be some
 * percent of a highlight off (ls_polarisation_assume).
 */
#ifndef LS_DAEMON_SEPARATION_H
#define LS_DAEMON_SEPARATION_H

#include "core/error.h"
#include "core/separated.h"
#include "daemon/field_source.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_separation {
    struct ls_separated_field field;
    struct ls_split *split; /* [n_lights] */
    uint32_t inseparable;   /* lights */
    double white[3];        /* p of V + H, by camera channel */
};

/** Does the take have every light's picture under both polarisers? LS_ERR_NOT_FOUND: its plan does
 * not ask for them; LS_ERR_STATE: some are missing. */
LS_MUST_CHECK enum ls_err ls_separation_possible(const struct ls_field_source *source,
                                                 struct ls_diag *diag);

/** @ideal: a = (1, 0) for every light; @plain: the paper's plain difference of colours. Errors:
 * those of ls_separation_possible and core. */
LS_MUST_CHECK enum ls_err ls_separation_init(struct ls_separation *separation,
                                             const struct ls_field_source *source, bool ideal,
                                             bool plain, struct ls_diag *diag);

/** p(s,c) / p(w,c) of spectrum @s. */
void ls_separation_tint(const struct ls_separation *separation,
                        const struct ls_field_source *source, uint32_t s, double tint[3]);

/** Zeroed is allowed. */
void ls_separation_finish(struct ls_separation *separation);

#endif

/*
 * bounce: diffuse light between the surfaces of the subject, one and two reflections deep.
 * Layer: sim. Threads: built on one, then read only. Ownership: finish frees.
 *
 * Radiosity on the surfaces' nodes: the irradiance of a node from a patch j is F_rj B_j with the
 * disc form factor F = cos cos A / (pi d^2 + A) where the two see each other. Rows that would sum
 * past 1 are scaled to 1, so no energy appears. Coefficients stay apart by the materials the light
 * has touched (a chain: one emitter, or emitter a then b at 4 + 4 a + b), so colour is exact:
 * radiance at node = sum over chains of coefficient x response of the chain.
 */
#ifndef LS_SIM_BOUNCE_H
#define LS_SIM_BOUNCE_H

#include "core/error.h"
#include "sim/geometry.h"
#include "sim/response.h"
#include "sim/subject.h"

struct sim_bounce {
    uint32_t n_lights, n_nodes;
    float *coef;       /* [light][node][SIM_CHAINS], per unit strength; NULL without nodes */
    uint16_t *surface; /* [node] */
};

LS_MUST_CHECK enum ls_err sim_bounce_build(const struct sim_subject *subject,
                                           const struct sim_geometry *geometry,
                                           struct sim_bounce *out, struct ls_diag *diag);
void sim_bounce_finish(struct sim_bounce *bounce);

/** Irradiance factor at @x, normal @n under light @i of strength 1, without shadows: 0 behind. */
float sim_irradiance(const struct sim_geometry *geometry, uint32_t light, struct sim_vec x,
                     struct sim_vec n);

/** Add weight x bounced radiance of every node under a light: acc[node * n_colours + colour]. */
void sim_bounce_add(const struct sim_bounce *bounce, const struct sim_subject *subject,
                    const struct sim_response *response, uint32_t light, uint32_t source,
                    float weight, float *acc);

#endif

/*
 * subject: what stands in the middle of the dome: bodies, and the surfaces they wear.
 * Layer: sim. Threads: built on one, then read only. Ownership: values in one struct.
 *
 * A body wears one surface, or in front a grid of them set in a frame (the chart, the fabrics).
 * A surface has a material, a finish, and a grid of nodes at which bounced light is received (and,
 * for materials that emit, from which it is sent).
 */
#ifndef LS_SIM_SUBJECT_H
#define LS_SIM_SUBJECT_H

#include "core/error.h"
#include "sim/body.h"

#include <stdint.h>

enum {
    SIM_MAX_BODIES = 32,
    SIM_MAX_SURFACES = 96,
    SIM_NO_SURFACE = 0xffff,
    SIM_CHART_PATCHES = 24,
    SIM_FABRICS = 12,
    SIM_MAX_MATERIALS = 64,
};

enum sim_finish {
    SIM_MATTE,
    SIM_COATED, /* Lambertian under a dielectric, index 1.5 */
    SIM_METAL,
};

struct sim_surface {
    uint16_t material;
    enum sim_finish finish;
    float alpha;            /* GGX roughness of coat or metal */
    float weave;            /* amplitude of the fabric's texture */
    float weave_u, weave_v; /* its periods over the surface */
    float bend;             /* how far the normal leans towards the edges, as on worn wax */
    uint16_t body;
    uint8_t part;
    float u0, u1, v0, v1;      /* its rectangle of the body's parameters */
    uint16_t nodes_u, nodes_v; /* 0: receives no bounced light */
    uint32_t first_node;
    int16_t emitter; /* index among the bouncing materials, -1 = does not bounce */
};

struct sim_dress {
    uint16_t front, back; /* surfaces of parts 0 and 1 */
    uint16_t first_patch; /* surfaces of the grid on part 0 ... */
    uint16_t columns, rows;
    float fill; /* ... each this share of its cell, centred */
};

struct sim_subject {
    uint32_t n_bodies, n_surfaces, n_nodes, n_emitters;
    struct sim_body body[SIM_MAX_BODIES];
    struct sim_dress dress[SIM_MAX_BODIES];
    struct sim_surface surface[SIM_MAX_SURFACES];
    uint16_t emitter_material[4];
    uint16_t chart, fabrics, velvet; /* first surface of each, SIM_NO_SURFACE if absent */
};

/** Materials: chart patches, then fabrics, then these (rows of materials.csv). */
enum sim_material {
    SIM_MAT_CHART,
    SIM_MAT_FABRIC = SIM_MAT_CHART + SIM_CHART_PATCHES,
    SIM_MAT_GREY33 = SIM_MAT_FABRIC + SIM_FABRICS,
    SIM_MAT_FLAT, /* 1 at every wavelength */
    SIM_MAT_TABLE,
    SIM_MAT_CUP,
    SIM_MAT_RED_FELT,
    SIM_MAT_GREEN_FELT,
    SIM_MAT_VELVET,
    SIM_MAT_BOARD,
    SIM_MAT_WAX,
    SIM_MAT_OCHRE,
    SIM_MAT_BLACK_GLASS,
    SIM_MAT_RED_METAL,
    SIM_MAT_GOLD,
    SIM_MAT_CHROME,
    SIM_MAT_RED_WAX,
    SIM_MATERIALS,
};

/** @scene: "stilllife", "grey", "chrome", "gloss" or "highlights"; anything else leaves the dome
 * empty. */
void sim_subject_build(const char *scene, double sphere_radius_m, struct sim_subject *out);

/** The surface at (u, v) of a body's part; (*su, *sv) in [0, 1] within it. */
uint16_t sim_subject_surface(const struct sim_subject *subject, uint32_t body, int part, float u,
                             float v, float *su, float *sv);

/** Nearest hit of a ray; SIM_NO_SURFACE if none. @hit has u, v of the surface. */
uint16_t sim_subject_trace(const struct sim_subject *subject, struct sim_vec o, struct sim_vec d,
                           struct sim_hit *hit);

/** May x and y see each other? Blocked by any body between, their own included. */
int sim_subject_visible(const struct sim_subject *subject, struct sim_vec x, struct sim_vec y);

#endif

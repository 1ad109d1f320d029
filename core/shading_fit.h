/*
 * shading_fit: the parts of ls_shading_fit: a fit in the making, strengths, and what depends on
 * where things stand. Private to core/shading*.c. Layer: core. Threads: a fit belongs to one.
 * Ownership: a fit's arrays are ls_shading_fit's.
 */
#ifndef LS_CORE_SHADING_FIT_H
#define LS_CORE_SHADING_FIT_H

#include "core/shading.h"

/** A light: where it is, the way it faces, and its squared distance from the stage's centre. */
struct ls_lamp {
    double at[3], axis[3], r2;
};

struct ls_lamp ls_lamp_at(const double position_m[3]);

/** m of core/shading.h at a point with a normal; 0 where no light arrives. */
double ls_lamp_model(const struct ls_lamp *lamp, const float x[3], const float n[3]);

/** A pixel in use. */
struct ls_shading_sample {
    const struct ls_sphere_pixel *pixel;
    double e, m;
    double w;     /* of the fit: the biweight's psi(r)/r, 0 = refused */
    double slope; /* psi'(r), which says how the estimate follows the data */
};

struct ls_shading_work {
    const struct ls_sphere_view *view;
    struct ls_lamp lamp; /* where it is believed to be */
    struct ls_shading_sample *sample;
    uint32_t n;
    double m_max;
    double scale[3]; /* robust sigma of residual * sqrt(1 / (m + floor)) */
    uint32_t used[3], refused;
    float *room; /* view->n */
};

/** Strength and sigma of one colour about the samples' m; sets their weights. */
void ls_shading_strength(struct ls_shading_work *work, int colour, struct ls_shading *out);

/** tilt, place_score and place_information about the believed place, then the direction and the
 * free strengths (which moves the samples' m and weights). */
void ls_shading_place(struct ls_shading_work *work, struct ls_shading *out);

#endif

/*
 * grey_sphere_work: the parts of grey_sphere.
 * Layer: core, for grey_sphere*.c alone. Threads: any. Ownership: ls_grey_measure's.
 */
#ifndef LS_CORE_GREY_SPHERE_WORK_H
#define LS_CORE_GREY_SPHERE_WORK_H

#include "core/grey_sphere.h"

/** The pictures of several lights of one channel, and the sums of those lights' own. */
struct ls_grey_sums {
    const struct ls_lit_picture **pattern;
    uint32_t n, at;    /* at: of those read so far */
    float *sum;        /* [pattern][pixel of the view] */
    uint8_t *validity; /* the same: the worst of its parts */
};

struct ls_grey_work {
    const struct ls_grey_rig *rig;
    const struct ls_grey_source *source;
    struct ls_grey *grey;
    struct ls_diag *diag;
    uint32_t channel, camera;             /* being read */
    const struct ls_lit_picture **lights; /* [channel * n_lights + light] */
    struct ls_shading *fits;              /* where they go, [light * stride] */
    uint32_t stride;
    struct ls_grey_sums *sums;  /* NULL: none are wanted */
    uint64_t n_px, n_saturated; /* of white pictures */
    float *whole;               /* a picture of the largest camera */
    uint8_t *whole_validity;
};

/** Find the sphere in the picture of w->camera, and place it by its shading. */
LS_MUST_CHECK enum ls_err ls_grey_place(struct ls_grey_work *w);

/** Fit every @every-th light of w->channel, as w->camera saw it. */
LS_MUST_CHECK enum ls_err ls_grey_fit(struct ls_grey_work *w, uint32_t every);

/** Prepare w->sums for w->channel and w->camera, to be ended in any case. */
LS_MUST_CHECK enum ls_err ls_grey_sums_begin(struct ls_grey_work *w, struct ls_grey_sums *sums);
void ls_grey_sums_end(struct ls_grey_sums *sums);

/** Add the picture of a light to the sums of the patterns that show it. RT-safe. */
void ls_grey_sums_add(const struct ls_grey_work *w, uint32_t light, const float *e,
                      const uint8_t *validity);

/** Read the patterns, and compare. */
LS_MUST_CHECK enum ls_err ls_grey_factors(struct ls_grey_work *w);

/** Pictures of one class, from factor @first on, become one factor. */
LS_MUST_CHECK enum ls_err ls_grey_combine(struct ls_grey *grey, uint32_t first,
                                          struct ls_diag *diag);

#endif

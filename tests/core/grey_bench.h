/*
 * grey_bench: a simulated grey sphere measured as a rig's calibration does it: found in the
 * picture, placed by its shading, every light fitted, gains solved.
 */
#ifndef LS_TESTS_CORE_GREY_BENCH_H
#define LS_TESTS_CORE_GREY_BENCH_H

#include "core/gains.h"
#include "core/shading.h"
#include "tests/core/grey_rig.h"

#include <stdbool.h>

/* Everything measured of one channel. */
struct grey_measured {
    struct ls_gains gains;
    struct ls_shading *fits; /* [light * n_cameras + camera] */
    double *strength, *sigma, *lit;
    uint8_t *one_sided;
};

struct grey_bench {
    struct grey_rig *rig;
    struct ls_sphere_view *view[SIM_MAX_CAMERAS];
    double misplaced_deg;    /* by how much every light stands beside its place in the rig file */
    const double (*tint)[3]; /* [n_lights], what the pictures of a light are multiplied by in each
                                camera colour; or NULL */
    bool moved;              /* ls_shading_settle found that */
    float *e;
    uint8_t *validity;
};

/** Creates the rig (full sphere at duty 0.011, 14 groups at duty 0.1) and finds the sphere in every
 * camera. */
struct grey_bench *grey_bench_new(const struct grey_rig_options *options);
struct grey_bench *grey_bench_new_with(const struct grey_rig_options *options, double sphere_duty,
                                       uint32_t n_groups, double group_duty);
void grey_bench_free(struct grey_bench *bench);

/** Photograph one light and fit its shading, the light believed to be at @position. */
void grey_bench_fit(struct grey_bench *bench, uint32_t camera, uint32_t channel, uint32_t light,
                    const double position[3], struct ls_shading *out);

/** Where the rig file says a light is: turned by misplaced_deg in a direction of its own. */
void grey_bench_believed(const struct grey_bench *bench, uint32_t light, double position[3]);

/** Fit every light of a channel where it is believed to be, settle, and solve. */
void grey_measure(struct grey_bench *bench, uint32_t channel, struct grey_measured *out);
void grey_measured_finish(struct grey_measured *measured);

#endif

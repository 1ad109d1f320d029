/*
 * grey_bench: a simulated grey sphere photographed by one to four cameras and measured as a rig is,
 * by ls_grey_measure: in every channel each light, the full sphere, and groups of lights.
 */
#ifndef LS_TESTS_CORE_GREY_BENCH_H
#define LS_TESTS_CORE_GREY_BENCH_H

#include "core/grey_sphere.h"
#include "tests/core/grey_rig.h"

enum { GREY_GROUPS = 14 };
/* The LEDs take 11 of 1000 steps for the first, which is 0.9 % less. */
static const double grey_sphere_duty = 0.0111, grey_group_duty = 0.1;
static const double grey_reflectance = 0.33; /* materials.csv: 0.3300 at every wavelength */

struct grey_bench {
    struct grey_rig *rig;
    double misplaced_deg;    /* by how much every light stands beside its place in the rig file */
    const double (*tint)[3]; /* [n_lights], what the pictures of a light are multiplied by in each
                                camera colour; or NULL */
    struct {
        float *e;
        uint8_t *validity;
    } * photographs; /* [picture * n_cameras + camera], taken once */
    uint32_t n_pictures;
};

struct grey_bench *grey_bench_new(const struct grey_rig_options *options);
void grey_bench_free(struct grey_bench *bench);

/** All of it. *returns: (transfer full), ls_grey_destroy. */
struct ls_grey *grey_bench_measure(struct grey_bench *bench);

/** What the factor of the full sphere or of a group is, by the simulator. */
double grey_bench_sphere_factor(const struct grey_bench *bench, uint32_t channel);
double grey_bench_group_factor(const struct grey_bench *bench, uint32_t channel);

#endif

/*
 * truth: the noise-free field and pictures of a scene, for whoever judges the system.
 * Layer: sim. Threads: any, concurrently: the scene is read only. Ownership: the caller owns every
 * buffer passed.
 *
 * R(i,p,s,c) is the radiance of pixel p in camera channel c under light i alone at strength 1 in
 * channel s (so k E for an E without noise, droop or quantisation), in the unit of sim/scene.h. V
 * and H are scaled so that a depolarising grey reads half of W under each. Camera channels are
 * R, G, B, or one for a mono camera, each at every pixel: no mosaic.
 */
#ifndef LS_SIM_TRUTH_H
#define LS_SIM_TRUTH_H

#include "core/calibration.h"
#include "core/environment.h"
#include "core/error.h"
#include "sim/scene.h"

#include <stdbool.h>
#include <stdint.h>

/** A region of the sensor of one camera. */
struct sim_region {
    uint32_t camera, x, y, width, height;
};

/** Is it a region of a scene that has a truth? LS_ERR_INVALID, LS_ERR_UNSUPPORTED (stamp). */
LS_MUST_CHECK enum ls_err sim_truth_check(const struct sim_scene *scene,
                                          const struct sim_region *region, struct ls_diag *diag);

/** Camera channels of a camera: 3, or 1 for mono. */
uint32_t sim_truth_colours(const struct sim_scene *scene, uint32_t camera);

/**
 * R of every channel under @light over a region, in one geometric evaluation.
 * @out: [n_channels][height][width][colours], floats. Errors: LS_ERR_INVALID (out of range),
 * LS_ERR_UNSUPPORTED (stamp has no truth), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err sim_truth_field(const struct sim_scene *scene,
                                          const struct sim_region *region, uint32_t light,
                                          float *out, struct ls_diag *diag);

/**
 * Pictures relit with weights: out = sum over s and i of weight R. @weights: [n_pictures]
 * [n_channels][n_lights]; @out: [n_pictures][height][width][colours]. Lights whose weights are all
 * zero cost nothing.
 */
LS_MUST_CHECK enum ls_err sim_truth_relight(const struct sim_scene *scene,
                                            const struct sim_region *region, const float *weights,
                                            uint32_t n_pictures, float *out, struct ls_diag *diag);

/**
 * A picture under a spectral environment: each lobe's radiance is integrated over every light's
 * cell with @n_directions (spherical Fibonacci, each given to its nearest light), then shaded with
 * the lobe's own spectrum, at 5 nm, as if the light had it. Spectra have the unit in which the
 * white LED of the calibration reads p(W, green) = 1. @out: [height][width][colours]. @specular:
 * [height][width], the share of specular light in the picture, largest over colours, 0 without any
 * light; or NULL. Errors: LS_ERR_INVALID, LS_ERR_UNSUPPORTED (stamp, replay), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err sim_truth_environment(const struct sim_scene *scene,
                                                const struct sim_region *region,
                                                const struct ls_lobes *lobes, uint32_t n_directions,
                                                float *out, float *specular, struct ls_diag *diag);

/**
 * The pixels' shares, per method: bounced light over total light under the sum of all white
 * lights (@bounced), specular over total under one light in white, green or mono (@specular).
 * Out: [height][width]; pixels without any light are 0. The masks are > 0.2 and > 0.5.
 */
LS_MUST_CHECK enum ls_err sim_truth_bounced(const struct sim_scene *scene,
                                            const struct sim_region *region, float *bounced,
                                            struct ls_diag *diag);
LS_MUST_CHECK enum ls_err sim_truth_specular(const struct sim_scene *scene,
                                             const struct sim_region *region, uint32_t light,
                                             float *specular, struct ls_diag *diag);

/** A rectangle of sensor pixels well inside one sample of the still life. */
struct sim_sample {
    char name[32];  /* "white", "fabric 1", "velvet" ... */
    char group[16]; /* "chart", "fabric", "velvet" */
    uint32_t x, y, width, height;
};

enum {
    SIM_SAMPLES = 24 + 12 + 1,
};

/** Chart in reading order, fabrics, velvet. LS_ERR_UNSUPPORTED for scenes without them; a sample
 * is at least 1 x 1 px. @out: SIM_SAMPLES. */
LS_MUST_CHECK enum ls_err sim_truth_samples(const struct sim_scene *scene, uint32_t camera,
                                            struct sim_sample *out, struct ls_diag *diag);

/** The calibration of a rig that knows itself: gains, p, L, M, the constants of @camera read out as
 * @pixel_format, and the droop of full spheres at the duties given, of fourteen segments and of a
 * head light of three lights, each light at an even share of full. @out: ls_calibration_destroy. */
LS_MUST_CHECK enum ls_err sim_truth_calibration(const struct sim_scene *scene, uint32_t camera,
                                                const char *pixel_format, const double *duties,
                                                uint32_t n_duties, struct ls_calibration **out,
                                                struct ls_diag *diag);

/**
 * The subcommands of lightstage-sim that ask for truth; argv[0] is the subcommand:
 *   describe    calibration.json
 *   field       lights x channels x region as EXR, mosaic or RGB
 *   relit       pictures with given weights
 *   environment a picture under lobes
 *   samples     rectangles as JSON
 *   masks       interreflection and highlight masks
 * @scene is the configured world. Returns the process's exit status; prints usage on a wrong one.
 */
int sim_truth_main(const struct sim_scene_config *config, int argc, char **argv);

/** Is @name one of them? */
bool sim_truth_has(const char *name);

/** What each of them takes. */
const char *sim_truth_usage(void);

#endif

/*
 * judge: a take, and pictures relit from it, compared with what the simulator knows to be true.
 * Layer: tests. Threads: one caller; judge_field_errors runs two of its own. Ownership: the caller
 * owns every struct; scene, source and lobes are (transfer none).
 *
 * "Promoted" is the take's field by one model, as the daemon serves it; "true" is the noise-free
 * field through the same mosaic and demosaic; both in camera RGB, no matrix. Spectra: every one but
 * white that the take has pictures of (R A G C B on the reference rig).
 */
#ifndef LS_TESTS_JUDGE_H
#define LS_TESTS_JUDGE_H

#include "core/environment.h"
#include "core/error.h"
#include "core/image.h"
#include "daemon/field_source.h"
#include "daemon/promotion.h"
#include "daemon/takedir.h"
#include "sim/truth.h"

#include <stdint.h>

enum { JUDGE_COLOURS = 3 };

/** What is judged against what. */
struct judge {
    const struct sim_scene *scene;
    struct ls_field_source *source;
    const struct ls_lobes *lobes;
    struct ls_promotion promotion;
};

/** Errors of the promoted field, in percent unless said otherwise. */
struct judge_field_errors {
    double olat_mae;            /* samples, camera channels, spectra, lights that light the white */
    double field_rms;           /* all lights, spectra, pixels, channels */
    double interreflection_rms; /* pixels with > 20 % bounced light under the white full sphere */
    double highlight_rms;       /* (light, pixel) pairs with > 50 % specular */
    double promotion;           /* samples relit through one channel by the environment's mean */
    double promotion_by_spectrum[LS_FIELD_MAX_SPECTRA]; /* [spectrum]; 0 is unused */
    double black_mean_sigma; /* velvet under a constant map, channel W; in predicted sigmas */
};

/** The stored values of a picture over a window, out[height][width]; 0 where no tile is stored. */
void judge_load(const struct ls_field *field, const struct ls_picture *picture,
                const struct ls_demosaic_region *window, float *out);

/** One sweep over lights and rows. Errors: LS_ERR_STATE, LS_ERR_NOT_FOUND (a spectrum lacks what
 * the model needs, a light its picture), LS_ERR_INVALID (take and scene differ in size),
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err judge_field_errors(const struct judge *judge,
                                             struct judge_field_errors *out, struct ls_diag *diag);

/** The true picture under the environment, through the take's mosaic and demosaic (height, width,
 * 3), and the share of specular light in it (height, width, 1). ls_image_finish each. */
LS_MUST_CHECK enum ls_err judge_true_picture(const struct judge *judge, struct ls_image *image,
                                             struct ls_image *specular, struct ls_diag *diag);

/** Relative RMS in percent of @relit (camera RGB, unit of R) against @truth, outside the highlights
 * (@specular > 50 %). LS_ERR_INVALID: sizes differ. */
LS_MUST_CHECK enum ls_err judge_picture_error(const struct ls_image *relit,
                                              const struct ls_image *truth,
                                              const struct ls_image *specular, double *percent,
                                              struct ls_diag *diag);

/**
 * The paper's errors (its Figs. 5 and 7) of @relit against @truth: squared differences of a
 * sample's mean pixel after the take's matrix M, relative to the square of the true white patch's
 * largest channel, averaged over samples and channels; percent. NAN where there is no M. @chart,
 * @fabric: of the 24 patches, of the 12 fabrics. @rms: the root of the mean over both, percent.
 * Errors: LS_ERR_INVALID (sizes differ), those of sim_truth_samples.
 */
LS_MUST_CHECK enum ls_err judge_paper_error(const struct judge *judge, const struct ls_image *relit,
                                            const struct ls_image *truth, double *chart,
                                            double *fabric, double *rms, struct ls_diag *diag);

/** Tickets joined to the simulator's log of what was truly shown. */
struct judge_labels {
    uint32_t checked, mislabeled;
    char first[256]; /* the first one, in words */
};

/** A shot is mislabeled when its ticket's frame was lit otherwise or exposed for another time than
 * the plan says, or when no such frame was ever shown. @log: the text of the log. Errors:
 * LS_ERR_INVALID (a log that is none), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err judge_check_labels(const struct ls_takedir *take, const char *log,
                                             struct judge_labels *out, struct ls_diag *diag);

/** Pictures to look at: every spectrum's photographed full sphere, and the light nearest to
 * camera-left above, in white; camera RGB. @spheres: [n_spectra]; ls_image_finish each. */
LS_MUST_CHECK enum ls_err judge_view_field(const struct judge *judge, struct ls_image *spheres,
                                           struct ls_image *light, struct ls_diag *diag);

/** One picture of a contact sheet; camera RGB or mono, made to be looked at with @m (row-major,
 * NULL = none) and @gain. */
struct judge_thumb {
    const struct ls_image *image;
    const double *m;
    double gain;
};

/** Thumbnails in rows of @columns, each @side px wide, sRGB. @image: ls_image_finish. Linear. */
LS_MUST_CHECK enum ls_err judge_contact_sheet(const struct judge_thumb *thumbs, uint32_t n,
                                              uint32_t columns, uint32_t side,
                                              struct ls_image *image, struct ls_diag *diag);

#endif

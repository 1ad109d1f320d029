/*
 * grey_sphere: a rig measured on a grey sphere, from its merged pictures: where the sphere stands,
 * the lights' gains and directions, factors of patterns, p and scale; with one to sixteen cameras.
 * Layer: core. Threads: any; pure but for the pictures, which the caller reads. Ownership: the
 * result owns its arrays; see destroy.
 *
 * In each camera the outline of the white full sphere says where the sphere stands; then passes
 * over single white lights move it to where their shading says (ls_centre_step), until a step is
 * within its error: an outline may be millimetres off along the view, where a step leaves a tenth,
 * and 0.3 mm there are 0.1 % of a gain, the same in all colours. A hundred lights are enough for
 * that, evenly taken from all. Then every picture is fitted once (core/shading.h), of all channels
 * and cameras together it is settled whether the lights stand where they should, gains are solved
 * per channel (core/gains.h), patterns compared with the sums of their lights
 * (core/pattern_factor.h), polarised channels and closure scaled.
 *
 * Accuracy on the rigs of core/gains.h: directions of lights without a flag within 0.1 degrees (rms
 * 0.03), the lights up to 0.9 degrees from where they should be; factors of full spheres within
 * 0.1 %, of segments within 0.02 %.
 */
#ifndef LS_CORE_GREY_SPHERE_H
#define LS_CORE_GREY_SPHERE_H

#include "core/calibration.h"
#include "core/gains.h"
#include "core/pattern_factor.h"
#include "core/shading.h"
#include "core/sphere_view.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_GREY_PATTERNS = 1024 }; /* pictures of several lights in one channel */

/** A lit picture of a plan; every camera takes it. */
struct ls_lit_picture {
    char id[64];
    uint32_t channel;
    int32_t light;    /* of a single light, else -1 */
    char pattern[24]; /* of several lights, else "" */
    double duty;      /* nominal */
    float *weights;   /* [n_lights] of several: level over the nominal level; else NULL */
};

/**
 * One picture: @e [height][width] of the whole camera, full scale / s, ungained, NaN where it was
 * not asked for; @validity: enum ls_validity. Valid during the call.
 */
typedef enum ls_err ls_lit_use(void *user, const struct ls_lit_picture *picture, const float *e,
                               const uint8_t *validity, struct ls_diag *diag);

/**
 * Reads pictures: hands each of @n, in that order, to @use, whose error ends it. Only pixels within
 * @around are needed, all if it is NULL.
 */
struct ls_grey_source {
    enum ls_err (*read)(void *user, uint32_t camera, const struct ls_lit_picture *const *pictures,
                        uint32_t n, const struct ls_outline *around, ls_lit_use *use,
                        void *use_user, struct ls_diag *diag);
    void *user;
};

/** The rig as its file describes it, the sphere, and what was photographed. All the caller's. */
struct ls_grey_rig {
    uint32_t n_lights, n_channels, n_cameras, n_pictures;
    const float (*position_m)[3]; /* [light], stage frame */
    struct {
        const char *name;
        bool spectrum;                       /* else behind a polariser */
    } channels[LS_CALIBRATION_MAX_CHANNELS]; /* the first spectrum is white */
    struct {
        struct ls_pinhole pinhole;
        enum ls_cfa cfa; /* all mono or none */
    } cameras[LS_CALIBRATION_MAX_CAMERAS];
    struct ls_sphere nominal; /* about where it stands, and its radius */
    double reflectance;       /* in all colours */
    const struct ls_lit_picture *pictures;
};

/** The factor of one pattern at one duty in one channel. */
struct ls_grey_factor {
    uint32_t channel;
    char pattern[24];
    double duty;
    struct ls_pattern_factor value;
    uint32_t pictures; /* of all cameras */
};

/** What one camera saw. */
struct ls_grey_view {
    struct ls_sphere sphere; /* where it stands */
    struct ls_outline outline;
    struct ls_sphere_view *view;
    double misfit, rejected; /* middle of the well-lit white pictures */
    double saturated;        /* share of the sphere's white pixels */
    double scale;
    float p[LS_CALIBRATION_MAX_CHANNELS][3];
};

struct ls_grey {
    uint32_t n_lights, n_channels, n_cameras, n_colours, white;
    struct ls_grey_view cameras[LS_CALIBRATION_MAX_CAMERAS];
    struct ls_gains gains[LS_CALIBRATION_MAX_CHANNELS];
    double *numbers;             /* behind the pointers of gains */
    uint8_t *flags;              /* [light] of all channels together; behind them those of gains */
    struct ls_shading *shading;  /* [(channel * n_lights + light) * n_cameras + camera] */
    double (*direction)[3];      /* [light], unit, by white shading; else as the rig says */
    double *sigma_direction_deg; /* [light]; 0: no camera saw enough */
    struct ls_shading_settled settled;
    uint32_t n_factors;
    struct ls_grey_factor *factors;
};

/**
 * Errors, each with a sentence that says what to do: LS_ERR_NOT_FOUND (no sphere in the picture,
 * cut off, not grey and matte, too bright), LS_ERR_STATE (pictures that are needed are not there),
 * LS_ERR_INVALID, LS_ERR_LIMIT, LS_ERR_NOMEM; those of @source as they are. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_grey_measure(const struct ls_grey_rig *rig,
                                          const struct ls_grey_source *source, struct ls_grey **out,
                                          struct ls_diag *diag);

/** Strength of a light on the grey sphere as a camera saw it, per colour; 0 where it was not
 * measured. RT-safe. */
void ls_grey_strength(const struct ls_grey *grey, uint32_t light, uint32_t channel, uint32_t camera,
                      double strength[3]);

/** NULL is allowed. */
void ls_grey_destroy(struct ls_grey *grey);

#endif

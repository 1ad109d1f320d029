/*
 * scene: the simulated world: lights, subject, optics, and the pictures a program of conditions
 * makes. What is seen here is the truth the rest of the system is judged against.
 * Layer: sim. Threads: create, commit and destroy on one thread; sim_scene_expose from any number
 * of camera threads, also while a commit runs (it then sees the previous program). Ownership: the
 * scene copies its configuration.
 *
 * Scenes:
 *   stilllife  chart, fabrics, spheres, wax prism, cup between felts, velvet, backdrop, table
 *   grey       33 % Lambertian sphere at the centre (calibration)
 *   chrome     mirror-like metal sphere at the centre
 *   gloss      black glossy dielectric sphere at the centre
 *   highlights four spheres: red wax (coated), ochre (matte), gold and chrome (metal)
 *   stamp      every frame carries what was really in force, in its pixels (sim/stamp.h)
 *   replay     a folder of images, one per light in name order, is the truth; mono, one channel
 *
 * Light: an LED is a Lambertian emitter at its position aimed at the centre, so a point x at
 * distance d sees irradiance r^2 cos(emission) cos(incidence) / d^2 with r the light's own distance
 * from the centre: 1 at the centre for strength 1. A closed sphere of such lights is a uniform
 * field everywhere inside. Unit of radiance: a 100 % Lambertian facing one white light of strength
 * 1 at the centre reads 1/pi in green (mono: its channel).
 */
#ifndef LS_SIM_SCENE_H
#define LS_SIM_SCENE_H

#include "core/error.h"
#include "sim/geometry.h"
#include "sim/stage.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    SIM_MAX_CAMERAS = 4,
    SIM_MAX_CHANNELS = 16,
    SIM_MAX_LED_FAULTS = 64,
};

enum sim_channel_kind {
    SIM_CHANNEL_SPECTRUM,
    SIM_CHANNEL_VERTICAL,   /* behind a polariser whose axis is as vertical as the light allows */
    SIM_CHANNEL_HORIZONTAL, /* behind a polariser across that */
};

struct sim_channel_config {
    char name[16];
    enum sim_channel_kind kind;
    char spectrum[64];   /* column of leds.csv */
    double droop;        /* >= 1: divisor when every light is on, 1 for a single one */
    double drift;        /* relative change of its light once warm, > -1 */
    double drift_pulses; /* exposures of a camera after which 63 % of it has come, > 0 */
};

/** Optics and sensor of one camera: what it sees. (How it talks is sim/camera.h.) */
struct sim_view_config {
    double position_m[3], look_at_m[3];
    double focal_length_mm, sensor_width_mm; /* square pixels: height follows from the size */
    uint32_t width, height;                  /* sensor, px; both >= 1 */
    char cfa[8];    /* "RG" "GR" "GB" "BG": the 2x2 cell's first row at pixel (0,0); "mono" */
    double blur_px; /* sigma of a point's image, photosites' aperture included: sim/blur.h */
    /* sensor: x = black + full_scale * rate * radiance * t, then noise, in fractions of full scale
     */
    double full_well_e; /* electrons at full scale */
    double black;       /* of full scale; rounded to whole DN per format */
    double read_noise_e;
    double dark_current_e_s;   /* electrons per second, mean; Poisson noise */
    double prnu;               /* sigma of the pixels' relative gain */
    double hot_per_mpixel;     /* defective pixels with a high dark current */
    double ambient;            /* radiance added while the shutter is open, LEDs on or off */
    double white_exposure_us;  /* at which a 90 % diffuser facing a front light reads 0.5 */
    double exposure_offset_us; /* what this sensor adds to a trigger pulse (written to the
                                  calibration; the stage already includes it in exposure_us) */
};

/** An LED that is not what it should be. */
struct sim_led_fault {
    uint32_t light;
    char channel[16]; /* "" = all of the light's */
    double strength;  /* of what it would give, [0, 10] */
};

struct sim_scene_config {
    char scene[16];
    uint64_t seed;
    /* lights */
    char positions_csv[1024]; /* "" = the generated sphere */
    char axes[64];            /* of the CSV, e.g. "left,up,away" */
    char unit[8];
    uint32_t n_lights;   /* of the generated sphere, 346 */
    double radius_m;     /* of the generated sphere, 1.35 */
    double gain_sigma;   /* relative spread of LED strengths, 0.05 */
    uint32_t pwm_levels; /* distinct duties in (0, 1]; 0 = continuous */
    uint32_t n_channels;
    struct sim_channel_config channels[SIM_MAX_CHANNELS];
    uint32_t n_led_faults;
    struct sim_led_fault led_faults[SIM_MAX_LED_FAULTS];
    /* cameras */
    uint32_t n_cameras;
    struct sim_view_config views[SIM_MAX_CAMERAS]; /* by camera index */
    /* files and limits */
    char spectra_dir[1024]; /* "" = the one of the source tree */
    char replay_dir[1024];
    bool replay_linear;     /* else sRGB-decoded */
    double sphere_radius_m; /* of grey, chrome and gloss: (0, 0.1] */
    uint64_t memory_bytes;  /* for rendered conditions; what does not fit is rendered when shown */
    uint32_t threads;       /* renderers, 1 or 2 */
    uint32_t stamp_frames;  /* stamps are cut out of so many frames read out before; 0 = each
                               is read out on its own: sim/stamp_frames.h */
};

/** The reference: stilllife, 346 lights, W R A G C B V H, one 512x512 BayerRG camera at 1.6 m. */
void sim_scene_config_default(struct sim_scene_config *config);

/** The defaults of one camera of @width x @height; the sensor's area stays the same. */
void sim_view_config_default(struct sim_view_config *view, uint32_t width, uint32_t height);

/** Would sim_scene_create accept it? LS_ERR_INVALID names the key. Reads no file. */
LS_MUST_CHECK enum ls_err sim_scene_config_check(const struct sim_scene_config *config,
                                                 struct ls_diag *diag);

struct sim_scene;

/**
 * Build the world: load spectra and positions, draw gains, trace what the cameras see.
 * (transfer full). Errors: LS_ERR_INVALID, LS_ERR_NOT_FOUND (a file), LS_ERR_NOMEM. For replay
 * there must be at least as many PNG images as lights, none larger than the sensor; smaller ones
 * lie at its top left, the rest is black.
 */
LS_MUST_CHECK enum ls_err sim_scene_create(const struct sim_scene_config *config,
                                           struct sim_scene **out, struct ls_diag *diag);
void sim_scene_destroy(struct sim_scene *scene);

const struct sim_scene_config *sim_scene_config(const struct sim_scene *scene);
const struct sim_geometry *sim_scene_geometry(const struct sim_scene *scene);

/** Strength of an LED at full duty, alone and cold: the reciprocal of the calibration's k. What a
 * faulty LED would give without its fault. */
double sim_scene_gain(const struct sim_scene *scene, uint32_t light, uint32_t channel);

/** Divisor on the output of @channel when @n_lit LEDs are lit together: 1 + (droop - 1) (n_lit - 1)
 * / (n_lights - 1), never below 1. Duty plays no part: PWM switches all LEDs in phase, so the
 * supply sags as for full duty while they are on. */
double sim_scene_droop(const struct sim_scene *scene, uint32_t channel, double n_lit);

/** What is left of a channel's light at a camera's exposure number @sequence:
 * 1 + drift (1 - exp(-sequence / drift_pulses)). */
double sim_scene_drift(const struct sim_scene *scene, uint32_t channel, uint64_t sequence);

/** A duty as this hardware can drive it: the nearest multiple of 1 / pwm_levels, [0, 1]. */
double sim_scene_quantise(const struct sim_scene *scene, double duty);

/** Progress of a commit, [0, 1], on the committing thread. */
typedef void sim_scene_progress(void *user, double done);

/**
 * Make the program's conditions showable. Renders the distinct ones in one sweep over the lights
 * into memory up to memory_bytes, conditions with many LEDs first; those an earlier commit rendered
 * are kept, so that committing a repair or resume program is cheap. The arrays are copied.
 * @progress may be NULL. Errors: LS_ERR_INVALID (light or channel out of range), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err sim_scene_commit(struct sim_scene *scene,
                                           const struct sim_condition *conditions, uint32_t n,
                                           sim_scene_progress *progress, void *user,
                                           struct ls_diag *diag);

/** Bytes of a raw image; 0 if the pixel format is none of core/pixel.h. */
size_t sim_raw_bytes(const struct sim_raw_format *format);

/**
 * One exposure as raw wire bytes (core/pixel.h). A run repeats exactly: the noise depends on seed,
 * camera, sequence and pixel alone. @raw: sim_raw_bytes(format). The region must lie in the sensor
 * and a Bayer format must have the sensor's order, shifted by an odd offset. Errors:
 * LS_ERR_INVALID.
 */
LS_MUST_CHECK enum ls_err sim_scene_expose(struct sim_scene *scene,
                                           const struct sim_exposure *exposure,
                                           const struct sim_raw_format *format, void *raw,
                                           size_t raw_bytes, struct ls_diag *diag);

#endif

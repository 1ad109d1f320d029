/*
 * calibration: everything measured about a rig that a take's numbers depend on, and its JSON form.
 * Layer: core. Threads: any; no shared state. Ownership: one allocation tree under ls_calibration,
 * released by ls_calibration_destroy.
 *
 * Relations (k, g, p, L: see the fields):
 *   E = (x - dark) / (full_scale_dn * t)         ungained, full scale per second
 *   R = scale * k(i,s) * E                       a 100 % Lambertian facing a white light reads 1/pi
 *   sum of basis images / (photographed pattern / nominal duty) = pattern factor, on E
 * Spectra of channels are spectral irradiance per nm of a light of strength 1 and share one unit
 * with the sensitivities: integral of spectrum * sensitivity d(lambda) = p(s,c), p(W, green) = 1
 * (mono: its one channel).
 *
 * JSON schema, format 1 (every key required unless marked optional):
 *   format            1
 *   lights            { position_m: [[x,y,z]...], direction: [[x,y,z]...], omega_sr: [...] }
 *   channels          [{ name, kind: "spectrum"|"polariser",
 *                        spectrum (optional): { start_nm, step_nm, values: [...] } }]
 *   k, sigma_k        { channel name: [one per light] }
 *   pattern_factors   [{ channel, pattern: "sphere", duty, factor }]
 *   scale             number > 0
 *   p                 { channel name: [r,g,b] or [mono] }
 *   chart (optional)  { names: [...],
 *                       reflectance: { start_nm, step_nm, values: [one row per patch] } }
 *   L (optional)      [patch][camera channel][channel of kind spectrum and polariser, in order]
 *   camera            { sensitivities (optional): { start_nm, step_nm, values: [one row per camera
 *                       channel] }, black_dn, full_scale_dn, electrons_per_dn, read_noise_dn,
 *                       cfa: "RG"|"GR"|"GB"|"BG"|"mono", pixel_format, exposure_offset_us,
 *                       range: [low, high], hot_pixels: [[x,y]...] }
 *   M (optional)      [[3]...3] camera raw to linear Rec. 709; a D65 white whose green raw is 1
 *                       becomes (1,1,1)
 * What `lightstagectl calibrate` has measured besides; every key is optional:
 *   lights            also { flags: { "one-sided"|"dead"|"uncertain": [light...] },
 *                       measured_direction: [[x,y,z]...], sigma_direction_deg: [...] }
 *   k_colour          { channel name: [[r,g,b] per light] } factors on k for one camera channel
 *                       (core/gains.h); a channel that is missing has none. Of a mono camera
 *                       ([f] per light) they are part of k, and normalised with it
 *   pattern_factors   also { sigma } in each
 *   polarisation      { a_v: [[one per light] per camera], a_h: the same }
 *   mirror_reflectivity  [r,g,b] or [mono]
 *   residuals         [{ name, value, unit }]
 *   provenance        { date, software, takes: [{ subject, take }] }
 *
 * Names of patterns: "sphere" (every light), "segments-14" (any one of a partition into 14),
 * "headlight", "multiplex" ...: one name for all pictures that light about as many LEDs at a time,
 * since the supply's sag is what the factor holds.
 */
#ifndef LS_CORE_CALIBRATION_H
#define LS_CORE_CALIBRATION_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    LS_CALIBRATION_MAX_LIGHTS = 4096,
    LS_CALIBRATION_MAX_CHANNELS = 16,
    LS_CALIBRATION_MAX_PATTERNS = 1024,
    LS_CALIBRATION_MAX_PATCHES = 256,
    LS_CALIBRATION_MAX_SAMPLES = 1024, /* wavelengths of a spectrum */
    LS_CALIBRATION_MAX_HOT = 1 << 20,
    LS_CALIBRATION_MAX_CAMERAS = 16,
    LS_CALIBRATION_MAX_RESIDUALS = 1024,
    LS_CALIBRATION_MAX_TAKES = 64,
};

/** What is known against a light; a set of bits. */
enum ls_light_flag {
    LS_LIGHT_ONE_SIDED = 1, /* beyond 120 degrees of every camera: its gain comes from a crescent */
    LS_LIGHT_DEAD = 2,      /* gives no light in some channel: k = 1 there, and sigma_k = 1 */
    LS_LIGHT_UNCERTAIN = 4, /* no camera saw enough of it: taken for the mean of the others */
    LS_LIGHT_FLAGS = 7,
};

/** Rows of equally sampled spectra: value of row r at start_nm + i step_nm is v[r * n + i]. */
struct ls_spectral_table {
    double start_nm, step_nm;
    uint32_t n; /* wavelengths, 0 = absent */
    uint32_t rows;
    float *v;
};

struct ls_calibration_channel {
    char name[16];
    bool polariser;                    /* kind */
    struct ls_spectral_table spectrum; /* one row; n = 0 if unknown */
};

/** Ungained basis sum over photographed picture per nominal duty, e.g. 1.20 for a full sphere. */
struct ls_calibration_pattern {
    uint32_t channel;
    char pattern[16]; /* "sphere" */
    double duty;      /* nominal, (0, 1] */
    double factor;
    double sigma; /* standard error of the factor; 0 = unknown */
};

/** One number about the quality of the calibration, e.g. {"sphere outline", 0.04, "px"}. */
struct ls_calibration_residual {
    char name[64];
    double value;
    char unit[16]; /* may be empty: a ratio */
};

struct ls_calibration_take {
    char subject[32]; /* "grey sphere" */
    char take[64];    /* its id */
};

/** Where the numbers come from. */
struct ls_calibration_provenance {
    char date[32];     /* ISO 8601, UTC; empty = no provenance */
    char software[64]; /* "lightstaged 0.1.0" */
    uint32_t n_takes;
    struct ls_calibration_take takes[LS_CALIBRATION_MAX_TAKES];
};

struct ls_calibration_camera {
    struct ls_spectral_table sensitivity; /* rows = colours; n = 0 if unknown */
    double black_dn, full_scale_dn, electrons_per_dn, read_noise_dn;
    double exposure_offset_us;
    double range_low, range_high; /* linear range, of full scale */
    char cfa[8];                  /* "RG" "GR" "GB" "BG" "mono" */
    char pixel_format[32];        /* GenICam name the DN constants hold for */
    uint32_t n_hot;
    uint32_t (*hot)[2]; /* x, y on the sensor */
};

struct ls_calibration {
    uint32_t n_lights, n_channels;
    uint32_t n_colours; /* camera channels: 3, or 1 for mono */
    float (*position_m)[3];
    float (*direction)[3]; /* unit, centre towards light, as the rig was built */
    float *omega_sr;
    struct ls_calibration_channel channels[LS_CALIBRATION_MAX_CHANNELS];
    float *k,
        *sigma_k; /* [channel * n_lights + light]; mean over lights of 1/k = 1, V, H excepted */
    uint32_t n_patterns;
    struct ls_calibration_pattern *patterns;
    double scale;
    float p[LS_CALIBRATION_MAX_CHANNELS][3]; /* [channel][colour] */
    uint32_t n_patches;                      /* 0 = no chart */
    char (*patch_names)[32];
    struct ls_spectral_table reflectance; /* rows = patches */
    float *L; /* [(patch * n_colours + colour) * n_channels + channel]; NULL = absent */
    struct ls_calibration_camera camera;
    bool has_m;
    double m[3][3]; /* row-major: rec709 = m raw */
    /* measured besides; NULL, 0 or empty where it was not */
    uint8_t *flags;                 /* [light], sets of enum ls_light_flag */
    float (*measured_direction)[3]; /* [light], unit, by shading */
    float *sigma_direction_deg;     /* [light], of either of two directions across */
    float *k_colour;                /* [(channel * n_lights + light) * n_colours + colour] */
    uint32_t n_polarised;           /* cameras with polarisation factors */
    float *a_v, *a_h;               /* [camera * n_lights + light]: share of the specular that each
                                       channel keeps behind the camera's polariser */
    bool has_mirror;
    double mirror_reflectivity[3]; /* [colour] of the chrome ball */
    uint32_t n_residuals;
    struct ls_calibration_residual *residuals;
    struct ls_calibration_provenance provenance;
};

/**
 * Parse and validate. Nothing in the text can make it crash, loop or allocate beyond a small
 * multiple of @size. Errors: LS_ERR_INVALID with the key's path and what was expected,
 * LS_ERR_UNSUPPORTED (another format number), LS_ERR_LIMIT (over a maximum above), LS_ERR_NOMEM.
 * @out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_calibration_parse(const char *text, size_t size,
                                               struct ls_calibration **out, struct ls_diag *diag);

/** NULL is allowed. */
void ls_calibration_destroy(struct ls_calibration *calibration);

/** An empty calibration with zeroed lights, k and sigma_k arrays. (transfer full). */
LS_MUST_CHECK enum ls_err ls_calibration_create(uint32_t n_lights, uint32_t n_channels,
                                                uint32_t n_colours, struct ls_calibration **out,
                                                struct ls_diag *diag);

/** JSON text, NUL-terminated, numbers with enough digits to round-trip floats. @text: (transfer
 * full), free(); NULL after an error. LS_ERR_INVALID: a number that is not finite, a name that is
 * not UTF-8, or out of memory; nothing is left out instead. */
LS_MUST_CHECK enum ls_err ls_calibration_write(const struct ls_calibration *calibration,
                                               char **text, struct ls_diag *diag);

/** Index of a channel by name, or -1. RT-safe. */
int ls_calibration_channel(const struct ls_calibration *calibration, const char *name);

/** Do two nominal duties mean the same? Within a permille of the larger: a picture is scaled by
 * factor / duty, so that much of the 0.5 % that factors are known to may be lost to a duty written
 * with few digits; a duty is a level of 65535, so one that was read back differs by less. RT-safe.
 */
bool ls_calibration_same_duty(double a, double b);

/** Factor of a pattern at a nominal duty, or 0 where none was calibrated. RT-safe. */
double ls_calibration_factor(const struct ls_calibration *calibration, uint32_t channel,
                             const char *pattern, double duty);

/** Say that a factor is not there, for whoever cannot go on without it: a sentence that names
 * channel, pattern, duty, and the duties that were calibrated. Returns LS_ERR_NOT_FOUND. */
enum ls_err ls_calibration_lacks_factor(const struct ls_calibration *calibration, uint32_t channel,
                                        const char *pattern, double duty, struct ls_diag *diag);

/** Add or replace the factor of (channel, pattern, duty). LS_ERR_INVALID (not finite, out of
 * range), LS_ERR_LIMIT, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_calibration_put_factor(struct ls_calibration *calibration,
                                                    const struct ls_calibration_pattern *pattern,
                                                    struct ls_diag *diag);

/** Add or replace a residual. Names and units are cut to their sizes. LS_ERR_INVALID (not finite,
 * no name), LS_ERR_LIMIT, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_calibration_put_residual(struct ls_calibration *calibration,
                                                      const char *name, double value,
                                                      const char *unit, struct ls_diag *diag);

/** Room for what is optional per light: flags, measured_direction and sigma_direction_deg where
 * they are NULL, zeroed (directions: the nominal ones). LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_calibration_add_measured(struct ls_calibration *calibration,
                                                      struct ls_diag *diag);

/** Room for a_v and a_h of @n_cameras, zeroed; what was there is gone. LS_ERR_LIMIT,
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_calibration_add_polarisation(struct ls_calibration *calibration,
                                                          uint32_t n_cameras, struct ls_diag *diag);

#endif

/*
 * environment: the light a picture is relit with: a lat-long RGB map, or spectral lobes.
 * Layer: core. Threads: any, read-only once made. Ownership: a map is a view of the caller's
 * pixels; lobes read from JSON are freed with ls_lobes_destroy.
 *
 * Directions are unit vectors of the stage frame (y up, camera on +z) towards the light.
 * Lat-long: d = (sin t sin f, cos t, -sin t cos f), t = pi v, f = 2 pi (u - 1/2).
 */
#ifndef LS_CORE_ENVIRONMENT_H
#define LS_CORE_ENVIRONMENT_H

#include "core/error.h"
#include "core/spectrum.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_LOBES_MAX = 4096,
    LS_LOBE_MAX_SAMPLES = 4096,
    LS_LOBES_MAX_BYTES = 16 << 20,
    LS_MAP_MAX_SIDE = 65536,
};

enum ls_map_space { LS_MAP_REC709_LINEAR, LS_MAP_CAMERA_RAW };

/** A lat-long radiance map, row 0 at the zenith; texel (x, y) covers u in [x, x + 1) / width. */
struct ls_map {
    const float *rgb; /* [height][width][3] */
    uint32_t width, height;
    enum ls_map_space space;
};

/** One lobe: radiance(d, l) = radiance * exp(sharpness (d . direction - 1)) * spectrum(l). */
struct ls_lobe {
    double direction[3]; /* unit */
    double sharpness;    /* >= 0; 0 = the same from everywhere */
    double radiance;     /* >= 0 */
    struct ls_spectrum spectrum;
};

/** A spectral environment: the sum of its lobes. */
struct ls_lobes {
    size_t n;
    struct ls_lobe *item;
};

/**
 * Parse {"format": 1, "lobes": [{"direction": [x, y, z], "sharpness": k, "radiance": a,
 * "spectrum": {"wavelength_nm": [...], "value": [...]}}, ...]}. Directions are normalised.
 * Hostile input is refused, never a crash: LS_ERR_INVALID names the lobe, the key, what was
 * expected; LS_ERR_UNSUPPORTED (another format); LS_ERR_LIMIT (the limits above). (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_lobes_parse_json(const char *text, size_t bytes, struct ls_lobes **out,
                                              struct ls_diag *diag);

/** NULL is allowed. */
void ls_lobes_destroy(struct ls_lobes *lobes);

/** radiance * exp(sharpness (d . direction - 1)), without the spectrum. @d unit. RT-safe. */
double ls_lobe_radiance(const struct ls_lobe *lobe, const double d[3]);

/** Integral of ls_lobe_radiance over the sphere, in radiance x sr. RT-safe. */
double ls_lobe_energy(const struct ls_lobe *lobe);

/** 1 - cos of the angle inside which the fraction @q in [0, 1] of a lobe's energy lies. RT-safe. */
double ls_lobe_quantile(const struct ls_lobe *lobe, double q);

/** Unit vectors @x, @y that make a right-handed frame with the unit vector @z. RT-safe. */
void ls_frame_about(const double z[3], double x[3], double y[3]);

/** Sizes within 1 .. LS_MAP_MAX_SIDE and every value finite? LS_ERR_INVALID names the texel. */
LS_MUST_CHECK enum ls_err ls_map_check(const struct ls_map *map, struct ls_diag *diag);

/** Direction of (u, v), both in [0, 1]. RT-safe. */
void ls_latlong_direction(double u, double v, double d[3]);

#endif

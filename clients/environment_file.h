/*
 * environment_file: the light somebody brings: a lat-long picture, spectral lobes, or a captured
 * one: a mirror ball and charts.
 * Layer: clients. Threads: the main thread. Ownership: owns pixels and lobes; see finish.
 */
#ifndef LS_CLIENTS_ENVIRONMENT_FILE_H
#define LS_CLIENTS_ENVIRONMENT_FILE_H

#include "core/calibration.h"
#include "core/environment.h"
#include "core/error.h"
#include "core/image.h"
#include "core/captured.h"
#include "core/profile.h"

struct ls_environment_file {
    struct ls_lobes *lobes;    /* or NULL: a map */
    struct ls_captured *probe; /* or NULL; the map is then its ball's, in camera-raw */
    double filled_sr;          /* of that map, what the ball could not show */
    const char *warning;       /* or NULL */
    struct ls_image image;
    struct ls_map map; /* view of image */
};

/** Who knows the reflectivity of a captured light's ball where its JSON does not say: first what
 * was measured of the take's chrome ball (R, G and B), then a profile. Either may be NULL; 1 with a
 * warning where neither knows. */
struct ls_environment_ball {
    const struct ls_calibration *calibration;
    const struct ls_profile *profile;
};

/** Read by extension: .hdr .pic, .exr, .json (core/environment.h or core/captured.h; the ball's
 * picture lies beside its JSON). @space is what a map's numbers mean; Errors: LS_ERR_INVALID,
 * LS_ERR_UNSUPPORTED, LS_ERR_LIMIT, each with the file's name. */
LS_MUST_CHECK enum ls_err ls_environment_file_read(const char *path, enum ls_map_space space,
                                                   const struct ls_environment_ball *known,
                                                   struct ls_environment_file *out,
                                                   struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_environment_file_finish(struct ls_environment_file *file);

#endif

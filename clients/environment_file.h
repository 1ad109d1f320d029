/*
 * environment_file: the light somebody brings: a lat-long picture, spectral lobes, or a captured
 * one: a mirror ball and charts.
 * Layer: clients. Threads: the main thread. Ownership: owns pixels and lobes; see finish.
 */
#ifndef LS_CLIENTS_ENVIRONMENT_FILE_H
#define LS_CLIENTS_ENVIRONMENT_FILE_H

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

/** Read by extension: .hdr .pic, .exr, .json (core/environment.h or core/captured.h; the ball's
 * picture lies beside its JSON). @space is what a map's numbers mean; @profile may be NULL, and
 * otherwise gives the ball's reflectivity where the JSON does not. Errors: LS_ERR_INVALID,
 * LS_ERR_UNSUPPORTED, LS_ERR_LIMIT, each with the file's name. */
LS_MUST_CHECK enum ls_err ls_environment_file_read(const char *path, enum ls_map_space space,
                                                   const struct ls_profile *profile,
                                                   struct ls_environment_file *out,
                                                   struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_environment_file_finish(struct ls_environment_file *file);

#endif

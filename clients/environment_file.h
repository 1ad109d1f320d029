/*
 * environment_file: the light somebody brings: a lat-long picture or spectral lobes.
 * Layer: clients. Threads: the main thread. Ownership: owns pixels and lobes; see finish.
 */
#ifndef LS_CLIENTS_ENVIRONMENT_FILE_H
#define LS_CLIENTS_ENVIRONMENT_FILE_H

#include "core/environment.h"
#include "core/error.h"
#include "core/image.h"

struct ls_environment_file {
    struct ls_lobes *lobes; /* or NULL: a map */
    struct ls_image image;
    struct ls_map map; /* view of image */
};

/** Read by extension: .hdr .pic, .exr, .json (core/environment.h). @space is what a map's numbers
 * mean. Errors: LS_ERR_INVALID, LS_ERR_UNSUPPORTED, LS_ERR_LIMIT, each with the file's name. */
LS_MUST_CHECK enum ls_err ls_environment_file_read(const char *path, enum ls_map_space space,
                                                   struct ls_environment_file *out,
                                                   struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_environment_file_finish(struct ls_environment_file *file);

#endif

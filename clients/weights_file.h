/*
 * weights_file: weights somebody has worked out, one per light and channel.
 * Layer: clients. Threads: the main thread. Ownership: as ls_light_weights.
 *
 * JSON, as `lightstage-sim relit` reads it: {"W": [one per light of the rig, in radiance x sr], ...}.
 * A channel that is not named is dark. The daemon applies the gains.
 */
#ifndef LS_CLIENTS_WEIGHTS_FILE_H
#define LS_CLIENTS_WEIGHTS_FILE_H

#include "clients/light_weights.h"
#include "clients/take_document.h"
#include "core/error.h"

/** Errors: LS_ERR_INVALID (no JSON, a channel the take's rig lacks, other than one finite number per
 * light), LS_ERR_NOT_FOUND, LS_ERR_LIMIT, LS_ERR_NOMEM, each with the file's name. */
LS_MUST_CHECK enum ls_err ls_weights_file_read(const char *path,
                                               const struct ls_take_document *document,
                                               struct ls_light_weights *out, struct ls_diag *diag);

#endif

/*
 * resumed: what a take on disk has already, for the run that goes on with it.
 * Layer: daemon. Threads: any, one at a time; finding blocks on the disk. Ownership: as stated.
 */
#ifndef LS_DAEMON_RESUMED_H
#define LS_DAEMON_RESUMED_H

#include "core/error.h"
#include "core/hot_pixels.h"
#include "daemon/checks.h"
#include "daemon/config.h"
#include "daemon/plan.h"
#include "daemon/takedir.h"
#include "drivers/camera.h"

/** Zeroed: nothing is there. */
struct ls_resumed {
    uint8_t *done; /* per condition: published by every camera; NULL = nothing was looked for */
    float **darks; /* [camera * n_exposures + exposure], NULL where none is published */
    size_t n_darks;
    struct ls_pixel_list defects[LS_MAX_CAMERAS]; /* of the published darks */
};

/** What is looked for, and by whom. */
struct ls_resumed_input {
    const struct ls_takedir *dir;
    const struct ls_plan *plan;
    const struct ls_camera_info *const *cameras;
    uint32_t n_cameras;
    struct ls_checks *checks; /* adopts the published references */
    const _Atomic bool *stop; /* gives up once set; NULL: never */
};

/**
 * Read darks and references (checked against the journal), mark what is done. On failure @out is
 * to be finished too. Errors: LS_ERR_MISMATCH (a camera of another size), LS_ERR_INVALID (a
 * picture is damaged or gone: it is named), LS_ERR_ABORTED, LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_resumed_find(const struct ls_resumed_input *in, struct ls_resumed *out,
                                          struct ls_diag *diag);

void ls_resumed_finish(struct ls_resumed *resumed);

#endif

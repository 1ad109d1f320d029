/*
 * settings: write every setting of a GenICam camera and read it back.
 * Layer: drivers. Threads: the one that may walk features. Ownership: borrows the camera.
 *
 * A value that is there already is not written again. Numbers agree within 1 % + 0.05 of their
 * unit: cameras quantise exposure and gain.
 */
#ifndef LS_DRIVERS_ARAVIS_SETTINGS_H
#define LS_DRIVERS_ARAVIS_SETTINGS_H

#include "drivers/aravis/chunks.h"
#include "drivers/camera.h"

/** What apply finds out and the stream needs. */
struct ls_aravis_setup {
    uint32_t width, height, pixel_format; /* of every good frame */
    uint32_t image_bytes;
    struct ls_aravis_chunk exposure, counter;
    const char *latch_command, *latch_value; /* features, or NULL */
    uint64_t latch_hz;                       /* ticks per second of latch_value */
};

/** Turn a GError into ours and free it: no answer is LS_ERR_GONE, anything else LS_ERR_REFUSED. */
enum ls_err ls_aravis_fail(struct ls_diag *diag, const char *address, const char *what,
                           GError *error);

/** ls_camera_apply of this driver. */
LS_MUST_CHECK enum ls_err ls_aravis_apply(ArvCamera *camera, const char *address,
                                          const struct ls_camera_config *config,
                                          struct ls_aravis_setup *setup,
                                          struct ls_camera_info *info, struct ls_diag *diag);

/** Latch the camera's clock; times as in ls_camera_latch. */
LS_MUST_CHECK enum ls_err ls_aravis_latch(ArvCamera *camera, const char *address,
                                          const struct ls_aravis_setup *setup,
                                          struct ls_camera_control *control, struct ls_diag *diag);

/** Host CLOCK_MONOTONIC_RAW in ns. RT-safe. */
uint64_t ls_aravis_host_ns(void);

#endif

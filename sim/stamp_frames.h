/*
 * stamp_frames: stamps cut out of frames that were read out beforehand, for rates at which reading
 * a sensor out pixel by pixel would take more of the processors than the system under test does.
 * Layer: sim. Threads: any number, one call per camera at a time. Ownership: the caller's struct
 * owns the frames; finish frees.
 *
 * A stamp has two levels. The whole sensor at each of them is read out @n times per exposure time
 * and raw format, in wire layout; a frame is then put together from pieces of their rows, and which
 * of the n each row comes from is drawn by the exposure's noise key. Its noise has the sensor's
 * distribution, and repeats after n frames: for labels, not for statistics.
 */
#ifndef LS_SIM_STAMP_FRAMES_H
#define LS_SIM_STAMP_FRAMES_H

#include "core/error.h"
#include "sim/sensor.h"
#include "sim/stage.h"
#include "sim/stamp.h"

#include <stdbool.h>
#include <stdint.h>

enum { SIM_STAMP_SETS = 8 }; /* of exposure time and format; the oldest gives way */

/** Frames of one exposure time and format. */
struct sim_stamp_set {
    struct sim_raw_format format;
    double exposure_us;
    uint32_t n;
    uint8_t *raw; /* [n][dark, light][row], NULL: unused */
};

/** Of one camera; zeroed to begin with. */
struct sim_stamp_frames {
    struct sim_stamp_set sets[SIM_STAMP_SETS];
    uint32_t next;
};

/** Can a stamp in this format be cut out of bytes, in a region at least 32 px wide and high? */
bool sim_stamp_frames_fit(const struct sim_raw_format *format);

/**
 * Fill @raw (sim_raw_bytes(format)) with @stamp as read out. The first call for an exposure time
 * (within a permille) and format reads 2 @n frames out: some 25 ms per frame of 4 megapixels.
 * @readout: of this exposure. LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err
sim_stamp_frames_draw(struct sim_stamp_frames *frames, uint32_t n, const struct sim_sensor *sensor,
                      const struct sim_stamp *stamp, const struct sim_raw_format *format,
                      const struct sim_readout *readout, void *raw, struct ls_diag *diag);

/** A zeroed struct is allowed. */
void sim_stamp_frames_finish(struct sim_stamp_frames *frames);

#endif

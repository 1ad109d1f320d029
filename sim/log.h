/*
 * log: what was truly shown, one JSON object per line and exposure. The daemon never sees it; it
 * is what a take is judged against.
 * Layer: sim. Threads: any; each line is one write, so a killed simulator leaves whole lines.
 * Ownership: open / close.
 *
 * Keys: camera, frame_id (0: none), camera_ns, true_ns, exposure_us, lit_us, step (-1: none),
 * condition (-1: dark), kind (dark one sphere segment list), n_leds, light (-1 unless exactly one
 * LED is lit), channel and duty (of the first LED; -1 if none), hash (8 hex digits over every LED),
 * fate (sent dropped_pulse lost_frame missed_trigger). camera_ns is the start of the exposure in
 * the camera's clock, true_ns the same in host CLOCK_MONOTONIC_RAW.
 */
#ifndef LS_SIM_LOG_H
#define LS_SIM_LOG_H

#include "core/error.h"
#include "sim/camera.h"
#include "sim/showing.h"

#include <stdint.h>

struct sim_log;

/** Truncates @path; "" logs nothing. Errors: LS_ERR_OS. @out: (transfer full). */
LS_MUST_CHECK enum ls_err sim_log_open(const char *path, struct sim_log **out,
                                       struct ls_diag *diag);

/** One line. A failed write is reported to stderr once and makes sim_log_close fail. */
void sim_log_exposure(struct sim_log *log, const struct sim_exposure *exposure, uint64_t frame_id,
                      uint64_t camera_ns, const struct sim_shown *shown, enum sim_camera_fate fate);

/** LS_ERR_OS if a line was lost. NULL is allowed. */
LS_MUST_CHECK enum ls_err sim_log_close(struct sim_log *log, struct ls_diag *diag);

#endif

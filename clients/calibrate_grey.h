/*
 * calibrate_grey: a take of the grey sphere, measured.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_GREY_H
#define LS_CLIENTS_CALIBRATE_GREY_H

#include "clients/calibrate_take.h"
#include "core/grey_sphere.h"

/** @takes: one take, opened for each of @n_cameras. @radius_m and @reflectance of the sphere, which
 * stands about at the stage's centre. Errors: those of ls_grey_measure and ls_calibrate_fetch, in
 * the take's context. *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_calibrate_grey(const struct ls_calibrate_take *const *takes,
                                            uint32_t n_cameras, double radius_m, double reflectance,
                                            struct ls_grey **out);

#endif

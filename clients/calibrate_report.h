/*
 * calibrate_report: what a person, or a program, is told of a calibration that was made.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_REPORT_H
#define LS_CLIENTS_CALIBRATE_REPORT_H

#include "clients/calibrate_result.h"

#include <jansson.h>

/** Residuals, flags, factors and verdict as a table on stdout. */
void ls_calibrate_print(const struct ls_calibration *calibration,
                        const struct ls_calibrate_remarks *remarks);

/** The same as one JSON object. (transfer full). */
json_t *ls_calibrate_json(const struct ls_calibration *calibration,
                          const struct ls_calibrate_remarks *remarks, const char *file);

#endif

/*
 * row_sums: the rows of core/relight_rows, summed by a crew.
 * Layer: daemon. Threads: one at a time per object; the crew's work along. Ownership: the rows'.
 */
#ifndef LS_DAEMON_ROW_SUMS_H
#define LS_DAEMON_ROW_SUMS_H

#include "core/relight_rows.h"
#include "daemon/crew.h"

/** Make the window hold rows [y0, y1) of the picture; what is above y0 is forgotten if any tile row
 * must be read. Both only grow. Errors: those of ls_relight_rows and of ls_crew_run. */
LS_MUST_CHECK enum ls_err ls_row_sums_need(struct ls_relight_rows *rows, const struct ls_crew *crew,
                                           uint32_t y0, uint32_t y1, struct ls_diag *diag);

#endif

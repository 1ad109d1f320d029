/*
 * relight_request: the daemon is asked for relit pictures, as many at once as it makes.
 * Layer: clients. Threads: the main thread. Ownership: the caller's; see below.
 */
#ifndef LS_CLIENTS_RELIGHT_REQUEST_H
#define LS_CLIENTS_RELIGHT_REQUEST_H

#include "clients/command.h"
#include "clients/light_weights.h"
#include "clients/promotion_report.h"
#include "clients/relight_options.h"
#include "clients/take_document.h"
#include "core/image.h"

#include <stdbool.h>
#include <stdint.h>

/** Of all pictures together. */
struct ls_relit {
    struct ls_promotion_report report;
    uint32_t lights_used, lights_skipped;
    uint64_t tiles_skipped;
    double bound, seconds;
    uint32_t passes; /* over the take */
    bool calibrated;
};

/** How many of the @n pictures to ask for at once: of one kind of weights, and no more than fit
 * into 2 GiB; at least 1. */
uint32_t ls_relight_at_once(const struct ls_relight_options *options,
                            const struct ls_take_document *document,
                            const struct ls_light_weights *weights, uint32_t n);

/** Rows of one picture, rgb[n_rows][width][3]. */
struct ls_relit_rows {
    uint32_t picture; /* of those that were asked for, from 0 */
    uint32_t width, height, first_row, n_rows;
    float *rgb; /* camera RGB, or after M (after_m); the callee's to change */
};

/** An error ends the request. */
typedef enum ls_err ls_relight_take(void *user, const struct ls_relit_rows *rows,
                                    struct ls_diag *diag);

/** Pictures under weights[n] of one kind, each from its first row to its last, a band of all of
 * them before the next. What the daemon will not make at once is asked for in halves. Adds to
 * *result. LS_EXIT_OK or the exit code, said already. */
int ls_relight_request(struct ls_command_context *context, const struct ls_relight_options *options,
                       const struct ls_take_document *document,
                       const struct ls_light_weights *weights, uint32_t n, ls_relight_take *take,
                       void *user, struct ls_relit *result);

#endif

/*
 * fetch_factored: lights under several spectra, from each light's white and one ratio a spectrum.
 * Layer: clients. Threads: the main thread. Ownership: owns what it keeps; see finish.
 *
 * N lights under S spectra come as N + S pictures in place of N x S, and are multiplied here, bit
 * for bit as the daemon would have (core/factored.h).
 */
#ifndef LS_CLIENTS_FETCH_FACTORED_H
#define LS_CLIENTS_FETCH_FACTORED_H

#include "clients/lightstage.h"
#include "clients/promotion_report.h"
#include "core/error.h"
#include "core/image.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_fetch_factored {
    uint32_t n;
    char *names; /* the list, cut at its commas */
    const char *spectra[LS_SPECTRA_SAID];
    struct ls_promotion_report reports[LS_SPECTRA_SAID];
    uint16_t *ratios[LS_SPECTRA_SAID], *white; /* [height][width][3] halves */
    uint32_t width, height;
};

/** @list: "R,A,B". Errors: LS_ERR_INVALID (too many, or a name is empty), LS_ERR_NOMEM. Finish it
 * in any case. */
LS_MUST_CHECK enum ls_err ls_fetch_factored_init(struct ls_fetch_factored *f, const char *list,
                                                 struct ls_diag *diag);

/** Keep what comes. *whole: it was the end of a light's white. Errors: LS_ERR_INVALID (no band of a
 * factored fetch, or of another size), LS_ERR_LIMIT, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_fetch_factored_take(struct ls_fetch_factored *f,
                                                 const struct lightstage_band *band, bool *whole,
                                                 struct ls_diag *diag);

/** The light whose white has come, times its @gain, under a spectrum. *image: finish it. */
LS_MUST_CHECK enum ls_err ls_fetch_factored_expand(const struct ls_fetch_factored *f,
                                                   uint32_t spectrum, float gain,
                                                   struct ls_image *image, struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_fetch_factored_finish(struct ls_fetch_factored *f);

#endif

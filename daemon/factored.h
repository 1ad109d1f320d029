/*
 * factored: the ratio pictures of a factored fetch (core/factored.h).
 * Layer: daemon. Threads: one at a time per object. Ownership: plain values; ways point into the
 * source.
 */
#ifndef LS_DAEMON_FACTORED_H
#define LS_DAEMON_FACTORED_H

#include "core/error.h"
#include "daemon/promotion.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_factored {
    bool wanted;
    uint32_t n, at; /* ratio pictures, which is the next; they come before the lights */
    char names[LS_FIELD_MAX_SPECTRA][32];
    struct ls_way ways[LS_FIELD_MAX_SPECTRA];
};

/** As asked. LS_ERR_UNSUPPORTED: not by a model, or in a form, of which a light is the product of
 * two pictures; LS_ERR_INVALID: the rest of the request does not go with it. */
LS_MUST_CHECK enum ls_err ls_factored_read(const Lightstage__Fetch *fetch,
                                           const struct ls_promotion *promotion,
                                           struct ls_factored *out, struct ls_diag *diag);

/** The ways of all its spectra, as ls_promotion_find, with its errors; may be called again after
 * LS_ERR_BUSY. @white: how the lights themselves come. LS_ERR_UNSUPPORTED: in this take a light is
 * no product. */
LS_MUST_CHECK enum ls_err ls_factored_find(struct ls_factored *f, struct ls_field_source *source,
                                           const struct ls_promotion *promotion,
                                           const struct ls_way *white, const struct ls_job *asker,
                                           struct ls_diag *diag);

/** Is a ratio picture next? */
bool ls_factored_is_ratio(const struct ls_factored *f);

/** Pixels of the next ratio: halves [height][width][components]. */
void ls_factored_fill(const struct ls_factored *f, const struct ls_field_source *source,
                      struct ls_demosaic_region r, uint16_t *out);

#endif

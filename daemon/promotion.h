/*
 * promotion: by which way a spectrum comes to each light, under a model that somebody asked for.
 * Layer: daemon. Threads: any. Ownership: a way points into its source.
 */
#ifndef LS_DAEMON_PROMOTION_H
#define LS_DAEMON_PROMOTION_H

#include "core/error.h"
#include "daemon/field_maps.h"
#include "daemon/field_source.h"
#include "proto/lightstage.pb-c.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_promotion {
    Lightstage__Model model;
    Lightstage__Reference reference;
    bool ideal_polarisation, plain_conductors;
};

/** As asked; @message NULL: @model with STRENGTHS. LS_ERR_UNSUPPORTED: an unknown number, or an
 * option that the model does not have. */
LS_MUST_CHECK enum ls_err ls_promotion_read(const Lightstage__Promotion *message,
                                            Lightstage__Model model, struct ls_promotion *out,
                                            struct ls_diag *diag);

enum ls_way_kind {
    LS_WAY_PHOTOGRAPHED, /* the pictures of `set` */
    LS_WAY_RATIO,        /* white's pictures times the map */
    LS_WAY_MATRIX,       /* the map's matrices on the pictures of its inputs */
    LS_WAY_BLEND,        /* white's pictures, weighted per segment, times the map's ratios */
    LS_WAY_SEPARATED,    /* the polarised pictures; the map for their diffuse part and metals */
};

struct ls_way {
    enum ls_way_kind kind;
    uint32_t channel;               /* of facts */
    uint32_t spectrum;              /* of the field; all but PHOTOGRAPHED */
    const struct ls_light_set *set; /* whose lights must all be there: PHOTOGRAPHED, RATIO, BLEND */
    const struct ls_field_map *map; /* all but PHOTOGRAPHED */
};

/**
 * The way to @channel; its map is made if it is not there yet, which may take long: LS_ERR_ABORTED
 * soon after @asker (or NULL) is cancelled, LS_ERR_BUSY as ls_field_maps_get. Other errors:
 * LS_ERR_NOT_FOUND (the plan asked for no such pictures), LS_ERR_STATE (they are missing, or their
 * pattern is not calibrated), LS_ERR_UNSUPPORTED (a polariser by any model but MEASURED): the
 * sentence says which, what makes them, and which models the take offers for this channel; those of
 * ls_field_maps_get.
 */
LS_MUST_CHECK enum ls_err ls_promotion_find(struct ls_field_source *source,
                                            const struct ls_promotion *promotion, uint32_t channel,
                                            const struct ls_job *asker, struct ls_way *out,
                                            struct ls_diag *diag);

/** What was done, for the client; strings point into the source. */
void ls_promotion_report(const struct ls_field_source *source, const struct ls_promotion *promotion,
                         const struct ls_way *way, Lightstage__SpectrumReport *out);

#endif

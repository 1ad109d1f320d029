/*
 * picture_attrs: what every picture made from a take says of the take in its OpenEXR header.
 * Layer: clients. Threads: the main thread. Ownership: the caller finishes the list.
 */
#ifndef LS_CLIENTS_PICTURE_ATTRS_H
#define LS_CLIENTS_PICTURE_ATTRS_H

#include "clients/lightstage.h"
#include "clients/take_document.h"
#include "core/exr.h"
#include "core/primaries.h"

/** The take, its time, its camera, its conventions, and whether it was @calibrated. Errors stay in
 * attrs->err. */
void ls_picture_attrs_take(const struct ls_take_document *document, bool calibrated,
                           struct ls_exr_attrs *attrs);

/** One light: its row in the rig, where it stands, and the direction towards it. */
void ls_picture_attrs_light(const struct ls_take_document *document, uint32_t light,
                            struct ls_exr_attrs *attrs);

/** Of a fetched picture: its channel, exposure and gain. Errors stay in attrs->err. */
void ls_picture_attrs_fetched(const struct ls_take_document *document,
                              const struct lightstage_band *band, const char *channel,
                              struct ls_exr_attrs *attrs);

/** `chromaticities`. Errors stay in attrs->err. */
void ls_picture_attrs_primaries(const struct ls_primaries *primaries, struct ls_exr_attrs *attrs);

#endif

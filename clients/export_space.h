/*
 * export_space: which colours exported pictures have, and the way there from the camera's.
 * Layer: clients. Threads: any; pure. Ownership: none.
 */
#ifndef LS_CLIENTS_EXPORT_SPACE_H
#define LS_CLIENTS_EXPORT_SPACE_H

#include "clients/colour_space.h"
#include "clients/take_document.h"
#include "core/exr.h"

struct ls_export_space {
    enum ls_colour_space space;
    double from_camera[3][3]; /* but for the camera's */
    bool shown;               /* what its colours are on a screen is known */
    double to_rec709[3][3];   /* if so */
};

/**
 * @space, of @document's pictures: through the calibration's matrix M, which takes the camera's
 * colours to Rec. 709, and from there by core/primaries.h. Errors: LS_ERR_UNSUPPORTED (a mono
 * camera, no matrix; not for the camera's).
 */
LS_MUST_CHECK enum ls_err ls_export_space_begin(struct ls_export_space *out,
                                                enum ls_colour_space space,
                                                const struct ls_take_document *document,
                                                struct ls_diag *diag);

/** What a picture in it says: chromaticities, adoptedNeutral, lightstage/space and
 * lightstage/whitePoint. Errors stay in attrs->err. */
void ls_export_space_attrs(const struct ls_export_space *space, struct ls_exr_attrs *attrs);

#endif

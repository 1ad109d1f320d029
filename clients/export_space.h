/*
 * export_space: which colours exported pictures have, and the way there from the camera's.
 * Layer: clients. Threads: any; pure. Ownership: none.
 */
#ifndef LS_CLIENTS_EXPORT_SPACE_H
#define LS_CLIENTS_EXPORT_SPACE_H

#include "clients/take_document.h"
#include "core/exr.h"
#include "core/primaries.h"

struct ls_export_space {
    const char *name;                     /* as --space has it; never NULL once begun */
    const struct ls_primaries *primaries; /* NULL: the camera's own, which none describe */
    double from_camera[3][3];             /* with primaries */
    bool shown;                           /* what its colours are on a screen is known */
    double to_rec709[3][3];               /* if so */
};

/**
 * The space of that name, "camera", "rec709" or "acescg", for @document's pictures: through the
 * calibration's matrix M, which takes the camera's colours to Rec. 709, and from there by
 * core/primaries.h. Errors: LS_ERR_INVALID (no such name), LS_ERR_UNSUPPORTED (a mono camera, no
 * matrix; not for "camera").
 */
LS_MUST_CHECK enum ls_err ls_export_space_begin(struct ls_export_space *space, const char *name,
                                                const struct ls_take_document *document,
                                                struct ls_diag *diag);

/** What a picture in it says: chromaticities, adoptedNeutral, lightstage/space and
 * lightstage/whitePoint. Errors stay in attrs->err. */
void ls_export_space_attrs(const struct ls_export_space *space, struct ls_exr_attrs *attrs);

#endif

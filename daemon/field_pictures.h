/*
 * field_pictures: which pictures a take has, mapped and put in the order core reads them.
 * Layer: daemon. Threads: one, while the source is opened. Ownership: the source's.
 */
#ifndef LS_DAEMON_FIELD_PICTURES_H
#define LS_DAEMON_FIELD_PICTURES_H

#include "daemon/field_source.h"
#include "daemon/takedir.h"

/** Map what is published of every condition that shows lights; sets the size of the picture.
 * LS_ERR_STATE: nothing is published. Other errors: those of ls_picture_map_open, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_field_pictures_map(struct ls_field_source *source,
                                                const struct ls_takedir *take,
                                                struct ls_diag *diag);

/** Choose white and the other spectra. LS_ERR_STATE: not photographed light by light. */
LS_MUST_CHECK enum ls_err ls_field_pictures_choose(struct ls_field_source *source,
                                                   struct ls_diag *diag);

/** Fill the sets of single lights, white and the spheres. LS_ERR_INVALID: the journal speaks of
 * other tiles; LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_field_pictures_gather(struct ls_field_source *source,
                                                   const struct ls_takedir *take,
                                                   struct ls_diag *diag);

void ls_field_pictures_free(struct ls_field_source *source);

#endif

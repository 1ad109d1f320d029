/*
 * relit_space: which colours a relit picture has, and the calibration's way to Rec. 709.
 * Layer: clients. Threads: any; pure. Ownership: none.
 */
#ifndef LS_CLIENTS_RELIT_SPACE_H
#define LS_CLIENTS_RELIT_SPACE_H

#include "clients/light_weights.h"
#include "clients/take_document.h"

#include <stdbool.h>

/** Is a picture under @weights to be multiplied by the calibration's matrix M? Mono cameras have
 * none, and some pictures are after M already. */
bool ls_relit_needs_m(const struct ls_take_document *document,
                      const struct ls_light_weights *weights);

/** Can it be had in Rec. 709 at all? */
bool ls_relit_in_rec709(const struct ls_take_document *document,
                        const struct ls_light_weights *weights);

/** out[n][3] = M rgb[n][3]; @out may be @rgb. RT-safe. */
void ls_relit_apply_m(const struct ls_take_document *document, const float *rgb, size_t n,
                      float *out);

#endif

/*
 * factored: what a factored fetch brings, to the picture of a light under a spectrum.
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 * LeGendre, Yu and Debevec, Eq. 1 and 2: a light's picture under a spectrum is its white picture,
 * times its gain, times a ratio that is the same for every light. So the white picture of each
 * light and one ratio picture for each spectrum say all of it. This is the one way in which the
 * daemon and its clients multiply them: what a client makes of a factored fetch is bit for bit what
 * the daemon sends as halves by SPHERE and HEADLIGHT. Accuracy: core/promote_tile.h.
 */
#ifndef LS_CORE_FACTORED_H
#define LS_CORE_FACTORED_H

#include <stddef.h>
#include <stdint.h>

/**
 * out[j] = gain white[j] ratio[j], all halves, [n] samples: a picture, some rows or a tile, as
 * white and ratio were sent. @gain: FetchReply.gain of the white picture. Returns how many results
 * are 0 because what they are made of is not finite. RT-safe.
 */
size_t ls_factored_expand(const uint16_t *white, float gain, const uint16_t *ratio, size_t n,
                          uint16_t *out);

#endif

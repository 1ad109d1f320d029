/*
 * colour_space: what the three numbers of a linear picture mean, and the one name of it: of every
 * option --space, and of the attribute lightstage/space.
 * Layer: clients. Threads: any; pure. Ownership: none.
 *
 *   camera  the camera's own red, green and blue, which no primaries describe
 *   rec709  the primaries of Rec. 709, white D65
 *   acescg  the primaries AP1, the ACES white
 *
 * A calibration's matrix M takes camera to rec709. Pictures of lights are exported in each of them.
 * A map to relight with has rec709 or camera, and a relit picture is in either.
 */
#ifndef LS_CLIENTS_COLOUR_SPACE_H
#define LS_CLIENTS_COLOUR_SPACE_H

#include "core/primaries.h"

#include <stdbool.h>

enum ls_colour_space { LS_SPACE_CAMERA, LS_SPACE_REC709, LS_SPACE_ACESCG };

const char *ls_colour_space_name(enum ls_colour_space space);

/** false: no such name. */
bool ls_colour_space_option(const char *text, enum ls_colour_space *out);

/** NULL: the camera's. (transfer none) */
const struct ls_primaries *ls_colour_space_primaries(enum ls_colour_space space);

#endif

/*
 * render_recipe: what a frame was made from, in a word.
 * Layer: clients. Threads: any; pure. Ownership: none.
 */
#ifndef LS_CLIENTS_RENDER_RECIPE_H
#define LS_CLIENTS_RENDER_RECIPE_H

#include "clients/light_weights.h"
#include "clients/relight_options.h"
#include "clients/take_document.h"

enum { LS_RECIPE_TEXT = 40 };

/** A hash (XXH3, 128 bit) of all that a frame's pixels follow from: the take's name and the
 * calibration's matrix, the strengths of every light (so the environment, its turn and the solve),
 * model, camera, region, level and bound, and this program's version. */
void ls_render_recipe(const struct ls_take_document *document,
                      const struct ls_relight_options *options,
                      const struct ls_light_weights *weights, char out[LS_RECIPE_TEXT]);

#endif

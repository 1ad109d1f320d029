#include "clients/render_recipe.h"

#include <stdio.h>
#include <string.h>
#include <xxhash.h>

static void add(XXH3_state_t *state, const void *bytes, size_t n)
{
    XXH3_128bits_update(state, bytes, n);
}

/* With its end, so that two texts are not one. */
static void add_text(XXH3_state_t *state, const char *text)
{
    add(state, text, strlen(text) + 1);
}

static void add_number(XXH3_state_t *state, double number)
{
    add(state, &number, sizeof number);
}

void ls_render_recipe(const struct ls_take_document *document,
                      const struct ls_relight_options *options,
                      const struct ls_light_weights *weights, char out[LS_RECIPE_TEXT])
{
    const struct lightstage_region *r = &options->region;
    const struct lightstage_promotion *p = &options->promotion;
    const double numbers[] = {weights->mode,
                              weights->after_m,
                              weights->by_target,
                              weights->n_rows,
                              weights->n_lights,
                              options->raw,
                              options->max_error,
                              options->camera,
                              options->level,
                              r->x,
                              r->y,
                              r->width,
                              r->height,
                              p->model,
                              p->reference,
                              p->ideal_polarisation,
                              p->plain_conductors};
    XXH3_state_t *state = XXH3_createState();
    snprintf(out, LS_RECIPE_TEXT, "none");
    if (!state)
        return; /* the frame is made, and made again the next time */
    XXH3_128bits_reset(state);
    add_text(state, LS_VERSION);
    add_text(state, document->id);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        add_number(state, numbers[i]);
    if (document->calibration && document->calibration->has_m)
        add(state, document->calibration->m, sizeof document->calibration->m);
    for (uint32_t i = 0; i < weights->n_names; i++)
        add_text(state, weights->names[i]);
    add(state, weights->rows, sizeof(float) * weights->n_rows * weights->n_lights);
    XXH128_hash_t hash = XXH3_128bits_digest(state);
    XXH3_freeState(state);
    snprintf(out, LS_RECIPE_TEXT, "%016llx%016llx", (unsigned long long)hash.high64,
             (unsigned long long)hash.low64);
}

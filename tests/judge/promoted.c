#include "compare.h"

#include "daemon/render.h"

#include <stdlib.h>
#include <string.h>

/* Band by band into the pictures of the whole region. */
static enum ls_err render(struct ls_render *render, const struct ls_demosaic_region *region,
                          uint32_t n_pictures, float *out, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (bool done = false; !done && !err;) {
        struct ls_demosaic_region band;
        LS_CLEANUP_FREE float *pixels = NULL;
        err = ls_render_step(render, &band, &pixels, &done, diag);
        size_t row = (size_t)JUDGE_COLOURS * region->width, rows = pixels ? band.height : 0;
        for (uint32_t k = 0; k < n_pictures && rows && !err; k++)
            memcpy(out + ((size_t)k * region->height + (band.y - region->y)) * row,
                   pixels + k * rows * row, rows * row * sizeof *out);
    }
    return err;
}

enum ls_err judge_promoted(const struct judge_comparison *comparison, uint32_t light,
                           const struct ls_demosaic_region *region, float *out,
                           struct ls_diag *diag)
{
    struct ls_field_source *source = comparison->judge->source;
    const struct ls_field *field = comparison->field;
    struct ls_render_term terms[LS_FIELD_MAX_SPECTRA];
    struct ls_render *open = NULL;
    LS_CLEANUP_FREE double *weights = calloc(field->n_lights, sizeof *weights);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    weights[light] = 1;
    for (uint32_t k = 0; k < field->n_spectra; k++)
        terms[k] = (struct ls_render_term){source->channel_of[k], weights, -1, k};
    const struct ls_render_job job = {.promotion = comparison->judge->promotion,
                                      .terms = terms,
                                      .n_terms = field->n_spectra,
                                      .n_pictures = field->n_spectra,
                                      .region = *region};
    enum ls_err err = ls_render_open(source, &job, &open, diag);
    if (!err)
        err = render(open, region, field->n_spectra, out, diag);
    ls_render_close(open);
    return err;
}

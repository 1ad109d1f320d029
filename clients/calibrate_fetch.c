/* Pictures of a take by their names in the plan. */
#include "clients/calibrate_take.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NAMES_PER_REQUEST = 256 };

struct fetch {
    const struct ls_calibrate_take *take;
    const struct ls_lit_picture *const *pictures; /* of this request */
    uint32_t n;
    struct ls_calibrate_region region;
    float *e;
    uint8_t *validity;
    ls_lit_use *use;
    void *user;
    enum ls_err err;
    struct ls_diag diag; /* of err */
};

static void put_row(const struct fetch *f, const struct lightstage_band *band, uint32_t row)
{
    uint32_t width = f->take->document->width;
    double unit = 1 / band->reference_exposure_s;
    size_t from = (size_t)row * band->width,
           at = (size_t)(f->region.y + band->first_row + row) * width + f->region.x;
    memcpy(f->e + at, (const float *)band->values + from, band->width * sizeof *f->e);
    for (uint32_t x = 0; x < band->width; x++)
        f->e[at + x] = (float)((double)f->e[at + x] * unit);
    memcpy(f->validity + at, band->validity + from, band->width);
}

static enum ls_err put_band(struct fetch *f, const struct lightstage_band *band)
{
    const struct ls_take_document *d = f->take->document;
    if (band->light >= f->n || band->sample != LIGHTSTAGE_FLOAT || band->components != 1 ||
        f->region.x + (uint64_t)band->width > d->width ||
        f->region.y + (uint64_t)band->first_row + band->n_rows > d->height || !band->validity ||
        !(band->reference_exposure_s > 0))
        return ls_fail(&f->diag, LS_ERR_INVALID,
                       "the daemon sent rows that do not fit the picture");
    for (uint32_t row = 0; row < band->n_rows; row++)
        put_row(f, band, row);
    if (band->first_row + band->n_rows < band->height)
        return LS_OK;
    return f->use(f->user, f->pictures[band->light], f->e, f->validity, &f->diag);
}

static int take_band(const struct lightstage_band *band, void *user)
{
    struct fetch *f = user;
    f->err = put_band(f, band);
    return f->err != LS_OK;
}

static enum ls_err ask(struct fetch *f)
{
    struct ls_command_context *context = f->take->context;
    const char *names[NAMES_PER_REQUEST];
    const struct lightstage_fetch wish = {
        .size = sizeof wish,
        .take = f->take->id,
        .conditions = names,
        .n_conditions = f->n,
        .region = {f->region.x, f->region.y, f->region.width, f->region.height},
        .quantity = LIGHTSTAGE_ESTIMATE,
        .camera = f->take->camera_row,
        .validity = 1,
    };
    uint32_t request = 0;
    for (uint32_t i = 0; i < f->n; i++)
        names[i] = f->pictures[i]->id;
    enum ls_err err =
        ls_command_said(context, lightstage_fetch_begin(context->stage, &wish, take_band, f,
                                                        &request, &context->error));
    if (err)
        return err;
    err = ls_command_wait(context, request);
    if (err == LS_ERR_ABORTED) /* its callback is not called any more */
        (void)lightstage_cancel(context->stage, request, NULL);
    return f->err ? ls_fail(&context->diag, f->err, "%s", f->diag.text) : err;
}

enum ls_err ls_calibrate_fetch(const struct ls_calibrate_take *take,
                               const struct ls_lit_picture *const *pictures, uint32_t n,
                               struct ls_calibrate_region region, ls_lit_use *use, void *user)
{
    size_t px = (size_t)take->document->width * take->document->height;
    LS_CLEANUP_FREE float *e = calloc(px, sizeof *e);
    LS_CLEANUP_FREE uint8_t *validity = calloc(px, 1);
    enum ls_err err = LS_OK;
    if (!e || !validity)
        return ls_fail(&take->context->diag, LS_ERR_NOMEM, "out of memory for a picture");
    for (size_t i = 0; i < px; i++)
        e[i] = NAN;
    for (uint32_t at = 0; at < n && !err; at += NAMES_PER_REQUEST) {
        struct fetch f = {.take = take,
                          .pictures = pictures + at,
                          .n = n - at < NAMES_PER_REQUEST ? n - at : NAMES_PER_REQUEST,
                          .region = region,
                          .e = e,
                          .validity = validity,
                          .use = use,
                          .user = user};
        err = ask(&f);
    }
    return err;
}

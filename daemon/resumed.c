#include "daemon/resumed.h"

#include "core/exr.h"
#include "core/half.h"
#include "core/pixel.h"

#include <stdatomic.h>
#include <stdlib.h>

enum { DARK_LIMIT_BYTES = 1 << 30 };

/* The published validity of a dark: its defective pixels, also those that its mean does not show.
 */
static enum ls_err load_defects(const struct ls_published *published, const void *bytes,
                                size_t n_bytes, struct ls_pixel_list *defects, struct ls_diag *diag)
{
    struct ls_exr_plane plane;
    struct ls_pixel_list list = {0};
    enum ls_err err = ls_exr_read_plane(bytes, n_bytes, "validity", DARK_LIMIT_BYTES, &plane, NULL);
    if (err == LS_ERR_NOT_FOUND)
        return LS_OK;
    if (!err && plane.type != LS_EXR_HALF)
        err = LS_ERR_INVALID;
    if (err)
        return ls_fail(diag, err, "%s: its validity cannot be read", published->file);
    uint32_t n = plane.width * plane.height; /* as the journal says it, checked before */
    list.index = malloc((n + 1) * sizeof *list.index);
    for (uint32_t i = 0; list.index && i < n; i++)
        if (((const uint16_t *)plane.samples)[i])
            list.index[list.n++] = i;
    err = list.index ? ls_pixel_list_join(defects, &list) : LS_ERR_NOMEM;
    ls_pixel_list_finish(&list);
    free(plane.samples);
    return err ? ls_fail(diag, err, "out of memory") : LS_OK;
}

/* What the rest of the take would be built on. */
static enum ls_err read_checked(const struct ls_resumed_input *in,
                                const struct ls_published *published, uint8_t **bytes, size_t *n,
                                struct ls_diag *diag)
{
    struct ls_diag why = {0};
    enum ls_err err = ls_takedir_read(in->dir, published, bytes, n, &why);
    if (!err)
        err = ls_published_check(published, *bytes, *n, &why);
    if (err == LS_ERR_NOMEM)
        return ls_fail(diag, err, "%s", why.text);
    return err ? ls_fail(
                     diag, LS_ERR_INVALID,
                     "%.300s: the take cannot go on from it; copy it back, or make the take anew",
                     why.text)
               : LS_OK;
}

static enum ls_err load_dark(const struct ls_resumed_input *in,
                             const struct ls_published *published, uint32_t camera,
                             uint32_t exposure, struct ls_resumed *out, struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint8_t *bytes = NULL;
    size_t n_bytes = 0;
    struct ls_image image = {0};
    enum ls_err err = read_checked(in, published, &bytes, &n_bytes, diag);
    if (!err)
        err = ls_exr_read(bytes, n_bytes, NULL, DARK_LIMIT_BYTES, &image, NULL, diag);
    const struct ls_camera_info *info = in->cameras[camera];
    if (!err &&
        (image.width != info->width || image.height != info->height || image.n_channels != 1))
        err = ls_fail(diag, LS_ERR_MISMATCH, "%s: %ux%u, the camera gives %ux%u", published->file,
                      image.width, image.height, info->width, info->height);
    if (err) {
        ls_image_finish(&image);
        return err;
    }
    out->darks[camera * in->plan->n_exposures + exposure] = image.pixels;
    return load_defects(published, bytes, n_bytes, &out->defects[camera], diag);
}

/* A reference of an earlier run: what comes is compared with it. */
static enum ls_err load_reference(const struct ls_resumed_input *in,
                                  const struct ls_published *published, uint32_t camera,
                                  uint32_t condition, struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint8_t *bytes = NULL;
    size_t n_bytes = 0, n_px = (size_t)published->width * published->height;
    struct ls_exr_plane mosaic = {0}, validity = {0};
    const struct ls_pixel_format *format = ls_pixel_by_name(in->cameras[camera]->pixel_format);
    enum ls_err err = read_checked(in, published, &bytes, &n_bytes, diag);
    if (!err)
        err = ls_exr_read_plane(bytes, n_bytes, NULL, DARK_LIMIT_BYTES, &mosaic, diag);
    if (!err && published->tile_invalid)
        err = ls_exr_read_plane(bytes, n_bytes, "validity", DARK_LIMIT_BYTES, &validity, diag);
    LS_CLEANUP_FREE uint8_t *states = validity.samples ? malloc(n_px) : NULL;
    for (size_t i = 0; states && i < n_px; i++)
        states[i] = (uint8_t)ls_half_to_float(((const uint16_t *)validity.samples)[i]);
    const struct ls_picture_view view = {mosaic.samples, states, published->width,
                                         published->height, format ? format->cfa : LS_CFA_NONE};
    if (!err && validity.samples && !states)
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (!err)
        err = ls_checks_adopt(in->checks, camera, condition, &view, diag);
    free(mosaic.samples);
    free(validity.samples);
    return err;
}

/* A condition is done when every camera's picture of it is published. */
static enum ls_err find_condition(const struct ls_resumed_input *in, uint32_t condition,
                                  struct ls_resumed *out, struct ls_diag *diag)
{
    const struct ls_plan_condition *c = &in->plan->conditions[condition];
    enum ls_err err = LS_OK;
    out->done[condition] = 1;
    for (uint32_t k = 0; k < in->n_cameras && !err; k++) {
        const struct ls_published *p = ls_takedir_find(in->dir, c->id, k);
        out->done[condition] &= p != NULL;
        if (p && c->dark && !c->watch)
            err = load_dark(in, p, k, c->exposure, out, diag);
        else if (p && c->reference)
            err = load_reference(in, p, k, condition, diag);
    }
    return err;
}

enum ls_err ls_resumed_find(const struct ls_resumed_input *in, struct ls_resumed *out,
                            struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    *out = (struct ls_resumed){.n_darks = (size_t)in->n_cameras * in->plan->n_exposures};
    out->done = calloc(in->plan->n_conditions, sizeof *out->done);
    out->darks = calloc(out->n_darks, sizeof *out->darks);
    if (!out->done || !out->darks)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < in->plan->n_conditions && !err; i++)
        err = in->stop && atomic_load(in->stop) ? ls_fail(diag, LS_ERR_ABORTED, "given up")
                                                : find_condition(in, i, out, diag);
    return err;
}

void ls_resumed_finish(struct ls_resumed *resumed)
{
    for (size_t i = 0; resumed->darks && i < resumed->n_darks; i++)
        free(resumed->darks[i]);
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        ls_pixel_list_finish(&resumed->defects[i]);
    free(resumed->darks);
    free(resumed->done);
    *resumed = (struct ls_resumed){0};
}

#include "clients/calibrate_grey.h"

static enum ls_err read_pictures(void *user, uint32_t camera,
                                 const struct ls_lit_picture *const *pictures, uint32_t n,
                                 const struct ls_outline *around, ls_lit_use *use, void *use_user,
                                 struct ls_diag *diag)
{
    const struct ls_calibrate_take *take = ((const struct ls_calibrate_take *const *)user)[camera];
    struct ls_calibrate_region region = {0};
    if (around)
        region = ls_calibrate_around(take, around);
    return ls_calibrate_fetch(take, pictures, n, region, use, use_user);
}

enum ls_err ls_calibrate_grey(const struct ls_calibrate_take *const *takes, uint32_t n_cameras,
                              double radius_m, double reflectance, struct ls_grey **out)
{
    const struct ls_take_document *d = takes[0]->document;
    const struct ls_grey_source source = {read_pictures, (void *)takes};
    struct ls_grey_rig rig = {.n_lights = d->n_lights,
                              .n_channels = d->n_channels,
                              .n_cameras = n_cameras,
                              .n_pictures = takes[0]->n_pictures,
                              .position_m = (const float(*)[3])d->position_m,
                              .nominal = {{0}, radius_m},
                              .reflectance = reflectance,
                              .pictures = takes[0]->pictures};
    for (uint32_t k = 0; k < n_cameras; k++) {
        rig.cameras[k].pinhole = takes[k]->camera;
        rig.cameras[k].cfa = takes[k]->document->cfa;
    }
    for (uint32_t c = 0; c < d->n_channels; c++) {
        rig.channels[c].name = d->channels[c].name;
        rig.channels[c].spectrum = d->channels[c].spectrum;
    }
    return ls_grey_measure(&rig, &source, out, &takes[0]->context->diag);
}

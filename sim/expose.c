#include "sim/stamp.h"
#include "sim/world.h"

#include "core/half.h"
#include "core/pixel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Bayer orders by the parity of column and row at which the red pixel stands. */
static enum ls_cfa shifted(enum ls_cfa cfa, uint32_t x, uint32_t y)
{
    static const enum ls_cfa order[4] = {LS_CFA_RGGB, LS_CFA_GRBG, LS_CFA_GBRG, LS_CFA_BGGR};
    for (uint32_t k = 0; k < 4; k++)
        if (order[k] == cfa)
            return order[k ^ ((y & 1) << 1 | (x & 1))];
    return LS_CFA_NONE;
}

size_t sim_raw_bytes(const struct sim_raw_format *format)
{
    const struct ls_pixel_format *pixel = ls_pixel_by_code(format->pixel_format);
    return pixel ? ls_pixel_payload_bytes(pixel, format->width, format->height) : 0;
}

static enum ls_err check(const struct sim_scene *scene, const struct sim_exposure *exposure,
                         const struct sim_raw_format *f, size_t raw_bytes, struct ls_diag *diag)
{
    const struct ls_pixel_format *pixel = ls_pixel_by_code(f->pixel_format);
    if (exposure->camera >= scene->config.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the scene has %u", exposure->camera,
                       scene->config.n_cameras);
    const struct sim_view *view = &scene->view[exposure->camera];
    if (!pixel)
        return ls_fail(diag, LS_ERR_INVALID, "pixel format 0x%08x is unknown", f->pixel_format);
    if (!f->width || !f->height || f->width > view->width || f->height > view->height ||
        f->offset_x > view->width - f->width || f->offset_y > view->height - f->height)
        return ls_fail(diag, LS_ERR_INVALID,
                       "region %u x %u at (%u, %u) is not inside the sensor of %u x %u", f->width,
                       f->height, f->offset_x, f->offset_y, view->width, view->height);
    if (pixel->cfa != shifted(view->cfa, f->offset_x, f->offset_y))
        return ls_fail(diag, LS_ERR_INVALID,
                       "pixel format %s at (%u, %u): the sensor's colour filter is %s", pixel->name,
                       f->offset_x, f->offset_y, ls_cfa_name(view->cfa));
    if (raw_bytes < sim_raw_bytes(f))
        return ls_fail(diag, LS_ERR_INVALID, "image of %zu bytes does not fit in %zu",
                       sim_raw_bytes(f), raw_bytes);
    return LS_OK;
}

/* What is drawn into a stamp. */
static struct sim_stamp describe(const struct sim_scene *scene, const struct sim_exposure *e)
{
    struct sim_stamp stamp = {
        .light = 0xffff,
        .channel = 0xff,
        .camera = (uint8_t)e->camera,
        .condition = e->condition,
        .step = e->step,
        .exposure_ns_10 = (uint32_t)lround(e->exposure_us * 100),
        .lit_ns_10 = (uint32_t)lround(e->lit_us * 100),
        .sequence = (uint32_t)e->sequence,
    };
    if (e->condition < scene->n_conditions) {
        const struct sim_condition *c = &scene->conditions[e->condition];
        stamp.kind = c->kind;
        stamp.n_leds = (uint16_t)(c->n_leds < 0xffff ? c->n_leds : 0xffff);
        if (c->n_leds) {
            stamp.light = c->leds[0].light;
            stamp.channel = (uint8_t)c->leds[0].channel;
        }
    }
    return stamp;
}

/* Where the light of an exposure comes from; at most one of the images is set. */
struct sight {
    const uint16_t *half; /* the condition's picture */
    float *stamp;         /* fractions of full scale, of the region */
    uint16_t *rendered;   /* a picture made for this exposure alone */
};

static enum ls_err render_now(const struct sim_scene *scene, uint32_t camera,
                              const struct sim_picture *known, struct sight *sight,
                              struct ls_diag *diag)
{
    struct sim_picture picture = *known, *list = &picture;
    size_t n = (size_t)scene->view[camera].width * scene->view[camera].height;
    picture.half[camera] = sight->rendered = malloc(n * sizeof *sight->rendered);
    if (!sight->rendered)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a rendered condition");
    sight->half = sight->rendered;
    return sim_render(scene, camera, &list, 1, NULL, NULL, diag);
}

static enum ls_err look(struct sim_scene *scene, const struct sim_exposure *e,
                        const struct sim_raw_format *f, struct sight *sight, struct ls_diag *diag)
{
    if (scene->kind == SIM_WORLD_STAMP) {
        struct sim_stamp stamp = describe(scene, e);
        sight->stamp = malloc((size_t)f->width * f->height * sizeof *sight->stamp);
        if (!sight->stamp)
            return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a stamp");
        return sim_stamp_draw(&stamp, f->width, f->height, sight->stamp, diag);
    }
    if (e->condition >= SIM_CONDITION_WORK && e->condition != UINT32_MAX) {
        const struct sim_picture *work = sim_work_picture(scene, e->condition - SIM_CONDITION_WORK);
        sight->half = work ? work->half[e->camera] : NULL;
        return work ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "no picture of the work light");
    }
    if (e->condition >= scene->n_conditions || !scene->program[e->condition])
        return LS_OK;
    const struct sim_picture *picture = scene->program[e->condition];
    sight->half = picture->half[e->camera];
    return sight->half ? LS_OK : render_now(scene, e->camera, picture, sight, diag);
}

/* Of a condition in several channels: that of its first LED. */
static double drift(const struct sim_scene *scene, const struct sim_exposure *e)
{
    if (e->condition >= scene->n_conditions || !scene->conditions[e->condition].n_leds)
        return 1;
    return sim_scene_drift(scene, scene->conditions[e->condition].leds[0].channel, e->sequence);
}

static void expose_row(const struct sim_scene *scene, const struct sim_exposure *e,
                       const struct sim_raw_format *f, const struct sight *sight, uint32_t row,
                       float *signal)
{
    const struct sim_view_config *config = &scene->config.views[e->camera];
    double full_well = config->full_well_e, rate = sim_world_rate(config);
    if (sight->stamp) {
        const float *from = sight->stamp + (size_t)row * f->width;
        for (uint32_t i = 0; i < f->width; i++)
            signal[i] = (float)full_well * from[i];
        return;
    }
    float veil = (float)(full_well * rate * config->ambient * e->exposure_us * 1e-6);
    float scale =
        (float)(full_well * rate * e->lit_us * 1e-6 / sim_picture_scale * drift(scene, e));
    memset(signal, 0, f->width * sizeof *signal);
    if (sight->half)
        ls_half_to_floats(sight->half + (size_t)(f->offset_y + row) * scene->view[e->camera].width +
                              f->offset_x,
                          signal, f->width);
    for (uint32_t i = 0; i < f->width; i++)
        signal[i] = signal[i] * scale + veil;
}

static struct sim_readout readout_of(const struct sim_scene *scene, const struct sim_exposure *e,
                                     const struct sim_raw_format *f)
{
    return (struct sim_readout){
        .key = sim_sensor_key(scene->config.seed, e->camera, e->sequence),
        .exposure_s = e->exposure_us * 1e-6,
        .gain = pow(10, f->gain_db / 20),
        .max_dn = ls_pixel_max_dn(ls_pixel_by_code(f->pixel_format)),
    };
}

static enum ls_err read_out(const struct sim_scene *scene, const struct sim_exposure *e,
                            const struct sim_raw_format *f, const struct sight *sight, void *raw,
                            struct ls_diag *diag)
{
    const struct ls_pixel_format *pixel = ls_pixel_by_code(f->pixel_format);
    LS_CLEANUP_FREE float *signal = malloc(f->width * sizeof *signal);
    LS_CLEANUP_FREE uint16_t *dn = malloc(f->width * sizeof *dn);
    if (!signal || !dn)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a row of pixels");
    const struct sim_readout readout = readout_of(scene, e, f);
    for (uint32_t row = 0; row < f->height; row++) {
        expose_row(scene, e, f, sight, row, signal);
        sim_sensor_row(&scene->sensor[e->camera], &readout, f->offset_x, f->offset_y + row,
                       f->width, signal, dn);
        ls_pixel_pack(pixel, dn, (size_t)row * f->width, f->width, raw);
    }
    return LS_OK;
}

static enum ls_err cut_stamp(struct sim_scene *scene, const struct sim_exposure *e,
                             const struct sim_raw_format *f, void *raw, struct ls_diag *diag)
{
    const struct sim_stamp stamp = describe(scene, e);
    const struct sim_readout readout = readout_of(scene, e, f);
    return sim_stamp_frames_draw(&scene->stamp_frames[e->camera], scene->config.stamp_frames,
                                 &scene->sensor[e->camera], &stamp, f, &readout, raw, diag);
}

static enum ls_err draw(struct sim_scene *scene, const struct sim_exposure *e,
                        const struct sim_raw_format *f, void *raw, struct ls_diag *diag)
{
    struct sight sight = {0};
    if (scene->kind == SIM_WORLD_STAMP && scene->config.stamp_frames && sim_stamp_frames_fit(f))
        return cut_stamp(scene, e, f, raw, diag);
    enum ls_err err = look(scene, e, f, &sight, diag);
    if (!err)
        err = read_out(scene, e, f, &sight, raw, diag);
    free(sight.stamp);
    free(sight.rendered);
    return err;
}

enum ls_err sim_scene_expose(struct sim_scene *scene, const struct sim_exposure *exposure,
                             const struct sim_raw_format *format, void *raw, size_t raw_bytes,
                             struct ls_diag *diag)
{
    enum ls_err err = check(scene, exposure, format, raw_bytes, diag);
    if (err)
        return err;
    pthread_rwlock_rdlock(&scene->lock);
    err = draw(scene, exposure, format, raw, diag);
    pthread_rwlock_unlock(&scene->lock);
    return err;
}

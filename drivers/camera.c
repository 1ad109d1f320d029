#include "drivers/camera.h"

#include "drivers/aravis/aravis.h"

#include <arpa/inet.h>
#include <assert.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum {
    MIN_PACKET_BYTES = 576,
    MAX_PACKET_BYTES = 65500,
    MIN_SLOTS = 4,
    MAX_SLOTS = 4096,
};

struct ls_camera {
    const struct ls_camera_ops *ops;
    void *priv;
    struct ls_camera_info info;
    char address[INET_ADDRSTRLEN];
    enum ls_camera_trigger trigger;
    bool applied;
    atomic_bool started;
    _Atomic uint32_t n_slots;
};

static const struct ls_camera_ops *const drivers[] = {&ls_aravis_ops};

static const struct ls_camera_ops *find_driver(const char *name)
{
    for (size_t i = 0; name && i < sizeof drivers / sizeof *drivers; i++)
        if (strcmp(drivers[i]->name, name) == 0)
            return drivers[i];
    return NULL;
}

enum ls_err ls_camera_open(const struct ls_camera_config *config, struct ls_camera **out,
                           struct ls_diag *diag)
{
    struct in_addr address;
    const struct ls_camera_ops *ops = find_driver(config->driver);
    if (!ops)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "camera driver \"%s\": expected \"aravis\"",
                       config->driver ? config->driver : "");
    if (!config->address || inet_pton(AF_INET, config->address, &address) != 1)
        return ls_fail(diag, LS_ERR_INVALID,
                       "camera address \"%s\": expected an IPv4 address such as 192.168.1.20",
                       config->address ? config->address : "");
    struct ls_camera *camera = calloc(1, sizeof *camera);
    if (!camera)
        return LS_ERR_NOMEM;
    camera->ops = ops;
    strncpy(camera->address, config->address, sizeof camera->address - 1);
    enum ls_err err = ops->open(config, &camera->priv, &camera->info, diag);
    if (err) {
        free(camera);
        return err;
    }
    *out = camera;
    return LS_OK;
}

static enum ls_err check_config(const struct ls_camera_config *c, struct ls_diag *diag)
{
    const char *at = c->address;
    if (!c->pixel_format || !*c->pixel_format)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: no pixel format given", at);
    if (!c->width != !c->height)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: region %u x %u: give both or neither", at,
                       c->width, c->height);
    if (c->packet_size < MIN_PACKET_BYTES || c->packet_size > MAX_PACKET_BYTES)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: packet size %u: expected %d..%d bytes", at,
                       c->packet_size, MIN_PACKET_BYTES, MAX_PACKET_BYTES);
    if (!isfinite(c->gain) || !isfinite(c->black_level))
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: gain and black level must be numbers", at);
    if (c->exposure != LS_EXPOSURE_WIDTH && !(c->exposure_us > 0 && c->exposure_us <= 6e7))
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: exposure %g us: expected (0, 6e7]", at,
                       c->exposure_us);
    if (c->exposure == LS_EXPOSURE_WIDTH && c->trigger == LS_TRIGGER_SOFTWARE)
        return ls_fail(diag, LS_ERR_INVALID,
                       "camera %s: a software trigger has no width: use timed exposure", at);
    return LS_OK;
}

static enum ls_err need_stopped(const struct ls_camera *camera, struct ls_diag *diag)
{
    if (atomic_load(&camera->started))
        return ls_fail(diag, LS_ERR_STATE, "camera %s: stop it first", camera->address);
    return LS_OK;
}

enum ls_err ls_camera_apply(struct ls_camera *camera, const struct ls_camera_config *config,
                            struct ls_diag *diag)
{
    enum ls_err err = need_stopped(camera, diag);
    if (!err)
        err = check_config(config, diag);
    if (err)
        return err;
    camera->applied = false;
    err = camera->ops->apply(camera->priv, config, &camera->info, diag);
    if (err)
        return err;
    camera->trigger = config->trigger;
    camera->applied = true;
    return LS_OK;
}

const struct ls_camera_info *ls_camera_info(const struct ls_camera *camera)
{
    return &camera->info;
}

static enum ls_err check_slots(const struct ls_camera *camera, const struct ls_camera_slots *slots,
                               struct ls_diag *diag)
{
    if (!slots->base || slots->n < MIN_SLOTS || slots->n > MAX_SLOTS)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: %u slots: expected %d..%d",
                       camera->address, slots->n, MIN_SLOTS, MAX_SLOTS);
    if (slots->stride < camera->info.payload_bytes)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: slots of %zu bytes: a frame has %zu",
                       camera->address, slots->stride, camera->info.payload_bytes);
    return LS_OK;
}

enum ls_err ls_camera_start(struct ls_camera *camera, const struct ls_camera_slots *slots,
                            struct ls_diag *diag)
{
    enum ls_err err = need_stopped(camera, diag);
    if (!err && !camera->applied)
        err = ls_fail(diag, LS_ERR_STATE, "camera %s: apply its settings first", camera->address);
    if (!err)
        err = check_slots(camera, slots, diag);
    if (!err)
        err = camera->ops->start(camera->priv, slots, &camera->info, diag);
    if (err)
        return err;
    atomic_store(&camera->n_slots, slots->n);
    atomic_store(&camera->started, true);
    return LS_OK;
}

enum ls_err ls_camera_next(struct ls_camera *camera, uint64_t timeout_us,
                           struct ls_camera_frame *frame)
{
    if (!atomic_load(&camera->started))
        return LS_ERR_STATE;
    return camera->ops->next(camera->priv, timeout_us, frame);
}

void ls_camera_release(struct ls_camera *camera, uint32_t slot)
{
    assert(slot < atomic_load(&camera->n_slots));
    camera->ops->release(camera->priv, slot);
}

void ls_camera_wake(struct ls_camera *camera)
{
    struct ls_camera_control control = {.verb = LS_CAMERA_WAKE};
    enum ls_err err = camera->ops->control(camera->priv, &control, NULL);
    assert(!err);
    (void)err;
}

enum ls_err ls_camera_trigger(struct ls_camera *camera, struct ls_diag *diag)
{
    struct ls_camera_control control = {.verb = LS_CAMERA_TRIGGER};
    if (!camera->applied || camera->trigger != LS_TRIGGER_SOFTWARE)
        return ls_fail(diag, LS_ERR_STATE, "camera %s: not set up for software triggers",
                       camera->address);
    return camera->ops->control(camera->priv, &control, diag);
}

enum ls_err ls_camera_set_exposure(struct ls_camera *camera, double *exposure_us,
                                   struct ls_diag *diag)
{
    struct ls_camera_control control = {.verb = LS_CAMERA_EXPOSURE, .exposure_us = *exposure_us};
    if (!camera->applied || camera->info.exposure != LS_EXPOSURE_TIMED)
        return ls_fail(diag, LS_ERR_STATE, "camera %s: not set up for timed exposure",
                       camera->address);
    if (!(*exposure_us > 0 && *exposure_us <= 6e7))
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: exposure %g us: expected (0, 6e7]",
                       camera->address, *exposure_us);
    enum ls_err err = camera->ops->control(camera->priv, &control, diag);
    if (!err)
        *exposure_us = control.exposure_us;
    return err;
}

enum ls_err ls_camera_latch(struct ls_camera *camera, uint64_t *camera_ns, uint64_t *host_before_ns,
                            uint64_t *host_after_ns, struct ls_diag *diag)
{
    struct ls_camera_control control = {.verb = LS_CAMERA_LATCH};
    if (!camera->info.has_latch)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "camera %s: has no timestamp latch",
                       camera->address);
    enum ls_err err = camera->ops->control(camera->priv, &control, diag);
    if (err)
        return err;
    *camera_ns = control.camera_ns;
    *host_before_ns = control.host_before_ns;
    *host_after_ns = control.host_after_ns;
    return LS_OK;
}

void ls_camera_stop(struct ls_camera *camera, struct ls_camera_stats *stats)
{
    struct ls_camera_stats ignored;
    if (stats)
        memset(stats, 0, sizeof *stats);
    if (!atomic_exchange(&camera->started, false))
        return;
    camera->ops->stop(camera->priv, stats ? stats : &ignored);
}

void ls_camera_close(struct ls_camera *camera)
{
    if (!camera)
        return;
    ls_camera_stop(camera, NULL);
    camera->ops->close(camera->priv);
    free(camera);
}

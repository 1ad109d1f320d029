#include "daemon/framing.h"

#include "daemon/realtime.h"
#include "daemon/ring.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <math.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdlib.h>

enum {
    PERIOD_US = 100000,
    SLOTS = 4,
    SLOWEST_PWM_US = 5000, /* 200 Hz: what is slower may be seen */
    MARGIN_US = 500000,    /* what a loaded host may add to a frame's way */
    MISSES = 5,            /* frames in a row that may stay away */
};

struct ls_framing {
    const struct ls_config *config;
    struct ls_framing_wish wish;
    struct ls_preview *preview;
    struct ls_errands *errands;
    uint64_t n_before; /* of the errands: they have the devices */
    struct ls_lights *lights;
    struct ls_camera *camera;
    struct ls_ring *ring;
    const struct ls_pixel_format *format;
    double exposure_us;
    pthread_t thread;
    sem_t stop;
    bool was_on; /* the configured work light */
    _Atomic bool stopping, ended, dark;
    enum ls_err err;
    struct ls_diag diag;
};

/* ---- light ---- */

static enum ls_err poll_lights(struct ls_framing *f, bool *on)
{
    struct ls_lights_status status = {0};
    struct ls_step_event event;
    size_t n;
    enum ls_err err = ls_lights_poll(f->lights, &status, &event, 1, &n, &f->diag);
    *on = status.work_light;
    return err;
}

static enum ls_err open_lights(struct ls_framing *f)
{
    enum ls_err err = ls_lights_open(&f->config->lights_driver, &f->lights, &f->diag);
    if (err)
        return err;
    const struct ls_lights_info *info = ls_lights_info(f->lights);
    if (f->wish.level < 1 && info->pwm_period_us >= SLOWEST_PWM_US)
        return ls_fail(&f->diag, LS_ERR_LIMIT,
                       "steady light: the controller dims at %u Hz, which may be seen to flicker; "
                       "expected more than 200 Hz: look without a light",
                       1000000 / info->pwm_period_us);
    if (info->pwm_period_us)
        f->exposure_us = ceil(f->exposure_us / info->pwm_period_us) * info->pwm_period_us;
    return poll_lights(f, &f->was_on);
}

static enum ls_err light(struct ls_framing *f)
{
    uint16_t level = (uint16_t)(65535 * f->wish.level), channel = (uint16_t)f->wish.channel;
    enum ls_err err = ls_lights_set_work(f->lights, channel, level, &f->diag);
    return err ? err : ls_lights_steady(f->lights, &f->diag);
}

static enum ls_err still_lit(struct ls_framing *f)
{
    bool on = true;
    enum ls_err err = f->lights ? poll_lights(f, &on) : LS_OK;
    if (!err && !on)
        err =
            ls_fail(&f->diag, LS_ERR_REFUSED,
                    "the steady light went out: interlock, E-stop, heat, or somebody else's blank");
    return err;
}

static void darken(struct ls_framing *f)
{
    struct ls_diag why = {{0}};
    if (!f->lights)
        return;
    enum ls_err err = ls_lights_blank(f->lights, &why);
    if (!err)
        err = ls_lights_set_work(f->lights, f->config->work_channel, f->config->work_level, &why);
    if (!err && f->was_on && f->config->work_level && !atomic_load(&f->dark))
        err = ls_lights_work(f->lights, &why);
    if (err && !f->err)
        f->err = ls_fail(&f->diag, err, "%.400s: the steady light may still be on", why.text);
    ls_lights_close(f->lights);
}

/* ---- camera ---- */

static enum ls_err start_camera(struct ls_framing *f)
{
    struct ls_camera_config config = f->config->cameras[f->wish.camera].driver;
    config.trigger = LS_TRIGGER_SOFTWARE;
    config.exposure = LS_EXPOSURE_TIMED;
    config.exposure_us = f->exposure_us;
    enum ls_err err = ls_camera_open(&config, &f->camera, &f->diag);
    if (!err)
        err = ls_camera_apply(f->camera, &config, &f->diag);
    if (err)
        return err;
    const struct ls_camera_info *info = ls_camera_info(f->camera);
    f->format = ls_pixel_by_name(info->pixel_format);
    if (!f->format)
        return ls_fail(&f->diag, LS_ERR_UNSUPPORTED, "pixel format %s is not supported",
                       info->pixel_format);
    err = ls_ring_create(SLOTS, info->payload_bytes, &f->ring, &f->diag);
    if (err)
        return err;
    const struct ls_camera_slots slots = ls_ring_slots(f->ring);
    ls_ring_queue(f->ring);
    return ls_camera_start(f->camera, &slots, &f->diag);
}

static enum ls_err show(struct ls_framing *f, const struct ls_camera_frame *frame)
{
    const struct ls_camera_info *info = ls_camera_info(f->camera);
    enum ls_err err = ls_ring_take(f->ring, frame->slot);
    if (!err && frame->status == LS_FRAME_OK &&
        frame->payload_bytes >= ls_pixel_payload_bytes(f->format, info->width, info->height))
        ls_preview_offer(f->preview, f->wish.camera, f->format, info->width, info->height,
                         ls_ring_payload(f->ring, frame->slot), frame->frame_id, info->exposure_us);
    if (!err)
        err = ls_ring_give_back(f->ring, frame->slot);
    if (!err)
        ls_camera_release(f->camera, frame->slot);
    return err;
}

/* The controller hears of us meanwhile. */
static enum ls_err wait_for_frame(struct ls_framing *f, uint64_t patience_us,
                                  struct ls_camera_frame *frame)
{
    enum ls_err err = LS_ERR_TIMEOUT;
    for (uint64_t us = 0; err == LS_ERR_TIMEOUT && us < patience_us; us += PERIOD_US) {
        enum ls_err lit = still_lit(f);
        if (lit)
            return lit;
        err = ls_camera_next(f->camera, PERIOD_US, frame);
    }
    return err;
}

static enum ls_err photograph(struct ls_framing *f, unsigned *misses)
{
    const struct ls_config_camera *config = &f->config->cameras[f->wish.camera];
    uint64_t patience = (uint64_t)f->exposure_us + config->driver.frame_retention_us + MARGIN_US;
    struct ls_camera_frame frame;
    enum ls_err err = ls_camera_trigger(f->camera, &f->diag);
    if (!err)
        err = wait_for_frame(f, patience, &frame);
    if (err == LS_ERR_TIMEOUT && ++*misses < MISSES)
        return LS_OK;
    if (err)
        return err;
    *misses = 0;
    return show(f, &frame);
}

/* ---- the thread ---- */

/* Beside the exposure, which is waited for in photograph. */
static uint64_t pause_us(const struct ls_framing *f)
{
    double fps = f->config->cameras[f->wish.camera].max_fps;
    return fps > 0 && 1e6 / fps > PERIOD_US ? (uint64_t)(1e6 / fps) : PERIOD_US;
}

static enum ls_err work(struct ls_framing *f)
{
    bool lit = f->wish.channel >= 0;
    unsigned misses = 0;
    enum ls_err err = lit ? open_lights(f) : LS_OK;
    if (!err)
        err = start_camera(f);
    if (!err && lit)
        err = light(f);
    while (!err && !atomic_load(&f->stopping)) {
        err = photograph(f, &misses);
        if (!err)
            ls_host_wait(&f->stop, pause_us(f));
    }
    return atomic_load(&f->stopping) ? LS_OK : err;
}

static void *run(void *data)
{
    struct ls_framing *f = data;
    ls_errands_wait(f->errands, f->n_before);
    f->err = atomic_load(&f->stopping) ? LS_OK : work(f);
    if (f->err && !f->diag.text[0])
        ls_fail(&f->diag, f->err, "camera %s: %s", f->config->cameras[f->wish.camera].name,
                ls_err_name(f->err));
    darken(f); /* first: it matters most */
    ls_camera_close(f->camera);
    ls_ring_destroy(f->ring);
    atomic_store(&f->ended, true);
    return NULL;
}

static enum ls_err check(const struct ls_config *config, const struct ls_framing_wish *wish,
                         struct ls_diag *diag)
{
    if (wish->camera >= config->n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the rig has %u", wish->camera,
                       config->n_cameras);
    if (!(wish->exposure_us >= 1 && wish->exposure_us <= 1e6))
        return ls_fail(diag, LS_ERR_INVALID, "exposure of %g us: expected 1 to 1000000",
                       wish->exposure_us);
    if (wish->channel >= 0 && !(wish->level * 65535 >= 1 && wish->level <= 1))
        return ls_fail(diag, LS_ERR_INVALID, "level %g: expected 1/65535 to 1", wish->level);
    return LS_OK;
}

enum ls_err ls_framing_start(const struct ls_config *config, const struct ls_framing_wish *wish,
                             struct ls_preview *preview, struct ls_errands *errands,
                             struct ls_framing **out, struct ls_diag *diag)
{
    enum ls_err err = check(config, wish, diag);
    if (err)
        return err;
    struct ls_framing *f = calloc(1, sizeof *f);
    if (!f)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    f->config = config;
    f->wish = *wish;
    f->preview = preview;
    f->errands = errands;
    f->n_before = ls_errands_count(errands);
    f->exposure_us = wish->exposure_us;
    sem_init(&f->stop, 0, 0);
    if (pthread_create(&f->thread, NULL, run, f)) {
        sem_destroy(&f->stop);
        free(f);
        return ls_fail(diag, LS_ERR_OS, "cannot start the live view's thread");
    }
    pthread_setname_np(f->thread, "ls-framing");
    *out = f;
    return LS_OK;
}

bool ls_framing_runs(const struct ls_framing *f)
{
    return !atomic_load(&f->ended);
}

void ls_framing_stop(struct ls_framing *f, bool dark)
{
    atomic_store(&f->dark, dark);
    atomic_store(&f->stopping, true);
    sem_post(&f->stop);
}

enum ls_err ls_framing_end(struct ls_framing *f, struct ls_diag *diag)
{
    if (!f)
        return LS_OK;
    pthread_join(f->thread, NULL);
    enum ls_err err = f->err;
    if (err && diag)
        *diag = f->diag;
    sem_destroy(&f->stop);
    free(f);
    return err;
}

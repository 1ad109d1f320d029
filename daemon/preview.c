#include "daemon/preview.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

enum state { IDLE, WANTED, FILLING, READY, TAKEN };

struct tap {
    _Atomic int state; /* enum state; FILLING is the offering thread's, TAKEN ls-main's */
    struct ls_preview_picture picture;
};

struct ls_preview {
    const struct ls_config *config;
    struct tap taps[LS_MAX_CAMERAS];
    pthread_mutex_t lock; /* of the rings */
    struct {
        const struct ls_ring *ring;
        struct ls_ring_view view; /* but for fd */
    } rings[LS_MAX_CAMERAS];
};

struct ls_preview *ls_preview_create(const struct ls_config *config)
{
    struct ls_preview *preview = calloc(1, sizeof *preview);
    if (!preview)
        return NULL;
    preview->config = config;
    pthread_mutex_init(&preview->lock, NULL);
    return preview;
}

static bool pass(struct tap *tap, int from, int to)
{
    return atomic_compare_exchange_strong(&tap->state, &from, to);
}

void ls_preview_want(struct ls_preview *preview, uint32_t camera)
{
    struct tap *tap = &preview->taps[camera];
    if (!pass(tap, IDLE, WANTED))
        pass(tap, TAKEN, WANTED);
}

static enum ls_err fill(const struct ls_config_camera *config, struct ls_preview_picture *picture,
                        const struct ls_pixel_format *format, uint32_t width, uint32_t height,
                        const void *raw)
{
    const struct ls_preview_params params = {.format = format,
                                             .width = width,
                                             .height = height,
                                             .black_dn = config->black_dn,
                                             .full_scale_dn = config->full_scale_dn,
                                             .electrons_per_dn = config->electrons_per_dn,
                                             .read_noise_dn = config->read_noise_dn,
                                             .bin =
                                                 ls_preview_bin(width, height, LS_PREVIEW_MOST_PX)};
    picture->bin = params.bin;
    picture->width = ls_preview_size(width, params.bin);
    picture->height = ls_preview_size(height, params.bin);
    return ls_preview_make(&params, raw, picture->rgb, &picture->figures);
}

void ls_preview_offer(struct ls_preview *preview, uint32_t camera,
                      const struct ls_pixel_format *format, uint32_t width, uint32_t height,
                      const void *raw, uint64_t frame_id, double exposure_us)
{
    struct tap *tap = preview ? &preview->taps[camera] : NULL;
    if (!tap || !pass(tap, WANTED, FILLING))
        return;
    enum ls_err err =
        fill(&preview->config->cameras[camera], &tap->picture, format, width, height, raw);
    tap->picture.frame_id = frame_id;
    tap->picture.exposure_us = exposure_us;
    atomic_store(&tap->state, err ? WANTED : READY); /* what is not to be shown is not: the next */
}

const struct ls_preview_picture *ls_preview_take(struct ls_preview *preview, uint32_t camera)
{
    struct tap *tap = &preview->taps[camera];
    return pass(tap, READY, TAKEN) ? &tap->picture : NULL;
}

static struct ls_ring_view view_of(const struct ls_ring *ring, const struct ls_camera_info *info)
{
    const struct ls_camera_slots slots = ls_ring_slots(ring);
    struct ls_ring_view view = {.slots = slots.n,
                                .stride = slots.stride,
                                .payload_bytes = ls_ring_payload_bytes(ring),
                                .index_at = ls_ring_index_at(ring),
                                .bytes = ls_ring_bytes(ring),
                                .width = info->width,
                                .height = info->height};
    snprintf(view.pixel_format, sizeof view.pixel_format, "%s", info->pixel_format);
    return view;
}

void ls_preview_set_ring(struct ls_preview *preview, uint32_t camera, const struct ls_ring *ring,
                         const struct ls_camera_info *info)
{
    if (!preview)
        return;
    pthread_mutex_lock(&preview->lock);
    preview->rings[camera].ring = ring;
    if (ring)
        preview->rings[camera].view = view_of(ring, info);
    pthread_mutex_unlock(&preview->lock);
}

enum ls_err ls_preview_ring(struct ls_preview *preview, uint32_t camera, struct ls_ring_view *out,
                            struct ls_diag *diag)
{
    pthread_mutex_lock(&preview->lock);
    const struct ls_ring *ring = preview->rings[camera].ring;
    *out = preview->rings[camera].view;
    enum ls_err err = ring ? ls_ring_share(ring, &out->fd, diag)
                           : ls_fail(diag, LS_ERR_STATE,
                                     "no frames land now: a camera has a ring while a take runs");
    pthread_mutex_unlock(&preview->lock);
    return err;
}

void ls_preview_destroy(struct ls_preview *preview)
{
    if (preview)
        pthread_mutex_destroy(&preview->lock);
    free(preview);
}

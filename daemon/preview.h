/*
 * preview: what cameras see, for who looks: one small picture per camera between the threads that
 * have frames and ls-main, which sends it. Nobody waits for anybody.
 * Layer: daemon. Threads: want and take on ls-main; offer on any thread that may compute (not
 * ls-seq or ls-cam), several at once. Ownership: as stated.
 *
 * A picture is made only while one is wanted: the first frame offered then is made into it, by the
 * thread that has the frame; all others pass. So a client that does not read costs a take nothing,
 * and one that does a frame's reduction (core/preview.h) as often as it takes pictures: ten times a
 * second at most, 8 ms of a core each for 2048 x 2048 in 8 bit.
 */
#ifndef LS_DAEMON_PREVIEW_H
#define LS_DAEMON_PREVIEW_H

#include "core/preview.h"
#include "daemon/config.h"
#include "daemon/ring.h"

enum { LS_PREVIEW_MOST_PX = 512 /* pixels of a picture in a row and a column */ };

struct ls_preview_picture {
    uint32_t width, height, bin;
    uint64_t frame_id;
    double exposure_us;
    struct ls_preview_figures figures;
    uint8_t rgb[LS_PREVIEW_MOST_PX * LS_PREVIEW_MOST_PX * 3]; /* [height][width][3] */
};

struct ls_preview;

/** NULL: out of memory. (transfer full). */
struct ls_preview *ls_preview_create(const struct ls_config *config);

/** The next frame of @camera is wanted; what ls_preview_take gave before is invalid. */
void ls_preview_want(struct ls_preview *preview, uint32_t camera);

/** A frame, valid during the call. Makes it into a picture if one is wanted. @preview may be NULL.
 */
void ls_preview_offer(struct ls_preview *preview, uint32_t camera,
                      const struct ls_pixel_format *format, uint32_t width, uint32_t height,
                      const void *raw, uint64_t frame_id, double exposure_us);

/** The picture that was wanted, or NULL: not there yet. (transfer none), until the next want. */
const struct ls_preview_picture *ls_preview_take(struct ls_preview *preview, uint32_t camera);

/** Frames of @camera land in @ring from now on, as @info says; NULL: no more, before it is
 * destroyed. Any thread but ls-seq and ls-cam. @preview may be NULL. */
void ls_preview_set_ring(struct ls_preview *preview, uint32_t camera, const struct ls_ring *ring,
                         const struct ls_camera_info *info);

/** What is needed to look at a ring. */
struct ls_ring_view {
    int fd; /* (transfer full), close */
    uint32_t slots;
    uint64_t stride, payload_bytes, index_at, bytes;
    uint32_t width, height;
    char pixel_format[32];
};

/** The ring of @camera. LS_ERR_STATE: there is none now; LS_ERR_OS. ls-main. */
LS_MUST_CHECK enum ls_err ls_preview_ring(struct ls_preview *preview, uint32_t camera,
                                          struct ls_ring_view *out, struct ls_diag *diag);

/** NULL is allowed. */
void ls_preview_destroy(struct ls_preview *preview);

#endif

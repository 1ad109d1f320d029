/*
 * fetch_private: a fetch under way, seen by its parts: fetch_job.c (its life, frame by frame),
 * fetch_start.c (what the take has for it), fetch_light.c (what a light's picture is made of),
 * fetch_rows.c (its pixels, in rows), fetch_tiles.c (the same in tiles), fetch_bounds.c (which of
 * those may be left out), fetch_reply.c (frames).
 * Layer: daemon. Threads: the one that steps it; pixels of tiles by a crew. Ownership: fetch_job.h.
 */
#ifndef LS_DAEMON_FETCH_PRIVATE_H
#define LS_DAEMON_FETCH_PRIVATE_H

#include "daemon/factored.h"
#include "daemon/fetch_job.h"
#include "daemon/pixel_quality.h"
#include "daemon/promotion.h"
#include "daemon/reduction.h"
#include "daemon/render.h"

#include <stdbool.h>

/** What each light is fetched under. */
struct ls_fetch_spectrum {
    char name[32];
    uint32_t channel;            /* of facts */
    struct ls_way way;           /* of single lights */
    const uint16_t *ratio_tiles; /* of promoted halves that are made tile by tile; or NULL */
    uint16_t *ratio_most; /* with max_error: [maps][tiles], the largest |half| of each; or NULL */
};

struct ls_fetch_job {
    struct ls_job job;
    struct ls_field_cache *cache;
    struct ls_field_source *source; /* from the first step on */
    char take[128];
    uint32_t camera;
    bool reported; /* what was done for the picture at hand */
    bool started, full_sphere, rgb, mono, estimate, half; /* mono: by way of rgb */
    struct ls_pixel_quality quality;
    struct ls_tiles tiles;
    double bounded_gain; /* |gain| of the picture whose tiles are bounded */
    struct ls_reduction reduction;
    struct ls_factored factored;
    struct ls_demosaic_region asked, region, /* region: what is sent of the picture at hand, in its
                                                level's pixels */
        read;                                /* full-size pixels that it is made of */
    uint32_t read_row;                       /* next, in them */
    uint32_t *lights;                        /* NULL = all, until the first step */
    size_t n_lights, light;                  /* current index */
    uint32_t row;                            /* next, in the region */
    struct ls_fetch_spectrum spectra[LS_FIELD_MAX_SPECTRA]; /* of a light, one after the other;
                                                               factored: white alone */
    struct ls_fetch_spectrum *now;                          /* that of the picture at hand */
    uint32_t n_spectra;
    struct ls_promotion promotion;
    struct ls_render *render; /* of the current light, where it is promoted */
};

/** The stored picture that is sent, or made into what is sent. */
struct ls_fetch_picture {
    const struct ls_picture_map *map; /* NULL: a ratio, or the sum of several */
    double gain;                      /* of the values sent */
    double k;
};

/* ---- fetch_start.c ---- */

/** Find what the take has for the request, and make the maps it needs. Errors: those of
 * ls_field_cache_get, ls_promotion_find (LS_ERR_BUSY: call again) and ls_factored_find;
 * LS_ERR_NOT_FOUND, LS_ERR_STATE, LS_ERR_UNSUPPORTED, LS_ERR_LIMIT, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_fetch_start(struct ls_fetch_job *self, struct ls_diag *diag);

/* ---- fetch_light.c ---- */

/** Has k a factor for each colour of the camera? */
bool ls_fetch_is_coloured(const struct ls_fetch_job *self);

/** Made of more than one picture per light? */
bool ls_fetch_is_of_several(const struct ls_fetch_job *self);

/** Not simply a picture times a gain? */
bool ls_fetch_is_promoted(const struct ls_fetch_job *self);

/** Is a promoted light one picture times a ratio, for halves to hold? Floats, and all other ways,
 * are rendered. */
bool ls_fetch_is_promoted_as_halves(const struct ls_fetch_job *self);

/** Can it be had? A way without a set needs the pictures of all lights, and has them. */
bool ls_fetch_has_light(const struct ls_fetch_job *self, const struct ls_fetch_spectrum *spectrum,
                        uint32_t light);

/** The next picture. LS_ERR_NOT_FOUND: no such light, or the plan has no picture of it;
 * LS_ERR_STATE: it is missing, or a sphere's duty is not calibrated. */
LS_MUST_CHECK enum ls_err ls_fetch_find_picture(const struct ls_fetch_job *self,
                                                struct ls_fetch_picture *out, struct ls_diag *diag);

/* ---- fetch_rows.c ---- */

/** Are full-size pixels sent, as halves? What is reduced is made of floats. */
bool ls_fetch_sends_halves(const struct ls_fetch_job *self);

/** Of what is sent. */
uint32_t ls_fetch_components(const struct ls_fetch_job *self);

/** Pixels @r of a full-size picture that is not rendered, as they go over the wire: into @chunk's
 * payload, if it has room, which floats need. Any thread. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_fetch_make_pixels(const struct ls_fetch_job *self,
                                               const struct ls_fetch_picture *picture,
                                               struct ls_demosaic_region r, struct ls_chunk *chunk,
                                               struct ls_diag *diag);

/** The next rows of the region, as they go over the wire: @chunk's payload. Errors: those of
 * ls_render_open and ls_render_step. */
LS_MUST_CHECK enum ls_err ls_fetch_next_band(struct ls_fetch_job *self,
                                             const struct ls_fetch_picture *picture,
                                             struct ls_demosaic_region *band,
                                             struct ls_chunk *chunk, struct ls_diag *diag);

/** The next frame of a fetch in rows. Errors: those of ls_fetch_next_band,
 * ls_pixel_quality_append and ls_fetch_send. */
LS_MUST_CHECK enum ls_err ls_fetch_next_rows(struct ls_fetch_job *self,
                                             const struct ls_fetch_picture *picture,
                                             struct ls_chunk *chunk, bool *last,
                                             struct ls_diag *diag);

/* ---- fetch_tiles.c ---- */

/** The next frame of a fetch in tiles, or none. LS_ERR_LIMIT: there is no such tile; those of
 * ls_fetch_next_band, daemon/tiles.h and ls_fetch_send. */
LS_MUST_CHECK enum ls_err ls_fetch_next_tiles(struct ls_fetch_job *self,
                                              const struct ls_fetch_picture *picture,
                                              struct ls_chunk *chunk, bool *last,
                                              struct ls_diag *diag);

/* ---- fetch_bounds.c ---- */

/** Under a max_error, say of the picture's tiles, which have just begun, which may be left out.
 * @by_pixel: its tiles are made one by one; before others are made, nothing is known of them.
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_fetch_bound_tiles(struct ls_fetch_job *self,
                                               const struct ls_fetch_picture *picture,
                                               bool by_pixel, struct ls_diag *diag);

/* ---- fetch_reply.c ---- */

/** @out: rows @band of @picture. */
void ls_fetch_describe(const struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                       struct ls_demosaic_region band, Lightstage__FetchReply *out);

/** This picture is done with. True: it was the last. */
bool ls_fetch_next_picture(struct ls_fetch_job *self);

/** @chunk's payload is there: make its head, with the picture's report if it is its first.
 * Errors: those of ls_message_frame. */
LS_MUST_CHECK enum ls_err ls_fetch_send(struct ls_fetch_job *self, Lightstage__FetchReply *body,
                                        bool picture_ends, struct ls_chunk *chunk, bool *last,
                                        struct ls_diag *diag);

#endif

/*
 * render_band: one band of a picture, from the sums over the lights.
 * Layer: daemon. Threads: one at a time per object. Ownership: the render's. Private to
 * daemon/render.c.
 */
#ifndef LS_DAEMON_RENDER_BAND_H
#define LS_DAEMON_RENDER_BAND_H

#include "core/linear.h"
#include "daemon/render.h"
#include "daemon/row_sums.h"
#include "daemon/separation.h"

/** The sums taken over one set of pictures. */
struct ls_render_stream {
    const struct ls_light_set *set;
    uint32_t n;
    float *weights; /* [n][set->n_pictures], gains applied */
    struct ls_relight_rows sums;
};

struct ls_render_sum {
    uint32_t stream, q;
};

/** One term, and the sums it needs. */
struct ls_render_part {
    struct ls_way way;
    int32_t target;
    bool coloured; /* MATRIX: of each input three sums that follow each other, one for each colour
                      of the camera */
    uint32_t picture, n_sums;
    struct ls_render_sum sums[LS_LINEAR_MAX_INPUTS]; /* BLEND: the first of n_sums that follow each
                                                        other; SEPARATED: q, a row of `separated` */
};

struct ls_render {
    struct ls_field_source *source;
    struct ls_promotion promotion;
    struct ls_demosaic_region region;
    uint32_t n_pictures, next_y, lights_used, tile_rows;
    bool mosaic;
    struct ls_crew crew;
    double error_scale; /* error of one sum, stored, to that of a picture */
    double sum_error;   /* what may be left out of one sum, stored */

    struct ls_render_stream streams[LS_MAX_CHANNELS + 1]; /* white, and each channel */
    uint32_t n_streams;
    struct ls_render_part parts[3 * LS_RENDER_MAX_TERMS]; /* a term may be one for each colour */
    uint32_t n_parts;

    struct ls_separation separation; /* if n_separated > 0 */
    float *separated;                /* [n_separated][n_lights] */
    uint32_t n_separated;
    struct ls_separated_report separated_report;
};

/** *pixels: as ls_render_step. The streams hold the band and its halo. */
LS_MUST_CHECK enum ls_err ls_render_make_band(struct ls_render *render,
                                              struct ls_demosaic_region band, float **pixels,
                                              struct ls_diag *diag);

#endif

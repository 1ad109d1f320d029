/*
 * render: pictures made of a take's field by a model of promotion, band by band from top to bottom.
 * Layer: daemon. Threads: one at a time per object; a step may start more. Ownership: see each
 * function; the source outlives it.
 *
 * Where lights differ in colour (daemon/light_set.h), a term is a sum for each colour of the
 * camera, else one. Polarised pictures are separated with k alone.
 *
 * A single light of a promoted field is a picture with one weight; a relit picture is one with
 * many. Each tile row of the field is read once (polarised pictures: with every band that touches
 * it). The result is bit-identical to making the whole picture at once, whatever the number of
 * threads.
 *
 * Memory: beyond the mapped pictures and what has been handed out, below 256 MiB for pictures 2048
 * pixels wide, the making of maps included, of as many as open accepts at once (measured: one 33 to
 * 119 MiB, 7 to 62 of them 191 to 231). The maps are the exception: they lie in files of the storage
 * folder (daemon/map_file.h), whose pages the kernel may take back: 12 bytes for each pixel and
 * promoted spectrum, LINEAR on RGB 36 (daemon/README.md has the rest), so of five spectra 252 and
 * 755 MB for 2048 x 2048.
 */
#ifndef LS_DAEMON_RENDER_H
#define LS_DAEMON_RENDER_H

#include "core/error.h"
#include "daemon/job.h"
#include "daemon/promotion.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_RENDER_MAX_TERMS = 256 };

/** One addend. */
struct ls_render_term {
    uint32_t channel;      /* of the take's rig */
    const double *weights; /* [n_lights of the rig], radiance x sr (one light: 1 at its row) */
    int32_t target;        /* -1: each channel of the camera goes to the same channel of the picture
                              (mono: to all three); 0..2: only that channel of the picture */
    uint32_t picture;      /* which one it is added to */
};

struct ls_render_job {
    struct ls_promotion promotion;
    const struct ls_render_term *terms; /* [n_terms], read by open only */
    uint32_t n_terms, n_pictures;
    struct ls_demosaic_region region; /* inside the picture */
    double max_error;   /* what may be left out of each picture and pixel, in R before promotion */
    bool mosaic;        /* one term, photographed: the sum before demosaicing */
    bool k_alone;       /* of photographs: leave out the factors on k for a camera colour */
    unsigned n_threads; /* that share a step, at most LS_CREW_MAX_THREADS; 0 = the caller's alone */
    const struct ls_job *asker; /* open stops soon after it is cancelled; or NULL */
};

struct ls_render;

/**
 * Choose ways and make what maps they need, which may take long. A term whose weights are all 0 is
 * dropped: it needs no pictures. Errors: those of ls_promotion_find; LS_ERR_STATE (lights that
 * shine lack their pictures: the sentence counts them), LS_ERR_LIMIT (too many sums; several
 * pictures that would need more than 256 MiB), LS_ERR_ABORTED (cancelled), LS_ERR_BUSY (as
 * ls_field_maps_get: open again later), LS_ERR_UNSUPPORTED
 * (no mosaic of what is promoted), LS_ERR_NOMEM. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_render_open(struct ls_field_source *source,
                                         const struct ls_render_job *job, struct ls_render **out,
                                         struct ls_diag *diag);

/**
 * Do a piece of work; when a band is complete, *pixels is
 * [n_pictures][band->height][band->width][3] (mono and mosaic: the same value three times),
 * (transfer full), free(), else NULL. Camera RGB, in R's unit. *done with the last band.
 * LS_ERR_INVALID, LS_ERR_NOMEM. Whether the pictures could be read is the caller's to ask
 * (ls_field_source_sound).
 */
LS_MUST_CHECK enum ls_err ls_render_step(struct ls_render *render, struct ls_demosaic_region *band,
                                         float **pixels, bool *done, struct ls_diag *diag);

struct ls_render_report {
    uint32_t lights_used; /* of the rig */
    uint64_t tiles_skipped;
    double error_bound; /* of what was left out, in R before promotion */
    uint32_t n_spectra;
    Lightstage__SpectrumReport spectra[LS_MAX_CHANNELS]; /* of every channel that shone */
};

/** So far. Strings point into the source. */
void ls_render_report(const struct ls_render *render, struct ls_render_report *out);

/** NULL is allowed. */
void ls_render_close(struct ls_render *render);

#endif

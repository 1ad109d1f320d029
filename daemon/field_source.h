/*
 * field_source: a take on disk as core's reflectance field: its pictures mapped, its gains and
 * geometry filled in, its promotion ratios made once.
 * Layer: daemon. Threads: opened by one; then read-only except for ls_field_source_ratio, which
 * any thread may call. Ownership: the source owns everything it points at.
 *
 * Without a calibration in the take the field is what it can be: gains, p and factors 1, scale 1
 * (values as stored, white near 1), cells from the lights' positions; `calibrated` is false.
 */
#ifndef LS_DAEMON_FIELD_SOURCE_H
#define LS_DAEMON_FIELD_SOURCE_H

#include "core/error.h"
#include "core/field.h"
#include "daemon/picture_map.h"
#include "daemon/take_facts.h"

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_field_source {
    char take[128];
    uint32_t camera;
    struct ls_take_facts *facts;
    uint32_t width, height;
    bool calibrated;
    struct ls_picture_map *maps; /* per condition of facts; base NULL = not published */

    /* Spectrum 0 is the channel photographed per light; then the channels of kind spectrum that
     * have a full sphere. */
    struct ls_field field;
    uint32_t channel_of[LS_FIELD_MAX_SPECTRA]; /* spectrum -> channel of facts */
    bool has_sphere[LS_FIELD_MAX_SPECTRA];
    uint32_t n_white; /* lights with a picture */
    float *tile_max;  /* [tiles_y * tiles_x][n_lights] */

    /* owned, behind the field's pointers */
    struct ls_picture *white, *sphere;
    const void **no_tiles;
    double *k, *g, *omega_sr, *p, *duty, *factor;
    float (*directions)[3];
    double *k_all; /* [n_channels of facts][n_lights] */

    GMutex ratio_lock;
    float *ratio[LS_FIELD_MAX_SPECTRA]; /* [height][width][n_channels], NULL = not made yet */
};

/**
 * Open take @id under @storage for one camera. Errors: LS_ERR_NOT_FOUND (take, camera),
 * LS_ERR_STATE (nothing published that could be served), LS_ERR_INVALID (damaged), LS_ERR_OS,
 * LS_ERR_NOMEM. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_field_source_open(const char *storage, const char *id, uint32_t camera,
                                               struct ls_field_source **out, struct ls_diag *diag);

/** The picture of one light (or, @light < 0, of the full sphere) of a channel of the take's rig;
 * NULL if it was not photographed. *fact (may be NULL): what was planned. (transfer none). */
const struct ls_picture_map *ls_field_source_picture(const struct ls_field_source *source,
                                                     uint32_t channel, int64_t light,
                                                     const struct ls_condition_fact **fact);

/** The field's spectrum of a channel, or -1. */
int ls_field_source_spectrum(const struct ls_field_source *source, uint32_t channel);

/** Gain k of a channel's light; 1 where uncalibrated. */
double ls_field_source_gain(const struct ls_field_source *source, uint32_t channel, uint32_t light);

/** May spectrum @s be promoted? LS_ERR_STATE says what the take lacks: a full sphere, a light. */
LS_MUST_CHECK enum ls_err ls_field_source_promotable(const struct ls_field_source *source,
                                                     uint32_t s, struct ls_diag *diag);

/**
 * The stable ratio of spectrum @s (not 0) over the whole picture; the first call makes those of
 * every promotable spectrum in one pass over the field, later ones return at once. Errors: those
 * of ls_field_source_promotable, LS_ERR_NOMEM. (transfer none).
 */
LS_MUST_CHECK enum ls_err ls_field_source_ratio(struct ls_field_source *source, uint32_t s,
                                                const float **ratio, struct ls_diag *diag);

/** Could every picture be read so far and, if @sizes, is every file still as long as it was? Ask
 * after each piece of work on the pictures and trust the work only then. LS_ERR_INVALID names the
 * file. Any thread. */
LS_MUST_CHECK enum ls_err ls_field_source_sound(const struct ls_field_source *source, bool sizes,
                                                struct ls_diag *diag);

/** NULL is allowed. */
void ls_field_source_close(struct ls_field_source *source);

#endif

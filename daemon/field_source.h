/*
 * field_source: a take on disk as core's reflectance field: its pictures mapped, its gains and
 * geometry filled in, the maps that promote it made once.
 * Layer: daemon. Threads: opened by one; then read-only except for its maps (daemon/field_maps.h),
 * which any thread may ask for. Ownership: the source owns everything it points at.
 *
 * A take may hold, of any channel: each light by itself or the rows of an S-matrix that stand for
 * them (daemon/light_set.h), the full sphere, segments of the dome, the head light. Spectra of the
 * field are the channels of kind spectrum of which it holds any of these, white first. White is the
 * first channel photographed light by light; in a take whose lights were photographed behind
 * polarisers only, it is the sum of the two, V + H.
 *
 * Without a calibration in the take the field is what it can be: gains, p and factors 1, scale 1
 * (values as stored, white near 1), cells from the lights' positions; `calibrated` is false.
 */
#ifndef LS_DAEMON_FIELD_SOURCE_H
#define LS_DAEMON_FIELD_SOURCE_H

#include "core/error.h"
#include "core/field.h"
#include "core/multiplex.h"
#include "daemon/picture_map.h"
#include "daemon/take_facts.h"

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

/** Pictures of a set that together stand for each light of the rig, of one channel. */
struct ls_light_group {
    uint32_t channel;     /* of facts */
    uint32_t first, n;    /* pictures of the set */
    uint32_t order;       /* 0: picture first + i shows light i; else first + j shows row j of the
                             S-matrix of that order (core/multiplex.h) */
    double duty;          /* of the rows */
    double *scale;        /* [order] factor / duty of each row; 0 where it is not calibrated */
    const double *k;      /* [n_lights] */
    const double *colour; /* [n_lights][3] factors on k for one camera colour; NULL: all are 1 */
    const struct ls_multiplex_spare *spare; /* what the spare column reads; NULL where it could not
                                               be looked at */
};

/** Pictures whose sum under any weights of lights can be had. White behind polarisers has two
 * groups. */
struct ls_light_set {
    uint32_t n_groups;
    struct ls_light_group group[2];
    uint32_t n_pictures, n_found; /* n_found 0: not photographed */
    struct ls_picture *pictures;  /* [n_pictures]; no_tiles where there is none */
    float *tile_max;              /* [tiles_y * tiles_x][n_pictures] */
};

struct ls_field_maps;

struct ls_field_source {
    char take[128], storage[4096];
    uint64_t spare_bytes; /* of the disk, that maps leave free; whoever opens it says */
    uint32_t camera;
    struct ls_take_facts *facts;
    uint32_t width, height;
    bool calibrated;
    struct ls_picture_map *maps; /* per condition of facts; base NULL = not published */

    struct ls_field field;                     /* its white is that of `white`, below */
    uint32_t channel_of[LS_FIELD_MAX_SPECTRA]; /* spectrum -> channel of facts */
    bool has_sphere[LS_FIELD_MAX_SPECTRA];     /* photographed, and its factor calibrated */
    struct ls_light_set set[LS_MAX_CHANNELS];  /* by channel of facts */
    struct ls_light_set white;
    struct ls_multiplex_spare spare[LS_MAX_CHANNELS];
    bool white_is_polarised;      /* V + H */
    int32_t vertical, horizontal; /* channels V and H of kind polariser, else the rig's first and
                                     second of that kind; or -1 */
    double neutral_vh[2][3];      /* p of vertical and horizontal, by camera channel */
    struct ls_field_maps *promoted;

    /* owned, behind the field's pointers */
    struct ls_picture *sphere;
    const void **no_tiles;
    double *k, *g, *omega_sr, *p, *duty, *factor;
    float (*directions)[3];
    double *k_all;                    /* [n_channels of facts][n_lights] */
    double *colour;                   /* [n_channels of facts][n_lights][3]; or NULL */
    bool has_colour[LS_MAX_CHANNELS]; /* by channel of facts: some factor of it is not 1 */
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

/** Factors [n_lights][3] on k of a channel for one camera colour each; NULL where all are 1, as
 * they are of a mono camera, whose one factor is part of k. (transfer none). */
const double *ls_field_source_colour(const struct ls_field_source *source, uint32_t channel);

/** Did the plan ask for a picture of this kind? @light < 0: of any light. */
bool ls_field_source_planned(const struct ls_field_source *source, enum ls_fact_kind kind,
                             uint32_t channel, int64_t light);

/** What a stored picture of a condition's lights is multiplied by to be the sum of its lights' E:
 * factor / duty. 0 where the take is calibrated and this pattern at this duty is not. */
double ls_field_source_factor(const struct ls_field_source *source,
                              const struct ls_condition_fact *fact);

/** Say that the take's calibration has no factor of @pattern at @duty for a channel of its rig, so
 * that @what of it cannot be used. Returns LS_ERR_STATE. */
enum ls_err ls_field_source_uncalibrated(const struct ls_field_source *source, const char *what,
                                         uint32_t channel, const char *pattern, double duty,
                                         struct ls_diag *diag);

/** Could every picture be read so far and, if @sizes, is every file still as long as it was? Ask
 * after each piece of work on the pictures and trust the work only then. LS_ERR_INVALID names the
 * file. Any thread. */
LS_MUST_CHECK enum ls_err ls_field_source_sound(const struct ls_field_source *source, bool sizes,
                                                struct ls_diag *diag);

/** NULL is allowed. */
void ls_field_source_close(struct ls_field_source *source);

#endif

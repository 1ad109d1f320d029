/*
 * calibrate_take: a take as a client sees it that reads pictures by their names in the plan: what
 * they show, and the pictures. Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_TAKE_H
#define LS_CLIENTS_CALIBRATE_TAKE_H

#include "clients/command.h"
#include "clients/take_document.h"
#include "core/field.h"
#include "core/grey_sphere.h"
#include "core/pinhole.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_calibrate_take {
    struct ls_command_context *context;
    char id[128];
    uint32_t camera_row;
    struct ls_take_document *document;
    struct ls_pinhole camera;
    char pixel_format[32], cfa[8];
    double black_dn, full_scale_dn, electrons_per_dn, read_noise_dn, exposure_offset_us;
    double range_low, range_high; /* of full scale */
    struct ls_field_noise noise;  /* of a dim pixel in full scale / s */
    uint32_t n_pictures;
    struct ls_lit_picture *pictures; /* the lit ones of the plan */
    size_t weights_bytes;            /* of all pictures */
};

/** Ask the daemon for a take. Errors: those of the daemon (LS_ERR_REFUSED), LS_ERR_INVALID naming
 * the key of take.json. *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_calibrate_take_open(struct ls_command_context *context, const char *id,
                                                 uint32_t camera, struct ls_calibrate_take **out);

/** Parse take.json; the context is for fetching later and may be NULL. */
LS_MUST_CHECK enum ls_err ls_calibrate_take_parse(struct ls_command_context *context,
                                                  const char *id, const char *text, size_t n,
                                                  uint32_t camera, struct ls_calibrate_take **out,
                                                  struct ls_diag *diag);

/** NULL is allowed. */
void ls_calibrate_take_close(struct ls_calibrate_take *take);

/** The picture of one light of a channel (@light >= 0) or of a pattern, or NULL. */
const struct ls_lit_picture *ls_calibrate_find(const struct ls_calibrate_take *take,
                                               uint32_t channel, int32_t light,
                                               const char *pattern);

/** Index of a channel by name, or -1. */
int ls_calibrate_channel(const struct ls_calibrate_take *take, const char *name);

/** A rectangle of pixels; width 0 = the whole picture. */
struct ls_calibrate_region {
    uint32_t x, y, width, height;
};

/** Around a sphere's outline, clipped at the picture, at even offsets. */
struct ls_calibrate_region ls_calibrate_around(const struct ls_calibrate_take *take,
                                               const struct ls_outline *outline);

/** Fetch pictures in the order given and hand each to @use with the validity that the take stored;
 * its error ends it. */
LS_MUST_CHECK enum ls_err ls_calibrate_fetch(const struct ls_calibrate_take *take,
                                             const struct ls_lit_picture *const *pictures,
                                             uint32_t n, struct ls_calibrate_region region,
                                             ls_lit_use *use, void *user);

#endif

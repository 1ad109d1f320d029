#include "daemon/linear_maps.h"

#include "core/mono_blend.h"
#include "core/relight.h"
#include "daemon/linear_check.h"
#include "daemon/segment_noise.h"
#include "daemon/segment_sums.h"

#include <stdlib.h>

enum { PIECE_PX = 128, LEAST_PX = 16, HALO_PX = LS_LINEAR_HALO_PX };
enum { BORDER_PX = HALO_PX + LS_DEMOSAIC_HALO };
static const size_t sums_bytes = (size_t)112 << 20, piece_bytes = (size_t)12 << 20;

/* What one thread fits a rectangle with. */
struct room {
    float *memory;
    float **v, **u, **f; /* [n_segments] -> [padded height][padded width][n_in, 1, colours] */
    float *rgb;          /* one demosaiced sum */
};

struct errors {
    struct ls_linear_error left_out, checked, highlights;
};

/* Everything one pass over the field needs. */
struct pass {
    const struct ls_linear_job *job;
    uint32_t colours, n_in, piece_px, n_pieces; /* across the picture */
    struct ls_segment_sums sums;
    uint32_t y0, y1;                /* the band to be fitted */
    struct ls_segment_noise *noise; /* [sums.n] */
    struct room *rooms;             /* [n_threads] */
    unsigned n_rooms;
    struct errors *errors; /* [sums.n][n_pieces] of a band */
};

static uint32_t above(uint32_t y, uint32_t halo)
{
    return y > halo ? y - halo : 0;
}

static uint32_t below(uint32_t y, uint32_t halo, uint32_t height)
{
    return height - y > halo ? y + halo : height;
}

/* ---- life ---- */

static size_t floats_of_pixel(const struct pass *pass)
{
    uint32_t values = pass->n_in + pass->colours + (pass->job->phi ? 1 : 0);
    return (size_t)pass->job->n_segments * values + pass->colours;
}

static size_t padded_px(const struct pass *pass)
{
    return (size_t)(pass->piece_px + 2 * HALO_PX) * (LS_TILE_SIDE + BORDER_PX + 2 * HALO_PX);
}

/* As wide as fits, and for no other reason: what is fitted does not depend on it. */
static void choose_pieces(struct pass *pass)
{
    pass->piece_px = PIECE_PX;
    while (pass->piece_px > LEAST_PX &&
           padded_px(pass) * floats_of_pixel(pass) * sizeof(float) > piece_bytes)
        pass->piece_px /= 2;
    pass->n_pieces = (pass->job->field->width + pass->piece_px - 1) / pass->piece_px;
}

static enum ls_err room_init(struct room *room, const struct pass *pass)
{
    uint32_t n = pass->job->n_segments;
    size_t padded = padded_px(pass);
    room->memory = malloc(padded * floats_of_pixel(pass) * sizeof(float));
    room->v = calloc((size_t)3 * n, sizeof *room->v);
    if (!room->memory || !room->v)
        return LS_ERR_NOMEM;
    room->u = room->v + n;
    room->f = room->u + n;
    float *next = room->memory;
    for (uint32_t g = 0; g < n; g++) {
        room->v[g] = next;
        room->f[g] = next += padded * pass->n_in;
        next += padded * pass->colours;
        room->u[g] = next;
        next += pass->job->phi ? padded : 0;
    }
    room->rgb = next;
    return LS_OK;
}

static void pass_finish(struct pass *pass)
{
    for (uint32_t t = 0; pass->noise && t < pass->sums.n; t++)
        ls_segment_noise_finish(&pass->noise[t]);
    for (unsigned k = 0; pass->rooms && k < pass->n_rooms; k++) {
        free(pass->rooms[k].memory);
        free(pass->rooms[k].v);
    }
    free(pass->noise);
    free(pass->rooms);
    free(pass->errors);
    ls_segment_sums_finish(&pass->sums);
}

static enum ls_err allocate(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    uint32_t n = pass->sums.n;
    enum ls_err err = LS_OK;
    pass->n_rooms = job->crew.n_threads < 1 ? 1 : job->crew.n_threads;
    if (pass->n_rooms > LS_CREW_MAX_THREADS)
        pass->n_rooms = LS_CREW_MAX_THREADS;
    pass->noise = calloc(n, sizeof *pass->noise);
    pass->rooms = calloc(pass->n_rooms, sizeof *pass->rooms);
    pass->errors = calloc((size_t)n * pass->n_pieces, sizeof *pass->errors);
    if (!pass->noise || !pass->rooms || !pass->errors)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a fit");
    for (uint32_t t = 0; t < n && !err; t++)
        err =
            ls_segment_noise_init(&pass->noise[t], job, &job->targets[pass->sums.first + t], diag);
    for (unsigned k = 0; k < pass->n_rooms && !err; k++)
        if (room_init(&pass->rooms[k], pass))
            err = ls_fail(diag, LS_ERR_NOMEM, "out of memory for a fit on %u segments",
                          job->n_segments);
    return err;
}

static enum ls_err pass_init(struct pass *pass, uint32_t first, uint32_t n, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    pass->colours = job->field->n_channels;
    pass->n_in = job->n_sets * pass->colours;
    choose_pieces(pass);
    enum ls_err err = ls_segment_sums_init(&pass->sums, job, first, n, diag);
    return err ? err : allocate(pass, diag);
}

/* ---- a rectangle ---- */

struct piece {
    struct ls_demosaic_region wanted, padded;
    uint32_t t; /* target of the pass */
};

static struct piece piece_at(const struct pass *pass, uint32_t item)
{
    const struct ls_field *field = pass->job->field;
    uint32_t x0 = item % pass->n_pieces * pass->piece_px;
    uint32_t x1 = below(x0, pass->piece_px, field->width);
    uint32_t left = above(x0, HALO_PX), right = below(x1, HALO_PX, field->width);
    uint32_t top = above(pass->y0, HALO_PX), end = below(pass->y1, HALO_PX, field->height);
    return (struct piece){.wanted = {x0, pass->y0, x1 - x0, pass->y1 - pass->y0},
                          .padded = {left, top, right - left, end - top},
                          .t = item / pass->n_pieces};
}

/* Colours [c0, c1) of a sum, demosaiced, into @plane of [pixels][depth] at @at. */
static enum ls_err fill_colours(const struct pass *pass, const struct room *room, const float *sum,
                                const struct ls_demosaic_region *padded, float *plane,
                                uint32_t depth, uint32_t at, uint32_t c0, uint32_t c1)
{
    uint32_t colours = pass->colours;
    size_t n = (size_t)padded->width * padded->height;
    float *to = depth == c1 - c0 ? plane : room->rgb;
    enum ls_err err = ls_relight_demosaic(pass->job->field, sum, pass->sums.window, *padded, to);
    for (size_t p = 0; p < n && !err && to == room->rgb; p++)
        for (uint32_t c = c0; c < c1; c++)
            plane[p * depth + at + c] = room->rgb[p * colours + c];
    return err;
}

static enum ls_err fill_plane(const struct pass *pass, const struct room *room, const float *sum,
                              const struct ls_demosaic_region *padded, float *plane, uint32_t depth)
{
    return fill_colours(pass, room, sum, padded, plane, depth, 0, 0, pass->colours);
}

static enum ls_err fill_v(const struct pass *pass, const struct room *room,
                          const struct piece *piece, uint32_t set, uint32_t g)
{
    uint32_t n = pass->job->n_rows, taken = n > 1 ? 1 : pass->colours;
    enum ls_err err = LS_OK;
    for (uint32_t c = 0; c < n && !err; c++)
        err =
            fill_colours(pass, room, ls_segment_sums_v(&pass->sums, piece->t, set, g, c),
                         &piece->padded, room->v[g], pass->n_in, set * pass->colours, c, c + taken);
    return err;
}

static enum ls_err fill_planes(const struct pass *pass, const struct room *room,
                               const struct piece *piece)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_segment_sums *sums = &pass->sums;
    enum ls_err err = LS_OK;
    for (uint32_t g = 0; g < job->n_segments && !err; g++) {
        err = fill_plane(pass, room, ls_segment_sums_f(sums, piece->t, g), &piece->padded,
                         room->f[g], pass->colours);
        for (uint32_t k = 0; k < job->n_sets && !err; k++)
            err = fill_v(pass, room, piece, k, g);
        if (!err && job->phi)
            err = fill_plane(pass, room, ls_segment_sums_u(sums, piece->t, g), &piece->padded,
                             room->u[g], 1);
    }
    return err;
}

static const struct ls_linear_target *target_of(const struct pass *pass, const struct piece *piece)
{
    return &pass->job->targets[pass->sums.first + piece->t];
}

/* To the next multiple of the step. */
static uint32_t first_of_step(uint32_t x)
{
    return (LS_LINEAR_ERROR_STEP - x % LS_LINEAR_ERROR_STEP) % LS_LINEAR_ERROR_STEP;
}

/* The rectangle that is wanted, its map of @depth values a pixel. */
static struct ls_linear_part part_of(const struct pass *pass, const struct piece *piece,
                                     size_t depth, struct ls_linear_error *error)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_demosaic_region *wanted = &piece->wanted, *padded = &piece->padded;
    size_t stride = job->field->width * depth;
    return (struct ls_linear_part){.x = wanted->x - padded->x,
                                   .y = wanted->y - padded->y,
                                   .width = wanted->width,
                                   .height = wanted->height,
                                   .out = target_of(pass, piece)->map + wanted->y * stride +
                                          wanted->x * depth,
                                   .out_stride = stride,
                                   .step = job->n_segments > 2 ? LS_LINEAR_ERROR_STEP : 0,
                                   .first_x = first_of_step(wanted->x),
                                   .first_y = first_of_step(wanted->y),
                                   .error = error};
}

static enum ls_err fit_matrices(const struct pass *pass, const struct room *room,
                                const struct piece *piece, struct ls_linear_error *error,
                                struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_segment_noise *noise = &pass->noise[piece->t];
    struct ls_linear_options options;
    const struct ls_linear_pictures pictures = {.width = piece->padded.width,
                                                .height = piece->padded.height,
                                                .n_segments = job->n_segments,
                                                .n_lights = job->field->n_lights,
                                                .n_in = pass->n_in,
                                                .n_out = pass->colours,
                                                .v = (const float *const *)room->v,
                                                .f = (const float *const *)room->f,
                                                .v_noise = noise->v,
                                                .f_noise = noise->f,
                                                .total_noise = noise->total,
                                                .p_in = job->p_in,
                                                .p_out = job->field->p +
                                                         target_of(pass, piece)->s * pass->colours,
                                                .inputs = {0, 1, 2},
                                                .demosaiced = pass->colours > 1};
    const struct ls_linear_part part =
        part_of(pass, piece, (size_t)pass->colours * pass->n_in, error);
    ls_linear_options_default(&options);
    return ls_linear_fit(&pictures, &options, &part, diag);
}

static enum ls_err blend_ratios(const struct pass *pass, const struct room *room,
                                const struct piece *piece, struct ls_linear_error *error,
                                struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_segment_noise *noise = &pass->noise[piece->t];
    const struct ls_mono_blend_pictures pictures = {
        .width = piece->padded.width,
        .height = piece->padded.height,
        .n_segments = job->n_segments,
        .n_lights = job->field->n_lights,
        .v = (const float *const *)room->v,
        .u = (const float *const *)room->u,
        .f = (const float *const *)room->f,
        .v_noise = noise->v,
        .f_noise = noise->f,
        .total_noise = noise->total,
        .neutral = job->field->p[target_of(pass, piece)->s] / job->p_in[0],
        .others = job->others};
    const struct ls_linear_part part = part_of(pass, piece, job->n_segments, error);
    return ls_mono_blend_fit(&pictures, &part, diag);
}

static enum ls_err fit_piece(void *user, uint32_t item, unsigned thread, struct ls_diag *diag)
{
    const struct pass *pass = user;
    const struct room *room = &pass->rooms[thread];
    const struct piece piece = piece_at(pass, item);
    struct errors *errors = &pass->errors[item];
    *errors = (struct errors){0};
    if (fill_planes(pass, room, &piece))
        return ls_fail(diag, LS_ERR_INVALID, "rows %u to %u cannot be demosaiced", pass->y0,
                       pass->y1);
    enum ls_err err = pass->job->phi ? blend_ratios(pass, room, &piece, &errors->left_out, diag)
                                     : fit_matrices(pass, room, &piece, &errors->left_out, diag);
    const struct ls_linear_check check = {.job = pass->job,
                                          .target = target_of(pass, &piece),
                                          .wanted = piece.wanted,
                                          .padded = piece.padded,
                                          .v = (const float *const *)room->v};
    return err ? err : ls_linear_check(&check, &errors->checked, &errors->highlights, diag);
}

/* ---- bands ---- */

static enum ls_err fit_band(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    uint32_t n = pass->sums.n * pass->n_pieces;
    enum ls_err err = ls_crew_run(&job->crew, n, fit_piece, pass, diag);
    for (uint32_t item = 0; item < n && !err; item++) {
        struct ls_linear_target *target = &job->targets[pass->sums.first + item / pass->n_pieces];
        ls_linear_error_add(&target->left_out, &pass->errors[item].left_out);
        ls_linear_error_add(&target->checked, &pass->errors[item].checked);
        ls_linear_error_add(&target->highlights, &pass->errors[item].highlights);
    }
    return err;
}

/* A tile row is read, and fitted as far as the rows below are there. */
static enum ls_err run(struct pass *pass, struct ls_diag *diag)
{
    uint32_t height = pass->job->field->height;
    enum ls_err err = LS_OK;
    for (pass->y1 = 0; pass->y1 < height && !err;) {
        pass->y0 = pass->y1;
        err = ls_segment_sums_advance(&pass->sums, above(pass->y0, BORDER_PX), diag);
        uint32_t end = pass->sums.window.y + pass->sums.window.height;
        pass->y1 = end == height ? end : end - BORDER_PX;
        if (!err)
            err = fit_band(pass, diag);
    }
    return err;
}

enum ls_err ls_linear_maps_make(const struct ls_linear_job *job, struct ls_diag *diag)
{
    size_t fit = sums_bytes / ls_segment_sums_bytes(job);
    uint32_t together = fit < 1 ? 1 : fit < job->n_targets ? (uint32_t)fit : job->n_targets;
    enum ls_err err = LS_OK;
    for (uint32_t t = 0; t < job->n_targets; t++)
        job->targets[t].left_out = job->targets[t].checked = job->targets[t].highlights =
            (struct ls_linear_error){0};
    for (uint32_t first = 0; first < job->n_targets && !err; first += together) {
        struct pass pass = {.job = job};
        uint32_t left = job->n_targets - first;
        err = pass_init(&pass, first, left < together ? left : together, diag);
        if (!err)
            err = run(&pass, diag);
        pass_finish(&pass);
    }
    return err;
}

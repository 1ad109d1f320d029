#include "daemon/linear_check.h"

#include "core/relight.h"
#include "daemon/light_set.h"

#include <stdlib.h>

/* One light over the wanted pixels. */
struct room {
    float *total, *v, *f; /* [pixels][n_in, n_in, colours] */
    float *m;             /* of a blend: [pixels] */
    float *rgb;           /* one demosaiced picture */
};

static uint32_t colours_of(const struct ls_linear_check *check)
{
    return check->job->field->n_channels;
}

static uint32_t inputs_of(const struct ls_linear_check *check)
{
    return check->job->n_sets * colours_of(check);
}

/* k E of light @light with k's factors of @colour (or -1), demosaiced: [pixels][colours]. */
static enum ls_err one_colour(const struct ls_linear_check *check, const struct ls_light_set *set,
                              uint32_t light, int32_t colour, float *out, struct ls_diag *diag)
{
    const struct ls_field *field = check->job->field;
    const struct ls_demosaic_region *w = &check->wanted;
    const struct ls_tile_region tiles =
        ls_region_of_pixels(field, w->x, w->y, w->x + w->width, w->y + w->height, LS_DEMOSAIC_HALO);
    const struct ls_demosaic_region window = {tiles.x0 * LS_TILE_SIDE, tiles.y0 * LS_TILE_SIDE,
                                              ls_region_width_px(field, &tiles),
                                              ls_region_height_px(field, &tiles)};
    struct ls_accumulate_report report;
    LS_CLEANUP_FREE double *only = calloc(field->n_lights, sizeof *only);
    LS_CLEANUP_FREE float *row = malloc(set->n_pictures * sizeof *row);
    LS_CLEANUP_FREE float *mosaic = malloc((size_t)window.width * window.height * sizeof *mosaic);
    if (!only || !row || !mosaic)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a light");
    only[light] = 1;
    enum ls_err err = ls_light_set_row(set, only, field->n_lights, colour, row, diag);
    if (err)
        return err;
    const struct ls_accumulate_job job = {
        .pictures = set->pictures, .n_pictures = set->n_pictures, .n_sums = 1, .weights = row};
    err = ls_accumulate(field, &job, &tiles, mosaic, &report, diag);
    if (!err && ls_relight_demosaic(field, mosaic, window, *w, out))
        err = ls_fail(diag, LS_ERR_INVALID, "light %u cannot be demosaiced", light);
    return err;
}

/* R of light @light, demosaiced: [pixels][colours]. */
static enum ls_err one_light(const struct ls_linear_check *check, const struct ls_light_set *set,
                             uint32_t light, float *out, struct ls_diag *diag)
{
    size_t values = (size_t)check->wanted.width * check->wanted.height * colours_of(check);
    if (!ls_light_set_is_coloured(set))
        return one_colour(check, set, light, -1, out, diag);
    LS_CLEANUP_FREE float *rgb = malloc(values * sizeof *rgb);
    enum ls_err err = rgb ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a light");
    for (uint32_t c = 0; c < 3 && !err; c++) {
        err = one_colour(check, set, light, (int32_t)c, rgb, diag);
        for (size_t j = c; j < values && !err; j += 3)
            out[j] = rgb[j];
    }
    return err;
}

static enum ls_err fill_inputs(const struct ls_linear_check *check, uint32_t light,
                               const struct room *room, struct ls_diag *diag)
{
    uint32_t colours = colours_of(check), n_in = inputs_of(check);
    size_t n = (size_t)check->wanted.width * check->wanted.height;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < check->job->n_sets && !err; k++) {
        err = one_light(check, check->job->set[k], light, room->rgb, diag);
        for (size_t p = 0; p < n && !err; p++)
            for (uint32_t c = 0; c < colours; c++)
                room->v[p * n_in + k * colours + c] = room->rgb[p * colours + c];
    }
    return err;
}

/* The full sphere: V of all segments. */
static void fill_total(const struct ls_linear_check *check, const struct room *room)
{
    const struct ls_demosaic_region *w = &check->wanted, *p = &check->padded;
    size_t n_in = inputs_of(check), row = w->width * n_in;
    for (uint32_t y = 0; y < w->height; y++) {
        size_t from = ((size_t)(w->y - p->y + y) * p->width + w->x - p->x) * n_in;
        for (size_t j = 0; j < row; j++) {
            double sum = 0;
            for (uint32_t g = 0; g < check->job->n_segments; g++)
                sum += (double)check->v[g][from + j];
            room->total[y * row + j] = (float)sum;
        }
    }
}

/* What the map makes of this light: its matrix, or the blended ratio. */
static const float *row_of_map(const struct ls_linear_check *check, uint32_t light, uint32_t y,
                               const struct room *room)
{
    const struct ls_linear_job *job = check->job;
    size_t n = job->n_segments, depth = job->phi ? n : (size_t)colours_of(check) * inputs_of(check);
    size_t pixel = (size_t)(check->wanted.y + y) * job->field->width + check->wanted.x;
    const float *map = check->target->map + pixel * depth;
    for (uint32_t x = 0; x < check->wanted.width && job->phi; x++) {
        double ratio = 0;
        for (uint32_t g = 0; g < n; g++)
            ratio += job->phi[light * n + g] * (double)map[x * n + g];
        room->m[x] = (float)ratio;
    }
    return job->phi ? room->m : map;
}

static enum ls_err check_one(const struct ls_linear_check *check, uint32_t light,
                             const struct room *room, struct ls_linear_error *all,
                             struct ls_linear_error *highlights, struct ls_diag *diag)
{
    const struct ls_field *field = check->job->field;
    uint32_t n_in = inputs_of(check), colours = colours_of(check);
    enum ls_err err = fill_inputs(check, light, room, diag);
    if (!err)
        err = one_light(check, check->target->photographed, light, room->f, diag);
    for (uint32_t y = 0; y < check->wanted.height && !err; y++) {
        size_t at = (size_t)y * check->wanted.width;
        const struct ls_linear_light row = {
            .n = check->wanted.width,
            .n_in = n_in,
            .n_out = colours,
            .n_lights = field->n_lights,
            .strength = field->g[(size_t)check->target->s * field->n_lights + light],
            .v = room->v + at * n_in,
            .v_total = room->total + at * n_in,
            .m = row_of_map(check, light, y, room),
            .f = room->f + at * colours};
        ls_linear_check_light(&row, all, highlights);
    }
    return err;
}

enum ls_err ls_linear_check(const struct ls_linear_check *check, struct ls_linear_error *all,
                            struct ls_linear_error *highlights, struct ls_diag *diag)
{
    const struct ls_linear_target *target = check->target;
    size_t n = (size_t)check->wanted.width * check->wanted.height;
    size_t n_in = inputs_of(check), colours = colours_of(check);
    enum ls_err err = LS_OK;
    if (target->n_checks == 0)
        return LS_OK;
    LS_CLEANUP_FREE float *memory = malloc(n * (2 * n_in + 2 * colours + 1) * sizeof *memory);
    if (!memory)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a light");
    const struct room room = {.total = memory,
                              .v = memory + n * n_in,
                              .f = memory + 2 * n * n_in,
                              .rgb = memory + n * (2 * n_in + colours),
                              .m = memory + n * (2 * n_in + 2 * colours)};
    fill_total(check, &room);
    for (uint32_t k = 0; k < target->n_checks && !err; k++)
        err = check_one(check, target->checks[k], &room, all, highlights, diag);
    return err;
}

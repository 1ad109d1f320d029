#include "clients/relight_request.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Of weights in a request, and what a request carries (proto/PROTOCOL.md). */
enum { MOST_ROWS = 256, MOST_WEIGHTS = 1024 * 1024 / sizeof(float) };

struct asked {
    const struct ls_take_document *document;
    bool by_target; /* three of the daemon's pictures each */
    uint32_t first, n;
    ls_relight_take *take;
    void *user;
    float *band;   /* rows of one picture */
    size_t room;   /* floats */
    uint64_t rows; /* that came */
    bool whole;
    struct ls_relit *result;
    struct ls_diag *diag;
    enum ls_err err;
};

static bool alike(const struct ls_light_weights *a, const struct ls_light_weights *b)
{
    bool same = a->mode == b->mode && a->n_names == b->n_names && a->n_rows == b->n_rows &&
                a->by_target == b->by_target && a->after_m == b->after_m;
    for (uint32_t i = 0; same && i < a->n_names; i++)
        same = strcmp(a->names[i], b->names[i]) == 0;
    return same;
}

uint32_t ls_relight_at_once(const struct ls_relight_options *options,
                            const struct ls_take_document *document,
                            const struct ls_light_weights *weights, uint32_t n)
{
    static const double most = 2147483648.0;
    double width = options->region.width ? options->region.width : document->width;
    double height = options->region.height ? options->region.height : document->height;
    double fit = floor(most / (width * height * 3 * sizeof(float)));
    uint32_t count = 1, rows = weights->n_rows, most_rows = MOST_WEIGHTS / weights->n_lights;
    most_rows = most_rows < MOST_ROWS ? most_rows : MOST_ROWS;
    while (count < n && count < fit && (count + 1) * rows <= most_rows &&
           alike(&weights[0], &weights[count]))
        count++;
    return count;
}

/* ---- what comes back ---- */

/* A row of M makes one channel of the picture from camera RGB. */
static void place_target(const double row[3], uint32_t target, const char *from, size_t n,
                         float *out)
{
    for (size_t i = 0; i < n; i++) {
        float v[3];
        memcpy(v, from + i * sizeof v, sizeof v);
        out[3 * i + target] =
            (float)(row[0] * (double)v[0] + row[1] * (double)v[1] + row[2] * (double)v[2]);
    }
}

static enum ls_err make_room(struct asked *asked, size_t n)
{
    if (n <= asked->room)
        return LS_OK;
    float *grown = realloc(asked->band, n * sizeof *grown);
    if (!grown)
        return ls_fail(asked->diag, LS_ERR_NOMEM, "out of memory");
    asked->band = grown;
    asked->room = n;
    return LS_OK;
}

/* The three targets of some rows come one after the other. */
static enum ls_err place_band(struct asked *asked, const struct lightstage_relit *band)
{
    uint32_t each = asked->by_target ? 3 : 1, picture = band->picture / each;
    uint32_t target = band->picture % each;
    size_t n = (size_t)band->n_rows * band->width;
    if (picture >= asked->n)
        return ls_fail(asked->diag, LS_ERR_INVALID,
                       "the daemon sent a picture that was not asked for");
    enum ls_err err = make_room(asked, 3 * n);
    if (err)
        return err;
    if (asked->by_target)
        place_target(asked->document->calibration->m[target], target, band->values, n, asked->band);
    else
        memcpy(asked->band, band->values, 3 * n * sizeof *asked->band);
    asked->rows += band->n_rows;
    const struct ls_relit_rows rows = {.picture = asked->first + picture,
                                       .width = band->width,
                                       .height = band->height,
                                       .first_row = band->first_row,
                                       .n_rows = band->n_rows,
                                       .rgb = asked->band};
    return target + 1 < each ? LS_OK : asked->take(asked->user, &rows, asked->diag);
}

/* The largest share of a picture's error in what M makes of it. */
static double most_of_m(const struct asked *asked)
{
    double most = 0;
    for (int t = 0; asked->by_target && t < 3; t++) {
        const double *row = asked->document->calibration->m[t];
        most = fmax(most, fabs(row[0]) + fabs(row[1]) + fabs(row[2]));
    }
    return asked->by_target ? most : 1;
}

static enum ls_err keep_report(struct asked *asked, const struct lightstage_relit *last)
{
    struct ls_relit *result = asked->result;
    uint64_t rows = (uint64_t)asked->n * (asked->by_target ? 3 : 1) * last->height;
    if (asked->rows != rows)
        return ls_fail(asked->diag, LS_ERR_INVALID,
                       "the daemon ended before the pictures were whole");
    ls_promotion_report_keep(&result->report, last->spectra, last->n_spectra);
    result->calibrated = last->calibrated;
    if (last->lights_used >= result->lights_used) {
        result->lights_used = last->lights_used;
        result->lights_skipped = last->lights_skipped;
    }
    result->tiles_skipped += last->tiles_skipped;
    result->bound = fmax(result->bound, last->error_bound * most_of_m(asked));
    result->seconds += last->seconds;
    result->passes++;
    return LS_OK;
}

static int take_rows(const struct lightstage_relit *rows, void *user)
{
    struct asked *asked = user;
    asked->err = rows->n_rows ? place_band(asked, rows) : keep_report(asked, rows);
    asked->whole = !rows->n_rows;
    return asked->err != LS_OK;
}

/* ---- asking ---- */

static enum ls_err ask(struct ls_command_context *context, const struct ls_relight_options *options,
                       struct asked *asked, const struct ls_light_weights *weights)
{
    size_t each = (size_t)weights->n_rows * weights->n_lights;
    LS_CLEANUP_FREE float *rows = malloc(each * asked->n * sizeof *rows);
    if (!rows)
        return ls_fail(&context->diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t k = 0; k < asked->n; k++)
        memcpy(rows + each * k, weights[k].rows, each * sizeof *rows);
    const struct lightstage_relight relight = {
        .size = sizeof relight,
        .take = asked->document->id,
        .mode = weights->mode,
        .channels = (const char *const *)weights->names,
        .n_channels = weights->n_names,
        .n_lights = weights->n_lights,
        .weights = rows,
        .n_pictures = asked->n * (asked->by_target ? 3 : 1),
        .region = options->region,
        .promotion = &options->promotion,
        .max_error = options->max_error,
        .camera = options->camera,
        .level = options->level,
    };
    enum ls_err err = ls_command_said(
        context, lightstage_relight(context->stage, &relight, take_rows, asked, &context->error));
    if (asked->err)
        return ls_fail(&context->diag, asked->err, "%s", asked->diag->text);
    return err || asked->whole ? err
                               : ls_fail(&context->diag, LS_ERR_INVALID,
                                         "the daemon ended before the pictures were whole");
}

static int request(struct ls_command_context *context, const struct ls_relight_options *options,
                   const struct ls_light_weights *weights, struct asked *asked)
{
    uint32_t n = asked->n, first = asked->first, half = n / 2;
    asked->rows = 0;
    asked->whole = false;
    enum ls_err err = ask(context, options, asked, weights + first);
    if (!err)
        return LS_EXIT_OK;
    if (n == 1 || err != LS_ERR_REFUSED || context->error.number != LIGHTSTAGE_OVER_LIMIT)
        return ls_command_failed(context, err);
    asked->n = half;
    int code = request(context, options, weights, asked);
    asked->first = first + half;
    asked->n = n - half;
    return code ? code : request(context, options, weights, asked);
}

int ls_relight_request(struct ls_command_context *context, const struct ls_relight_options *options,
                       const struct ls_take_document *document,
                       const struct ls_light_weights *weights, uint32_t n, ls_relight_take *take,
                       void *user, struct ls_relit *result)
{
    struct ls_diag diag = {0};
    struct asked asked = {.document = document,
                          .by_target = weights->by_target,
                          .n = n,
                          .take = take,
                          .user = user,
                          .result = result,
                          .diag = &diag};
    int code = request(context, options, weights, &asked);
    free(asked.band);
    return code;
}

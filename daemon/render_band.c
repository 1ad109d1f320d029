#include "daemon/render_band.h"

#include "core/linear.h"
#include "core/pixel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a band of a picture");
}

static const float *sum_at(const struct ls_render *render, struct ls_render_sum sum)
{
    return ls_relight_rows_get(&render->streams[sum.stream].sums, sum.q);
}

static struct ls_demosaic_region window_of(const struct ls_render *render, struct ls_render_sum sum)
{
    return render->streams[sum.stream].sums.window;
}

/* Value @at of each of a map's pixels in the band, side by side. */
static const float *column(const struct ls_render *render, const struct ls_field_map *map,
                           struct ls_demosaic_region band, uint32_t at, float *room)
{
    size_t width = render->source->width, depth = map->depth;
    const float *from = map->values + ((size_t)band.y * width + band.x) * depth + at;
    float *to = room;
    for (uint32_t y = 0; y < band.height; y++, from += width * depth)
        for (uint32_t x = 0; x < band.width; x++)
            *to++ = from[x * depth];
    return room;
}

/* A map's pixels in the band, its rows in place. */
static const float *rows(const struct ls_render *render, const struct ls_field_map *map,
                         struct ls_demosaic_region band)
{
    return map->values + ((size_t)band.y * render->source->width + band.x) * map->depth;
}

/* The same, without gaps between rows. */
static const float *cut(const struct ls_render *render, const struct ls_field_map *map,
                        struct ls_demosaic_region band, float *room)
{
    const float *from = rows(render, map, band);
    size_t row = (size_t)band.width * map->depth;
    if (band.width == render->source->width)
        return from;
    for (uint32_t y = 0; y < band.height; y++)
        memcpy(room + y * row, from + (size_t)y * render->source->width * map->depth,
               row * sizeof *room);
    return room;
}

/* @from[n][channels] += into the picture; mono into every channel. */
static void add(const struct ls_render *render, const struct ls_render_part *part,
                const float *from, size_t n, float scale, float *picture)
{
    uint32_t channels = render->source->field.n_channels;
    for (size_t j = 0; j < n; j++)
        for (int32_t c = 0; c < 3; c++)
            if (part->target < 0 || part->target == c)
                picture[3 * j + (size_t)c] +=
                    scale * from[j * channels + (channels == 3 ? (size_t)c : 0)];
}

/* ---- what core finishes by itself ---- */

/* A matrix that core applies to white, all channels at once. */
static bool is_plain_matrix(const struct ls_render *render, const struct ls_render_part *part)
{
    return part->way.kind == LS_WAY_MATRIX && part->n_sums == 1 && !part->coloured &&
           part->target < 0 && render->source->field.n_channels == 3;
}

static bool is_direct(const struct ls_render *render, const struct ls_render_part *part)
{
    return part->way.kind == LS_WAY_MATRIX ? is_plain_matrix(render, part)
                                           : part->way.kind != LS_WAY_SEPARATED;
}

/* One of segments' ratios each. */
static size_t fill_blend(const struct ls_render *render, const struct ls_render_part *part,
                         struct ls_demosaic_region band, float **room,
                         struct ls_relight_term *terms)
{
    for (uint32_t g = 0; g < part->n_sums; g++) {
        const struct ls_render_sum sum = {part->sums[0].stream, part->sums[0].q + g};
        terms[g] = (struct ls_relight_term){.sum = sum_at(render, sum),
                                            .ratio = column(render, part->way.map, band, g, *room),
                                            .channel = part->target};
        *room += (size_t)band.width * band.height;
    }
    return part->n_sums;
}

static size_t fill_terms(const struct ls_render *render, const struct ls_render_part *part,
                         struct ls_demosaic_region band, float **room,
                         struct ls_relight_term *terms)
{
    if (part->way.kind == LS_WAY_BLEND)
        return fill_blend(render, part, band, room, terms);
    *terms =
        (struct ls_relight_term){.sum = sum_at(render, part->sums[0]), .channel = part->target};
    if (part->way.kind == LS_WAY_RATIO)
        terms->ratio = rows(render, part->way.map, band);
    else if (part->way.kind == LS_WAY_MATRIX)
        terms->matrix = rows(render, part->way.map, band);
    if (part->way.map)
        terms->map_stride = (size_t)render->source->width * part->way.map->depth;
    return 1;
}

/* How many terms there are, and how many columns of maps they need room for. */
static size_t count_terms(const struct ls_render *render, size_t *columns)
{
    size_t terms = 0;
    *columns = 0;
    for (uint32_t k = 0; k < render->n_parts; k++) {
        const struct ls_render_part *part = &render->parts[k];
        bool blend = part->way.kind == LS_WAY_BLEND;
        terms += blend ? part->n_sums : is_direct(render, part);
        *columns += blend ? part->n_sums : 0;
    }
    return terms;
}

static enum ls_err finish_picture(const struct ls_render *render, struct ls_demosaic_region band,
                                  uint32_t picture, float *room, struct ls_relight_term *terms,
                                  float *out, struct ls_diag *diag)
{
    struct ls_demosaic_region window = {0};
    size_t n = 0;
    for (uint32_t k = 0; k < render->n_parts; k++) {
        const struct ls_render_part *part = &render->parts[k];
        if (part->picture != picture || !is_direct(render, part))
            continue;
        window = window_of(render, part->sums[0]); /* the same of every stream */
        n += fill_terms(render, part, band, &room, terms + n);
    }
    if (n > 0)
        return ls_relight_finish(&render->source->field, window, band, terms, n, NULL, out, diag);
    memset(out, 0, 3 * (size_t)band.width * band.height * sizeof *out);
    return LS_OK;
}

/* Fills all pictures; they lie @stride apart. */
static enum ls_err finish_direct(const struct ls_render *render, struct ls_demosaic_region band,
                                 float *pixels, size_t stride, struct ls_diag *diag)
{
    size_t n = (size_t)band.width * band.height, columns, n_terms = count_terms(render, &columns);
    LS_CLEANUP_FREE struct ls_relight_term *terms = calloc(n_terms + 1, sizeof *terms);
    LS_CLEANUP_FREE float *room = malloc((columns * n + 1) * sizeof *room);
    enum ls_err err = terms && room ? LS_OK : out_of_memory(diag);
    for (uint32_t k = 0; k < render->n_pictures && !err; k++)
        err = finish_picture(render, band, k, room, terms, pixels + stride * k, diag);
    return err;
}

/* ---- matrices of more inputs, or for one channel ---- */

/* v of every pixel: the sums of the inputs, demosaiced, side by side. */
static enum ls_err gather_inputs(const struct ls_render *render, const struct ls_render_part *part,
                                 struct ls_demosaic_region band, float *rgb, float *v)
{
    const struct ls_field *field = &render->source->field;
    uint32_t colours = field->n_channels, n_in = part->n_sums * colours;
    size_t n = (size_t)band.width * band.height;
    for (uint32_t k = 0; k < part->n_sums; k++) {
        uint32_t n_sums = part->coloured ? colours : 1, taken = part->coloured ? 1 : colours;
        float *to = n_in == colours && n_sums == 1 ? v : rgb;
        for (uint32_t c = 0; c < n_sums; c++) {
            const struct ls_render_sum sum = {part->sums[k].stream, part->sums[k].q + c};
            enum ls_err err =
                ls_relight_demosaic(field, sum_at(render, sum), window_of(render, sum), band, to);
            if (err)
                return err;
            for (size_t j = 0; j < n && to == rgb; j++)
                memcpy(v + j * n_in + k * colours + c, rgb + j * colours + c, taken * sizeof *v);
        }
    }
    return LS_OK;
}

static enum ls_err finish_matrix(const struct ls_render *render, const struct ls_render_part *part,
                                 struct ls_demosaic_region band, float *picture,
                                 struct ls_diag *diag)
{
    const struct ls_field *field = &render->source->field;
    uint32_t colours = field->n_channels, n_in = part->n_sums * colours;
    size_t n = (size_t)band.width * band.height;
    LS_CLEANUP_FREE float *v = malloc(n * n_in * sizeof *v);
    LS_CLEANUP_FREE float *rgb = malloc(n * colours * sizeof *rgb);
    LS_CLEANUP_FREE float *room = malloc(n * part->way.map->depth * sizeof *room);
    if (!v || !rgb || !room)
        return out_of_memory(diag);
    enum ls_err err = gather_inputs(render, part, band, rgb, v);
    if (err)
        return ls_fail(diag, err, "rows %u to %u cannot be demosaiced", band.y,
                       band.y + band.height);
    const float *m = cut(render, part->way.map, band, room);
    ls_linear_apply(m, v, n, n_in, colours, rgb);
    add(render, part, rgb, n, (float)field->scale, picture);
    return LS_OK;
}

/* ---- polarised ---- */

struct separated {
    float *diffuse, *specular, *conductor; /* [n_separated][n][n_channels] */
    float *rgb, *ratio;                    /* [n][n_channels] */
};

static enum ls_err accumulate_separated(struct ls_render *render, struct ls_demosaic_region band,
                                        const struct separated *sums, struct ls_diag *diag)
{
    const struct ls_separated_job job = {.field = &render->separation.field,
                                         .n_rows = render->n_separated,
                                         .weights = render->separated,
                                         .region = band,
                                         .method = LS_DEMOSAIC_GRADIENT,
                                         .max_error = render->sum_error};
    struct ls_separated_report report = {0}, *total = &render->separated_report;
    enum ls_err err = ls_separated_accumulate(&job, sums->diffuse, sums->specular, sums->conductor,
                                              &report, diag);
    total->bound = fmax(total->bound, report.bound);
    total->tiles_read += report.tiles_read;
    total->tiles_skipped += report.tiles_skipped;
    return err;
}

static void finish_separated(const struct ls_render *render, const struct ls_render_part *part,
                             struct ls_demosaic_region band, const struct separated *sums,
                             float *picture)
{
    const struct ls_field *field = &render->source->field;
    size_t n = (size_t)band.width * band.height, at = part->sums[0].q * n * field->n_channels;
    double tint[3];
    ls_separation_tint(&render->separation, render->source, part->way.spectrum, tint);
    const float *ratio = cut(render, part->way.map, band, sums->ratio);
    memset(sums->rgb, 0, n * field->n_channels * sizeof *sums->rgb);
    ls_separated_finish(sums->diffuse + at, sums->specular + at, sums->conductor + at, ratio, tint,
                        field->scale, n, field->n_channels, sums->rgb);
    add(render, part, sums->rgb, n, 1, picture);
}

static enum ls_err finish_all_separated(struct ls_render *render, struct ls_demosaic_region band,
                                        float *pixels, struct ls_diag *diag)
{
    size_t n = (size_t)band.width * band.height;
    size_t plane = n * render->source->field.n_channels, all = plane * render->n_separated;
    LS_CLEANUP_FREE float *room = malloc((3 * all + 2 * plane) * sizeof *room);
    if (!room)
        return out_of_memory(diag);
    const struct separated sums = {room, room + all, room + 2 * all, room + 3 * all,
                                   room + 3 * all + plane};
    enum ls_err err = accumulate_separated(render, band, &sums, diag);
    for (uint32_t k = 0; k < render->n_parts && !err; k++) {
        const struct ls_render_part *part = &render->parts[k];
        if (part->way.kind == LS_WAY_SEPARATED)
            finish_separated(render, part, band, &sums, pixels + 3 * n * part->picture);
    }
    return err;
}

/* ---- not demosaiced ---- */

static void finish_mosaic(const struct ls_render *render, struct ls_demosaic_region band,
                          float *picture)
{
    const struct ls_demosaic_region window = window_of(render, render->parts[0].sums[0]);
    enum ls_cfa cfa = render->source->field.cfa;
    float scale = (float)render->source->field.scale;
    for (uint32_t y = 0; y < band.height; y++) {
        size_t from = (size_t)(band.y + y - window.y) * window.width + (band.x - window.x);
        for (uint32_t x = 0; x < band.width; x++, picture += 3) {
            unsigned part = render->n_parts == 1 ? 0 : ls_cfa_channel(cfa, band.x + x, band.y + y);
            const float *sum = sum_at(render, render->parts[part].sums[0]);
            picture[0] = picture[1] = picture[2] = scale * sum[from + x];
        }
    }
}

/* ---- all of it ---- */

/* A band, whose rows its threads share: so many at a time. */
struct band {
    const struct ls_render *render;
    struct ls_demosaic_region region;
    uint32_t rows;
    float *pixels;
    size_t stride; /* from picture to picture */
};

/* What is made of sums over lights, in some rows of every picture. */
static enum ls_err finish_sums(void *data, uint32_t piece, unsigned thread, struct ls_diag *diag)
{
    const struct band *band = data;
    const struct ls_render *render = band->render;
    struct ls_demosaic_region part = band->region;
    uint32_t first = piece * band->rows;
    float *pixels = band->pixels + 3 * (size_t)first * part.width;
    part.y += first;
    part.height = part.height - first < band->rows ? part.height - first : band->rows;
    if (render->mosaic) {
        finish_mosaic(render, part, pixels);
        return LS_OK;
    }
    enum ls_err err = finish_direct(render, part, pixels, band->stride, diag);
    for (uint32_t k = 0; k < render->n_parts && !err; k++) {
        const struct ls_render_part *p = &render->parts[k];
        if (p->way.kind == LS_WAY_MATRIX && !is_plain_matrix(render, p))
            err = finish_matrix(render, p, part, pixels + band->stride * p->picture, diag);
    }
    return err;
}

enum ls_err ls_render_make_band(struct ls_render *render, struct ls_demosaic_region region,
                                float **pixels, struct ls_diag *diag)
{
    enum { PIECE_ROWS = 16 }; /* several of ls_relight_finish's steps, a few pieces for a thread */
    size_t stride = 3 * (size_t)region.width * region.height;
    LS_CLEANUP_FREE float *out = malloc(stride * render->n_pictures * sizeof *out);
    if (!out)
        return out_of_memory(diag);
    struct band band = {render, region, render->crew.n_threads > 1 ? PIECE_ROWS : region.height,
                        out, stride};
    uint32_t n = (region.height + band.rows - 1) / band.rows;
    enum ls_err err = ls_crew_run(&render->crew, n, finish_sums, &band, diag);
    if (!err && render->n_separated > 0)
        err = finish_all_separated(render, region, out, diag);
    if (err)
        return err;
    *pixels = out;
    out = NULL;
    return LS_OK;
}

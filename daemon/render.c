#include "daemon/render.h"

#include "daemon/light_set.h"
#include "daemon/render_band.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool shines(const struct ls_render_term *term, uint32_t n_lights)
{
    for (uint32_t i = 0; i < n_lights; i++)
        if (term->weights[i] != 0)
            return true;
    return false;
}

/* ---- sums ---- */

static struct ls_render_stream *stream_of(struct ls_render *render, const struct ls_light_set *set)
{
    for (uint32_t k = 0; k < render->n_streams; k++)
        if (render->streams[k].set == set)
            return &render->streams[k];
    struct ls_render_stream *stream = &render->streams[render->n_streams++];
    stream->set = set;
    return stream;
}

/* One more sum of @set under w (times phi of a segment, [n_lights] of @stride), right in @colour
 * or, -1, in all; its place. */
static enum ls_err add_sum(struct ls_render *render, const struct ls_light_set *set,
                           const double *w, const double *phi, uint32_t stride, int32_t colour,
                           struct ls_render_sum *out, struct ls_diag *diag)
{
    struct ls_render_stream *stream = stream_of(render, set);
    uint32_t n = render->source->field.n_lights;
    *out = (struct ls_render_sum){(uint32_t)(stream - render->streams), stream->n};
    if (stream->n == LS_ACCUMULATE_MAX_SUMS)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "this light needs more than %d sums over the field at once; ask for fewer "
                       "pictures at once, fewer channels, or weights shared by R, G and B",
                       LS_ACCUMULATE_MAX_SUMS);
    float *grown =
        realloc(stream->weights, (size_t)(stream->n + 1) * set->n_pictures * sizeof *grown);
    if (!grown)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the weights of %u lights", n);
    stream->weights = grown;
    float *row = grown + (size_t)stream->n++ * set->n_pictures;
    LS_CLEANUP_FREE double *blended = malloc(n * sizeof *blended);
    if (!blended)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the weights of %u lights", n);
    for (uint32_t i = 0; i < n; i++)
        blended[i] = w[i] * (phi ? phi[(size_t)i * stride] : 1);
    return ls_light_set_row(set, blended, n, colour, row, diag);
}

static const struct ls_light_set *input_of(const struct ls_field_source *source,
                                           const struct ls_field_map *map, uint32_t k)
{
    uint32_t s = map->inputs[k];
    return s ? &source->set[source->channel_of[s]] : &source->white;
}

static enum ls_err add_inputs(struct ls_render *render, struct ls_render_part *part,
                              const double *w, struct ls_diag *diag)
{
    const struct ls_field_source *source = render->source;
    const struct ls_field_map *map = part->way.map;
    struct ls_render_sum next;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < map->n_inputs; k++)
        part->coloured |= ls_light_set_is_coloured(input_of(source, map, k));
    for (uint32_t k = 0; k < map->n_inputs && !err; k++) {
        const struct ls_light_set *set = input_of(source, map, k);
        err = add_sum(render, set, w, NULL, 0, part->coloured ? 0 : -1, &part->sums[k], diag);
        for (int32_t c = 1; c < 3 && part->coloured && !err; c++)
            err = add_sum(render, set, w, NULL, 0, c, &next, diag);
    }
    part->n_sums = map->n_inputs;
    return err;
}

static enum ls_err add_segments(struct ls_render *render, struct ls_render_part *part,
                                const double *w, struct ls_diag *diag)
{
    const struct ls_field_map *map = part->way.map;
    struct ls_render_sum sum;
    enum ls_err err = LS_OK;
    for (uint32_t g = 0; g < map->n_segments && !err; g++) {
        err = add_sum(render, part->way.set, w, map->phi + g, map->n_segments, -1, &sum, diag);
        if (g == 0)
            part->sums[0] = sum; /* the others follow it */
    }
    part->n_sums = map->n_segments;
    return err;
}

static enum ls_err add_separated(struct ls_render *render, struct ls_render_part *part,
                                 const double *w, const struct ls_promotion *promotion,
                                 struct ls_diag *diag)
{
    uint32_t n = render->source->field.n_lights;
    float *grown =
        realloc(render->separated, (size_t)(render->n_separated + 1) * n * sizeof *grown);
    if (!grown)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the weights of %u lights", n);
    render->separated = grown;
    part->sums[0].q = render->n_separated;
    for (uint32_t i = 0; i < n; i++)
        grown[(size_t)render->n_separated * n + i] = (float)w[i];
    if (render->n_separated++ > 0)
        return LS_OK;
    return ls_separation_init(&render->separation, render->source, promotion->ideal_polarisation,
                              promotion->plain_conductors, diag);
}

static enum ls_err add_part(struct ls_render *render, const struct ls_render_term *term,
                            const struct ls_render_job *job, struct ls_diag *diag);

/* For each colour of the camera. */
static enum ls_err add_three(struct ls_render *render, struct ls_render_term term,
                             const struct ls_render_job *job, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (term.target = 0; term.target < 3 && !err; term.target++)
        err = add_part(render, &term, job, diag);
    return err;
}

static enum ls_err add_part(struct ls_render *render, const struct ls_render_term *term,
                            const struct ls_render_job *job, struct ls_diag *diag)
{
    const struct ls_promotion *promotion = &job->promotion;
    struct ls_render_part *part = &render->parts[render->n_parts];
    if (render->n_parts == 3 * LS_RENDER_MAX_TERMS)
        return ls_fail(diag, LS_ERR_LIMIT, "more than %d terms", LS_RENDER_MAX_TERMS);
    *part = (struct ls_render_part){.target = term->target, .picture = term->picture, .n_sums = 1};
    enum ls_err err =
        ls_promotion_find(render->source, promotion, term->channel, job->asker, &part->way, diag);
    if (err)
        return err;
    bool direct = part->way.kind == LS_WAY_PHOTOGRAPHED || part->way.kind == LS_WAY_RATIO;
    if (direct && term->target < 0 && !job->k_alone && ls_light_set_is_coloured(part->way.set))
        return add_three(render, *term, job, diag);
    render->n_parts++;
    switch (part->way.kind) {
    case LS_WAY_MATRIX:
        return add_inputs(render, part, term->weights, diag);
    case LS_WAY_BLEND:
        return add_segments(render, part, term->weights, diag);
    case LS_WAY_SEPARATED:
        return add_separated(render, part, term->weights, promotion, diag);
    case LS_WAY_PHOTOGRAPHED:
    case LS_WAY_RATIO:
        break;
    }
    return add_sum(render, part->way.set, term->weights, NULL, 0, job->k_alone ? -1 : part->target,
                   &part->sums[0], diag);
}

/* ---- which lights ---- */

static bool weighs(const struct ls_render_stream *stream, uint32_t picture)
{
    for (uint32_t q = 0; q < stream->n; q++)
        if (stream->weights[(size_t)q * stream->set->n_pictures + picture] != 0)
            return true;
    return false;
}

static enum ls_err check_stream(const struct ls_render *render,
                                const struct ls_render_stream *stream, struct ls_diag *diag)
{
    const struct ls_field_source *source = render->source;
    uint32_t missing = 0, first = 0;
    for (uint32_t j = 0; j < stream->set->n_pictures; j++)
        if (stream->set->pictures[j].tiles == source->no_tiles && weighs(stream, j) &&
            missing++ == 0)
            first = j % source->field.n_lights; /* multiplexed sets have all they need */
    if (missing > 0)
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s lacks the pictures of %u lights that this light needs (light %u is "
                       "the first); resume the take",
                       source->take, missing, first);
    return LS_OK;
}

static uint32_t count_lights(const struct ls_render_job *job, uint32_t n_lights)
{
    uint32_t used = 0;
    for (uint32_t i = 0; i < n_lights; i++) {
        bool any = false;
        for (uint32_t t = 0; t < job->n_terms; t++)
            any |= job->terms[t].weights[i] != 0;
        used += any;
    }
    return used;
}

/*
 * What an error of one sum can become in a picture, before promotion: the gradient filter's
 * coefficients add to 20/8 in magnitude (core/demosaic.c), and several sums meet in one channel.
 */
static double amplification(const struct ls_render *render)
{
    double filter = render->source->field.n_channels > 1 ? 2.5 : 1, most = 0;
    for (uint32_t picture = 0; picture < render->n_pictures; picture++)
        for (int32_t c = 0; c < 3; c++) {
            double sums = 0;
            for (uint32_t k = 0; k < render->n_parts; k++) {
                const struct ls_render_part *part = &render->parts[k];
                if (part->picture == picture && (part->target < 0 || part->target == c))
                    sums += part->n_sums;
            }
            most = fmax(most, sums);
        }
    return filter * fmax(most, 1);
}

/* What a band of all pictures holds in memory: sums over rows of tiles and the rows kept beside
 * them, what is made of polarised pictures, and the pictures. One picture gets what it needs. A
 * quarter more is at work beside them: 256 MiB are the whole. */
static enum ls_err check_room(struct ls_render *render, struct ls_diag *diag)
{
    static const double most = 200 << 20;
    uint32_t n = 3 * render->n_pictures;
    double rows = LS_TILE_SIDE + 2 * LS_DEMOSAIC_HALO;
    for (uint32_t k = 0; k < render->n_streams; k++)
        n += render->streams[k].n;
    n += 3 * render->source->field.n_channels * render->n_separated;
    double need = rows * render->region.width * n * sizeof(float);
    render->tile_rows = ls_relight_tile_rows(render->region.width, n);
    if (render->n_pictures > 1 && need > most)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "%u pictures at once need %.0f MiB for a band, at most %.0f MiB are given; "
                       "ask for fewer at once",
                       render->n_pictures, need / (1 << 20), most / (1 << 20));
    return LS_OK;
}

/* ---- life ---- */

static void start_streams(struct ls_render *render, double max_error)
{
    const struct ls_field *field = &render->source->field;
    render->error_scale = field->scale * amplification(render);
    render->sum_error = max_error / render->error_scale;
    for (uint32_t k = 0; k < render->n_streams; k++) {
        struct ls_render_stream *stream = &render->streams[k];
        struct ls_accumulate_job job = {.pictures = stream->set->pictures,
                                        .n_pictures = stream->set->n_pictures,
                                        .n_sums = stream->n,
                                        .weights = stream->weights,
                                        .tile_max = stream->set->tile_max};
        if (max_error > 0)
            job.max_error = render->sum_error;
        ls_relight_rows_init(&stream->sums, field, &job, &render->region, LS_DEMOSAIC_HALO);
    }
}

enum ls_err ls_render_open(struct ls_field_source *source, const struct ls_render_job *job,
                           struct ls_render **out, struct ls_diag *diag)
{
    struct ls_render *render = calloc(1, sizeof *render);
    enum ls_err err = LS_OK;
    if (!render)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
    render->source = source;
    render->promotion = job->promotion;
    render->region = job->region;
    render->mosaic = job->mosaic;
    render->crew.n_threads = job->n_threads;
    render->n_pictures = job->n_pictures;
    render->next_y = job->region.y;
    render->lights_used = count_lights(job, source->field.n_lights);
    for (uint32_t t = 0; t < job->n_terms && !err; t++) {
        if (job->asker && ls_job_cancelled(job->asker))
            err = ls_fail(diag, LS_ERR_ABORTED, "cancelled");
        else if (shines(&job->terms[t], source->field.n_lights))
            err = add_part(render, &job->terms[t], job, diag);
    }
    for (uint32_t k = 0; k < render->n_streams && !err; k++)
        err = check_stream(render, &render->streams[k], diag);
    if (!err && job->mosaic &&
        (render->n_parts == 0 || render->parts[0].way.kind != LS_WAY_PHOTOGRAPHED))
        err = ls_fail(diag, LS_ERR_UNSUPPORTED, "what is promoted has no mosaic");
    if (!err)
        err = check_room(render, diag);
    if (err) {
        ls_render_close(render);
        return err;
    }
    start_streams(render, job->max_error);
    *out = render;
    return LS_OK;
}

enum ls_err ls_render_step(struct ls_render *render, struct ls_demosaic_region *band,
                           float **pixels, bool *done, struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &render->region;
    uint32_t height = render->source->height, y = render->next_y;
    uint32_t halo =
        render->n_separated > 0 ? 0 : LS_DEMOSAIC_HALO; /* whole tiles: core/separated.h */
    uint32_t end = ls_relight_band_end(&render->source->field, r, y, halo, render->tile_rows);
    enum ls_err err = LS_OK;
    *pixels = NULL;
    uint32_t top = y > LS_DEMOSAIC_HALO ? y - LS_DEMOSAIC_HALO : 0;
    uint32_t below = height - end > LS_DEMOSAIC_HALO ? end + LS_DEMOSAIC_HALO : height;
    for (uint32_t k = 0; k < render->n_streams && !err; k++)
        err = ls_row_sums_need(&render->streams[k].sums, &render->crew, top, below, diag);
    if (err)
        return err;
    *band = (struct ls_demosaic_region){r->x, y, r->width, end - y};
    render->next_y = end;
    *done = end == r->y + r->height;
    return ls_render_make_band(render, *band, pixels, diag);
}

static void report_spectra(const struct ls_render *render, struct ls_render_report *out)
{
    for (uint32_t k = 0; k < render->n_parts; k++) {
        bool known = false;
        for (uint32_t j = 0; j < k; j++)
            known |= render->parts[j].way.channel == render->parts[k].way.channel;
        if (!known)
            ls_promotion_report(render->source, &render->promotion, &render->parts[k].way,
                                &out->spectra[out->n_spectra++]);
    }
}

void ls_render_report(const struct ls_render *render, struct ls_render_report *out)
{
    *out = (struct ls_render_report){.lights_used = render->lights_used,
                                     .tiles_skipped = render->separated_report.tiles_skipped,
                                     .error_bound =
                                         render->separated_report.bound * render->error_scale};
    for (uint32_t k = 0; k < render->n_streams; k++) {
        const struct ls_accumulate_report *report = &render->streams[k].sums.report;
        out->tiles_skipped += report->tiles_skipped;
        out->error_bound = fmax(out->error_bound, report->bound * render->error_scale);
    }
    report_spectra(render, out);
}

void ls_render_close(struct ls_render *render)
{
    if (!render)
        return;
    for (uint32_t k = 0; k < render->n_streams; k++) {
        ls_relight_rows_finish(&render->streams[k].sums);
        free(render->streams[k].weights);
    }
    ls_separation_finish(&render->separation);
    free(render->separated);
    free(render);
}

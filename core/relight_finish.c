#include "core/relight.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

void ls_relight_row(const double *k, const double *w, uint32_t n, float *row)
{
    for (uint32_t i = 0; i < n; i++)
        row[i] = (float)((w ? w[i] : 1) * k[i]);
}

void ls_relight_tristimulus(const struct ls_field *field, uint32_t c, double *w)
{
    for (uint32_t i = 0; i < field->n_lights; i++)
        w[i] /= field->p[field->n_channels == 1 ? 0 : c];
}

static struct ls_demosaic_source source_of(const struct ls_field *field, const float *sum,
                                           struct ls_demosaic_region window)
{
    return (struct ls_demosaic_source){.data = sum,
                                       .stride = window.width,
                                       .window = window,
                                       .image_width = field->width,
                                       .image_height = field->height,
                                       .cfa = field->cfa};
}

enum ls_err ls_relight_demosaic(const struct ls_field *field, const float *sum,
                                struct ls_demosaic_region window, struct ls_demosaic_region region,
                                float *out)
{
    if (field->n_channels == 1) {
        if (region.x < window.x || region.y < window.y ||
            region.x - window.x + (uint64_t)region.width > window.width ||
            region.y - window.y + (uint64_t)region.height > window.height)
            return LS_ERR_INVALID;
        for (uint32_t y = 0; y < region.height; y++)
            memcpy(out + (size_t)y * region.width,
                   sum + (size_t)(region.y - window.y + y) * window.width + (region.x - window.x),
                   sizeof *out * region.width);
        return LS_OK;
    }
    struct ls_demosaic_source source = source_of(field, sum, window);
    struct ls_demosaic_target target = {
        .plane = {out, out + 1, out + 2}, .pixel_step = 3, .row_step = 3 * (size_t)region.width};
    return ls_demosaic(&source, region, field->demosaic, &target);
}

static void add_matrix(const float *restrict v, const float *restrict m, float scale, size_t n,
                       float *restrict out)
{
    for (size_t j = 0; j < n; j++, v += 3, m += 9, out += 3) {
        float r = scale * v[0], g = scale * v[1], b = scale * v[2];
        for (int c = 0; c < 3; c++)
            out[c] += m[3 * c] * r + m[3 * c + 1] * g + m[3 * c + 2] * b;
    }
}

/* one channel of the output, of the same channel (Bayer) or the only one (mono) */
static void add_channel(const float *v, const float *ratio, uint32_t channels, int c, float scale,
                        size_t n, float *out)
{
    size_t from = channels == 3 ? (size_t)c : 0;
    for (size_t j = 0; j < n; j++, from += channels) {
        float scaled = scale * v[from];
        out[3 * j + (size_t)c] += ratio ? scaled * ratio[from] : scaled;
    }
}

/* All colours at once, by the demosaic itself; @y: the band's first row in the region. */
static enum ls_err add_colours(const struct ls_field *field, const struct ls_relight_term *term,
                               struct ls_demosaic_region window, struct ls_demosaic_region band,
                               size_t y, float *out)
{
    struct ls_demosaic_source source = source_of(field, term->sum, window);
    size_t row = 3 * (size_t)band.width, map_row = term->map_stride ? term->map_stride : row;
    struct ls_demosaic_target target = {.plane = {out, out + 1, out + 2},
                                        .pixel_step = 3,
                                        .row_step = row,
                                        .add = true,
                                        .scale = (float)field->scale,
                                        .ratio = term->ratio ? term->ratio + y * map_row : NULL,
                                        .ratio_step = map_row};
    return ls_demosaic(&source, band, field->demosaic, &target);
}

/* Row @y of the region. */
static void add_term(const struct ls_field *field, const struct ls_relight_term *term,
                     const float *v, size_t y, size_t n, float *out)
{
    uint32_t channels = field->n_channels;
    float scale = (float)field->scale;
    size_t depth = term->matrix ? 9 : channels;
    size_t at = y * (term->map_stride ? term->map_stride : n * depth);
    const float *ratio = term->ratio ? term->ratio + at : NULL;
    if (term->matrix)
        add_matrix(v, term->matrix + at, scale, n, out);
    else
        for (int c = 0; c < 3; c++)
            if (term->channel < 0 || term->channel == c)
                add_channel(v, ratio, channels, c, scale, n, out);
}

static void apply_matrix(const double *m, size_t n, float *out)
{
    for (size_t j = 0; j < n; j++, out += 3) {
        double r = (double)out[0], g = (double)out[1], b = (double)out[2];
        for (int c = 0; c < 3; c++)
            out[c] = (float)(m[3 * c] * r + m[3 * c + 1] * g + m[3 * c + 2] * b);
    }
}

static enum ls_err check_terms(const struct ls_field *field, const struct ls_relight_term *terms,
                               size_t n_terms, struct ls_diag *diag)
{
    for (size_t t = 0; t < n_terms; t++) {
        if (terms[t].channel < -1 || terms[t].channel > 2)
            return ls_fail(diag, LS_ERR_INVALID, "relight: term %zu: channel %d: expected -1..2", t,
                           terms[t].channel);
        if (terms[t].matrix && (terms[t].ratio || terms[t].channel != -1 || field->n_channels != 3))
            return ls_fail(diag, LS_ERR_INVALID,
                           "relight: term %zu: a matrix stands alone, for all channels of an RGB "
                           "camera",
                           t);
    }
    return LS_OK;
}

/* rows demosaiced at a time: few enough for the second cache, enough to share their neighbours */
enum { ROWS = 8 };

enum ls_err ls_relight_finish(const struct ls_field *field, struct ls_demosaic_region window,
                              struct ls_demosaic_region region, const struct ls_relight_term *terms,
                              size_t n_terms, const double *m, float *out, struct ls_diag *diag)
{
    size_t n = region.width, row = n * field->n_channels;
    LS_CLEANUP_FREE float *v = malloc((ROWS * row + 1) * sizeof *v);
    if (!v)
        return ls_fail(diag, LS_ERR_NOMEM, "relight: out of memory");
    enum ls_err err = check_terms(field, terms, n_terms, diag);
    memset(out, 0, sizeof *out * 3 * n * region.height);
    for (uint32_t y = 0; y < region.height && !err; y += ROWS) {
        uint32_t rows = region.height - y < ROWS ? region.height - y : ROWS;
        struct ls_demosaic_region band = {region.x, region.y + y, region.width, rows};
        for (size_t t = 0; t < n_terms && !err; t++) {
            bool at_once =
                field->n_channels == 3 && terms[t].channel < 0 && terms[t].matrix == NULL;
            float *to = out + 3 * n * y;
            err = at_once ? add_colours(field, &terms[t], window, band, y, to)
                          : ls_relight_demosaic(field, terms[t].sum, window, band, v);
            if (err)
                return ls_fail(diag, err,
                               "relight: [%u + %u) x [%u + %u) px is not inside what was summed",
                               region.x, region.width, region.y, region.height);
            for (uint32_t k = 0; k < rows && !at_once; k++)
                add_term(field, &terms[t], v + k * row, y + k, n, to + 3 * n * k);
        }
        if (m)
            apply_matrix(m, n * rows, out + 3 * n * y);
    }
    return err;
}

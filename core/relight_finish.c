#include "core/relight.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

void ls_relight_row(const struct ls_field *field, const double *w, size_t stride, float *row)
{
    for (uint32_t i = 0; i < field->n_lights; i++)
        row[i] = (float)(w[i * stride] * field->k[i]);
}

void ls_relight_tristimulus_row(const struct ls_field *field, const double *w, size_t stride,
                                uint32_t c, float *row)
{
    for (uint32_t i = 0; i < field->n_lights; i++)
        row[i] = (float)(w[i * stride] * field->k[i] / field->p[c]);
}

enum ls_err ls_relight_demosaic(const struct ls_field *field, const float *sum,
                                struct ls_demosaic_region window, struct ls_demosaic_region region,
                                float *out)
{
    struct ls_demosaic_source source = {.data = sum,
                                        .stride = window.width,
                                        .window = window,
                                        .image_width = field->width,
                                        .image_height = field->height,
                                        .cfa = field->cfa};
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
    struct ls_demosaic_target target = {
        .plane = {out, out + 1, out + 2}, .pixel_step = 3, .row_step = 3 * (size_t)region.width};
    return ls_demosaic(&source, region, LS_DEMOSAIC_GRADIENT, &target);
}

static void add_term(const struct ls_field *field, const struct ls_relight_term *term,
                     const float *rgb, size_t n, float *out)
{
    uint32_t channels = field->n_channels;
    float scale = (float)field->scale;
    for (size_t j = 0; j < n; j++) {
        for (int c = 0; c < 3; c++) {
            if (term->channel >= 0 && term->channel != c)
                continue;
            size_t from = j * channels + (channels == 3 ? (size_t)c : 0);
            float v = scale * rgb[from];
            out[3 * j + (size_t)c] += term->ratio ? v * term->ratio[from] : v;
        }
    }
}

static void apply_matrix(const double *m, size_t n, float *out)
{
    for (size_t j = 0; j < n; j++, out += 3) {
        double r = (double)out[0], g = (double)out[1], b = (double)out[2];
        for (int c = 0; c < 3; c++)
            out[c] = (float)(m[3 * c] * r + m[3 * c + 1] * g + m[3 * c + 2] * b);
    }
}

enum ls_err ls_relight_finish(const struct ls_field *field, struct ls_demosaic_region window,
                              struct ls_demosaic_region region, const struct ls_relight_term *terms,
                              size_t n_terms, const double *m, float *out, struct ls_diag *diag)
{
    size_t n = (size_t)region.width * region.height;
    LS_CLEANUP_FREE float *rgb = calloc(n * field->n_channels + 1, sizeof *rgb);
    if (!rgb)
        return ls_fail(diag, LS_ERR_NOMEM, "relight: out of memory");
    memset(out, 0, sizeof *out * 3 * n);
    for (size_t t = 0; t < n_terms; t++) {
        if (terms[t].channel < -1 || terms[t].channel > 2)
            return ls_fail(diag, LS_ERR_INVALID, "relight: term %zu: channel %d: expected -1..2", t,
                           terms[t].channel);
        enum ls_err err = ls_relight_demosaic(field, terms[t].sum, window, region, rgb);
        if (err)
            return ls_fail(diag, err,
                           "relight: [%u + %u) x [%u + %u) px is not inside what was summed",
                           region.x, region.width, region.y, region.height);
        add_term(field, &terms[t], rgb, n, out);
    }
    if (m)
        apply_matrix(m, n, out);
    return LS_OK;
}

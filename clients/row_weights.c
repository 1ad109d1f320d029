#include "clients/row_weights.h"

#include "clients/command.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_BYTES = 1 << 20, MAX_PATCHES = 4096, MAX_CHANNELS = 3 };

static enum ls_err wrong(const char *path, struct ls_diag *diag)
{
    return ls_fail(
        diag, LS_ERR_INVALID,
        "%.200s: expected [a number per patch] or [[one per channel] per patch], numbers of "
        "0 or more and not all 0",
        path);
}

static double value_at(const json_t *root, size_t patch, size_t channel, size_t n_channels)
{
    const json_t *item = json_array_get(root, patch);
    if (json_is_array(item) && json_array_size(item) != n_channels)
        return NAN;
    item = json_is_array(item) ? json_array_get(item, channel) : n_channels == 1 ? item : NULL;
    return json_is_number(item) ? json_number_value(item) : NAN;
}

static enum ls_err read_json(const char *path, const json_t *root, struct ls_row_weights *out,
                             struct ls_diag *diag)
{
    const json_t *first = json_array_get(root, 0);
    double sum = 0;
    out->n_patches = json_array_size(root);
    out->n_channels = json_is_array(first) ? json_array_size(first) : 1;
    if (out->n_patches < 1 || out->n_patches > MAX_PATCHES || out->n_channels < 1 ||
        out->n_channels > MAX_CHANNELS)
        return wrong(path, diag);
    size_t n = out->n_patches * out->n_channels;
    out->values = calloc(n, sizeof *out->values);
    if (!out->values)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < n; i++) {
        double w = value_at(root, i / out->n_channels, i % out->n_channels, out->n_channels);
        if (!(w >= 0) || !isfinite(w))
            return wrong(path, diag);
        out->values[i] = w;
        sum += w;
    }
    return sum > 0 ? LS_OK : wrong(path, diag);
}

enum ls_err ls_row_weights_read(const char *path, struct ls_row_weights *out, struct ls_diag *diag)
{
    json_t *root = NULL;
    enum ls_err err = ls_command_read_json(path, MAX_BYTES, &root, diag);
    if (err)
        return err;
    err = read_json(path, root, out, diag);
    json_decref(root);
    if (err)
        ls_row_weights_finish(out);
    return err;
}

enum ls_err ls_row_weights_for(const struct ls_row_weights *weights, size_t n_patches,
                               size_t n_channels, double **rows, struct ls_diag *diag)
{
    *rows = NULL;
    if (weights->n_patches == 0)
        return LS_OK;
    if (weights->n_patches != n_patches ||
        (weights->n_channels != 1 && weights->n_channels != n_channels))
        return ls_fail(
            diag, LS_ERR_INVALID,
            "--row-weights: %zu patches x %zu, expected the calibration's %zu patches, with "
            "one number or %zu each",
            weights->n_patches, weights->n_channels, n_patches, n_channels);
    *rows = calloc(n_patches * n_channels, sizeof **rows);
    if (!*rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < n_patches * n_channels; i++)
        (*rows)[i] = weights->values[weights->n_channels == 1 ? i / n_channels : i];
    return LS_OK;
}

void ls_row_weights_finish(struct ls_row_weights *weights)
{
    free(weights->values);
    memset(weights, 0, sizeof *weights);
}

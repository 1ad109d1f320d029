#include "clients/weights_file.h"

#include "clients/command.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const size_t max_bytes = (size_t)64 << 20;

static int channel_of(const struct ls_take_document *document, const char *name)
{
    for (uint32_t c = 0; c < document->n_channels; c++)
        if (strcmp(document->channels[c].name, name) == 0)
            return (int)c;
    return -1;
}

static enum ls_err read_row(const char *path, const char *name, const json_t *list,
                            struct ls_light_weights *out, struct ls_diag *diag)
{
    float *row = out->rows + (size_t)out->n_rows * out->n_lights;
    if (!json_is_array(list) || json_array_size(list) != out->n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "%.200s: %.40s: expected an array of %u weights", path,
                       name, out->n_lights);
    for (uint32_t i = 0; i < out->n_lights; i++) {
        const json_t *item = json_array_get(list, i);
        row[i] = (float)json_number_value(item);
        if (!json_is_number(item) || !isfinite(row[i]))
            return ls_fail(diag, LS_ERR_INVALID, "%.200s: %.40s: light %u: expected a number", path,
                           name, i);
    }
    out->n_rows++;
    return LS_OK;
}

static enum ls_err read_rows(const char *path, const struct ls_take_document *document,
                             json_t *root, struct ls_light_weights *out, struct ls_diag *diag)
{
    const char *name;
    json_t *list;
    json_object_foreach(root, name, list)
    {
        int c = channel_of(document, name);
        if (c < 0)
            return ls_fail(diag, LS_ERR_INVALID, "%.200s: the take's rig has no channel \"%.40s\"",
                           path, name);
        out->names[out->n_names++] = (char *)document->channels[c].name;
        enum ls_err err = read_row(path, name, list, out, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

static enum ls_err read_json(const char *path, const struct ls_take_document *document,
                             json_t *root, struct ls_light_weights *out, struct ls_diag *diag)
{
    size_t n = json_object_size(root);
    if (n < 1 || n > LS_DOCUMENT_CHANNELS)
        return ls_fail(diag, LS_ERR_INVALID,
                       "%.200s: expected weights as {\"channel\": [one per light], ...}", path);
    out->mode = LIGHTSTAGE_SHARED;
    out->n_lights = document->n_lights;
    out->rows = calloc(n * document->n_lights, sizeof(float));
    return out->rows ? read_rows(path, document, root, out, diag)
                     : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

enum ls_err ls_weights_file_read(const char *path, const struct ls_take_document *document,
                                 struct ls_light_weights *out, struct ls_diag *diag)
{
    json_t *root = NULL;
    memset(out, 0, sizeof *out);
    enum ls_err err = ls_command_read_json(path, max_bytes, &root, diag);
    if (err)
        return err;
    err = read_json(path, document, root, out, diag);
    json_decref(root);
    if (err)
        ls_light_weights_finish(out);
    return err;
}

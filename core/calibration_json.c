#include "core/calibration_json.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *kind_of(const json_t *value)
{
    static const char *const names[] = {"an object", "an array", "a string", "an integer",
                                        "a number",  "true",     "false",    "null"};
    return value ? names[json_typeof(value)] : "nothing";
}

enum ls_err ls_json_wrong(struct ls_diag *diag, const char *path, const char *expected,
                          const json_t *found)
{
    return ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected %s, found %s", path, expected,
                   kind_of(found));
}

const char *ls_json_child(char buffer[160], const char *path, const char *key)
{
    snprintf(buffer, 160, "%.100s%s%.40s", path, *path ? "." : "", key);
    return buffer;
}

const char *ls_json_element(char buffer[160], const char *path, size_t index)
{
    snprintf(buffer, 160, "%.120s[%zu]", path, index);
    return buffer;
}

enum ls_err ls_json_number(const json_t *value, const char *path, double low, double high,
                           double *out, struct ls_diag *diag)
{
    if (!json_is_number(value))
        return ls_json_wrong(diag, path, "a number", value);
    *out = json_number_value(value);
    if (!(*out >= low && *out <= high))
        return ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected %g to %g, found %g", path,
                       low, high, *out);
    return LS_OK;
}

enum ls_err ls_json_member(const json_t *object, const char *path, const char *key, double low,
                           double high, double *out, struct ls_diag *diag)
{
    char at[160];
    return ls_json_number(json_object_get(object, key), ls_json_child(at, path, key), low, high,
                          out, diag);
}

enum ls_err ls_json_string(const json_t *value, const char *path, size_t size, char *out,
                           struct ls_diag *diag)
{
    if (!json_is_string(value))
        return ls_json_wrong(diag, path, "a string", value);
    size_t n = json_string_length(value);
    if (n < 1 || n >= size || strlen(json_string_value(value)) != n)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected 1 to %zu characters", path,
                       size - 1);
    memcpy(out, json_string_value(value), n + 1);
    return LS_OK;
}

enum ls_err ls_json_array(const json_t *value, const char *path, size_t n, struct ls_diag *diag)
{
    if (!json_is_array(value))
        return ls_json_wrong(diag, path, "an array", value);
    if (json_array_size(value) != n)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected %zu elements, found %zu",
                       path, n, json_array_size(value));
    return LS_OK;
}

enum ls_err ls_json_bounded(const json_t *value, const char *path, size_t most,
                            struct ls_diag *diag)
{
    if (!json_is_array(value))
        return ls_json_wrong(diag, path, "an array", value);
    if (json_array_size(value) > most)
        return ls_fail(diag, LS_ERR_LIMIT, "calibration: %s: at most %zu elements, found %zu", path,
                       most, json_array_size(value));
    return LS_OK;
}

enum ls_err ls_json_floats(const json_t *value, const char *path, size_t n, double low, double high,
                           float *out, struct ls_diag *diag)
{
    char at[160];
    enum ls_err err = ls_json_array(value, path, n, diag);
    for (size_t i = 0; i < n && !err; i++) {
        double x = 0;
        err = ls_json_number(json_array_get(value, i), ls_json_element(at, path, i), low, high, &x,
                             diag);
        out[i] = (float)x;
    }
    return err;
}

enum ls_err ls_json_vectors(const json_t *value, const char *path, uint32_t n, float (*out)[3],
                            struct ls_diag *diag)
{
    char at[160];
    enum ls_err err = ls_json_array(value, path, n, diag);
    for (uint32_t i = 0; i < n && !err; i++)
        err = ls_json_floats(json_array_get(value, i), ls_json_element(at, path, i), 3, -1e3, 1e3,
                             out[i], diag);
    return err;
}

enum ls_err ls_json_directions(const json_t *value, const char *path, uint32_t n, float (*out)[3],
                               struct ls_diag *diag)
{
    enum ls_err err = ls_json_vectors(value, path, n, out, diag);
    for (uint32_t i = 0; i < n && !err; i++) {
        double length = 0;
        for (int k = 0; k < 3; k++)
            length += (double)out[i][k] * out[i][k];
        if (fabs(length - 1) > 1e-3)
            err = ls_fail(diag, LS_ERR_INVALID, "calibration: %s[%u]: expected a unit vector", path,
                          i);
    }
    return err;
}

void ls_json_append(json_t **to, json_t *value)
{
    if (json_array_append_new(*to, value)) {
        json_decref(*to);
        *to = NULL;
    }
}

void ls_json_set(json_t **to, const char *key, json_t *value)
{
    if (json_object_set_new(*to, key, value)) {
        json_decref(*to);
        *to = NULL;
    }
}

json_t *ls_json_of_floats(const float *v, size_t n)
{
    json_t *list = json_array();
    for (size_t i = 0; i < n && list; i++)
        ls_json_append(&list, json_real((double)v[i]));
    return list;
}

json_t *ls_json_of_rows(const float *v, size_t n_rows, size_t n)
{
    json_t *list = json_array();
    for (size_t r = 0; r < n_rows && list; r++)
        ls_json_append(&list, ls_json_of_floats(v + r * n, n));
    return list;
}

#include "core/json_document.h"

#include <math.h>
#include <stdbool.h>

enum ls_err ls_json_document(const char *what, const char *text, size_t bytes, size_t most,
                             json_t **root, struct ls_diag *diag)
{
    json_error_t where;
    *root = NULL;
    if (bytes > most)
        return ls_fail(diag, LS_ERR_LIMIT, "%s: %zu bytes: expected at most %zu", what, bytes,
                       most);
    json_t *json = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, &where);
    if (!json)
        return ls_fail(diag, LS_ERR_INVALID, "%s: line %d, column %d: %s", what, where.line,
                       where.column, where.text);
    const json_t *format = json_object_get(json, "format");
    enum ls_err err = LS_OK;
    if (!json_is_integer(format))
        err = ls_fail(diag, LS_ERR_INVALID, "%s: expected an object with \"format\": 1", what);
    else if (json_integer_value(format) != 1)
        err = ls_fail(diag, LS_ERR_UNSUPPORTED, "%s: format %lld: expected 1", what,
                      (long long)json_integer_value(format));
    if (err)
        json_decref(json);
    else
        *root = json;
    return err;
}

enum ls_err ls_json_numbers(const char *what, const json_t *object, const char *key, size_t n,
                            double *out, struct ls_diag *diag)
{
    const json_t *array = json_object_get(object, key);
    bool good = json_array_size(array) == n;
    for (size_t k = 0; good && k < n; k++) {
        const json_t *item = json_array_get(array, k);
        out[k] = json_number_value(item);
        good = json_is_number(item) && isfinite(out[k]);
    }
    return good ? LS_OK
                : ls_fail(diag, LS_ERR_INVALID, "%s: \"%s\": expected %zu numbers", what, key, n);
}

enum ls_err ls_json_unit(const char *what, const json_t *object, const char *key, double out[3],
                         struct ls_diag *diag)
{
    enum ls_err err = ls_json_numbers(what, object, key, 3, out, diag);
    double length = err ? 0 : hypot(hypot(out[0], out[1]), out[2]);
    if (!err && !(length > 1e-100 && length < 1e100))
        return ls_fail(diag, LS_ERR_INVALID, "%s: \"%s\" has length %g: expected a direction", what,
                       key, length);
    for (int k = 0; k < 3 && !err; k++)
        out[k] /= length;
    return err;
}

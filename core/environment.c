#include "core/environment.h"

#include "core/json_document.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void ls_latlong_direction(double u, double v, double d[3])
{
    double theta = M_PI * v, phi = 2 * M_PI * (u - 0.5);
    d[0] = sin(theta) * sin(phi);
    d[1] = cos(theta);
    d[2] = -sin(theta) * cos(phi);
}

double ls_lobe_radiance(const struct ls_lobe *lobe, const double d[3])
{
    double cosine =
        d[0] * lobe->direction[0] + d[1] * lobe->direction[1] + d[2] * lobe->direction[2];
    return lobe->radiance * exp(lobe->sharpness * (fmin(cosine, 1) - 1));
}

double ls_lobe_energy(const struct ls_lobe *lobe)
{
    double k = lobe->sharpness;
    return lobe->radiance * 2 * M_PI * (k < 1e-9 ? 2 : -expm1(-2 * k) / k);
}

double ls_lobe_quantile(const struct ls_lobe *lobe, double q)
{
    double k = lobe->sharpness;
    if (k < 1e-9)
        return 2 * q;
    double cap = k < 20 ? -expm1(-2 * k) : 1;
    return fmin(2, -log1p(-q * cap) / k);
}

void ls_frame_about(const double z[3], double x[3], double y[3])
{
    int least = fabs(z[0]) < fabs(z[1]) ? 0 : 1;
    if (fabs(z[2]) < fabs(z[least]))
        least = 2;
    double a[3] = {0, 0, 0};
    a[least] = 1;
    double along = a[0] * z[0] + a[1] * z[1] + a[2] * z[2], length;
    for (int k = 0; k < 3; k++)
        x[k] = a[k] - along * z[k];
    length = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    for (int k = 0; k < 3; k++)
        x[k] /= length;
    y[0] = z[1] * x[2] - z[2] * x[1];
    y[1] = z[2] * x[0] - z[0] * x[2];
    y[2] = z[0] * x[1] - z[1] * x[0];
}

enum ls_err ls_map_check(const struct ls_map *map, struct ls_diag *diag)
{
    if (map->width < 1 || map->height < 1 || map->width > LS_MAP_MAX_SIDE ||
        map->height > LS_MAP_MAX_SIDE)
        return ls_fail(diag, LS_ERR_INVALID, "environment: %u x %u texels: expected 1..%d each",
                       map->width, map->height, LS_MAP_MAX_SIDE);
    size_t n = (size_t)map->width * map->height;
    for (size_t i = 0; i < n; i++) {
        const float *rgb = map->rgb + 3 * i;
        if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2]))
            return ls_fail(diag, LS_ERR_INVALID,
                           "environment: texel (%zu, %zu) is not a finite number: repair the map",
                           i % map->width, i / map->width);
    }
    return LS_OK;
}

/* --- JSON --- */

static enum ls_err number(const json_t *json, size_t lobe, const char *key, double least,
                          double *out, struct ls_diag *diag)
{
    *out = json_is_number(json) ? json_number_value(json) : NAN;
    if (!isfinite(*out) || *out < least)
        return ls_fail(diag, LS_ERR_INVALID, "environment: lobe %zu: \"%s\": expected a %s", lobe,
                       key, least >= 0 ? "number >= 0" : "finite number");
    return LS_OK;
}

static enum ls_err parse_samples(const json_t *nm, const json_t *value, size_t n, size_t lobe,
                                 double *samples, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (size_t k = 0; !err && k < n; k++) {
        err = number(json_array_get(nm, k), lobe, "wavelength_nm", 0, &samples[k], diag);
        if (!err)
            err = number(json_array_get(value, k), lobe, "value", 0, &samples[n + k], diag);
    }
    return err;
}

static enum ls_err parse_spectrum(const json_t *json, size_t lobe, struct ls_spectrum *out,
                                  struct ls_diag *diag)
{
    const json_t *nm = json_object_get(json, "wavelength_nm");
    const json_t *value = json_object_get(json, "value");
    size_t n = json_array_size(nm);
    if (n < 1 || json_array_size(value) != n)
        return ls_fail(diag, LS_ERR_INVALID,
                       "environment: lobe %zu: \"spectrum\": expected arrays \"wavelength_nm\" and "
                       "\"value\" of equal length, found %zu and %zu",
                       lobe, n, json_array_size(value));
    if (n > LS_LOBE_MAX_SAMPLES)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "environment: lobe %zu: %zu samples: expected at most "
                       "%d",
                       lobe, n, LS_LOBE_MAX_SAMPLES);
    LS_CLEANUP_FREE double *samples = calloc(2 * n, sizeof *samples);
    if (!samples)
        return ls_fail(diag, LS_ERR_NOMEM, "environment: out of memory");
    struct ls_diag inner = {{0}};
    enum ls_err err = parse_samples(nm, value, n, lobe, samples, diag);
    if (err)
        return err;
    err = ls_spectrum_resample(samples, samples + n, n, out, &inner);
    if (err)
        return ls_fail(diag, err, "environment: lobe %zu: %.400s", lobe, inner.text);
    return LS_OK;
}

static enum ls_err parse_lobe(const json_t *json, size_t index, struct ls_lobe *out,
                              struct ls_diag *diag)
{
    char what[48];
    if (!json_is_object(json))
        return ls_fail(diag, LS_ERR_INVALID, "environment: lobe %zu: expected an object", index);
    snprintf(what, sizeof what, "environment: lobe %zu", index);
    enum ls_err err = ls_json_unit(what, json, "direction", out->direction, diag);
    if (!err)
        err = number(json_object_get(json, "sharpness"), index, "sharpness", 0, &out->sharpness,
                     diag);
    if (!err)
        err = number(json_object_get(json, "radiance"), index, "radiance", 0, &out->radiance, diag);
    if (!err)
        err = parse_spectrum(json_object_get(json, "spectrum"), index, &out->spectrum, diag);
    return err;
}

static enum ls_err parse_root(const json_t *root, struct ls_lobes *lobes, struct ls_diag *diag)
{
    const json_t *array = json_object_get(root, "lobes");
    size_t n = json_array_size(array);
    enum ls_err err = LS_OK;
    if (n < 1)
        return ls_fail(diag, LS_ERR_INVALID,
                       "environment: \"lobes\": expected an array of at least one lobe");
    if (n > LS_LOBES_MAX)
        return ls_fail(diag, LS_ERR_LIMIT, "environment: %zu lobes: expected at most %d", n,
                       LS_LOBES_MAX);
    lobes->item = calloc(n, sizeof *lobes->item);
    if (!lobes->item)
        return ls_fail(diag, LS_ERR_NOMEM, "environment: out of memory");
    lobes->n = n;
    for (size_t k = 0; !err && k < n; k++)
        err = parse_lobe(json_array_get(array, k), k, &lobes->item[k], diag);
    return err;
}

enum ls_err ls_lobes_parse_json(const char *text, size_t bytes, struct ls_lobes **out,
                                struct ls_diag *diag)
{
    json_t *root;
    *out = NULL;
    enum ls_err err = ls_json_document("environment", text, bytes, LS_LOBES_MAX_BYTES, &root, diag);
    if (err)
        return err;
    struct ls_lobes *lobes = calloc(1, sizeof *lobes);
    err = lobes ? parse_root(root, lobes, diag)
                : ls_fail(diag, LS_ERR_NOMEM, "environment: out of memory");
    json_decref(root);
    if (err)
        ls_lobes_destroy(lobes);
    else
        *out = lobes;
    return err;
}

void ls_lobes_destroy(struct ls_lobes *lobes)
{
    if (!lobes)
        return;
    free(lobes->item);
    free(lobes);
}

#include "core/captured.h"

#include "core/json_document.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const char document[] = "probe";

void ls_captured_destroy(struct ls_captured *probe)
{
    if (!probe)
        return;
    for (size_t k = 0; k < probe->n_charts; k++) {
        free(probe->chart[k].rgb);
        free(probe->chart[k].saturated);
    }
    free(probe->chart);
    free(probe->neutral);
    free(probe);
}

static void destroy_probe(struct ls_captured **probe)
{
    ls_captured_destroy(*probe);
}

static void decref(json_t **json)
{
    json_decref(*json);
}

static enum ls_err expected(struct ls_diag *diag, const char *key, const char *what)
{
    return ls_fail(diag, LS_ERR_INVALID, "probe: \"%s\": expected %s", key, what);
}

static enum ls_err parse_polariser(const json_t *ball, struct ls_captured *probe,
                                   struct ls_diag *diag)
{
    static const char *const words[] = {"none", "vertical", "horizontal"};
    const char *word = json_string_value(json_object_get(ball, "polariser"));
    for (int k = 0; word && k < 3; k++)
        if (strcmp(word, words[k]) == 0) {
            strcpy(probe->polariser, word);
            return LS_OK;
        }
    return expected(diag, "polariser", "\"none\", \"vertical\" or \"horizontal\"");
}

static enum ls_err parse_optional(const json_t *ball, struct ls_captured *probe,
                                  struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    probe->has_reflectivity = json_object_get(ball, "reflectivity") != NULL;
    probe->has_blind = json_object_get(ball, "blind_deg") != NULL;
    if (probe->has_reflectivity)
        err = ls_json_numbers(document, ball, "reflectivity", 3, probe->reflectivity, diag);
    for (int c = 0; !err && probe->has_reflectivity && c < 3; c++)
        if (!(probe->reflectivity[c] > 0 && probe->reflectivity[c] <= 1))
            err = expected(diag, "reflectivity", "numbers above 0, up to 1");
    if (err || !probe->has_blind)
        return err;
    probe->blind_deg = json_number_value(json_object_get(ball, "blind_deg"));
    return probe->blind_deg > 0 && probe->blind_deg <= 90
               ? LS_OK
               : expected(diag, "blind_deg", "a half-angle above 0, up to 90");
}

static enum ls_err parse_ball(const json_t *root, struct ls_captured *probe, struct ls_diag *diag)
{
    const json_t *ball = json_object_get(root, "ball");
    const char *picture = json_string_value(json_object_get(ball, "picture"));
    if (!picture || strlen(picture) == 0 || strlen(picture) >= sizeof probe->picture)
        return expected(diag, "ball\": \"picture", "the name of a file");
    strcpy(probe->picture, picture);
    probe->radius_px = json_number_value(json_object_get(ball, "radius_px"));
    if (!(probe->radius_px > 0))
        return expected(diag, "radius_px", "a number > 0");
    enum ls_err err = ls_json_numbers(document, ball, "centre_px", 2, probe->centre_px, diag);
    if (!err)
        err = ls_json_unit(document, ball, "camera_direction", probe->camera_direction, diag);
    if (!err)
        err = parse_polariser(ball, probe, diag);
    if (!err)
        err = parse_optional(ball, probe, diag);
    return err;
}

static enum ls_err parse_neutrals(const json_t *root, struct ls_captured *probe,
                                  struct ls_diag *diag)
{
    const json_t *array = json_object_get(root, "neutrals");
    if (json_array_size(array) < 1)
        return expected(diag, "neutrals", "at least one {\"patch\", \"reflectance\"}");
    for (size_t k = 0; k < json_array_size(array); k++) {
        const json_t *item = json_array_get(array, k), *patch = json_object_get(item, "patch");
        double rho = json_number_value(json_object_get(item, "reflectance"));
        json_int_t index = json_integer_value(patch);
        if (!json_is_integer(patch) || index < 0 || (size_t)index >= probe->n_patches)
            return expected(diag, "neutrals\": \"patch", "the number of a patch, from 0");
        if (!(rho > 0 && rho <= 1))
            return expected(diag, "neutrals\": \"reflectance", "a number above 0, up to 1");
        probe->neutral[index] = rho;
    }
    return LS_OK;
}

static enum ls_err parse_saturated(const json_t *chart, const struct ls_captured *probe,
                                   struct ls_captured_chart *out, struct ls_diag *diag)
{
    const json_t *array = json_object_get(chart, "saturated");
    size_t left = 0;
    if (array && !json_is_array(array))
        return expected(diag, "saturated", "an array of patch numbers");
    for (size_t k = 0; k < json_array_size(array); k++) {
        const json_t *item = json_array_get(array, k);
        json_int_t p = json_integer_value(item);
        if (!json_is_integer(item) || p < 0 || (size_t)p >= probe->n_patches)
            return expected(diag, "saturated", "numbers of patches, from 0");
        if (probe->neutral[p] == 0)
            return ls_fail(diag, LS_ERR_INVALID,
                           "probe: \"saturated\": patch %d is no neutral, its colour is lost: "
                           "expose the charts shorter",
                           (int)p);
        out->saturated[p] = true;
    }
    for (size_t p = 0; p < probe->n_patches; p++)
        left += probe->neutral[p] > 0 && !out->saturated[p];
    return left > 0 ? LS_OK
                    : ls_fail(diag, LS_ERR_INVALID,
                              "probe: a chart has no neutral that is not saturated: expose the "
                              "charts shorter");
}

static enum ls_err parse_chart(const json_t *chart, const struct ls_captured *probe,
                               struct ls_captured_chart *out, struct ls_diag *diag)
{
    const json_t *rgb = json_object_get(chart, "rgb");
    out->rgb = calloc(probe->n_patches, sizeof *out->rgb);
    out->saturated = calloc(probe->n_patches, sizeof *out->saturated);
    if (!out->rgb || !out->saturated)
        return ls_fail(diag, LS_ERR_NOMEM, "probe: out of memory");
    enum ls_err err = ls_json_unit(document, chart, "normal", out->normal, diag);
    if (!err && (!json_is_array(rgb) || json_array_size(rgb) != probe->n_patches))
        return ls_fail(diag, LS_ERR_INVALID, "probe: \"rgb\": expected %zu patches, as elsewhere",
                       probe->n_patches);
    for (size_t p = 0; !err && p < probe->n_patches; p++) {
        const json_t *patch = json_array_get(rgb, p);
        for (size_t c = 0; c < 3; c++) {
            const json_t *value = json_array_get(patch, c);
            out->rgb[p][c] = json_number_value(value);
            if (json_array_size(patch) != 3 || !json_is_number(value) || !isfinite(out->rgb[p][c]))
                return ls_fail(diag, LS_ERR_INVALID,
                               "probe: \"rgb\": patch %zu: expected three numbers", p);
        }
        if (probe->neutral[p] > 0 &&
            !(out->rgb[p][0] > 0 && out->rgb[p][1] > 0 && out->rgb[p][2] > 0))
            return ls_fail(diag, LS_ERR_INVALID,
                           "probe: \"rgb\": neutral patch %zu reads 0 or less: expose the charts "
                           "longer",
                           p);
    }
    return err ? err : parse_saturated(chart, probe, out, diag);
}

static enum ls_err parse_charts(const json_t *root, struct ls_captured *probe, struct ls_diag *diag)
{
    const json_t *charts = json_object_get(root, "charts");
    size_t n = json_array_size(charts);
    enum ls_err err = LS_OK;
    if (n < 1)
        return expected(diag, "charts", "an array of at least one chart");
    probe->n_patches = json_array_size(json_object_get(json_array_get(charts, 0), "rgb"));
    if (n > LS_CAPTURED_MAX_CHARTS || probe->n_patches > LS_CAPTURED_MAX_PATCHES)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "probe: %zu charts of %zu patches: expected at most %d of %d", n,
                       probe->n_patches, LS_CAPTURED_MAX_CHARTS, LS_CAPTURED_MAX_PATCHES);
    if (probe->n_patches < 1)
        return expected(diag, "rgb", "at least one patch");
    probe->chart = calloc(n, sizeof *probe->chart);
    probe->neutral = calloc(probe->n_patches, sizeof *probe->neutral);
    if (!probe->chart || !probe->neutral)
        return ls_fail(diag, LS_ERR_NOMEM, "probe: out of memory");
    probe->n_charts = n;
    err = parse_neutrals(root, probe, diag);
    for (size_t k = 0; !err && k < n; k++)
        err = parse_chart(json_array_get(charts, k), probe, &probe->chart[k], diag);
    return err;
}

enum ls_err ls_captured_parse_json(const char *text, size_t bytes, struct ls_captured **out,
                                   struct ls_diag *diag)
{
    __attribute__((cleanup(decref))) json_t *root = NULL;
    *out = NULL;
    enum ls_err err = ls_json_document(document, text, bytes, LS_CAPTURED_MAX_BYTES, &root, diag);
    if (err)
        return err;
    __attribute__((cleanup(destroy_probe))) struct ls_captured *probe = calloc(1, sizeof *probe);
    if (!probe)
        return ls_fail(diag, LS_ERR_NOMEM, "probe: out of memory");
    err = parse_ball(root, probe, diag);
    if (!err)
        err = parse_charts(root, probe, diag);
    if (err)
        return err;
    *out = probe;
    probe = NULL;
    return LS_OK;
}

bool ls_captured_is(const char *text, size_t bytes)
{
    __attribute__((cleanup(decref))) json_t *root =
        bytes <= LS_CAPTURED_MAX_BYTES ? json_loadb(text, bytes, 0, NULL) : NULL;
    return json_object_get(root, "ball") != NULL;
}

static double cosine(const struct ls_captured_chart *chart, const double d[3])
{
    return chart->normal[0] * d[0] + chart->normal[1] * d[1] + chart->normal[2] * d[2];
}

static size_t nearest(const struct ls_captured *probe, const double d[3])
{
    size_t best = 0;
    for (size_t k = 1; k < probe->n_charts; k++)
        if (cosine(&probe->chart[k], d) > cosine(&probe->chart[best], d))
            best = k;
    return best;
}

static void add_chart(const struct ls_captured *probe, const struct ls_captured_chart *chart,
                      double weight, double *targets, double *clipped)
{
    for (size_t p = 0; p < probe->n_patches; p++)
        for (size_t c = 0; c < 3; c++)
            targets[3 * p + c] += weight * chart->rgb[p][c];
    for (size_t p = 0; p < probe->n_patches; p++)
        if (chart->saturated[p])
            clipped[p] += weight;
}

/* every channel so that the sound neutrals together read their reflectances x cell */
static void scale(const struct ls_captured *probe, const double cell[3], const double *clipped,
                  double *targets)
{
    for (size_t c = 0; c < 3; c++) {
        double rho = 0, reads = 0;
        for (size_t p = 0; p < probe->n_patches; p++)
            if (probe->neutral[p] > 0 && clipped[p] == 0) {
                rho += probe->neutral[p];
                reads += targets[3 * p + c];
            }
        double factor = reads > 0 ? rho * cell[c] / reads : 0;
        for (size_t p = 0; p < probe->n_patches; p++)
            targets[3 * p + c] = probe->neutral[p] > 0 && (clipped[p] > 0 || reads <= 0)
                                     ? probe->neutral[p] * cell[c]
                                     : targets[3 * p + c] * factor;
    }
}

/* is there a neutral that no chart of the mean had saturated? */
static bool sound(const struct ls_captured *probe, const double *clipped)
{
    for (size_t p = 0; p < probe->n_patches; p++)
        if (probe->neutral[p] > 0 && clipped[p] == 0)
            return true;
    return false;
}

bool ls_captured_targets(const struct ls_captured *probe, const double direction[3],
                         const double cell[3], double *targets)
{
    double clipped[LS_CAPTURED_MAX_PATCHES] = {0};
    bool faced = false;
    memset(targets, 0, 3 * probe->n_patches * sizeof *targets);
    for (size_t k = 0; k < probe->n_charts; k++) {
        double facing = fmax(0, cosine(&probe->chart[k], direction));
        if (facing > 0)
            add_chart(probe, &probe->chart[k], facing * facing, targets, clipped);
        faced |= facing > 0;
    }
    if (!faced || !sound(probe, clipped)) {
        memset(targets, 0, 3 * probe->n_patches * sizeof *targets);
        memset(clipped, 0, sizeof clipped);
        add_chart(probe, &probe->chart[nearest(probe, direction)], 1, targets, clipped);
    }
    scale(probe, cell, clipped, targets);
    return faced;
}

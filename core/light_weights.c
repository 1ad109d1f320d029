#include "core/light_weights.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static enum ls_err check(const struct ls_environment *environment, struct ls_diag *diag)
{
    if (!environment->map == !environment->lobes)
        return ls_fail(diag, LS_ERR_INVALID,
                       "environment: expected either a map or lobes, found %s",
                       environment->map ? "both" : "neither");
    return LS_OK;
}

static enum ls_err spectra_of_lobes(const struct ls_environment *environment,
                                    struct ls_spectrum *spectra, struct ls_diag *diag)
{
    const struct ls_lobes *lobes = environment->lobes;
    size_t n = environment->n_lights;
    LS_CLEANUP_FREE double *w = calloc(n * lobes->n + 1, sizeof *w);
    if (!w)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    enum ls_err err = ls_envlights_lobes(environment->directions, n, environment->rotation, lobes,
                                         w, diag);
    if (err)
        return err;
    memset(spectra, 0, sizeof *spectra * n);
    for (size_t i = 0; i < n; i++)
        for (size_t l = 0; l < lobes->n; l++)
            for (int k = 0; k < LS_SPECTRUM_N; k++)
                spectra[i].v[k] += w[i * lobes->n + l] * lobes->item[l].spectrum.v[k];
    return LS_OK;
}

static const struct ls_spectrum *green_of(const struct ls_spectrum *sensitivities,
                                          size_t n_channels)
{
    return &sensitivities[n_channels == 3 ? 1 : 0];
}

static enum ls_err functionals_of(const struct ls_map *map, const struct ls_spectrum *sensitivities,
                                  size_t n_channels, struct ls_spectrum out[3],
                                  struct ls_diag *diag)
{
    if (map->space == LS_MAP_REC709_LINEAR)
        return ls_rec709_functionals_for(green_of(sensitivities, n_channels), out, diag);
    if (n_channels != 3)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "environment: a camera-raw map needs a camera of three channels, this one "
                       "has %zu: convert the map to rec709-linear",
                       n_channels);
    memcpy(out, sensitivities, 3 * sizeof *out);
    return LS_OK;
}

static enum ls_err map_rgb(const struct ls_environment *environment, double *rgb,
                           struct ls_diag *diag)
{
    return ls_envlights_map(environment->directions, environment->n_lights, environment->rotation,
                            environment->map, rgb, diag);
}

static enum ls_err spectra_of_map(const struct ls_environment *environment,
                                  const struct ls_spectrum *sensitivities, size_t n_channels,
                                  struct ls_spectrum *spectra, size_t *unreachable,
                                  struct ls_diag *diag)
{
    struct ls_spectrum functionals[3];
    LS_CLEANUP_FREE double *rgb = calloc(3 * environment->n_lights + 1, sizeof *rgb);
    if (!rgb)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    enum ls_err err = functionals_of(environment->map, sensitivities, n_channels, functionals,
                                     diag);
    if (!err)
        err = map_rgb(environment, rgb, diag);
    for (size_t i = 0; !err && i < environment->n_lights; i++) {
        struct ls_smoothest found;
        err = ls_spectrum_smoothest(rgb + 3 * i, functionals, &spectra[i], &found, diag);
        *unreachable += !err && !found.reachable;
    }
    return err;
}

enum ls_err ls_light_spectra(const struct ls_environment *environment,
                             const struct ls_spectrum *sensitivities, size_t n_channels,
                             struct ls_spectrum *spectra, struct ls_light_weights_report *report,
                             struct ls_diag *diag)
{
    size_t unreachable = 0;
    enum ls_err err = check(environment, diag);
    if (err)
        return err;
    err = environment->lobes
              ? spectra_of_lobes(environment, spectra, diag)
              : spectra_of_map(environment, sensitivities, n_channels, spectra, &unreachable, diag);
    if (!err && report)
        report->unreachable = unreachable;
    return err;
}

/** What one light's solve needs, and what all have shown so far. */
struct solver {
    const struct ls_stage_chart *chart;
    const struct ls_spectrum *observer; /* [n_targets] functionals of the targets */
    size_t n_targets, n_weights;        /* per light */
    double *targets;                    /* [n_patches][n_targets] */
    struct ls_light_weights_report *report;
};

static void apply_m(const struct ls_lighting *lighting, double *targets)
{
    const double *m = lighting->m;
    if (ls_lighting_space(lighting) != LS_SOLVE_AFTER_M)
        return;
    for (size_t p = 0; p < lighting->n_patches; p++, targets += 3) {
        double raw[3] = {targets[0], targets[1], targets[2]};
        for (int c = 0; c < 3; c++)
            targets[c] = m[3 * c] * raw[0] + m[3 * c + 1] * raw[1] + m[3 * c + 2] * raw[2];
    }
}

static enum ls_err solve_light(struct solver *solver, const struct ls_spectrum *light,
                               double *weights, struct ls_diag *diag)
{
    const struct ls_lighting *lighting = &solver->chart->lighting;
    struct ls_solution found = {0};
    ls_lighting_targets(solver->chart->reflectances, lighting->n_patches, solver->observer,
                        solver->n_targets, light, solver->targets);
    if (lighting->mode == LS_SOLVE_PER_TARGET && lighting->n_channels == 3)
        apply_m(lighting, solver->targets);
    enum ls_err err = ls_lighting_solve(lighting, solver->targets, solver->n_targets, weights,
                                        &found, diag);
    if (err)
        return err;
    struct ls_light_weights_report *r = solver->report;
    r->worst_relative = fmax(r->worst_relative, found.relative);
    r->condition = fmax(r->condition, found.condition);
    r->rank = found.rank < r->rank ? found.rank : r->rank;
    return LS_OK;
}

static bool dark(const struct ls_spectrum *light)
{
    for (int k = 0; k < LS_SPECTRUM_N; k++)
        if (light->v[k] != 0)
            return false;
    return true;
}

static enum ls_err solve_all(struct solver *solver, const struct ls_spectrum *spectra, size_t n,
                             double *weights, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    memset(weights, 0, sizeof *weights * n * solver->n_weights);
    for (size_t i = 0; !err && i < n; i++)
        if (!dark(&spectra[i]))
            err = solve_light(solver, &spectra[i], weights + i * solver->n_weights, diag);
    return err;
}

enum ls_err ls_light_weights(const struct ls_environment *environment,
                             const struct ls_stage_chart *chart, double *weights,
                             struct ls_light_weights_report *report, struct ls_diag *diag)
{
    const struct ls_lighting *lighting = &chart->lighting;
    bool per_target = lighting->mode == LS_SOLVE_PER_TARGET, mono = lighting->n_channels == 1;
    struct ls_light_weights_report unused;
    struct ls_spectrum rec709[3];
    LS_CLEANUP_FREE struct ls_spectrum *spectra = calloc(environment->n_lights + 1, sizeof *spectra);
    LS_CLEANUP_FREE double *targets = calloc(3 * lighting->n_patches + 1, sizeof *targets);
    if (!spectra || !targets)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    report = report ? report : &unused;
    *report = (struct ls_light_weights_report){.rank = (unsigned)lighting->n_spectra,
                                               .space = ls_lighting_space(lighting)};
    enum ls_err err = ls_light_spectra(environment, chart->sensitivities, lighting->n_channels,
                                       spectra, report, diag);
    if (!err && per_target && mono)
        err = ls_rec709_functionals_for(chart->sensitivities, rec709, diag);
    if (err)
        return err;
    struct solver solver = {
        .chart = chart,
        .observer = per_target && mono ? rec709 : chart->sensitivities,
        .n_targets = per_target ? 3 : lighting->n_channels,
        .n_weights = lighting->n_spectra * (per_target ? 3 : 1),
        .targets = targets,
        .report = report,
    };
    return solve_all(&solver, spectra, environment->n_lights, weights, diag);
}

enum ls_err ls_light_weights_tristimulus(const struct ls_environment *environment,
                                         const struct ls_spectrum sensitivities[3],
                                         double *weights, struct ls_light_weights_report *report,
                                         struct ls_diag *diag)
{
    enum ls_err err = check(environment, diag);
    if (report)
        *report = (struct ls_light_weights_report){.space = LS_SOLVE_CAMERA_RAW};
    if (err)
        return err;
    if (environment->map && environment->map->space == LS_MAP_CAMERA_RAW)
        return map_rgb(environment, weights, diag);
    LS_CLEANUP_FREE struct ls_spectrum *spectra = calloc(environment->n_lights + 1, sizeof *spectra);
    if (!spectra)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    err = ls_light_spectra(environment, sensitivities, 3, spectra, report, diag);
    for (size_t i = 0; !err && i < environment->n_lights; i++)
        for (size_t c = 0; c < 3; c++)
            weights[3 * i + c] = ls_spectrum_dot(&spectra[i], &sensitivities[c]);
    return err;
}

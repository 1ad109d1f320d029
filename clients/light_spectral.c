#include "clients/light_solver.h"

#include "core/cell_lighting.h"
#include "core/envlights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void choose_solve(const struct ls_light_solver *solver, struct ls_lighting *lighting)
{
    const struct ls_light_options *options = solver->options;
    ls_lighting_defaults(lighting);
    if (options->solve == LS_LIGHT_SHARED)
        lighting->mode = LS_SOLVE_SHARED;
    if (options->solve == LS_LIGHT_PER_TARGET)
        lighting->mode = LS_SOLVE_PER_TARGET;
    if (options->method == LS_LIGHT_METHOD_NNLS) {
        lighting->method = LS_SOLVE_NNLS;
        lighting->tikhonov = 0;
    }
    if (options->method == LS_LIGHT_METHOD_LEAST_SQUARES)
        lighting->method = LS_SOLVE_LEAST_SQUARES;
    if (lighting->method == LS_SOLVE_LEAST_SQUARES)
        lighting->tikhonov = 1e-3;
    if (options->damped)
        lighting->tikhonov = options->tikhonov;
}

static enum ls_err read_chart(struct ls_light_solver *solver, struct ls_light_weights *weights,
                              struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    size_t rows = (size_t)cal->n_patches * cal->n_colours, n = weights->n_names;
    enum ls_err err = LS_OK;
    if (cal->n_patches == 0 || !cal->L || cal->reflectance.n == 0)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take's calibration has no chart: the spectral solve needs its "
                       "reflectances and L; use --solve tristimulus");
    solver->reflectance = calloc(cal->n_patches, sizeof *solver->reflectance);
    solver->chart = calloc(rows * n, sizeof(double));
    if (!solver->reflectance || !solver->chart)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t p = 0; p < cal->n_patches && !err; p++)
        err = ls_light_table_row(&cal->reflectance, p, &solver->reflectance[p], diag);
    for (size_t r = 0; r < rows; r++)
        for (size_t s = 0; s < n; s++)
            solver->chart[r * n + s] = (double)cal->L[r * cal->n_channels + solver->columns[s]];
    return err;
}

static enum ls_err factor_chart(struct ls_light_solver *solver, struct ls_light_weights *weights,
                                struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    struct ls_lighting lighting = {.n_patches = cal->n_patches,
                                   .n_channels = cal->n_colours,
                                   .n_spectra = weights->n_names,
                                   .chart = solver->chart,
                                   .m = cal->has_m ? &cal->m[0][0] : NULL};
    static const struct ls_row_weights even = {0};
    const struct ls_row_weights *rows = solver->options->rows ? solver->options->rows : &even;
    LS_CLEANUP_FREE double *row_weight = NULL;
    choose_solve(solver, &lighting);
    enum ls_err err = ls_row_weights_for(rows, cal->n_patches, cal->n_colours, &row_weight, diag);
    if (err)
        return err;
    lighting.row_weight = row_weight;
    weights->tikhonov = lighting.tikhonov;
    if (lighting.mode == LS_SOLVE_SHARED && solver->n_colours == 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "--solve shared: one set of strengths makes no colours of a monochrome "
                       "camera; use --solve per-target");
    /* the daemon weights each camera channel before anything mixes them */
    weights->by_target =
        lighting.mode == LS_SOLVE_PER_TARGET && ls_lighting_space(&lighting) == LS_SOLVE_AFTER_M;
    weights->mode = lighting.mode == LS_SOLVE_SHARED || weights->by_target ? LIGHTSTAGE_SHARED
                                                                           : LIGHTSTAGE_PER_TARGET;
    return ls_lighting_solver_create(&lighting, 3, &solver->lighting, diag);
}

/* The direction of a light in the environment, turned by @rotation: its inverse on the light's. */
static void seen_from(const struct ls_light_solver *solver, uint32_t light,
                      const double rotation[9], double out[3])
{
    const float *d = solver->document->direction[light];
    for (int k = 0; k < 3; k++)
        out[k] = rotation[k] * (double)d[0] + rotation[3 + k] * (double)d[1] +
                 rotation[6 + k] * (double)d[2];
}

/* What a mono camera's pictures are to show: the ball camera's colours, after M if there is one. */
static void after_m(const struct ls_calibration *cal, double *targets, size_t n_patches)
{
    for (size_t p = 0; p < n_patches && cal->has_m; p++) {
        double raw[3];
        memcpy(raw, targets + 3 * p, sizeof raw);
        for (int r = 0; r < 3; r++)
            targets[3 * p + (size_t)r] =
                cal->m[r][0] * raw[0] + cal->m[r][1] * raw[1] + cal->m[r][2] * raw[2];
    }
}

/* A captured environment: its charts did read the light. */
static enum ls_err solve_probe(const struct ls_light_solver *solver, double *alpha,
                               struct ls_cell_lighting *found, struct ls_diag *diag)
{
    const struct ls_captured *probe = solver->environment->probe;
    const struct ls_calibration *cal = solver->document->calibration;
    size_t n_lights = solver->document->n_lights, values = 3 * probe->n_patches;
    double rotation[9];
    if (probe->n_patches != cal->n_patches)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the environment's charts have %zu patches, the calibration's %u: calibrate "
                       "with the chart that was photographed, or use --solve tristimulus",
                       probe->n_patches, cal->n_patches);
    LS_CLEANUP_FREE double *targets = calloc(n_lights * values, sizeof *targets);
    if (!targets)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    ls_rotation_y(solver->options->turn_deg * M_PI / 180, rotation);
    for (uint32_t i = 0; i < n_lights; i++) {
        double d[3];
        seen_from(solver, i, rotation, d);
        ls_captured_targets(probe, d, ls_light_cell(solver, i), targets + i * values);
        if (cal->n_colours == 1)
            after_m(cal, targets + i * values, probe->n_patches);
    }
    return ls_cell_lighting_targets(solver->lighting, targets, values, n_lights, alpha, found,
                                    diag);
}

static enum ls_err solve_cells(const struct ls_light_solver *solver, double *alpha,
                               struct ls_cell_lighting *found, struct ls_diag *diag)
{
    const struct ls_environment_file *environment = solver->environment;
    size_t n_lights = solver->document->n_lights;
    const struct ls_spectral_chart chart = {.solver = solver->lighting,
                                            .reflectance = solver->reflectance,
                                            .n_patches = solver->document->calibration->n_patches,
                                            .reader = solver->n_colours == 1 ? solver->functionals
                                                                             : solver->sensitivity,
                                            .n_readers = 3};
    if (environment->probe)
        return solve_probe(solver, alpha, found, diag);
    if (environment->lobes)
        return ls_cell_lighting_lobes(&chart, environment->lobes, solver->cells, n_lights, alpha,
                                      found, diag);
    return ls_cell_lighting_map(&chart, solver->functionals, solver->cells, n_lights, alpha, found,
                                diag);
}

static enum ls_err solve_all(struct ls_light_solver *solver, struct ls_light_weights *out,
                             struct ls_diag *diag)
{
    struct ls_cell_lighting found = {0};
    size_t outputs = ls_lighting_solver_outputs(solver->lighting);
    size_t n_lights = solver->document->n_lights;
    LS_CLEANUP_FREE double *alpha = calloc(n_lights * outputs, sizeof *alpha);
    if (!alpha)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_light_rows(out, (uint32_t)outputs, (uint32_t)n_lights, diag);
    if (!err)
        err = solve_cells(solver, alpha, &found, diag);
    if (err)
        return err;
    for (size_t i = 0; i < n_lights; i++)
        for (size_t r = 0; r < outputs; r++)
            out->rows[r * n_lights + i] = (float)alpha[i * outputs + r];
    out->solved = true;
    out->solution = found.worst;
    out->residual = found.residual;
    out->unreachable = found.energy > 0 ? found.missed / found.energy : 0;
    return LS_OK;
}

enum ls_err ls_light_spectral(struct ls_light_solver *solver, struct ls_light_weights *out,
                              struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    solver->n_colours = solver->document->calibration->n_colours;
    if (!solver->environment->probe)
        err = ls_light_sensitivities(solver, diag);
    if (!err && !solver->environment->probe)
        err = ls_light_functionals(solver, diag);
    if (!err)
        err = read_chart(solver, out, diag);
    if (!err)
        err = factor_chart(solver, out, diag);
    if (!err)
        err = solve_all(solver, out, diag);
    out->after_m = solver->n_colours == 1 || out->by_target;
    return err;
}

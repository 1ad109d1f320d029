#include "clients/light_solver.h"

#include "core/envlights.h"
#include "core/smooth_cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bool ls_light_solve_option(const char *word, enum ls_light_solve *out)
{
    static const char *const words[] = {"spectral", "tristimulus", "shared", "per-target"};
    for (int i = 0; i < 4; i++)
        if (strcmp(word, words[i]) == 0) {
            *out = (enum ls_light_solve)i;
            return true;
        }
    return false;
}

bool ls_light_method_option(const char *word, enum ls_light_method *out)
{
    bool nnls = strcmp(word, "nnls") == 0;
    *out = nnls ? LS_LIGHT_METHOD_NNLS : LS_LIGHT_METHOD_LEAST_SQUARES;
    return nnls || strcmp(word, "least-squares") == 0;
}

bool ls_light_cells_option(const char *word, bool *smooth)
{
    *smooth = strcmp(word, "smooth") == 0;
    return *smooth || strcmp(word, "nearest") == 0;
}

static void solver_finish(struct ls_light_solver *solver)
{
    free(solver->cells);
    free(solver->reflectance);
    free(solver->chart);
    ls_lighting_solver_destroy(solver->lighting);
}

void ls_light_weights_finish(struct ls_light_weights *weights)
{
    free(weights->rows);
    memset(weights, 0, sizeof *weights);
}

/* ---- the environment, cell by cell ---- */

static enum ls_err cut_cells(struct ls_light_solver *solver, struct ls_diag *diag)
{
    const struct ls_take_document *d = solver->document;
    const struct ls_environment_file *e = solver->environment;
    const float(*directions)[3] = (const float(*)[3])d->direction;
    double rotation[9];
    ls_rotation_y(solver->options->turn_deg * M_PI / 180, rotation);
    solver->n_cells = e->lobes ? e->lobes->n : 3;
    solver->cells = calloc((size_t)d->n_lights * (solver->n_cells + 1), sizeof(double));
    if (!solver->cells)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (e->lobes)
        return (solver->options->smooth ? ls_smooth_cells_lobes : ls_envlights_lobes)(
            directions, d->n_lights, rotation, e->lobes, solver->cells, diag);
    return (solver->options->smooth ? ls_smooth_cells_map : ls_envlights_map)(
        directions, d->n_lights, rotation, &e->map, solver->cells, diag);
}

const double *ls_light_cell(const struct ls_light_solver *solver, uint32_t light)
{
    return solver->cells + light * solver->n_cells;
}

/* ---- the calibration's spectra ---- */

enum ls_err ls_light_table_row(const struct ls_spectral_table *table, uint32_t row,
                               struct ls_spectrum *out, struct ls_diag *diag)
{
    double *nm = calloc(table->n, sizeof *nm), *value = calloc(table->n, sizeof *value);
    enum ls_err err = nm && value ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; !err && i < table->n; i++) {
        nm[i] = table->start_nm + i * table->step_nm;
        value[i] = (double)table->v[(size_t)row * table->n + i];
    }
    if (!err)
        err = ls_spectrum_resample(nm, value, table->n, out, diag);
    free(nm);
    free(value);
    return err;
}

enum ls_err ls_light_sensitivities(struct ls_light_solver *solver, struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    enum ls_err err = LS_OK;
    solver->n_colours = cal->n_colours;
    if (cal->camera.sensitivity.n == 0 || cal->camera.sensitivity.rows < cal->n_colours)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take's calibration has no camera sensitivities: a spectral light needs "
                       "them; relight with an RGB map and --solve tristimulus");
    for (uint32_t c = 0; c < cal->n_colours && !err; c++)
        err = ls_light_table_row(&cal->camera.sensitivity, c, &solver->sensitivity[c], diag);
    return err;
}

enum ls_err ls_light_functionals(struct ls_light_solver *solver, struct ls_diag *diag)
{
    uint32_t green = solver->n_colours == 3 ? 1 : 0;
    if (!solver->environment->lobes && solver->environment->map.space == LS_MAP_CAMERA_RAW) {
        if (solver->n_colours != 3)
            return ls_fail(diag, LS_ERR_UNSUPPORTED,
                           "a camera-raw map needs a colour camera; this take's is monochrome");
        memcpy(solver->functionals, solver->sensitivity, sizeof solver->functionals);
        return LS_OK;
    }
    return ls_rec709_functionals_for(&solver->sensitivity[green], solver->functionals, diag);
}

/* ---- the whole ---- */

enum ls_err ls_light_rows(struct ls_light_weights *out, uint32_t n_rows, uint32_t n_lights,
                          struct ls_diag *diag)
{
    out->n_rows = n_rows;
    out->n_lights = n_lights;
    out->rows = calloc((size_t)n_rows * n_lights, sizeof(float));
    return out->rows ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

enum ls_err ls_light_weights_make(const struct ls_take_document *document,
                                  const struct ls_environment_file *environment,
                                  const struct ls_light_options *options,
                                  struct ls_light_weights *out, struct ls_diag *diag)
{
    struct ls_light_solver solver = {
        .document = document, .environment = environment, .options = options};
    bool tristimulus = options->solve == LS_LIGHT_TRISTIMULUS;
    memset(out, 0, sizeof *out);
    out->warning = environment->warning;
    enum ls_err err = ls_light_channels(&solver, out, diag);
    if (!err)
        err = cut_cells(&solver, diag);
    if (!err && !document->calibration && document->mono)
        err = ls_light_grey(&solver, out, diag);
    else if (!err && (tristimulus || !document->calibration))
        err = ls_light_tristimulus(&solver, out, diag);
    else if (!err)
        err = ls_light_spectral(&solver, out, diag);
    solver_finish(&solver);
    if (err)
        ls_light_weights_finish(out);
    return err;
}

#include "core/cell_lighting.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* a cell this much darker than the brightest does not speak for the solve's quality */
static const double faint = 1e-6;

static double square_of(const double *v, size_t n)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += v[i] * v[i];
    return sum;
}

static double brightest(const double *targets, size_t values, size_t n)
{
    double most = 0;
    for (size_t i = 0; i < n; i++)
        most = fmax(most, square_of(targets + i * values, values));
    return most;
}

enum ls_err ls_cell_lighting_targets(const struct ls_lighting_solver *solver, const double *targets,
                                     size_t values_per_cell, size_t n, double *alpha,
                                     struct ls_cell_lighting *out, struct ls_diag *diag)
{
    struct ls_cell_lighting result = {0};
    size_t outputs = ls_lighting_solver_outputs(solver);
    double most = brightest(targets, values_per_cell, n), left = 0, all = 0;
    enum ls_err err = LS_OK;
    memset(alpha, 0, n * outputs * sizeof *alpha);
    for (size_t i = 0; !err && i < n; i++) {
        struct ls_lighting_solution one;
        const double *p = targets + i * values_per_cell;
        double size = square_of(p, values_per_cell);
        if (size == 0)
            continue;
        err = ls_lighting_solver_run(solver, p, alpha + i * outputs, &one, diag);
        all += size;
        left += err ? 0 : size * one.worst.relative * one.worst.relative;
        if (!err && size >= faint * faint * most &&
            one.worst.relative >= result.worst.worst.relative)
            result.worst = one;
    }
    result.residual = all > 0 ? sqrt(left / all) : 0;
    if (out) {
        result.energy = out->energy;
        result.missed = out->missed;
        *out = result;
    }
    return err;
}

/* what every patch reads per radiance at each wavelength: [patch * readers][LS_SPECTRUM_N] */
static double *readings(const struct ls_spectral_chart *chart)
{
    size_t rows = chart->n_patches * chart->n_readers;
    double *table = malloc(rows * LS_SPECTRUM_N * sizeof *table);
    struct ls_spectrum unit = {{0}};
    for (int w = 0; table && w < LS_SPECTRUM_N; w++) {
        unit.v[w] = 1;
        double nm = ls_spectrum_integral(&unit);
        unit.v[w] = 0;
        for (size_t r = 0; r < rows; r++)
            table[r * LS_SPECTRUM_N + (size_t)w] = nm *
                                                   chart->reflectance[r / chart->n_readers].v[w] *
                                                   chart->reader[r % chart->n_readers].v[w];
    }
    return table;
}

static void read_spectrum(const double *table, size_t rows, const struct ls_spectrum *light,
                          double *targets)
{
    for (size_t r = 0; r < rows; r++) {
        targets[r] = 0;
        for (int w = 0; w < LS_SPECTRUM_N; w++)
            targets[r] += table[r * LS_SPECTRUM_N + (size_t)w] * light->v[w];
    }
}

static enum ls_err read_map(const double *table, size_t rows,
                            const struct ls_spectrum functionals[3], const double *cells, size_t n,
                            double *targets, struct ls_cell_lighting *out, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (size_t i = 0; !err && i < n; i++) {
        struct ls_spectrum light;
        struct ls_smoothest report;
        err = ls_spectrum_smoothest(cells + 3 * i, functionals, &light, &report, diag);
        if (err)
            break;
        double norm = sqrt(square_of(cells + 3 * i, 3));
        out->energy += norm;
        out->missed += report.reachable ? 0 : report.residual * norm;
        read_spectrum(table, rows, &light, targets + i * rows);
    }
    return err;
}

enum ls_err ls_cell_lighting_map(const struct ls_spectral_chart *chart,
                                 const struct ls_spectrum functionals[3], const double *cells,
                                 size_t n, double *alpha, struct ls_cell_lighting *out,
                                 struct ls_diag *diag)
{
    struct ls_cell_lighting result = {0};
    size_t rows = chart->n_patches * chart->n_readers;
    LS_CLEANUP_FREE double *table = readings(chart);
    LS_CLEANUP_FREE double *targets = calloc(n * rows + 1, sizeof *targets);
    if (!table || !targets)
        return ls_fail(diag, LS_ERR_NOMEM, "lighting: out of memory");
    enum ls_err err = read_map(table, rows, functionals, cells, n, targets, &result, diag);
    if (!err)
        err = ls_cell_lighting_targets(chart->solver, targets, rows, n, alpha, &result, diag);
    if (out)
        *out = result;
    return err;
}

enum ls_err ls_cell_lighting_lobes(const struct ls_spectral_chart *chart,
                                   const struct ls_lobes *lobes, const double *cells, size_t n,
                                   double *alpha, struct ls_cell_lighting *out,
                                   struct ls_diag *diag)
{
    size_t rows = chart->n_patches * chart->n_readers;
    struct ls_cell_lighting result = {0};
    LS_CLEANUP_FREE double *table = readings(chart);
    LS_CLEANUP_FREE double *of_lobe = calloc(lobes->n * rows + 1, sizeof *of_lobe);
    LS_CLEANUP_FREE double *targets = calloc(n * rows + 1, sizeof *targets);
    if (!table || !of_lobe || !targets)
        return ls_fail(diag, LS_ERR_NOMEM, "lighting: out of memory");
    for (size_t l = 0; l < lobes->n; l++)
        read_spectrum(table, rows, &lobes->item[l].spectrum, of_lobe + l * rows);
    for (size_t i = 0; i < n; i++)
        for (size_t l = 0; l < lobes->n; l++)
            for (size_t r = 0; r < rows; r++)
                targets[i * rows + r] += cells[i * lobes->n + l] * of_lobe[l * rows + r];
    enum ls_err err =
        ls_cell_lighting_targets(chart->solver, targets, rows, n, alpha, &result, diag);
    if (out)
        *out = result;
    return err;
}

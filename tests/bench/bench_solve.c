/* The lighting solve: 346 directions x 3 outputs x 6 unknowns, and a whole RGB map with it. */
#include "core/cell_lighting.h"
#include "tests/bench/bench.h"
#include "tests/core/lighting_once.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { LIGHTS = 346, PATCHES = 24, SPECTRA = 6, ROWS = 3 * PATCHES };

struct work {
    struct ls_lighting lighting;
    struct ls_spectral_chart chart;
    struct ls_spectrum functionals[3], reflectance[PATCHES];
    double l[ROWS * SPECTRA], targets[LIGHTS * ROWS], cells[LIGHTS * 3];
    double alpha[LIGHTS * 3 * SPECTRA];
    size_t n;
};

static void need(enum ls_err err)
{
    if (err) {
        fprintf(stderr, "bench_solve: %d\n", (int)err);
        exit(1);
    }
}

static double bump(int i, double centre, double width)
{
    double x = (i - centre) / width;
    return exp(-0.5 * x * x);
}

/* smooth reflectances, narrow spectra, the observer as camera */
static void make_chart(struct work *work)
{
    struct ls_spectrum led[SPECTRA];
    ls_rec709_functionals(work->functionals);
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        for (int s = 0; s < SPECTRA; s++)
            led[s].v[i] = s == 0 ? 0.3 + bump(i, 14, 4) : bump(i, 10.0 + 11 * s, 3);
        for (int p = 0; p < PATCHES; p++)
            work->reflectance[p].v[i] = 0.05 + 0.8 * bump(i, 3.4 * p, 6 + p % 5 * 5);
    }
    for (int s = 0; s < SPECTRA; s++) {
        double p[ROWS];
        chart_reads(work->reflectance, PATCHES, work->functionals, 3, &led[s], p);
        for (int r = 0; r < ROWS; r++)
            work->l[r * SPECTRA + s] = p[r];
    }
}

static void make_targets(struct work *work)
{
    struct ls_spectrum light;
    for (size_t i = 0; i < LIGHTS; i++) {
        double at = (double)i / LIGHTS;
        for (int w = 0; w < LS_SPECTRUM_N; w++)
            light.v[w] = 0.2 + bump(w, 80 * at, 5) + 0.5 * bump(w, 80 * fmod(7 * at, 1), 2);
        chart_reads(work->reflectance, PATCHES, work->functionals, 3, &light,
                    work->targets + i * ROWS);
        for (int c = 0; c < 3; c++)
            work->cells[3 * i + (size_t)c] = ls_spectrum_dot(&light, &work->functionals[c]);
    }
}

/* factored once, as a relight does */
static void solve(void *data)
{
    struct work *work = data;
    struct ls_lighting_solver *solver;
    need(ls_lighting_solver_create(&work->lighting, 3, &solver, NULL));
    need(ls_cell_lighting_targets(solver, work->targets, ROWS, work->n, work->alpha, NULL, NULL));
    ls_lighting_solver_destroy(solver);
}

static void solve_map(void *data)
{
    struct work *work = data;
    struct ls_lighting_solver *solver;
    need(ls_lighting_solver_create(&work->lighting, 3, &solver, NULL));
    work->chart.solver = solver;
    need(ls_cell_lighting_map(&work->chart, work->functionals, work->cells, work->n, work->alpha,
                              NULL, NULL));
    ls_lighting_solver_destroy(solver);
}

/* how exact the solve is, test_nnls says against every active set in long double */
static void print(const struct bench *bench, const char *name, const struct bench_task *task,
                  double limit_ms)
{
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "ms",
                                         .value = task->best_s * 1e3,
                                         .median = task->median_s * 1e3,
                                         .error = NAN,
                                         .reference = isnan(limit_ms) ? "none" : "5 ms",
                                         .reference_value = limit_ms,
                                         .ratio = task->best_s * 1e3 / limit_ms,
                                         .wanted = isnan(limit_ms) ? NAN : 1,
                                         .at_most = true});
}

int main(int argc, char **argv)
{
    struct bench bench;
    bench_init(&bench, argc, argv);
    struct work *nnls = calloc(1, sizeof *nnls), *squares = calloc(1, sizeof *squares);
    if (!nnls || !squares)
        return 1;
    make_chart(nnls);
    make_targets(nnls);
    nnls->n = bench_size(&bench, LIGHTS, 8);
    nnls->lighting =
        (struct ls_lighting){.n_patches = PATCHES, .n_channels = 3, .n_spectra = SPECTRA};
    ls_lighting_defaults(&nnls->lighting);
    nnls->lighting.mode = LS_SOLVE_PER_TARGET;
    nnls->chart = (struct ls_spectral_chart){.reflectance = nnls->reflectance,
                                             .n_patches = PATCHES,
                                             .reader = nnls->functionals,
                                             .n_readers = 3};
    *squares = *nnls;
    nnls->lighting.chart = nnls->l;
    squares->lighting.chart = squares->l;
    nnls->chart.reflectance = nnls->reflectance;
    squares->lighting.method = LS_SOLVE_LEAST_SQUARES;
    squares->lighting.tikhonov = 1e-3;
    struct bench_task tasks[] = {{.name = "NNLS", .run = solve, .data = nnls},
                                 {.name = "least squares", .run = solve, .data = squares}};
    bench_time(&bench, tasks, 2);
    print(&bench, "solve", &tasks[0], 5);
    print(&bench, "solve_least_squares", &tasks[1], 5);
    struct bench_task map = {.name = "RGB map", .run = solve_map, .data = nnls};
    bench_time(&bench, &map, 1);
    print(&bench, "solve_rgb_map", &map, NAN);
    free(nnls);
    free(squares);
    return 0;
}

#include "core/lighting.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { MAX_TARGETS = 3 };

struct ls_lighting_solver {
    enum ls_solve_mode mode;
    enum ls_solve_space space;
    size_t n_patches, n_channels, n_spectra, n_targets;
    double m[9];
    size_t n_solvers; /* shared or mono: 1, else one per output channel */
    struct ls_solver *solver[MAX_TARGETS];
};

void ls_lighting_defaults(struct ls_lighting *lighting)
{
    bool mono = lighting->n_channels == 1;
    lighting->mode = mono ? LS_SOLVE_PER_TARGET : LS_SOLVE_SHARED;
    lighting->method = mono ? LS_SOLVE_LEAST_SQUARES : LS_SOLVE_NNLS;
    lighting->tikhonov = mono ? 1e-3 : 0;
}

enum ls_solve_space ls_lighting_space(const struct ls_lighting *lighting)
{
    return lighting->m && lighting->n_channels == 3 ? LS_SOLVE_AFTER_M : LS_SOLVE_CAMERA_RAW;
}

size_t ls_lighting_solver_outputs(const struct ls_lighting_solver *solver)
{
    return solver->n_spectra * (solver->mode == LS_SOLVE_SHARED ? 1 : solver->n_targets);
}

void ls_lighting_solver_destroy(struct ls_lighting_solver *solver)
{
    if (!solver)
        return;
    for (size_t k = 0; k < solver->n_solvers; k++)
        ls_solver_destroy(solver->solver[k]);
    free(solver);
}

static void destroy_solver(struct ls_lighting_solver **solver)
{
    ls_lighting_solver_destroy(*solver);
}

static void apply_m(const double *m, const double *in, size_t stride, double *out)
{
    for (size_t r = 0; r < 3; r++)
        out[r * stride] =
            m[3 * r] * in[0] + m[3 * r + 1] * in[stride] + m[3 * r + 2] * in[2 * stride];
}

/* L in the space of the solve: [patch][channel][spectrum] */
static void chart_in_space(const struct ls_lighting *lighting, double *l)
{
    size_t n_s = lighting->n_spectra, n_c = lighting->n_channels;
    for (size_t k = 0; k < lighting->n_patches * n_c * n_s; k++)
        l[k] = lighting->chart[k];
    if (ls_lighting_space(lighting) != LS_SOLVE_AFTER_M)
        return;
    for (size_t p = 0; p < lighting->n_patches; p++)
        for (size_t s = 0; s < n_s; s++)
            apply_m(lighting->m, &lighting->chart[p * n_c * n_s + s], n_s, &l[p * n_c * n_s + s]);
}

static enum ls_err check(const struct ls_lighting *lighting, size_t n_targets, struct ls_diag *diag)
{
    if (lighting->n_channels != 1 && lighting->n_channels != 3)
        return ls_fail(diag, LS_ERR_INVALID, "lighting: %zu camera channels: expected 1 or 3",
                       lighting->n_channels);
    if (lighting->n_patches < 1 || lighting->n_patches > LS_SOLVE_MAX_ROWS / 3 ||
        lighting->n_spectra < 1 || lighting->n_spectra > LS_SOLVE_MAX_COLS)
        return ls_fail(
            diag, LS_ERR_INVALID, "lighting: %zu patches and %zu spectra: expected 1..%d and 1..%d",
            lighting->n_patches, lighting->n_spectra, LS_SOLVE_MAX_ROWS / 3, LS_SOLVE_MAX_COLS);
    bool per_target = lighting->mode == LS_SOLVE_PER_TARGET;
    if (per_target && (n_targets < 1 || n_targets > MAX_TARGETS))
        return ls_fail(diag, LS_ERR_INVALID, "lighting: %zu output channels: expected 1..%d",
                       n_targets, MAX_TARGETS);
    if (per_target && lighting->n_channels == 3 && n_targets != 3)
        return ls_fail(diag, LS_ERR_INVALID,
                       "lighting: %zu output channels of a three-channel chart: expected 3",
                       n_targets);
    return LS_OK;
}

/* Output channel t of a Bayer chart is fitted on its own channel; of a mono chart, on the only
 * one. */
static enum ls_err factor_channel(const struct ls_lighting *lighting, const double *l,
                                  size_t channel, double *scratch, struct ls_solver **out,
                                  struct ls_diag *diag)
{
    size_t n_p = lighting->n_patches, n_c = lighting->n_channels, n_s = lighting->n_spectra;
    double *a = scratch, *w = a + n_p * n_s;
    for (size_t p = 0; p < n_p; p++) {
        for (size_t s = 0; s < n_s; s++)
            a[p * n_s + s] = l[(p * n_c + channel) * n_s + s];
        w[p] = lighting->row_weight ? lighting->row_weight[p * n_c + channel] : 1;
    }
    struct ls_system system = {
        .rows = n_p, .cols = n_s, .a = a, .row_weight = w, .tikhonov = lighting->tikhonov};
    return ls_solver_create(&system, lighting->method, out, diag);
}

static enum ls_err factor(struct ls_lighting_solver *solver, const struct ls_lighting *lighting,
                          struct ls_diag *diag)
{
    size_t n_p = lighting->n_patches, n_c = lighting->n_channels, n_s = lighting->n_spectra;
    enum ls_err err = LS_OK;
    LS_CLEANUP_FREE double *l = calloc(n_p * n_c * n_s, sizeof *l);
    LS_CLEANUP_FREE double *scratch = calloc(n_p * (n_s + 1), sizeof *scratch);
    if (!l || !scratch)
        return ls_fail(diag, LS_ERR_NOMEM, "lighting: out of memory");
    chart_in_space(lighting, l);
    if (lighting->mode == LS_SOLVE_SHARED) {
        struct ls_system system = {.rows = n_p * n_c,
                                   .cols = n_s,
                                   .a = l,
                                   .row_weight = lighting->row_weight,
                                   .tikhonov = lighting->tikhonov};
        solver->n_solvers = 1;
        return ls_solver_create(&system, lighting->method, &solver->solver[0], diag);
    }
    solver->n_solvers = n_c;
    for (size_t c = 0; !err && c < n_c; c++)
        err = factor_channel(lighting, l, c, scratch, &solver->solver[c], diag);
    return err;
}

enum ls_err ls_lighting_solver_create(const struct ls_lighting *lighting, size_t n_targets,
                                      struct ls_lighting_solver **out, struct ls_diag *diag)
{
    *out = NULL;
    enum ls_err err = check(lighting, n_targets, diag);
    if (err)
        return err;
    __attribute__((cleanup(destroy_solver))) struct ls_lighting_solver *solver =
        calloc(1, sizeof *solver);
    if (!solver)
        return ls_fail(diag, LS_ERR_NOMEM, "lighting: out of memory");
    solver->mode = lighting->mode;
    solver->space = ls_lighting_space(lighting);
    solver->n_patches = lighting->n_patches;
    solver->n_channels = lighting->n_channels;
    solver->n_spectra = lighting->n_spectra;
    solver->n_targets = lighting->mode == LS_SOLVE_SHARED ? lighting->n_channels : n_targets;
    for (int i = 0; i < 9 && lighting->m; i++)
        solver->m[i] = lighting->m[i];
    err = factor(solver, lighting, diag);
    if (err)
        return err;
    *out = solver;
    solver = NULL;
    return LS_OK;
}

/* targets in the space of the solve; @b: shared [patch][channel], per-target [target][patch] */
static void targets_in_space(const struct ls_lighting_solver *solver, const double *targets,
                             double *b)
{
    size_t n_t = solver->n_targets, n_p = solver->n_patches;
    bool shared = solver->mode == LS_SOLVE_SHARED;
    for (size_t p = 0; p < n_p; p++) {
        double moved[MAX_TARGETS];
        const double *at = targets + p * n_t;
        if (solver->space == LS_SOLVE_AFTER_M) {
            apply_m(solver->m, at, 1, moved);
            at = moved;
        }
        for (size_t t = 0; t < n_t; t++)
            b[shared ? p * n_t + t : t * n_p + p] = at[t];
    }
}

static enum ls_err run_one(const struct ls_solver *solver, const double *b, double *alpha,
                           struct ls_solution *worst, struct ls_diag *diag)
{
    struct ls_solution one;
    enum ls_err err = ls_solver_run(solver, b, alpha, &one, diag);
    if (!err && one.relative >= worst->relative)
        *worst = one;
    return err;
}

enum ls_err ls_lighting_solver_run(const struct ls_lighting_solver *solver, const double *targets,
                                   double *alpha, struct ls_lighting_solution *out,
                                   struct ls_diag *diag)
{
    struct ls_lighting_solution solution = {.space = solver->space, .mode = solver->mode};
    size_t n_p = solver->n_patches;
    enum ls_err err = LS_OK;
    LS_CLEANUP_FREE double *b = malloc(n_p * solver->n_targets * sizeof *b);
    if (!b)
        return ls_fail(diag, LS_ERR_NOMEM, "lighting: out of memory");
    targets_in_space(solver, targets, b);
    if (solver->mode == LS_SOLVE_SHARED)
        err = run_one(solver->solver[0], b, alpha, &solution.worst, diag);
    for (size_t t = 0; !err && solver->mode == LS_SOLVE_PER_TARGET && t < solver->n_targets; t++)
        err = run_one(solver->solver[solver->n_solvers == 1 ? 0 : t], b + t * n_p,
                      alpha + t * solver->n_spectra, &solution.worst, diag);
    if (out)
        *out = solution;
    return err;
}

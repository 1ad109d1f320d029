#include "core/solve.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

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

static void apply_m(const double *m, const double *in, size_t stride, double *out)
{
    for (int r = 0; r < 3; r++)
        out[r * (int)stride] =
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

static void shared_targets(const struct ls_lighting *lighting, const double *targets, double *b)
{
    size_t n_c = lighting->n_channels;
    for (size_t p = 0; p < lighting->n_patches; p++) {
        if (ls_lighting_space(lighting) == LS_SOLVE_AFTER_M)
            apply_m(lighting->m, &targets[p * n_c], 1, &b[p * n_c]);
        else
            for (size_t c = 0; c < n_c; c++)
                b[p * n_c + c] = targets[p * n_c + c];
    }
}

static enum ls_err solve_one(const struct ls_lighting *lighting, const struct ls_system *system,
                             double *alpha, struct ls_solution *worst, struct ls_diag *diag)
{
    struct ls_solution one;
    enum ls_err err = lighting->method == LS_SOLVE_NNLS
                          ? ls_solve_nnls(system, alpha, &one, diag)
                          : ls_solve_least_squares(system, alpha, &one, diag);
    if (!err && one.relative >= worst->relative)
        *worst = one;
    return err;
}

/* Output channel t of a Bayer chart is fitted on its own channel; of a mono chart, on the only
 * one. */
static enum ls_err solve_target(const struct ls_lighting *lighting, const double *l,
                                const double *targets, size_t n_targets, size_t t, double *scratch,
                                double *alpha, struct ls_solution *worst, struct ls_diag *diag)
{
    size_t n_p = lighting->n_patches, n_c = lighting->n_channels, n_s = lighting->n_spectra;
    size_t channel = n_c == 1 ? 0 : t;
    double *a = scratch, *b = a + n_p * n_s, *w = b + n_p;
    for (size_t p = 0; p < n_p; p++) {
        for (size_t s = 0; s < n_s; s++)
            a[p * n_s + s] = l[(p * n_c + channel) * n_s + s];
        b[p] = targets[p * n_targets + t];
        w[p] = lighting->row_weight ? lighting->row_weight[p * n_c + channel] : 1;
    }
    struct ls_system system = {
        .rows = n_p, .cols = n_s, .a = a, .b = b, .row_weight = w, .tikhonov = lighting->tikhonov};
    return solve_one(lighting, &system, alpha + t * n_s, worst, diag);
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
    if (per_target && (n_targets < 1 || n_targets > 3))
        return ls_fail(diag, LS_ERR_INVALID, "lighting: %zu output channels: expected 1..3",
                       n_targets);
    if (per_target && lighting->n_channels == 3 && n_targets != 3)
        return ls_fail(diag, LS_ERR_INVALID,
                       "lighting: %zu output channels of a three-channel chart: expected 3",
                       n_targets);
    return LS_OK;
}

enum ls_err ls_lighting_solve(const struct ls_lighting *lighting, const double *targets,
                              size_t n_targets, double *alpha, struct ls_solution *out,
                              struct ls_diag *diag)
{
    struct ls_solution worst = {0};
    enum ls_err err = check(lighting, n_targets, diag);
    if (err)
        return err;
    size_t n_p = lighting->n_patches, n_c = lighting->n_channels, n_s = lighting->n_spectra;
    LS_CLEANUP_FREE double *l = calloc(n_p * n_c * n_s, sizeof *l);
    LS_CLEANUP_FREE double *scratch = calloc(n_p * (n_s + n_c + 2), sizeof *scratch);
    if (!l || !scratch)
        return ls_fail(diag, LS_ERR_NOMEM, "lighting: out of memory");
    chart_in_space(lighting, l);
    if (lighting->mode == LS_SOLVE_SHARED) {
        shared_targets(lighting, targets, scratch);
        struct ls_system system = {.rows = n_p * n_c,
                                   .cols = n_s,
                                   .a = l,
                                   .b = scratch,
                                   .row_weight = lighting->row_weight,
                                   .tikhonov = lighting->tikhonov};
        err = solve_one(lighting, &system, alpha, &worst, diag);
    } else {
        for (size_t t = 0; !err && t < n_targets; t++)
            err = solve_target(lighting, l, targets, n_targets, t, scratch, alpha, &worst, diag);
    }
    if (!err && out)
        *out = worst;
    return err;
}

void ls_lighting_targets(const struct ls_spectrum *reflectances, size_t n_patches,
                         const struct ls_spectrum *sensitivities, size_t n_channels,
                         const struct ls_spectrum *light, double *targets)
{
    for (size_t p = 0; p < n_patches; p++)
        for (size_t c = 0; c < n_channels; c++)
            targets[p * n_channels + c] =
                ls_spectrum_dot3(light, &reflectances[p], &sensitivities[c]);
}

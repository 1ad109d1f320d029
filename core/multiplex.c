#include "core/multiplex.h"

#include "core/bases.h"

#include <math.h>

static enum ls_err check(uint32_t order, uint32_t n_lights, double scale, struct ls_diag *diag)
{
    if (n_lights < 1 || n_lights > 65536 || order <= n_lights ||
        ls_multiplex_order(order - 1) != order)
        return ls_fail(diag, LS_ERR_INVALID,
                       "a multiplexing matrix of order %u does not serve %u lights: expected a "
                       "prime of 3 modulo 4 above them",
                       order, n_lights);
    if (!(scale > 0) || !isfinite(scale))
        return ls_fail(diag, LS_ERR_INVALID, "factor / duty is %g: expected a positive number",
                       scale);
    return LS_OK;
}

/* Row j lights the columns j + d^2: sum over them, each column once, by running over d. */
static double lit_sum(uint32_t order, uint32_t n_lights, uint32_t row, const double *weights)
{
    double sum = 0;
    uint32_t step = 1, column = row;
    for (uint32_t d = 0; d <= order / 2; d++) {
        if (column < n_lights)
            sum += weights[column];
        column = (column + step) % order;
        step += 2;
    }
    return sum;
}

enum ls_err ls_multiplex_weights(uint32_t order, uint32_t n_lights, double scale,
                                 const double *weights, double *row, struct ls_diag *diag)
{
    enum ls_err err = check(order, n_lights, scale, diag);
    double all = 0;
    for (uint32_t i = 0; i < n_lights && !err; i++) {
        if (!isfinite(weights[i]))
            err = ls_fail(diag, LS_ERR_INVALID, "the weight of light %u is not finite", i);
        all += weights[i];
    }
    for (uint32_t j = 0; j < order && !err; j++)
        row[j] = scale * 2 / (order + 1.0) * (2 * lit_sum(order, n_lights, j, weights) - all);
    return err;
}

static bool lights_column(uint32_t order, uint32_t row, uint32_t column)
{
    uint32_t step = 1, at = row;
    for (uint32_t d = 0; d <= order / 2; d++) {
        if (at == column)
            return true;
        at = (at + step) % order;
        step += 2;
    }
    return false;
}

enum ls_err ls_multiplex_spare(uint32_t order, uint32_t n_lights, double scale,
                               const float *const *rows, size_t n, double read_variance,
                               double dark_variance, double shot, struct ls_multiplex_spare *out,
                               struct ls_diag *diag)
{
    enum ls_err err = check(order, n_lights, scale, diag);
    if (err)
        return err;
    if (n == 0)
        return ls_fail(diag, LS_ERR_INVALID, "no samples of the multiplexed rows");
    double sum = 0, light = 0;
    for (uint32_t j = 0; j < order; j++) {
        double row = 0;
        for (size_t k = 0; k < n; k++) {
            if (!isfinite(rows[j][k]))
                return ls_fail(diag, LS_ERR_INVALID, "sample %zu of row %u is not finite", k, j);
            row += rows[j][k];
            light += fmax(rows[j][k], 0);
        }
        sum += lights_column(order, j, order - 1) ? row : -row;
    }
    double one = scale * 2 / (order + 1.0);
    double variance =
        one * one * (order * read_variance + dark_variance + shot * light / (double)n);
    out->mean = one * sum / (double)n;
    out->sigma = sqrt(variance / (double)n);
    out->alarm = fabs(out->mean) > 5 * out->sigma;
    return LS_OK;
}

enum ls_err ls_multiplex_noise(uint32_t order, uint32_t n_lights, double scale, double mean_e,
                               double read_variance, double shot, struct ls_multiplex_noise *out,
                               struct ls_diag *diag)
{
    enum ls_err err = check(order, n_lights, scale, diag);
    if (err)
        return err;
    if (!(mean_e >= 0) || !isfinite(mean_e) || !(read_variance >= 0) || !isfinite(read_variance) ||
        !(shot >= 0) || !isfinite(shot))
        return ls_fail(diag, LS_ERR_INVALID,
                       "noise of multiplexing: expected finite numbers, none negative");
    double p = order, read = scale * scale * 4 * p / ((p + 1) * (p + 1)) * read_variance;
    double per_e = scale * 2 * n_lights / (p + 1) * shot; /* of the variance, by the mean */
    out->single_sigma = sqrt(read_variance + shot * mean_e);
    out->multiplexed_sigma = sqrt(read + per_e * mean_e);
    out->gain = out->multiplexed_sigma > 0 ? out->single_sigma / out->multiplexed_sigma : 1;
    double gained = read_variance - read, lost = per_e - shot;
    if (lost > 0)
        out->break_even = fmax(gained / lost, 0);
    else
        out->break_even = gained >= 0 ? INFINITY : 0;
    return LS_OK;
}

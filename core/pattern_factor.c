#include "core/pattern_factor.h"

#include "core/merge.h"

#include <math.h>
#include <stdlib.h>

enum { LEAST = 50, ROUNDS = 4 };
static const double least_level = 0.05; /* of the brightest */
static const double reach = 6;          /* robust sigmas */

struct pair {
    double sum, shot; /* of the basis; photographed / duty */
    uint8_t colour, block, kept;
};

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static int good(const uint8_t *validity, uint32_t index)
{
    return !validity || validity[index] == LS_VALIDITY_OK || validity[index] == LS_VALIDITY_DARK;
}

static uint32_t gather(const struct ls_sphere_view *view, const float *sum,
                       const uint8_t *sum_validity, const float *photographed,
                       const uint8_t *validity, double duty, struct pair *pairs)
{
    uint32_t n = 0;
    for (uint32_t k = 0; k < view->n; k++) {
        const struct ls_sphere_pixel *p = &view->pixels[k];
        double a = (double)sum[p->index], b = (double)photographed[p->index] / duty;
        if (isfinite(a) && isfinite(b) && good(sum_validity, p->index) && good(validity, p->index))
            pairs[n++] = (struct pair){a, b, p->colour, p->block, 0};
    }
    return n;
}

/* Keep what is bright for its colour, by the basis, whose noise is the smaller one. */
static void keep_bright(struct pair *pairs, uint32_t n, double *room)
{
    for (int c = 0; c < 3; c++) {
        uint32_t m = 0;
        for (uint32_t k = 0; k < n; k++)
            if (pairs[k].colour == c)
                room[m++] = pairs[k].sum;
        if (!m)
            continue;
        qsort(room, m, sizeof *room, by_value);
        double brightest = room[(size_t)(0.98 * (m - 1))];
        for (uint32_t k = 0; k < n; k++)
            if (pairs[k].colour == c)
                pairs[k].kept = pairs[k].sum > least_level * brightest && brightest > 0;
    }
}

static double ratio_of_sums(const struct pair *pairs, uint32_t n)
{
    double a = 0, b = 0;
    for (uint32_t k = 0; k < n; k++)
        if (pairs[k].kept) {
            a += pairs[k].sum;
            b += pairs[k].shot;
        }
    return a / b;
}

static double off(const struct pair *p, double ratio)
{
    return (p->sum - ratio * p->shot) / sqrt(p->sum);
}

/* Median of ratios, or of absolute residuals about @ratio if that is positive. */
static double middle(const struct pair *pairs, uint32_t n, double ratio, double *room)
{
    uint32_t m = 0;
    for (uint32_t k = 0; k < n; k++)
        if (pairs[k].kept)
            room[m++] = ratio > 0 ? fabs(off(&pairs[k], ratio)) : pairs[k].shot / pairs[k].sum;
    qsort(room, m, sizeof *room, by_value);
    return m ? room[m / 2] : 0;
}

static uint32_t count(const struct pair *pairs, uint32_t n)
{
    uint32_t m = 0;
    for (uint32_t k = 0; k < n; k++)
        m += pairs[k].kept;
    return m;
}

static double estimate(struct pair *pairs, uint32_t n, double *room)
{
    double ratio = 1 / middle(pairs, n, 0, room);
    for (int round = 0; round < ROUNDS && ratio > 0 && isfinite(ratio); round++) {
        double limit = reach * 1.4826 * middle(pairs, n, ratio, room) + 1e-9;
        for (uint32_t k = 0; k < n; k++)
            pairs[k].kept = pairs[k].kept && fabs(off(&pairs[k], ratio)) <= limit;
        ratio = ratio_of_sums(pairs, n);
    }
    return ratio;
}

static double block_sigma(const struct pair *pairs, uint32_t n, double ratio)
{
    double sum[LS_SPHERE_BLOCKS * LS_SPHERE_BLOCKS] = {0}, shot = 0, square = 0;
    uint8_t there[LS_SPHERE_BLOCKS * LS_SPHERE_BLOCKS] = {0};
    double blocks = 0;
    for (uint32_t k = 0; k < n; k++) {
        if (!pairs[k].kept)
            continue;
        sum[pairs[k].block] += pairs[k].sum - ratio * pairs[k].shot;
        there[pairs[k].block] = 1;
        shot += pairs[k].shot;
    }
    for (size_t b = 0; b < sizeof there; b++) {
        blocks += there[b];
        square += sum[b] * sum[b];
    }
    return blocks > 1 ? sqrt(square * blocks / (blocks - 1)) / shot : INFINITY;
}

enum ls_err ls_pattern_factor(const struct ls_sphere_view *view, const float *sum,
                              const uint8_t *sum_validity, const float *photographed,
                              const uint8_t *validity, double duty, struct ls_pattern_factor *out,
                              struct ls_diag *diag)
{
    if (!(duty > 0 && duty <= 1))
        return ls_fail(diag, LS_ERR_INVALID, "pattern factor: duty %g: expected (0, 1]", duty);
    LS_CLEANUP_FREE struct pair *pairs = calloc(view->n, sizeof *pairs);
    LS_CLEANUP_FREE double *room = calloc(view->n, sizeof *room);
    if (!pairs || !room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a pattern factor");
    uint32_t n = gather(view, sum, sum_validity, photographed, validity, duty, pairs);
    keep_bright(pairs, n, room);
    if (count(pairs, n) < LEAST)
        return ls_fail(
            diag, LS_ERR_NOT_FOUND,
            "pattern factor: %u pixels of the grey sphere are lit by the pattern's single "
            "lights and usable, expected at least %d",
            count(pairs, n), LEAST);
    double ratio = estimate(pairs, n, room);
    out->n = count(pairs, n);
    if (out->n < LEAST || !(ratio >= 0.2 && ratio <= 5))
        return ls_fail(
            diag, LS_ERR_NOT_FOUND,
            "pattern factor: single lights over photographed pattern = %.4g from %u "
            "pixels, expected 0.2 to 5: is it the same pattern, duty %g, and one subject?",
            ratio, out->n, duty);
    out->factor = ratio;
    out->sigma = block_sigma(pairs, n, ratio);
    return LS_OK;
}

enum ls_err ls_pattern_factor_combine(const struct ls_pattern_factor *each, uint32_t n,
                                      struct ls_pattern_factor *out, struct ls_diag *diag)
{
    double w = 0, mean = 0, chi2 = 0;
    *out = (struct ls_pattern_factor){0};
    for (uint32_t k = 0; k < n; k++) {
        if (!(each[k].sigma > 0 && each[k].factor > 0) || !isfinite(each[k].sigma))
            return ls_fail(diag, LS_ERR_INVALID, "pattern factor: %g +- %g is none", each[k].factor,
                           each[k].sigma);
        w += 1 / (each[k].sigma * each[k].sigma);
        mean += each[k].factor / (each[k].sigma * each[k].sigma);
        out->n += each[k].n;
    }
    if (!n)
        return ls_fail(diag, LS_ERR_INVALID, "pattern factor: nothing to combine");
    out->factor = mean / w;
    for (uint32_t k = 0; k < n; k++) {
        double z = (each[k].factor - out->factor) / each[k].sigma;
        chi2 += z * z;
    }
    out->sigma = sqrt((n > 1 ? fmax(1, chi2 / (n - 1)) : 1) / w);
    return LS_OK;
}

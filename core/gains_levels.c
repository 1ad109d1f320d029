#include "core/gains_system.h"

#include "core/sample.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>

static const double dead_share = 0.02;

static int usable(const struct ls_gains_input *in, size_t at)
{
    return in->sigma[at] > 0 && isfinite(in->sigma[at]) && isfinite(in->strength[at]);
}

/* Middle strength of each camera and colour, over lights seen well. */
static double middle(const struct ls_gains_system *s, uint32_t j, float *room)
{
    size_t count = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        size_t at = (size_t)i * s->m + j;
        double lit = s->in->lit[i * s->in->n_cameras + j / s->in->n_colours];
        if (usable(s->in, at) && lit >= LS_GAINS_MIN_LIT)
            room[count++] = (float)s->in->strength[at];
    }
    return count ? (double)ls_median(room, count) : 0;
}

static double taper(double lit)
{
    double t = (lit - LS_GAINS_MIN_LIT) / LS_GAINS_MIN_LIT;
    return t < 0 ? 0 : t > 1 ? 1 : t;
}

static void enter(struct ls_gains_system *s, uint32_t i, uint32_t j, int *alive, int *seen)
{
    size_t at = (size_t)i * s->m + j;
    double q = s->in->strength[at], sigma = s->in->sigma[at];
    *seen = 1;
    if (q < dead_share * exp(s->level[j]) + 3 * sigma && sigma < 0.1 * exp(s->level[j]))
        return; /* known well enough to be no light */
    *alive = 1;
    if (q <= 5 * sigma)
        return;
    s->y[at] = log(q);
    s->var[at] = sigma / q * (sigma / q);
    if (q >= LS_GAINS_MIN_SNR * sigma)
        s->w[at] = taper(s->in->lit[i * s->in->n_cameras + j / s->in->n_colours]) / s->var[at];
}

enum ls_err ls_gains_gather(struct ls_gains_system *s, struct ls_diag *diag)
{
    LS_CLEANUP_FREE float *room = calloc(s->n, sizeof *room);
    if (!room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    int any = 0;
    for (uint32_t j = 0; j < s->m; j++) {
        double q = middle(s, j, room);
        any |= q > 0;
        s->level[j] = q > 0 ? log(q) : -INFINITY;
    }
    if (!any)
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: no light brightens the grey sphere in any camera: is it in place, "
                       "and did the lights come on?");
    for (uint32_t i = 0; i < s->n; i++) {
        int alive = 0, seen = 0;
        for (uint32_t j = 0; j < s->m; j++)
            if (usable(s->in, (size_t)i * s->m + j) && isfinite(s->level[j]))
                enter(s, i, j, &alive, &seen);
        if (seen && !alive)
            s->flags[i] |= LS_LIGHT_DEAD;
    }
    return LS_OK;
}

/* ---- levels from shared lights ---- */

double ls_gains_row_weight(const struct ls_gains_system *s, uint32_t i)
{
    double sum = 0;
    for (uint32_t j = 0; j < s->m; j++)
        sum += s->w[(size_t)i * s->m + j];
    return sum;
}

/* Normal equations of the levels with every light eliminated. */
static void reduce(const struct ls_gains_system *s, double *a, double *b)
{
    for (uint32_t i = 0; i < s->n; i++) {
        const double *w = s->w + (size_t)i * s->m, *y = s->y + (size_t)i * s->m;
        double sum = ls_gains_row_weight(s, i), mean = 0;
        if (!(sum > 0))
            continue;
        for (uint32_t j = 0; j < s->m; j++)
            mean += w[j] * y[j] / sum;
        for (uint32_t j = 0; j < s->m; j++) {
            b[j] += w[j] * (y[j] - mean);
            a[j * s->m + j] += w[j];
            for (uint32_t k = 0; k < s->m; k++)
                a[j * s->m + k] -= w[j] * w[k] / sum;
        }
    }
}

/* Which of the cameras and colours have any measurement; their component among shared lights. */
static uint32_t components(const struct ls_gains_system *s, uint32_t *part)
{
    uint32_t n_parts = 0, changed = 1;
    for (uint32_t j = 0; j < s->m; j++)
        part[j] = LS_GAINS_LEVELS + 1;
    for (uint32_t i = 0; i < s->n; i++)
        for (uint32_t j = 0; j < s->m; j++)
            if (s->w[(size_t)i * s->m + j] > 0)
                part[j] = j;
    while (changed) {
        changed = 0;
        for (uint32_t i = 0; i < s->n; i++) {
            uint32_t least = LS_GAINS_LEVELS + 1;
            for (uint32_t j = 0; j < s->m; j++)
                if (s->w[(size_t)i * s->m + j] > 0 && part[j] < least)
                    least = part[j];
            for (uint32_t j = 0; j < s->m; j++)
                if (s->w[(size_t)i * s->m + j] > 0 && part[j] > least) {
                    part[j] = least;
                    changed = 1;
                }
        }
    }
    for (uint32_t j = 0; j < s->m; j++)
        n_parts += part[j] == j;
    return n_parts;
}

enum ls_err ls_gains_levels(struct ls_gains_system *s, struct ls_diag *diag)
{
    uint32_t part[LS_GAINS_LEVELS], list[LS_GAINS_LEVELS], n = 0;
    uint32_t n_parts = components(s, part);
    if (!n_parts)
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: no light was measured at a signal of %g times its error with 10 %% "
                       "of the sphere lit: expose longer, or look at the sphere",
                       LS_GAINS_MIN_SNR);
    if (n_parts > 1)
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: the cameras fall into %u groups that share no light well seen by "
                       "both, so that their scales cannot be compared",
                       n_parts);
    LS_CLEANUP_FREE double *a = calloc((size_t)s->m * s->m, sizeof *a);
    LS_CLEANUP_FREE double *reduced = calloc((size_t)s->m * s->m, sizeof *reduced);
    double b[LS_GAINS_LEVELS] = {0}, rhs[LS_GAINS_LEVELS];
    if (!a || !reduced)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    reduce(s, a, b);
    for (uint32_t j = 0; j < s->m; j++)
        if (part[j] <= LS_GAINS_LEVELS && part[j] != j)
            list[n++] = j; /* the first one stays at 0 */
    for (uint32_t r = 0; r < n; r++) {
        rhs[r] = b[list[r]];
        for (uint32_t c = 0; c < n; c++)
            reduced[r * n + c] = a[list[r] * s->m + list[c]];
    }
    if (n && LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', (int)n, 1, reduced, (int)n, rhs, 1))
        return ls_fail(diag, LS_ERR_INVALID, "gains: the cameras' scales are not determined");
    for (uint32_t j = 0; j < s->m; j++)
        s->level[j] = part[j] == j ? 0 : s->level[j];
    for (uint32_t r = 0; r < n; r++)
        s->level[list[r]] = rhs[r];
    for (uint32_t j = 0; j < s->m; j++)
        if (part[j] > LS_GAINS_LEVELS)
            s->level[j] = NAN;
    return LS_OK;
}

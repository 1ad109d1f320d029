#include "core/spectrum.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { N = LS_SPECTRUM_N, ORDER = N + 3, MAX_ITERATIONS = 20000, MAX_ROUNDS = 20 };
enum { ONE_BY_ONE = 2 * N };         /* exchanges */
static const double penalty = 1e-12; /* 1 / weight of the equalities, functionals of norm 1 */

/** min s' H s / 2 + ||A s - b||^2 / (2 penalty), s >= 0; H = D'D, D the second
 * differences. */
struct qp {
    double a[3][N], target[3], b[3]; /* b = target + multipliers x penalty */
    double h[N][5];                  /* H is pentadiagonal: h[i][k] = H(i, i + k - 2) */
    bool free[N];
    double s[N], lambda[3], y[N]; /* y = H s + A' lambda, lambda = (A s - b) / penalty */
    double matrix[ORDER * ORDER], rhs[ORDER];
};

static void second_differences(struct qp *qp)
{
    static const double d[3] = {1, -2, 1};
    for (int r = 0; r + 2 < N; r++)
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++)
                qp->h[r + p][q - p + 2] += d[p] * d[q];
}

static double norm3(const double v[3])
{
    return hypot(hypot(v[0], v[1]), v[2]);
}

/* the QP in units where the longest functional and the RGB have norm 1; returns s's scale */
static double set_up(struct qp *qp, const double rgb[3], const struct ls_spectrum functionals[3])
{
    struct ls_spectrum unit = {{0}};
    double longest = 0;
    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (int i = 0; i < N; i++) {
            unit.v[i] = 1;
            qp->a[c][i] = ls_spectrum_dot(&unit, &functionals[c]);
            unit.v[i] = 0;
            sum += qp->a[c][i] * qp->a[c][i];
        }
        longest = fmax(longest, sqrt(sum));
    }
    double norm = norm3(rgb);
    for (int c = 0; c < 3; c++) {
        qp->target[c] = qp->b[c] = rgb[c] / norm;
        for (int i = 0; i < N; i++)
            qp->a[c][i] /= longest;
    }
    second_differences(qp);
    for (int i = 0; i < N; i++)
        qp->free[i] = true;
    return norm / longest;
}

static double gram(const struct qp *qp, int c, int d)
{
    double sum = 0;
    for (int i = 0; i < N; i++)
        sum += qp->a[c][i] * qp->a[d][i];
    return sum;
}

static bool independent(const struct qp *qp)
{
    double g[3][3], size = 1;
    for (int c = 0; c < 3; c++)
        for (int d = 0; d < 3; d++)
            g[c][d] = gram(qp, c, d);
    for (int c = 0; c < 3; c++)
        size *= g[c][c];
    double det = g[0][0] * (g[1][1] * g[2][2] - g[1][2] * g[2][1]) -
                 g[0][1] * (g[1][0] * g[2][2] - g[1][2] * g[2][0]) +
                 g[0][2] * (g[1][0] * g[2][1] - g[1][1] * g[2][0]);
    return det > 1e-12 * size;
}

static double h_at(const struct qp *qp, int i, int j)
{
    int k = j - i + 2;
    return k < 0 || k > 4 ? 0 : qp->h[i][k];
}

/* the stationary point on the free samples: [H A'; A -penalty] [s; lambda] = [0; b] */
static int solve_free(struct qp *qp)
{
    int index[N], n = 0, pivots[ORDER];
    for (int i = 0; i < N; i++)
        if (qp->free[i])
            index[n++] = i;
    int order = n + 3;
    memset(qp->matrix, 0, sizeof qp->matrix);
    for (int r = 0; r < n; r++) {
        for (int q = 0; q <= r; q++)
            qp->matrix[r * order + q] = h_at(qp, index[r], index[q]);
        for (int c = 0; c < 3; c++)
            qp->matrix[(n + c) * order + r] = qp->a[c][index[r]];
        qp->rhs[r] = 0;
    }
    for (int c = 0; c < 3; c++) {
        qp->matrix[(n + c) * order + n + c] = -penalty;
        qp->rhs[n + c] = qp->b[c];
    }
    /* the rows of the lower triangle are the columns of the upper one */
    int info =
        LAPACKE_dsysv(LAPACK_COL_MAJOR, 'U', order, 1, qp->matrix, order, pivots, qp->rhs, order);
    memset(qp->s, 0, sizeof qp->s);
    for (int r = 0; r < n; r++)
        qp->s[index[r]] = qp->rhs[r];
    for (int c = 0; c < 3; c++)
        qp->lambda[c] = qp->rhs[n + c];
    return info;
}

static void gradient(struct qp *qp)
{
    for (int i = 0; i < N; i++) {
        double y = 0;
        for (int k = 0; k < 5; k++)
            if (i + k - 2 >= 0 && i + k - 2 < N)
                y += qp->h[i][k] * qp->s[i + k - 2];
        for (int c = 0; c < 3; c++)
            y += qp->a[c][i] * qp->lambda[c];
        qp->y[i] = qp->free[i] ? 0 : y;
    }
}

static int infeasible(const struct qp *qp, bool bad[N])
{
    double largest_s = 0, largest_y = 0;
    int n = 0;
    for (int i = 0; i < N; i++) {
        largest_s = fmax(largest_s, fabs(qp->s[i]));
        largest_y = fmax(largest_y, fabs(qp->y[i]));
    }
    for (int i = 0; i < N; i++) {
        bad[i] = qp->free[i] ? qp->s[i] < -1e-11 * largest_s : qp->y[i] < -1e-9 * largest_y;
        n += bad[i];
    }
    return n;
}

static void exchange(struct qp *qp, const bool bad[N], bool only_last)
{
    for (int i = N - 1; i >= 0; i--) {
        if (!bad[i])
            continue;
        qp->free[i] = !qp->free[i];
        if (only_last)
            return;
    }
}

/* All that is bad at once, which takes few exchanges but may circle; then the last of it alone,
 * which cannot, but may take ages: so for a while, twice as long each time, and
 * again all at once from where that led. */
static enum ls_err pivot(struct qp *qp, unsigned *iterations, struct ls_diag *diag)
{
    int fewest = N + 1, patience = 3, one_by_one = 2 * N;
    bool bad[N];
    for (; *iterations < MAX_ITERATIONS; ++*iterations) {
        if (solve_free(qp) != 0)
            return ls_fail(diag, LS_ERR_BUG, "smoothest spectrum: the KKT system is singular");
        gradient(qp);
        int n = infeasible(qp, bad);
        if (n == 0)
            return LS_OK;
        bool wanders = patience < -one_by_one;
        one_by_one *= wanders ? 2 : 1;
        if (n < fewest || wanders) {
            fewest = n;
            patience = 3;
        } else {
            patience--;
        }
        exchange(qp, bad, patience < 0);
    }
    return ls_fail(diag, LS_ERR_BUG, "smoothest spectrum: no end after %d exchanges",
                   MAX_ITERATIONS);
}

static double misses(const struct qp *qp, double r[3])
{
    for (int c = 0; c < 3; c++) {
        r[c] = qp->target[c];
        for (int i = 0; i < N; i++)
            r[c] -= qp->a[c][i] * fmax(qp->s[i], 0);
    }
    return norm3(r);
}

/* the method of multipliers: each round adds what was missed to the right-hand side */
static enum ls_err solve(struct qp *qp, struct ls_smoothest *result, struct ls_diag *diag)
{
    double r[3], before = INFINITY;
    for (int round = 0; round < MAX_ROUNDS; round++) {
        enum ls_err err = pivot(qp, &result->iterations, diag);
        if (err)
            return err;
        result->iterations++;
        result->residual = misses(qp, r);
        if (result->residual < 1e-10 || result->residual > 0.95 * before)
            break;
        before = result->residual;
        for (int c = 0; c < 3; c++)
            qp->b[c] += r[c];
    }
    result->reachable = result->residual <= 1e-6;
    return LS_OK;
}

static bool inputs_finite(const double rgb[3], const struct ls_spectrum functionals[3])
{
    bool finite = true;
    for (int c = 0; c < 3; c++) {
        finite &= isfinite(rgb[c]);
        for (int i = 0; i < N; i++)
            finite &= isfinite(functionals[c].v[i]);
    }
    return finite;
}

enum ls_err ls_spectrum_smoothest(const double rgb[3], const struct ls_spectrum functionals[3],
                                  struct ls_spectrum *out, struct ls_smoothest *report,
                                  struct ls_diag *diag)
{
    struct ls_smoothest result = {.reachable = true};
    memset(out, 0, sizeof *out);
    if (!inputs_finite(rgb, functionals))
        return ls_fail(diag, LS_ERR_INVALID,
                       "smoothest spectrum: an RGB or a sensitivity is not a finite number");
    if (norm3(rgb) > 0) {
        LS_CLEANUP_FREE struct qp *qp = calloc(1, sizeof *qp);
        if (!qp)
            return ls_fail(diag, LS_ERR_NOMEM, "smoothest spectrum: out of memory");
        double scale = set_up(qp, rgb, functionals);
        if (!independent(qp))
            return ls_fail(diag, LS_ERR_INVALID,
                           "smoothest spectrum: the three sensitivities are linearly dependent");
        enum ls_err err = solve(qp, &result, diag);
        if (err)
            return err;
        for (int i = 0; i < N; i++)
            out->v[i] = fmax(qp->s[i], 0) * scale;
    }
    if (report)
        *report = result;
    return LS_OK;
}

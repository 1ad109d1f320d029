#include "core/solve.h"

#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static const double rank_threshold = 1e-12;

/** The weighted system with its Tikhonov rows, column-major. */
struct dense {
    int rows, data_rows, cols;
    double *a; /* [cols][rows] */
    double *b; /* [rows] */
};

static void dense_finish(struct dense *dense)
{
    free(dense->a);
    free(dense->b);
}

static enum ls_err check_system(const struct ls_system *system, struct ls_diag *diag)
{
    if (system->rows < 1 || system->rows > LS_SOLVE_MAX_ROWS || system->cols < 1 ||
        system->cols > LS_SOLVE_MAX_COLS)
        return ls_fail(diag, LS_ERR_INVALID,
                       "solve: %zu x %zu system: expected 1..%d rows and 1..%d columns",
                       system->rows, system->cols, LS_SOLVE_MAX_ROWS, LS_SOLVE_MAX_COLS);
    if (!(system->tikhonov >= 0 && system->tikhonov < INFINITY))
        return ls_fail(diag, LS_ERR_INVALID, "solve: tikhonov %g: expected a number >= 0",
                       system->tikhonov);
    for (size_t r = 0; r < system->rows; r++) {
        bool good = isfinite(system->b[r]);
        if (system->row_weight)
            good &= system->row_weight[r] >= 0 && isfinite(system->row_weight[r]);
        for (size_t c = 0; c < system->cols; c++)
            good &= isfinite(system->a[r * system->cols + c]);
        if (!good)
            return ls_fail(diag, LS_ERR_INVALID,
                           "solve: row %zu holds a value that is not finite, or a weight below 0",
                           r);
    }
    return LS_OK;
}

static double tikhonov_row(const struct dense *dense, double tikhonov)
{
    double trace = 0;
    for (int c = 0; c < dense->cols; c++)
        for (int r = 0; r < dense->data_rows; r++)
            trace += dense->a[c * dense->rows + r] * dense->a[c * dense->rows + r];
    return sqrt(tikhonov * trace / dense->cols);
}

static enum ls_err dense_init(struct dense *dense, const struct ls_system *system,
                              struct ls_diag *diag)
{
    enum ls_err err = check_system(system, diag);
    *dense = (struct dense){0};
    if (err)
        return err;
    dense->cols = (int)system->cols;
    dense->data_rows = (int)system->rows;
    dense->rows = dense->data_rows + (system->tikhonov > 0 ? dense->cols : 0);
    dense->a = calloc((size_t)dense->rows * system->cols, sizeof *dense->a);
    dense->b = calloc((size_t)dense->rows, sizeof *dense->b);
    if (!dense->a || !dense->b)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    for (int r = 0; r < dense->data_rows; r++) {
        double w = system->row_weight ? system->row_weight[r] : 1;
        dense->b[r] = w * system->b[r];
        for (int c = 0; c < dense->cols; c++)
            dense->a[c * dense->rows + r] = w * system->a[(size_t)r * system->cols + (size_t)c];
    }
    if (system->tikhonov > 0) {
        double t = tikhonov_row(dense, system->tikhonov);
        for (int c = 0; c < dense->cols; c++)
            dense->a[c * dense->rows + dense->data_rows + c] = t;
    }
    return LS_OK;
}

static double norm(const double *v, int n)
{
    double sum = 0, largest = 0;
    for (int i = 0; i < n; i++)
        largest = fmax(largest, fabs(v[i]));
    if (largest == 0)
        return 0;
    for (int i = 0; i < n; i++)
        sum += v[i] / largest * (v[i] / largest);
    return largest * sqrt(sum);
}

static void residual_of(const struct dense *dense, const double *x, double *r)
{
    for (int i = 0; i < dense->rows; i++)
        r[i] = -dense->b[i];
    for (int c = 0; c < dense->cols; c++)
        for (int i = 0; i < dense->rows; i++)
            r[i] += dense->a[c * dense->rows + i] * x[c];
}

/* singular values of the data rows */
static enum ls_err spectrum_of(const struct dense *dense, struct ls_solution *out,
                               struct ls_diag *diag)
{
    int m = dense->data_rows, n = dense->cols, least = m < n ? m : n;
    LS_CLEANUP_FREE double *a = calloc((size_t)m * (size_t)n, sizeof *a);
    double s[LS_SOLVE_MAX_COLS], superb[LS_SOLVE_MAX_COLS];
    if (!a)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    for (int c = 0; c < n; c++)
        memcpy(a + (size_t)c * (size_t)m, dense->a + (size_t)c * (size_t)dense->rows,
               sizeof(double) * (size_t)m);
    if (LAPACKE_dgesvd(LAPACK_COL_MAJOR, 'N', 'N', m, n, a, m, s, NULL, 1, NULL, 1, superb))
        return ls_fail(diag, LS_ERR_BUG, "solve: singular values did not converge");
    out->rank = 0;
    for (int i = 0; i < least; i++)
        out->rank += s[i] > rank_threshold * s[0];
    out->condition = (int)out->rank < n ? INFINITY : s[0] / s[n - 1];
    return LS_OK;
}

static enum ls_err report(const struct dense *dense, const double *x, struct ls_solution *out,
                          struct ls_diag *diag)
{
    LS_CLEANUP_FREE double *r = calloc((size_t)dense->rows, sizeof *r);
    if (!r)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    residual_of(dense, x, r);
    double scale = norm(dense->b, dense->data_rows);
    out->residual = norm(r, dense->data_rows);
    out->relative = scale > 0 ? out->residual / scale : 0;
    return spectrum_of(dense, out, diag);
}

static enum ls_err least_squares(const struct dense *dense, double *x, struct ls_diag *diag)
{
    int m = dense->rows, n = dense->cols, tall = m > n ? m : n, rank;
    LS_CLEANUP_FREE double *a = calloc((size_t)m * (size_t)n, sizeof *a);
    LS_CLEANUP_FREE double *b = calloc((size_t)tall, sizeof *b);
    double s[LS_SOLVE_MAX_COLS];
    if (!a || !b)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    memcpy(a, dense->a, sizeof(double) * (size_t)m * (size_t)n);
    memcpy(b, dense->b, sizeof(double) * (size_t)m);
    if (LAPACKE_dgelsd(LAPACK_COL_MAJOR, m, n, 1, a, m, b, tall, s, rank_threshold, &rank))
        return ls_fail(diag, LS_ERR_BUG, "solve: least squares did not converge");
    memcpy(x, b, sizeof(double) * (size_t)n);
    return LS_OK;
}

enum ls_err ls_solve_least_squares(const struct ls_system *system, double *x,
                                   struct ls_solution *out, struct ls_diag *diag)
{
    struct dense dense;
    struct ls_solution unused;
    out = out ? out : &unused;
    *out = (struct ls_solution){0};
    enum ls_err err = dense_init(&dense, system, diag);
    if (!err)
        err = least_squares(&dense, x, diag);
    if (!err)
        err = report(&dense, x, out, diag);
    dense_finish(&dense);
    return err;
}

/* --- Lawson and Hanson --- */

/** The set of columns that may be positive, with an orthonormal basis of their span. */
struct active_set {
    struct dense *dense;              /* columns scaled to norm 1, or zero */
    double scale[LS_SOLVE_MAX_COLS];  /* of the columns before */
    int member[LS_SOLVE_MAX_COLS], n; /* in order of entry */
    bool inside[LS_SOLVE_MAX_COLS], barred[LS_SOLVE_MAX_COLS];
    double x[LS_SOLVE_MAX_COLS], z[LS_SOLVE_MAX_COLS];
    double r[LS_SOLVE_MAX_COLS][LS_SOLVE_MAX_COLS]; /* columns of the triangular factor */
    double *q, *residual;                           /* [cols][rows], [rows] */
};

static double dot(const double *a, const double *b, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

static const double *column_of(const struct active_set *set, int c)
{
    return set->dense->a + (size_t)c * (size_t)set->dense->rows;
}

/* append column c to the basis, orthogonalised twice; false if it depends on those inside */
static bool push(struct active_set *set, int c)
{
    int m = set->dense->rows, n = set->n;
    double *v = set->q + (size_t)n * (size_t)m, *r = set->r[n];
    memcpy(v, column_of(set, c), sizeof(double) * (size_t)m);
    memset(r, 0, sizeof set->r[n]);
    for (int pass = 0; pass < 2; pass++) {
        for (int k = 0; k < n; k++) {
            const double *q = set->q + (size_t)k * (size_t)m;
            double h = dot(q, v, m);
            r[k] += h;
            for (int i = 0; i < m; i++)
                v[i] -= h * q[i];
        }
    }
    double length = norm(v, m);
    if (length <= 1e-11)
        return false;
    r[n] = length;
    for (int i = 0; i < m; i++)
        v[i] /= length;
    set->member[set->n++] = c;
    return true;
}

/* z = the unconstrained solution on the members */
static void solve_members(struct active_set *set)
{
    int m = set->dense->rows;
    for (int k = set->n - 1; k >= 0; k--) {
        double sum = dot(set->q + (size_t)k * (size_t)m, set->dense->b, m);
        for (int j = k + 1; j < set->n; j++)
            sum -= set->r[j][k] * set->z[set->member[j]];
        set->z[set->member[k]] = sum / set->r[k][k];
    }
}

static void rebuild(struct active_set *set)
{
    int n = set->n, member[LS_SOLVE_MAX_COLS];
    memcpy(member, set->member, sizeof member);
    set->n = 0;
    for (int k = 0; k < n; k++) {
        if (set->inside[member[k]] && !push(set, member[k])) {
            set->inside[member[k]] = false;
            set->x[member[k]] = 0;
        }
    }
}

static void refresh_residual(struct active_set *set)
{
    residual_of(set->dense, set->x, set->residual);
}

/* the column of steepest descent, ties to the lowest index; -1 at a KKT point */
static int steepest(const struct active_set *set, double tolerance)
{
    double descent[LS_SOLVE_MAX_COLS], best = tolerance;
    for (int c = 0; c < set->dense->cols; c++) {
        descent[c] = 0;
        if (!set->inside[c] && !set->barred[c])
            descent[c] = -dot(column_of(set, c), set->residual, set->dense->rows);
        best = fmax(best, descent[c]);
    }
    for (int c = 0; c < set->dense->cols; c++)
        if (descent[c] > tolerance && descent[c] >= best * (1 - 1e-12))
            return c;
    return -1;
}

/* the member that reaches zero first on the way from x to z, and how far that is; -1 = none */
static int first_to_zero(const struct active_set *set, double *step)
{
    int first = -1;
    *step = 1;
    for (int k = 0; k < set->n; k++) {
        int c = set->member[k];
        double reach = set->z[c] <= 0 ? set->x[c] / (set->x[c] - set->z[c]) : 2;
        if (reach < *step || (reach <= 1 && first < 0)) {
            *step = reach;
            first = c;
        }
    }
    return first;
}

/* move from x towards z until a member reaches zero, drop it, again; ends at a feasible z */
static void walk(struct active_set *set)
{
    for (;;) {
        double step;
        solve_members(set);
        int first = first_to_zero(set, &step);
        for (int k = 0; k < set->n; k++) {
            int c = set->member[k];
            set->x[c] += step * (set->z[c] - set->x[c]);
            if (first < 0)
                set->x[c] = set->z[c];
            if (c == first || (first >= 0 && set->x[c] <= 0)) {
                set->x[c] = 0;
                set->inside[c] = false;
            }
        }
        if (first < 0)
            return;
        rebuild(set);
    }
}

static bool enter(struct active_set *set, int c)
{
    if (!push(set, c)) {
        set->barred[c] = true;
        return false;
    }
    solve_members(set);
    if (set->z[c] <= 0) {
        set->n--;
        set->barred[c] = true;
        return false;
    }
    set->inside[c] = true;
    memset(set->barred, 0, sizeof set->barred);
    return true;
}

static double scale_columns(struct active_set *set)
{
    int m = set->dense->rows;
    for (int c = 0; c < set->dense->cols; c++) {
        double *a = set->dense->a + (size_t)c * (size_t)m, s = norm(a, m);
        set->scale[c] = s;
        for (int i = 0; i < m && s > 0; i++)
            a[i] /= s;
    }
    return norm(set->dense->b, m);
}

static double kkt_violation(struct active_set *set, double b_norm)
{
    double worst = 0;
    if (b_norm == 0)
        return 0;
    refresh_residual(set);
    for (int c = 0; c < set->dense->cols; c++) {
        double gradient = dot(column_of(set, c), set->residual, set->dense->rows);
        worst = fmax(worst, set->inside[c] ? fabs(gradient) : -gradient);
    }
    return worst / b_norm;
}

static enum ls_err lawson_hanson(struct active_set *set, struct ls_solution *out,
                                 struct ls_diag *diag)
{
    double b_norm = scale_columns(set);
    unsigned limit = 100u * (unsigned)set->dense->cols;
    refresh_residual(set);
    for (int c; (c = steepest(set, 1e-12 * b_norm)) >= 0;) {
        if (out->iterations++ == limit)
            return ls_fail(diag, LS_ERR_BUG, "nnls: no end after %u iterations", limit);
        if (!enter(set, c))
            continue;
        walk(set);
        refresh_residual(set);
    }
    out->kkt = kkt_violation(set, b_norm);
    return LS_OK;
}

static enum ls_err nnls(struct dense *dense, double *x, struct ls_solution *out,
                        struct ls_diag *diag)
{
    LS_CLEANUP_FREE struct active_set *set = calloc(1, sizeof *set);
    LS_CLEANUP_FREE double *q = calloc((size_t)dense->rows * ((size_t)dense->cols + 1), sizeof *q);
    LS_CLEANUP_FREE double *residual = calloc((size_t)dense->rows, sizeof *residual);
    if (!set || !q || !residual)
        return ls_fail(diag, LS_ERR_NOMEM, "nnls: out of memory");
    set->dense = dense;
    set->q = q;
    set->residual = residual;
    enum ls_err err = lawson_hanson(set, out, diag);
    for (int c = 0; !err && c < dense->cols; c++)
        x[c] = set->scale[c] > 0 ? set->x[c] / set->scale[c] : 0;
    return err;
}

enum ls_err ls_solve_nnls(const struct ls_system *system, double *x, struct ls_solution *out,
                          struct ls_diag *diag)
{
    struct dense scaled = {0}, dense;
    struct ls_solution unused;
    out = out ? out : &unused;
    *out = (struct ls_solution){0};
    enum ls_err err = dense_init(&dense, system, diag);
    if (!err)
        err = dense_init(&scaled, system, diag);
    if (!err)
        err = nnls(&scaled, x, out, diag);
    if (!err)
        err = report(&dense, x, out, diag);
    dense_finish(&dense);
    dense_finish(&scaled);
    return err;
}

#include "core/solve.h"

#include "core/nnls.h"

#include <lapacke.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static const double rank_threshold = 1e-12;

struct ls_solver {
    enum ls_solve_method method;
    int rows, cols, inner; /* inner: rows of the reduced system */
    double *wa;            /* W A, [rows][cols] */
    double *weight;        /* [rows], or NULL */
    double *q;             /* c = q W b: [inner][rows] */
    double *reduced;       /* [cols][inner]: NNLS, unit columns; least squares, x = reduced c */
    double scale[LS_SOLVE_MAX_COLS]; /* NNLS: x is divided by it; 0 = a zero column */
    double tikhonov;                 /* the diagonal of the Tikhonov rows */
    unsigned rank;
    double condition;
};

void ls_solver_destroy(struct ls_solver *solver)
{
    if (!solver)
        return;
    free(solver->wa);
    free(solver->weight);
    free(solver->q);
    free(solver->reduced);
    free(solver);
}

static void destroy_solver(struct ls_solver **solver)
{
    ls_solver_destroy(*solver);
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
        double w = system->row_weight ? system->row_weight[r] : 1;
        bool good = w >= 0 && isfinite(w);
        for (size_t c = 0; c < system->cols; c++)
            good &= isfinite(w * system->a[r * system->cols + c]);
        if (!good)
            return ls_fail(diag, LS_ERR_INVALID,
                           "solve: row %zu holds a value that is not finite, or a weight below 0",
                           r);
    }
    return LS_OK;
}

/* sqrt(t x mean diagonal), without overflow */
static double tikhonov_diagonal(const struct ls_solver *solver, double t)
{
    int n = solver->rows * solver->cols;
    return sqrt(t / solver->cols) * ls_nnls_norm(solver->wa, n);
}

static enum ls_err copy_system(struct ls_solver *solver, const struct ls_system *system,
                               struct ls_diag *diag)
{
    size_t n = system->rows * system->cols;
    solver->rows = (int)system->rows;
    solver->cols = (int)system->cols;
    solver->wa = malloc(n * sizeof *solver->wa);
    solver->weight = system->row_weight ? malloc(system->rows * sizeof(double)) : NULL;
    if (!solver->wa || (system->row_weight && !solver->weight))
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    for (size_t k = 0; k < n; k++)
        solver->wa[k] =
            (system->row_weight ? system->row_weight[k / system->cols] : 1) * system->a[k];
    if (system->row_weight)
        memcpy(solver->weight, system->row_weight, system->rows * sizeof(double));
    solver->tikhonov = tikhonov_diagonal(solver, system->tikhonov);
    return LS_OK;
}

/** Singular vectors and values of W A: inner = min(rows, cols). */
struct svd {
    int inner;
    double s[LS_SOLVE_MAX_COLS];
    double *u;                                        /* [inner][rows] */
    double vt[LS_SOLVE_MAX_COLS * LS_SOLVE_MAX_COLS]; /* [cols][inner] */
};

static enum ls_err decompose(const struct ls_solver *solver, struct svd *svd, struct ls_diag *diag)
{
    int m = solver->rows, n = solver->cols, inner = m < n ? m : n;
    double superb[LS_SOLVE_MAX_COLS];
    LS_CLEANUP_FREE double *a = malloc((size_t)m * (size_t)n * sizeof *a);
    svd->inner = inner;
    svd->u = malloc((size_t)m * (size_t)inner * sizeof *svd->u);
    if (!a || !svd->u)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    for (int r = 0; r < m; r++)
        for (int c = 0; c < n; c++)
            a[(size_t)c * (size_t)m + (size_t)r] = solver->wa[(size_t)r * (size_t)n + (size_t)c];
    if (LAPACKE_dgesvd(LAPACK_COL_MAJOR, 'S', 'S', m, n, a, m, svd->s, svd->u, m, svd->vt, inner,
                       superb))
        return ls_fail(diag, LS_ERR_BUG, "solve: singular values did not converge");
    return LS_OK;
}

static void describe(struct ls_solver *solver, const struct svd *svd)
{
    solver->rank = 0;
    for (int i = 0; i < svd->inner; i++)
        solver->rank += svd->s[i] > rank_threshold * svd->s[0];
    solver->condition =
        (int)solver->rank < solver->cols ? INFINITY : svd->s[0] / svd->s[solver->cols - 1];
}

/* s / (s^2 + t^2), without overflow; 0 for what counts as a zero */
static double inverse(double s, double largest, double t)
{
    if (t == 0)
        return s > rank_threshold * largest ? 1 / s : 0;
    return s >= t ? 1 / (s + t * (t / s)) : s / t / (s * (s / t) + t);
}

static enum ls_err prepare_least_squares(struct ls_solver *solver, struct svd *svd,
                                         struct ls_diag *diag)
{
    size_t inner = (size_t)svd->inner;
    solver->inner = svd->inner;
    solver->reduced = malloc((size_t)solver->cols * inner * sizeof *solver->reduced);
    if (!solver->reduced)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    for (size_t c = 0; c < (size_t)solver->cols; c++)
        for (size_t i = 0; i < inner; i++)
            solver->reduced[c * inner + i] =
                svd->vt[c * inner + i] * inverse(svd->s[i], svd->s[0], solver->tikhonov);
    solver->q = svd->u;
    svd->u = NULL;
    return LS_OK;
}

/* W A over its Tikhonov rows, in unit columns, column-major [cols][rows + cols] */
static void unit_columns(struct ls_solver *solver, double *a, int rows)
{
    for (int c = 0; c < solver->cols; c++) {
        double *column = a + (size_t)c * (size_t)rows;
        for (int r = 0; r < solver->rows; r++)
            column[r] = solver->wa[r * solver->cols + c];
        if (rows > solver->rows)
            column[solver->rows + c] = solver->tikhonov;
        solver->scale[c] = ls_nnls_norm(column, rows);
        for (int r = 0; r < rows && solver->scale[c] > 0; r++)
            column[r] /= solver->scale[c];
    }
}

/* ||A x - b||^2 = ||R x - Q'b||^2 + what no x changes: Q and R of the unit columns */
static enum ls_err prepare_nnls(struct ls_solver *solver, struct ls_diag *diag)
{
    int n = solver->cols, m = solver->rows + (solver->tikhonov > 0 ? n : 0);
    int inner = m < n ? m : n;
    double tau[LS_SOLVE_MAX_COLS];
    LS_CLEANUP_FREE double *a = calloc((size_t)m * (size_t)n, sizeof *a);
    solver->inner = inner;
    solver->reduced = calloc((size_t)n * (size_t)inner, sizeof *solver->reduced);
    solver->q = malloc((size_t)inner * (size_t)solver->rows * sizeof *solver->q);
    if (!a || !solver->reduced || !solver->q)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    unit_columns(solver, a, m);
    if (LAPACKE_dgeqrf(LAPACK_COL_MAJOR, m, n, a, m, tau))
        return ls_fail(diag, LS_ERR_BUG, "solve: the factorisation failed");
    for (int c = 0; c < n; c++)
        for (int i = 0; i <= c && i < inner; i++)
            solver->reduced[c * inner + i] = a[(size_t)c * (size_t)m + (size_t)i];
    if (LAPACKE_dorgqr(LAPACK_COL_MAJOR, m, inner, inner, a, m, tau))
        return ls_fail(diag, LS_ERR_BUG, "solve: the factorisation failed");
    for (int i = 0; i < inner; i++)
        memcpy(solver->q + (size_t)i * (size_t)solver->rows, a + (size_t)i * (size_t)m,
               (size_t)solver->rows * sizeof(double));
    return LS_OK;
}

enum ls_err ls_solver_create(const struct ls_system *system, enum ls_solve_method method,
                             struct ls_solver **out, struct ls_diag *diag)
{
    *out = NULL;
    enum ls_err err = check_system(system, diag);
    if (err)
        return err;
    __attribute__((cleanup(destroy_solver))) struct ls_solver *solver = calloc(1, sizeof *solver);
    LS_CLEANUP_FREE struct svd *svd = calloc(1, sizeof *svd);
    if (!solver || !svd)
        return ls_fail(diag, LS_ERR_NOMEM, "solve: out of memory");
    solver->method = method;
    err = copy_system(solver, system, diag);
    if (!err)
        err = decompose(solver, svd, diag);
    if (!err) {
        describe(solver, svd);
        err = method == LS_SOLVE_NNLS ? prepare_nnls(solver, diag)
                                      : prepare_least_squares(solver, svd, diag);
    }
    free(svd->u);
    if (err)
        return err;
    *out = solver;
    solver = NULL;
    return LS_OK;
}

/** A sum of squares that neither overflows nor underflows. */
struct square_sum {
    double scale, sum; /* scale^2 sum */
};

static void add_square(struct square_sum *squares, double v)
{
    double size = fabs(v);
    if (size > squares->scale) {
        double shrink = squares->scale / size;
        squares->sum = 1 + squares->sum * shrink * shrink;
        squares->scale = size;
    } else if (size > 0) {
        squares->sum += size / squares->scale * (size / squares->scale);
    }
}

static double weighted(const struct ls_solver *solver, const double *b, int r)
{
    return solver->weight ? solver->weight[r] * b[r] : b[r];
}

static double dot(const double *a, const double *b, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* ||W (A x - b)||; x = NULL: ||W b|| */
static double residual_of(const struct ls_solver *solver, const double *x, const double *b)
{
    double plain = 0;
    int n = solver->cols;
    for (int r = 0; r < solver->rows; r++) {
        double e = -weighted(solver, b, r);
        if (x)
            e += dot(solver->wa + (size_t)r * (size_t)n, x, n);
        plain += e * e;
    }
    if (plain > 1e-280 && plain < 1e280)
        return sqrt(plain);
    struct square_sum squares = {0, 0};
    for (int r = 0; r < solver->rows; r++) {
        double e = -weighted(solver, b, r);
        if (x)
            e += dot(solver->wa + (size_t)r * (size_t)n, x, n);
        add_square(&squares, e);
    }
    return squares.scale * sqrt(squares.sum);
}

/* c = Q' W b */
static void project(const struct ls_solver *solver, const double *b, double *c)
{
    for (int i = 0; i < solver->inner; i++) {
        const double *q = solver->q + (size_t)i * (size_t)solver->rows;
        c[i] = 0;
        for (int r = 0; r < solver->rows; r++)
            c[i] += q[r] * weighted(solver, b, r);
    }
}

static enum ls_err run_nnls(const struct ls_solver *solver, const double *c, double *x,
                            struct ls_solution *out, struct ls_diag *diag)
{
    const struct ls_nnls problem = {solver->inner, solver->cols, solver->reduced, c};
    if (!ls_nnls_solve(&problem, x, &out->iterations))
        return ls_fail(diag, LS_ERR_BUG, "nnls: no end after %u iterations", out->iterations);
    out->kkt = ls_nnls_violation(&problem, x);
    for (int i = 0; i < solver->cols; i++)
        x[i] = solver->scale[i] > 0 ? x[i] / solver->scale[i] : 0;
    return LS_OK;
}

enum ls_err ls_solver_run(const struct ls_solver *solver, const double *b, double *x,
                          struct ls_solution *out, struct ls_diag *diag)
{
    struct ls_solution unused;
    double c[LS_SOLVE_MAX_COLS];
    enum ls_err err = LS_OK;
    out = out ? out : &unused;
    *out = (struct ls_solution){.rank = solver->rank, .condition = solver->condition};
    for (int r = 0; r < solver->rows; r++)
        if (!isfinite(weighted(solver, b, r)))
            return ls_fail(diag, LS_ERR_INVALID, "solve: right side %d is not a finite number", r);
    project(solver, b, c);
    if (solver->method == LS_SOLVE_NNLS)
        err = run_nnls(solver, c, x, out, diag);
    else
        for (int i = 0; i < solver->cols; i++)
            x[i] = dot(solver->reduced + (size_t)i * (size_t)solver->inner, c, solver->inner);
    if (err)
        return err;
    double size = residual_of(solver, NULL, b);
    out->residual = residual_of(solver, x, b);
    out->relative = size > 0 ? out->residual / size : 0;
    return LS_OK;
}

enum ls_err ls_solve(const struct ls_system *system, enum ls_solve_method method, double *x,
                     struct ls_solution *out, struct ls_diag *diag)
{
    struct ls_solver *solver;
    enum ls_err err = ls_solver_create(system, method, &solver, diag);
    if (!err)
        err = ls_solver_run(solver, system->b, x, out, diag);
    ls_solver_destroy(solver);
    return err;
}

/*
 * solve: small least-squares problems, plain or with non-negative unknowns, for many right sides.
 * Layer: core. Threads: any; a solver is read-only once made. Ownership: a solver copies its
 * system; arrays are the caller's.
 *
 * A solver factors its matrix once and then solves a right side of 72 rows and 6 unknowns in about
 * a microsecond: 346 directions x 3 outputs are milliseconds.
 *
 * Sources: Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23; Golub and Van Loan,
 * Matrix Computations, 4th ed., 5.5 and 6.1 (singular values, Tikhonov).
 */
#ifndef LS_CORE_SOLVE_H
#define LS_CORE_SOLVE_H

#include "core/error.h"

#include <stddef.h>

enum { LS_SOLVE_MAX_COLS = 64, LS_SOLVE_MAX_ROWS = 65536 };

/** min over x of sum_r w_r^2 (A x - b)_r^2 + t mean_j(diag(A' W^2 A)) ||x||^2. */
struct ls_system {
    size_t rows, cols;        /* 1 .. LS_SOLVE_MAX_ROWS, 1 .. LS_SOLVE_MAX_COLS */
    const double *a;          /* [rows][cols] */
    const double *b;          /* [rows]; unused by ls_solver_create */
    const double *row_weight; /* [rows], >= 0; NULL = 1 */
    double tikhonov;          /* t >= 0, relative to the mean diagonal */
};

enum ls_solve_method { LS_SOLVE_NNLS, LS_SOLVE_LEAST_SQUARES };

struct ls_solution {
    double residual;     /* ||W (A x - b)||, without the Tikhonov rows */
    double relative;     /* residual / ||W b||; 0 if b = 0 */
    unsigned rank;       /* of W A, singular values above 1e-12 of the largest */
    double condition;    /* largest / smallest singular value of W A; INFINITY if rank < cols */
    double kkt;          /* NNLS: largest violation of the KKT conditions, relative (see below) */
    unsigned iterations; /* NNLS */
};

struct ls_solver;

/**
 * Factor W A (with its Tikhonov rows) for @method. (transfer full).
 *
 * Least squares: minimum norm when rank-deficient, by singular values; those below 1e-12 of the
 * largest count as zero unless t > 0.
 *
 * NNLS: the exact active-set method of Lawson and Hanson on columns scaled to unit norm, so column
 * scales of 1e-30 .. 1e30 change nothing. Enters the column of steepest descent, ties (1e-12) to
 * the lowest index. A column of which less than 1e-14 lies outside the span of those in the set
 * does not enter, so duplicated and rank-1 systems end too; so does a set that no longer lowers the
 * residual. With S = ||W b|| + sum_j ||W a_j|| x_j, the size of what is added up: at exit x >= 0
 * and the gradient of unit columns is >= -1e-12 S everywhere and within 1e-12 S of 0 where x > 0;
 * the objective is within 1e-13 S of the least (as a norm), whatever the condition. That is what
 * an x in doubles can carry.
 *
 * Errors: LS_ERR_INVALID (sizes, a value that is not finite), LS_ERR_NOMEM, LS_ERR_BUG.
 */
LS_MUST_CHECK enum ls_err ls_solver_create(const struct ls_system *system,
                                           enum ls_solve_method method, struct ls_solver **out,
                                           struct ls_diag *diag);

/** NULL is allowed. */
void ls_solver_destroy(struct ls_solver *solver);

/** Solve for one right side b[rows]; x[cols]. @out may be NULL. Allocates nothing. Reentrant.
 * Errors: LS_ERR_INVALID (a value of b that is not finite), LS_ERR_BUG (no end). */
LS_MUST_CHECK enum ls_err ls_solver_run(const struct ls_solver *solver, const double *b, double *x,
                                        struct ls_solution *out, struct ls_diag *diag);

/** Create, run for the system's own b, destroy. */
LS_MUST_CHECK enum ls_err ls_solve(const struct ls_system *system, enum ls_solve_method method,
                                   double *x, struct ls_solution *out, struct ls_diag *diag);

#endif

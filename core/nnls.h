/*
 * nnls: the active-set method behind core/solve.h, on a system already reduced to as many rows as
 * it has unknowns.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 */
#ifndef LS_CORE_NNLS_H
#define LS_CORE_NNLS_H

#include <stdbool.h>

/** min over x >= 0 of ||A x - b||. */
struct ls_nnls {
    int rows, cols;  /* 1 .. LS_SOLVE_MAX_COLS both */
    const double *a; /* [cols][rows], every column of norm 1 or 0 */
    const double *b; /* [rows] */
};

/** x[cols]; guarantees and tolerances: core/solve.h. false if it found no end in 100 x cols
 * iterations. @iterations: how many it took. RT-safe. */
bool ls_nnls_solve(const struct ls_nnls *problem, double *x, unsigned *iterations);

/** Largest violation of the KKT conditions at x, over ||b|| + sum |x|. RT-safe. */
double ls_nnls_violation(const struct ls_nnls *problem, const double *x);

/** ||v||, without overflow. RT-safe. */
double ls_nnls_norm(const double *v, int n);

#endif

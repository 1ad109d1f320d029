#include "core/nnls.h"

#include "core/solve.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { MAX = LS_SOLVE_MAX_COLS };
static const double dependent = 1e-14, no_descent = 1e-15, tie = 1e-12;
static const double fitted = 1e-16; /* a residual that is rounding of b */

/** The columns that may be positive, with an orthonormal basis of their span. */
struct active_set {
    const struct ls_nnls *problem;
    int member[MAX], n; /* in order of entry */
    bool inside[MAX], barred[MAX];
    double x[MAX], z[MAX];
    double q[MAX][MAX];    /* basis; only the first rows entries of each are used */
    double r[MAX][MAX];    /* columns of the triangular factor */
    double projected[MAX]; /* q' b */
    double residual[MAX];  /* b - Q Q' b */
};

double ls_nnls_norm(const double *v, int n)
{
    double sum = 0, largest = 0;
    for (int i = 0; i < n; i++)
        sum += v[i] * v[i];
    if (sum > 1e-280 && sum < 1e280)
        return sqrt(sum);
    for (int i = 0; i < n; i++)
        largest = fmax(largest, fabs(v[i]));
    if (largest == 0 || !isfinite(largest))
        return largest;
    sum = 0;
    for (int i = 0; i < n; i++)
        sum += v[i] / largest * (v[i] / largest);
    return largest * sqrt(sum);
}

static double dot(const double *a, const double *b, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

static const double *column(const struct active_set *set, int c)
{
    return set->problem->a + (size_t)c * (size_t)set->problem->rows;
}

/* take out of @v what lies in the basis, twice for orthogonality; @h += the coefficients */
static void project_out(const struct active_set *set, double *v, double *h)
{
    int m = set->problem->rows;
    for (int pass = 0; pass < 2; pass++) {
        for (int k = 0; k < set->n; k++) {
            double along = dot(set->q[k], v, m);
            h[k] += along;
            for (int i = 0; i < m; i++)
                v[i] -= along * set->q[k][i];
        }
    }
}

/* append column c to the basis; false if it depends on those inside */
static bool push(struct active_set *set, int c)
{
    int m = set->problem->rows, n = set->n;
    double *v = set->q[n];
    memcpy(v, column(set, c), sizeof(double) * (size_t)m);
    memset(set->r[n], 0, sizeof(double) * (size_t)(n + 1));
    project_out(set, v, set->r[n]);
    double length = ls_nnls_norm(v, m);
    if (!(length > dependent))
        return false;
    set->r[n][n] = length;
    for (int i = 0; i < m; i++)
        v[i] /= length;
    set->projected[n] = dot(v, set->problem->b, m);
    set->member[set->n++] = c;
    return true;
}

/* z = the unconstrained solution on the members */
static void solve_members(struct active_set *set)
{
    for (int k = set->n - 1; k >= 0; k--) {
        double sum = set->projected[k];
        for (int j = k + 1; j < set->n; j++)
            sum -= set->r[j][k] * set->z[set->member[j]];
        set->z[set->member[k]] = sum / set->r[k][k];
    }
}

static void rebuild(struct active_set *set)
{
    int n = set->n, member[MAX];
    memcpy(member, set->member, sizeof(int) * (size_t)n);
    set->n = 0;
    for (int k = 0; k < n; k++) {
        if (set->inside[member[k]] && !push(set, member[k])) {
            set->inside[member[k]] = false;
            set->x[member[k]] = 0;
        }
    }
}

/* of the members' own solution, from the basis: rounding in a large x does not reach it */
static double refresh_residual(struct active_set *set)
{
    double unused[MAX] = {0};
    memcpy(set->residual, set->problem->b, sizeof(double) * (size_t)set->problem->rows);
    project_out(set, set->residual, unused);
    return ls_nnls_norm(set->residual, set->problem->rows);
}

/* the column of steepest descent, ties to the lowest index; -1 at a KKT point */
static int steepest(const struct active_set *set, double tolerance)
{
    double descent[MAX], best = tolerance;
    for (int c = 0; c < set->problem->cols; c++) {
        descent[c] = 0;
        if (!set->inside[c] && !set->barred[c])
            descent[c] = dot(column(set, c), set->residual, set->problem->rows);
        best = fmax(best, descent[c]);
    }
    for (int c = 0; c < set->problem->cols; c++)
        if (descent[c] > tolerance && descent[c] >= best * (1 - tie))
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
            set->x[c] = first < 0 ? set->z[c] : set->x[c] + step * (set->z[c] - set->x[c]);
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
    bool entered = push(set, c);
    if (entered) {
        solve_members(set);
        if (set->z[c] <= 0) {
            set->n--;
            entered = false;
        }
    }
    set->inside[c] = entered;
    set->barred[c] = !entered;
    return entered;
}

static void begin(struct active_set *set, const struct ls_nnls *problem)
{
    set->problem = problem;
    set->n = 0;
    for (int c = 0; c < problem->cols; c++) {
        set->x[c] = 0;
        set->inside[c] = set->barred[c] = false;
    }
}

/* back to the members and x of before @c entered in vain */
static void take_back(struct active_set *set, const int *member, int n, const double *x, int c)
{
    memset(set->inside, 0, sizeof set->inside);
    for (int k = 0; k < n; k++)
        set->inside[member[k]] = true;
    memcpy(set->member, member, sizeof(int) * (size_t)n);
    memcpy(set->x, x, sizeof(double) * (size_t)set->problem->cols);
    set->n = n;
    rebuild(set);
    refresh_residual(set);
    set->barred[c] = true;
}

bool ls_nnls_solve(const struct ls_nnls *problem, double *x, unsigned *iterations)
{
    struct active_set set;
    unsigned limit = 100u * (unsigned)problem->cols;
    size_t bytes = sizeof(double) * (size_t)problem->cols;
    begin(&set, problem);
    double size = refresh_residual(&set), least = size;
    memset(x, 0, bytes);
    *iterations = 0;
    for (int c; least > fitted * size && (c = steepest(&set, no_descent * least)) >= 0;) {
        int member[MAX], n = set.n;
        memcpy(member, set.member, sizeof(int) * (size_t)n);
        if (++*iterations == limit)
            return false;
        if (!enter(&set, c))
            continue;
        walk(&set);
        double now = refresh_residual(&set);
        if (!(now < least)) {
            take_back(&set, member, n, x, c);
            continue;
        }
        least = now;
        memcpy(x, set.x, bytes);
        memset(set.barred, 0, sizeof set.barred);
    }
    return true;
}

double ls_nnls_violation(const struct ls_nnls *problem, const double *x)
{
    double residual[MAX], scale = ls_nnls_norm(problem->b, problem->rows), worst = 0;
    for (int i = 0; i < problem->rows; i++)
        residual[i] = -problem->b[i];
    for (int c = 0; c < problem->cols; c++) {
        scale += x[c];
        for (int i = 0; i < problem->rows; i++)
            residual[i] += problem->a[c * problem->rows + i] * x[c];
    }
    for (int c = 0; c < problem->cols; c++) {
        double gradient = dot(problem->a + c * problem->rows, residual, problem->rows);
        worst = fmax(worst, x[c] > 0 ? fabs(gradient) : -gradient);
    }
    return scale > 0 ? worst / scale : 0;
}

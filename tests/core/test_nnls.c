/* nnls: against every active set there is, in long double, on ordinary and degenerate systems. */
#include "core/solve.h"

#include <glib.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

enum { COLS = 6, ROWS_MAX = 18, TALL = ROWS_MAX + COLS };

enum kind {
    PLAIN,
    DUPLICATES,
    RANK_ONE,
    FLAT, /* fewer rows than columns */
    POSITIVE,
    ZERO_COLUMN,
    COLUMN_SCALES,
    TIKHONOV,
    CONDITION,
    NEARLY_PARALLEL,
    SYSTEM_SCALES,
    ROW_WEIGHTS,
    BEHIND, /* b behind every column: x = 0 */
    KINDS,
};

static const char *const names[KINDS] = {"plain",
                                         "duplicates",
                                         "rank 1",
                                         "fewer rows",
                                         "positive",
                                         "zero column",
                                         "columns of 1e-30..1e30",
                                         "Tikhonov",
                                         "condition 1e12",
                                         "columns 1e-12 apart",
                                         "systems of 1e-30..1e30",
                                         "row weights of 1e4",
                                         "b behind"};

struct random_system {
    double a[ROWS_MAX * COLS], b[ROWS_MAX], w[ROWS_MAX];
    struct ls_system system;
};

static double uniform(GRand *rand, double low, double high)
{
    return low + (high - low) * g_rand_double(rand);
}

/* singular values 1 to 1e-12: A = H1 D H2 with Householder reflections */
static void of_condition(struct random_system *r, size_t rows, GRand *rand)
{
    double u[ROWS_MAX], v[COLS], uu = 0, vv = 0;
    for (size_t i = 0; i < rows; i++)
        u[i] = uniform(rand, -1, 1), uu += u[i] * u[i];
    for (size_t j = 0; j < COLS; j++)
        v[j] = uniform(rand, -1, 1), vv += v[j] * v[j];
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < COLS; j++) {
            double sum = 0;
            for (size_t k = 0; k < COLS; k++)
                sum += ((i == k) - 2 * u[i] * u[k] / uu) * pow(10, -2.4 * (double)k) *
                       ((k == j) - 2 * v[k] * v[j] / vv);
            r->a[i * COLS + j] = sum;
        }
}

static void degrade(struct random_system *r, size_t rows, GRand *rand, enum kind kind)
{
    double direction[ROWS_MAX];
    for (size_t i = 0; i < rows; i++)
        direction[i] = uniform(rand, -1, 1);
    for (size_t i = 0; i < rows; i++) {
        double *row = r->a + i * COLS;
        switch (kind) {
        case DUPLICATES:
            row[2] = row[1], row[4] = 0x1p20 * row[1], row[5] = -row[3];
            break;
        case RANK_ONE: /* powers of two: exact multiples */
            for (int j = 0; j < COLS; j++)
                row[j] = ldexp(direction[i], 3 * j - 8) * (j == 3 ? -1 : 1);
            break;
        case ZERO_COLUMN:
            row[3] = 0, r->b[i] = row[0] + 2 * row[5];
            break;
        case COLUMN_SCALES:
            row[0] *= 1e-30, row[1] *= 1e30, row[2] *= 1e-15, row[3] *= 1e15;
            break;
        case NEARLY_PARALLEL:
            row[1] = row[0] + 1e-12 * direction[i], row[4] = -row[0] + 1e-12 * row[3];
            break;
        case SYSTEM_SCALES:
            for (int j = 0; j < COLS; j++)
                row[j] *= i % 2 ? 1e-30 : 1e-29;
            r->b[i] *= 1e30;
            break;
        case ROW_WEIGHTS:
            r->w[i] = i % 2 ? 1e4 : 1e-4;
            break;
        case BEHIND:
            r->b[i] = 0;
            for (int j = 0; j < COLS; j++)
                row[j] = fabs(row[j]), r->b[i] -= row[j];
            break;
        default:
            break;
        }
    }
}

static void make(struct random_system *r, GRand *rand, enum kind kind)
{
    size_t rows = kind == FLAT ? 3 : (size_t)g_rand_int_range(rand, COLS, ROWS_MAX + 1);
    for (size_t i = 0; i < rows; i++) {
        r->b[i] = uniform(rand, -1, 1);
        r->w[i] = uniform(rand, 0.1, 3);
        for (size_t j = 0; j < COLS; j++)
            r->a[i * COLS + j] = uniform(rand, kind == POSITIVE ? 0 : -1, 1);
    }
    if (kind == CONDITION)
        of_condition(r, rows, rand);
    degrade(r, rows, rand, kind);
    r->system = (struct ls_system){.rows = rows,
                                   .cols = COLS,
                                   .a = r->a,
                                   .b = r->b,
                                   .row_weight = kind % 2 ? r->w : NULL,
                                   .tikhonov = kind == TIKHONOV ? 1e-3 : 0};
}

/* --- the reference --- */

/** The system with weights and Tikhonov rows in it, columns of norm 1, in long double. */
struct reference {
    int rows;
    long double a[COLS][TALL], b[TALL], norm[COLS], b_norm;
    long double best, x[COLS]; /* the least residual, and where */
    int member[COLS];
    long double q[COLS][TALL], r[COLS][COLS], projected[COLS];
};

static long double dot(const long double *a, const long double *b, int n)
{
    long double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

static void load(struct reference *ref, const struct ls_system *s)
{
    long double trace = 0;
    int rows = (int)s->rows;
    memset(ref, 0, sizeof *ref);
    ref->rows = rows + (s->tikhonov > 0 ? COLS : 0);
    for (int i = 0; i < rows; i++) {
        long double w = s->row_weight ? s->row_weight[i] : 1;
        ref->b[i] = w * s->b[i];
        for (int j = 0; j < COLS; j++)
            ref->a[j][i] = w * s->a[i * COLS + j], trace += ref->a[j][i] * ref->a[j][i];
    }
    for (int j = 0; j < COLS; j++) {
        if (s->tikhonov > 0)
            ref->a[j][rows + j] = sqrtl(s->tikhonov * trace / COLS);
        ref->norm[j] = sqrtl(dot(ref->a[j], ref->a[j], ref->rows));
        for (int i = 0; i < ref->rows && ref->norm[j] > 0; i++)
            ref->a[j][i] /= ref->norm[j];
    }
    ref->b_norm = sqrtl(dot(ref->b, ref->b, ref->rows));
}

/* the members' own solution, if it is feasible, against the best so far */
static void consider(struct reference *ref, int n)
{
    long double z[COLS], residual[TALL], length;
    for (int k = n - 1; k >= 0; k--) {
        z[k] = ref->projected[k];
        for (int j = k + 1; j < n; j++)
            z[k] -= ref->r[j][k] * z[j];
        z[k] /= ref->r[k][k];
        if (z[k] < 0)
            return;
    }
    memcpy(residual, ref->b, sizeof residual);
    for (int k = 0; k < n; k++)
        for (int i = 0; i < ref->rows; i++)
            residual[i] -= ref->projected[k] * ref->q[k][i];
    length = sqrtl(dot(residual, residual, ref->rows));
    if (length >= ref->best)
        return;
    ref->best = length;
    memset(ref->x, 0, sizeof ref->x);
    for (int k = 0; k < n; k++)
        ref->x[ref->member[k]] = z[k];
}

/* every set of columns that holds the first n members and others from @from on; sets whose columns
 * depend on each other have a subset that does as well */
static void enumerate(struct reference *ref, int n, int from)
{
    consider(ref, n);
    for (int c = from; c < COLS; c++) {
        long double *v = ref->q[n];
        memcpy(v, ref->a[c], sizeof ref->q[n]);
        memset(ref->r[n], 0, sizeof ref->r[n]);
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < n; k++) {
                long double h = dot(ref->q[k], v, ref->rows);
                ref->r[n][k] += h;
                for (int i = 0; i < ref->rows; i++)
                    v[i] -= h * ref->q[k][i];
            }
        long double length = sqrtl(dot(v, v, ref->rows));
        if (length < 1e-14L)
            continue;
        for (int i = 0; i < ref->rows; i++)
            v[i] /= length;
        ref->r[n][n] = length;
        ref->projected[n] = dot(v, ref->b, ref->rows);
        ref->member[n] = c;
        enumerate(ref, n + 1, c + 1);
    }
}

/** How far a solution is from the best there is, all relative to S (core/solve.h). */
struct distance {
    long double residual, image, kkt; /* image: of L alpha */
};

static struct distance compare(struct reference *ref, const double *x)
{
    long double mine[TALL], image[TALL], size = ref->b_norm, theirs = ref->b_norm;
    struct distance d = {0};
    for (int i = 0; i < ref->rows; i++)
        mine[i] = -ref->b[i], image[i] = 0;
    for (int j = 0; j < COLS; j++) {
        long double y = x[j] * ref->norm[j];
        size += y, theirs += ref->x[j];
        for (int i = 0; i < ref->rows; i++) {
            mine[i] += ref->a[j][i] * y;
            image[i] += ref->a[j][i] * (y - ref->x[j]);
        }
    }
    size = fmaxl(size, theirs);
    if (size == 0)
        return d;
    d.residual = (sqrtl(dot(mine, mine, ref->rows)) - ref->best) / size;
    d.image = sqrtl(dot(image, image, ref->rows)) / size;
    for (int j = 0; j < COLS; j++) {
        long double gradient = dot(ref->a[j], mine, ref->rows) / size;
        d.kkt = fmaxl(d.kkt, x[j] > 0 ? fabsl(gradient) : -gradient);
    }
    return d;
}

static void test_it_is_the_best_of_all_active_sets(void)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    struct distance worst[KINDS] = {{0}};
    int n = g_getenv("LS_TEST_FULL") ? 100000 : 10000;
    g_test_message("seed %u", seed);
    for (int k = 0; k < n; k++) {
        struct random_system r;
        struct reference ref;
        struct ls_solution out;
        double x[COLS];
        enum kind kind = (enum kind)(k % KINDS);
        make(&r, rand, kind);
        g_assert_cmpint(ls_solve(&r.system, LS_SOLVE_NNLS, x, &out, NULL), ==, LS_OK);
        for (size_t j = 0; j < COLS; j++)
            g_assert_true(x[j] >= 0 && isfinite(x[j]));
        load(&ref, &r.system);
        ref.best = INFINITY;
        enumerate(&ref, 0, 0);
        struct distance d = compare(&ref, x);
        worst[kind].residual = fmaxl(worst[kind].residual, d.residual);
        worst[kind].image = fmaxl(worst[kind].image, d.image);
        worst[kind].kkt = fmaxl(worst[kind].kkt, fmaxl(d.kkt, out.kkt));
    }
    for (int kind = 0; kind < KINDS; kind++)
        g_test_message("%-24s residual %8.1Le  L alpha %8.1Le  KKT %8.1Le", names[kind],
                       worst[kind].residual, worst[kind].image, worst[kind].kkt);
    for (int kind = 0; kind < KINDS; kind++) {
        /* the promises of the header */
        g_assert_cmpfloat((double)worst[kind].residual, <=, 1e-13);
        /* L alpha is the point of a convex cone nearest to b, so its square distance from the best
         * is at most the difference of the squared residuals: 2 x 4e-16 S^2. Systems far from
         * dependent stay at rounding; the others, in 1e5 tries, at 1e-12. */
        bool close = kind == CONDITION || kind == NEARLY_PARALLEL;
        g_assert_cmpfloat((double)worst[kind].image, <=, close ? 1e-10 : 1e-13);
        g_assert_cmpfloat((double)worst[kind].kkt, <=, 1e-12);
    }
}

static void test_ties_go_to_the_lowest_index(void)
{
    /* three equal columns, differently scaled: scaling must not break the tie */
    const double a[] = {2, 1, 5, 4, 2, 10}, b[] = {1, 2};
    struct ls_system system = {.rows = 2, .cols = 3, .a = a, .b = b};
    double x[3];
    g_assert_cmpint(ls_solve(&system, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(x[0], 0.5, 1e-12);
    g_assert_cmpfloat(x[1], ==, 0);
    g_assert_cmpfloat(x[2], ==, 0);
}

/* Scales that are no powers of two leave the unit columns an ulp or two apart, either way. */
static void test_rounding_breaks_no_tie(void)
{
    const guint32 seed = 20;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int k = 0; k < 1000; k++) {
        double a[5 * 3], b[5], x[3];
        for (int i = 0; i < 5; i++)
            a[3 * i] = b[i] = uniform(rand, 0.1, 1);
        for (int c = 1; c < 3; c++) {
            double scale = uniform(rand, 0.1, 10);
            for (int i = 0; i < 5; i++)
                a[3 * i + c] = scale * a[3 * i];
        }
        struct ls_system system = {.rows = 5, .cols = 3, .a = a, .b = b};
        g_assert_cmpint(ls_solve(&system, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_OK);
        g_assert_cmpfloat_with_epsilon(x[0], 1, 1e-12); /* some ulps of five sums */
        g_assert_cmpfloat(x[1], ==, 0);
        g_assert_cmpfloat(x[2], ==, 0);
    }
}

static void test_a_solver_gives_every_right_side_what_it_would_get_alone(void)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int k = 0; k < 4 * KINDS; k++) {
        struct random_system r;
        struct ls_solver *solver;
        enum ls_solve_method method = k % 2 ? LS_SOLVE_NNLS : LS_SOLVE_LEAST_SQUARES;
        make(&r, rand, (enum kind)(k / 4));
        g_assert_cmpint(ls_solver_create(&r.system, method, &solver, NULL), ==, LS_OK);
        for (int side = 0; side < 3; side++) {
            struct ls_solution a, b;
            double x[COLS], alone[COLS];
            g_assert_cmpint(ls_solver_run(solver, r.b, x, &a, NULL), ==, LS_OK);
            g_assert_cmpint(ls_solve(&r.system, method, alone, &b, NULL), ==, LS_OK);
            g_assert_cmpmem(x, sizeof x, alone, sizeof alone);
            g_assert_cmpfloat(a.residual, ==, b.residual);
            for (size_t i = 0; i < r.system.rows; i++)
                r.b[i] *= uniform(rand, -1, 1);
        }
        r.b[0] = NAN;
        double x[COLS];
        g_assert_cmpint(ls_solver_run(solver, r.b, x, NULL, NULL), ==, LS_ERR_INVALID);
        ls_solver_destroy(solver);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/nnls/is-the-best-of-all-active-sets", test_it_is_the_best_of_all_active_sets);
    g_test_add_func("/nnls/ties-go-to-the-lowest-index", test_ties_go_to_the_lowest_index);
    g_test_add_func("/nnls/rounding-breaks-no-tie", test_rounding_breaks_no_tie);
    g_test_add_func("/nnls/a-solver-gives-every-right-side-what-it-would-get-alone",
                    test_a_solver_gives_every_right_side_what_it_would_get_alone);
    return g_test_run();
}

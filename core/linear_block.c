#include "core/linear_block.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { N = LS_LINEAR_BLOCK, IN = LS_LINEAR_MAX_INPUTS, OUT = LS_LINEAR_MAX_OUTPUTS };

static uint32_t at(uint32_t a, uint32_t b)
{
    return a * (a + 1) / 2 + b;
}

double ls_linear_trust(double snr)
{
    double t = fmin(fmax((snr - 4) / 6, 0), 1);
    return t * t * (3 - 2 * t);
}

static double mean(const double *v, uint32_t n)
{
    double sum = 0;
    for (uint32_t k = 0; k < n; k++)
        sum += v[k];
    return sum / n;
}

/* out[k][j] = picture[j][k]; brightness[j] = their mean, variance[j] that of one of them */
static inline void load_of(const float *restrict picture, uint32_t channels, uint32_t n,
                           const struct ls_linear_noise *noise, double (*restrict out)[N],
                           double *restrict brightness, double *restrict variance)
{
    double share = 1.0 / channels;
    memset(brightness, 0, N * sizeof *brightness);
    memset(variance, 0, N * sizeof *variance);
    for (uint32_t j = 0; j < n; j++)
        for (uint32_t k = 0; k < channels; k++)
            out[k][j] = (double)picture[j * channels + k];
    for (uint32_t k = 0; k < channels; k++) {
        double *restrict x = out[k];
        for (uint32_t j = n; j < N; j++)
            x[j] = 0;
        for (uint32_t j = 0; j < N; j++) {
            brightness[j] += share * x[j];
            variance[j] += share * (noise->floor + noise->shot * (x[j] > 0 ? x[j] : 0));
        }
    }
}

static void load(const float *picture, uint32_t channels, uint32_t n,
                 const struct ls_linear_noise *noise, double (*out)[N], double *brightness,
                 double *variance)
{
    if (channels == 3) /* known to the compiler */
        load_of(picture, 3, n, noise, out, brightness, variance);
    else
        load_of(picture, channels, n, noise, out, brightness, variance);
}

void ls_linear_block_row(const struct ls_linear_pictures *pictures,
                         const struct ls_linear_options *options, uint32_t g, size_t first,
                         uint32_t n, const struct ls_linear_total *total, struct ls_linear_row *row)
{
    double b[N], unused[N], variance[N], f_variance[N];
    uint32_t n_in = pictures->n_in, n_out = pictures->n_out;
    load(pictures->v[g] + first * n_in, n_in, n, &pictures->v_noise[g], row->v, b, variance);
    load(pictures->f[g] + first * n_out, n_out, n, &pictures->f_noise[g], row->f, unused,
         f_variance);
    double f_unit = mean(pictures->p_in, n_in) / mean(pictures->p_out, n_out);
    double trust = 1 / (options->row_noise * options->row_noise);
    double weight[N];
    for (uint32_t j = 0; j < N; j++) {
        double unit = total->per_brightness[j], bright = b[j] * unit;
        bright = bright > options->row_floor ? bright : options->row_floor;
        double noise = (variance[j] + f_unit * f_unit * f_variance[j]) * unit * unit;
        double square = 1 / (bright * bright + trust * noise);
        weight[j] = unit * sqrt(square);
        row->noise[j] = square * noise;
    }
    for (uint32_t a = 0; a < n_in; a++)
        for (uint32_t j = 0; j < N; j++)
            row->v[a][j] *= weight[j];
    for (uint32_t c = 0; c < n_out; c++)
        for (uint32_t j = 0; j < N; j++)
            row->f[c][j] *= weight[j];
}

static void add_product(const double *restrict x, const double *restrict y, double sign,
                        double *restrict sum)
{
    for (uint32_t j = 0; j < N; j++)
        sum[j] += sign * (x[j] * y[j]);
}

void ls_linear_block_add(const struct ls_linear_pictures *pictures, const struct ls_linear_row *row,
                         double sign, struct ls_linear_normal *normal)
{
    for (uint32_t a = 0; a < pictures->n_in; a++) {
        for (uint32_t b = 0; b < a; b++)
            add_product(row->v[a], row->v[b], sign, normal->vv[at(a, b)]);
        for (uint32_t j = 0; j < N; j++)
            normal->vv[at(a, a)][j] += sign * (row->v[a][j] * row->v[a][j]);
        for (uint32_t c = 0; c < pictures->n_out; c++)
            add_product(row->v[a], row->f[c], sign, normal->vf[a][c]);
    }
    for (uint32_t j = 0; j < N; j++)
        normal->noise[j] += sign * row->noise[j];
    normal->n_rows += sign;
}

/* One system per pixel: rows averaged, the dielectric row and the ridge added. */
struct system {
    double h[LS_LINEAR_TRIANGLE][N]; /* then L D: unit lower triangle times pivots */
    double reciprocal[IN][N];        /* of the pivots */
    double z[OUT + 1][IN][N];        /* right-hand sides, then solutions; last that of the sum */
};

static void assemble(const struct ls_linear_pictures *p, const struct ls_linear_options *options,
                     const struct ls_linear_normal *normal, struct system *s)
{
    double d = options->dielectric_weight / mean(p->p_in, p->n_in);
    for (uint32_t a = 0; a < p->n_in; a++) {
        for (uint32_t b = 0; b <= a; b++) {
            double coat = d * d * p->p_in[a] * p->p_in[b];
            for (uint32_t j = 0; j < N; j++)
                s->h[at(a, b)][j] = normal->vv[at(a, b)][j] / normal->n_rows + coat;
        }
        for (uint32_t c = 0; c < p->n_out; c++) {
            double coat = d * d * p->p_in[a] * p->p_out[c];
            for (uint32_t j = 0; j < N; j++)
                s->z[c][a][j] = normal->vf[a][c][j] / normal->n_rows + coat;
        }
    }
}

/* What Eq. 1 leaves to explain. */
static void subtract_ratio(const struct ls_linear_pictures *p, const struct ls_linear_total *total,
                           struct system *s)
{
    for (uint32_t c = 0; c < p->n_out; c++)
        for (uint32_t a = 0; a < p->n_in; a++) {
            uint32_t in = p->inputs[c];
            const double *h = s->h[in < a ? at(a, in) : at(in, a)];
            for (uint32_t j = 0; j < N; j++)
                s->z[c][a][j] -= h[j] * total->ratio[c][j];
        }
    for (uint32_t a = 0; a < p->n_in; a++)
        for (uint32_t j = 0; j < N; j++)
            s->z[OUT][a][j] = total->v[a][j] * total->per_brightness[j];
}

static void add_ridge(uint32_t n, const struct ls_linear_options *options,
                      const struct ls_linear_normal *normal, struct system *s)
{
    double trace[N] = {0};
    for (uint32_t a = 0; a < n; a++)
        for (uint32_t j = 0; j < N; j++)
            trace[j] += s->h[at(a, a)][j];
    for (uint32_t a = 0; a < n; a++)
        for (uint32_t j = 0; j < N; j++)
            s->h[at(a, a)][j] += options->ridge / n * trace[j] +
                                 options->noise_ridge / normal->n_rows * normal->noise[j];
}

/* x -= y z scale, for every pixel. Arrays do not overlap. */
static void take(const double *restrict y, const double *restrict z, const double *restrict scale,
                 double *restrict x)
{
    for (uint32_t j = 0; j < N; j++)
        x[j] -= y[j] * z[j] * scale[j];
}

static void factor(uint32_t n, struct system *s)
{
    for (uint32_t b = 0; b < n; b++) {
        for (uint32_t k = 0; k < b; k++)
            for (uint32_t j = 0; j < N; j++)
                s->h[at(b, b)][j] -= s->h[at(b, k)][j] * s->h[at(b, k)][j] * s->reciprocal[k][j];
        for (uint32_t j = 0; j < N; j++)
            s->reciprocal[b][j] = 1 / s->h[at(b, b)][j];
        for (uint32_t a = b + 1; a < n; a++)
            for (uint32_t k = 0; k < b; k++)
                take(s->h[at(a, k)], s->h[at(b, k)], s->reciprocal[k], s->h[at(a, b)]);
    }
}

static void substitute(uint32_t n, struct system *s, double (*x)[N])
{
    for (uint32_t a = 0; a < n; a++)
        for (uint32_t k = 0; k < a; k++)
            take(s->h[at(a, k)], x[k], s->reciprocal[k], x[a]);
    for (uint32_t a = n; a-- > 0;) {
        for (uint32_t j = 0; j < N; j++)
            x[a][j] *= s->reciprocal[a][j];
        for (uint32_t k = a + 1; k < n; k++)
            take(s->h[at(k, a)], x[k], s->reciprocal[a], x[a]);
    }
}

/* Move every solution along that of the sum, the cheapest way to make (D + Z) V = F. */
static void keep_sum(const struct ls_linear_pictures *p, const struct ls_linear_total *total,
                     struct system *s)
{
    double v[IN][N], along[N] = {0};
    for (uint32_t a = 0; a < p->n_in; a++)
        for (uint32_t j = 0; j < N; j++) {
            v[a][j] = total->v[a][j] * total->per_brightness[j];
            along[j] += v[a][j] * s->z[OUT][a][j];
        }
    for (uint32_t c = 0; c < p->n_out; c++) {
        double step[N];
        for (uint32_t j = 0; j < N; j++)
            step[j] =
                total->f[c][j] * total->per_brightness[j] - total->ratio[c][j] * v[p->inputs[c]][j];
        for (uint32_t a = 0; a < p->n_in; a++)
            for (uint32_t j = 0; j < N; j++)
                step[j] -= v[a][j] * s->z[c][a][j];
        for (uint32_t a = 0; a < p->n_in; a++)
            for (uint32_t j = 0; j < N; j++)
                s->z[c][a][j] += s->z[OUT][a][j] * (step[j] / along[j]);
    }
}

/* M = D + q Z, or D alone where that is no number. */
static void finish(const struct ls_linear_pictures *p, const struct ls_linear_total *total,
                   const struct system *s, struct ls_linear_matrix *out)
{
    for (uint32_t c = 0; c < p->n_out; c++)
        for (uint32_t a = 0; a < p->n_in; a++)
            for (uint32_t j = 0; j < N; j++) {
                double d = a == p->inputs[c] ? total->ratio[c][j] : 0;
                out->m[c][a][j] = d + total->trust[j] * s->z[c][a][j];
            }
    for (uint32_t j = 0; j < N; j++) {
        bool fitted = total->per_brightness[j] > 0 && total->trust[j] > 0;
        for (uint32_t c = 0; c < p->n_out; c++)
            for (uint32_t a = 0; a < p->n_in; a++)
                fitted = fitted && fabs(out->m[c][a][j]) <= (double)FLT_MAX;
        for (uint32_t c = 0; c < p->n_out && !fitted; c++)
            for (uint32_t a = 0; a < p->n_in; a++)
                out->m[c][a][j] = a == p->inputs[c] ? total->ratio[c][j] : 0;
    }
}

void ls_linear_block_solve(const struct ls_linear_pictures *pictures,
                           const struct ls_linear_options *options,
                           const struct ls_linear_normal *normal,
                           const struct ls_linear_total *total, struct ls_linear_matrix *out)
{
    struct system s;
    assemble(pictures, options, normal, &s);
    subtract_ratio(pictures, total, &s);
    add_ridge(pictures->n_in, options, normal, &s);
    factor(pictures->n_in, &s);
    for (uint32_t c = 0; c < pictures->n_out; c++)
        substitute(pictures->n_in, &s, s.z[c]);
    substitute(pictures->n_in, &s, s.z[OUT]);
    keep_sum(pictures, total, &s);
    finish(pictures, total, &s, out);
}

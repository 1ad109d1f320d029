#include "core/linear_block.h"

#include <math.h>
#include <string.h>

/* Pixels to predict: a strip of at most a block of them. */
struct strip {
    const struct ls_linear_pictures *pictures;
    const struct ls_linear_options *options;
    const struct ls_linear_sums *sums;
    size_t first; /* pixel of the band */
    uint32_t n;
};

struct pixel_error {
    double difference[LS_LINEAR_BLOCK], noise[LS_LINEAR_BLOCK], total[LS_LINEAR_BLOCK];
};

static double variance(const struct ls_linear_noise *noise, double x)
{
    return noise->floor + noise->shot * fmax(x, 0);
}

/* The sums without segment @g. Eq. 1 of the rest where it can be formed, else that of all. */
static void total_without(const struct strip *s, uint32_t g, const struct ls_linear_total *all,
                          struct ls_linear_total *rest)
{
    const struct ls_linear_pictures *p = s->pictures;
    double scale = (double)p->n_segments / (p->n_segments - 1);
    *rest = *all;
    for (uint32_t j = 0; j < s->n; j++) {
        const float *v = p->v[g] + (s->first + j) * p->n_in;
        const float *f = p->f[g] + (s->first + j) * p->n_out;
        rest->per_brightness[j] *= scale;
        for (uint32_t a = 0; a < p->n_in; a++) {
            rest->v[a][j] -= (double)v[a];
            double sigma = sqrt(variance(&p->total_noise, all->v[a][j]));
            double trust = sigma > 0 ? ls_linear_trust(rest->v[a][j] / sigma) : rest->v[a][j] > 0;
            rest->trust[j] = fmin(rest->trust[j], trust);
        }
        for (uint32_t c = 0; c < p->n_out; c++) {
            rest->f[c][j] -= (double)f[c];
            if (rest->trust[j] >= 1)
                rest->ratio[c][j] = rest->f[c][j] / rest->v[p->inputs[c]][j];
        }
    }
}

static void compare(const struct strip *s, uint32_t g, const struct ls_linear_matrix *m,
                    struct pixel_error *e)
{
    const struct ls_linear_pictures *p = s->pictures;
    for (uint32_t j = 0; j < s->n; j++) {
        const float *v = p->v[g] + (s->first + j) * p->n_in;
        const float *f = p->f[g] + (s->first + j) * p->n_out;
        for (uint32_t c = 0; c < p->n_out; c++) {
            double predicted = 0, noise = variance(&p->f_noise[g], (double)f[c]);
            for (uint32_t a = 0; a < p->n_in; a++) {
                double x = m->m[c][a][j];
                predicted += x * (double)v[a];
                noise += x * x * variance(&p->v_noise[g], (double)v[a]);
            }
            double difference = predicted - (double)f[c];
            e->difference[j] += difference * difference;
            e->noise[j] += noise;
            e->total[j] += (double)f[c] * (double)f[c];
        }
    }
}

static void predict(const struct strip *s, struct pixel_error *e)
{
    const struct ls_linear_pictures *p = s->pictures;
    struct ls_linear_total all, rest;
    struct ls_linear_normal normal;
    struct ls_linear_row row;
    ls_linear_sums_block(p, s->sums, s->first, s->n, &all);
    memset(&normal, 0, sizeof normal);
    memset(e, 0, sizeof *e);
    for (uint32_t g = 0; g < p->n_segments; g++) {
        ls_linear_block_row(p, s->options, g, s->first, s->n, &all, &row);
        ls_linear_block_add(p, &row, 1, &normal);
    }
    for (uint32_t g = 0; g < p->n_segments; g++) {
        struct ls_linear_normal without = normal;
        struct ls_linear_matrix m;
        ls_linear_block_row(p, s->options, g, s->first, s->n, &all, &row);
        ls_linear_block_add(p, &row, -1, &without);
        total_without(s, g, &all, &rest);
        ls_linear_block_solve(p, s->options, &without, &rest, &m);
        compare(s, g, &m, e);
    }
}

static void add(const struct strip *s, const struct pixel_error *e, struct ls_linear_error *error,
                float *per_pixel)
{
    for (uint32_t j = 0; j < s->n; j++) {
        bool known = isfinite(e->difference[j]) && isfinite(e->noise[j]) && isfinite(e->total[j]);
        if (per_pixel)
            per_pixel[j] =
                known && e->total[j] > 0 ? (float)sqrt(e->difference[j] / e->total[j]) : 0;
        if (!known)
            continue;
        error->difference += e->difference[j];
        error->noise += e->noise[j];
        error->total += e->total[j];
        error->pixels++;
    }
}

enum ls_err ls_linear_leave_one_out(const struct ls_linear_pictures *pictures,
                                    const struct ls_linear_options *options, uint32_t first_row,
                                    uint32_t n_rows, uint32_t step, struct ls_linear_error *error,
                                    float *per_pixel, struct ls_diag *diag)
{
    if (pictures->n_segments == 1)
        return ls_fail(diag, LS_ERR_STATE, "one segment: none can be predicted from the rest");
    if (step < 1)
        return ls_fail(diag, LS_ERR_INVALID, "leave one out: step is 0: expected 1 or more");
    struct ls_linear_sums sums;
    enum ls_err err = ls_linear_sums_init(pictures, options, first_row, n_rows, &sums, diag);
    for (uint32_t y = 0; y < n_rows && !err; y += step)
        for (uint32_t x = 0; x < pictures->width; x += LS_LINEAR_BLOCK) {
            uint32_t left = pictures->width - x;
            size_t at = (size_t)y * pictures->width + x;
            struct strip strip = {pictures, options, &sums,
                                  (size_t)first_row * pictures->width + at,
                                  left < LS_LINEAR_BLOCK ? left : LS_LINEAR_BLOCK};
            struct pixel_error e;
            predict(&strip, &e);
            add(&strip, &e, error, per_pixel ? per_pixel + at : NULL);
        }
    ls_linear_sums_finish(&sums);
    return err;
}

static double sum_of(const float *v, uint32_t n)
{
    double sum = 0;
    for (uint32_t k = 0; k < n; k++)
        sum += (double)v[k];
    return sum;
}

void ls_linear_check_light(const struct ls_linear_light *light, struct ls_linear_error *all,
                           struct ls_linear_error *highlights)
{
    for (size_t i = 0; i < light->n; i++) {
        const float *v = light->v + i * light->n_in, *f = light->f + i * light->n_out;
        const float *m = light->m + i * light->n_out * light->n_in;
        double difference = 0, total = 0;
        for (uint32_t c = 0; c < light->n_out; c++) {
            double predicted = 0;
            for (uint32_t a = 0; a < light->n_in; a++)
                predicted += (double)m[c * light->n_in + a] * (double)v[a];
            difference += (predicted - (double)f[c]) * (predicted - (double)f[c]);
            total += (double)f[c] * (double)f[c];
        }
        if (!isfinite(difference) || !isfinite(total))
            continue;
        double share = light->strength * sum_of(v, light->n_in) * light->n_lights;
        bool highlight = share > 16 * sum_of(light->v_total + i * light->n_in, light->n_in);
        struct ls_linear_error *to[2] = {all, highlight ? highlights : NULL};
        for (int k = 0; k < 2 && to[k]; k++) {
            to[k]->difference += difference;
            to[k]->total += total;
            to[k]->pixels++;
        }
    }
}

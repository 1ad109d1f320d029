#include "core/linear_block.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void ls_linear_options_default(struct ls_linear_options *options)
{
    *options = (struct ls_linear_options){.ridge = 1e-4,
                                          .noise_ridge = 2,
                                          .row_floor = 1e-3,
                                          .row_noise = 0.02,
                                          .dielectric_weight = 1};
}

static enum ls_err check_options(const struct ls_linear_options *o, struct ls_diag *diag)
{
    if (!(o->ridge >= 1e-9 && o->ridge <= 1e3))
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: ridge is %g: expected 1e-9 to 1000",
                       o->ridge);
    if (!(o->noise_ridge >= 0 && o->noise_ridge <= 1e3))
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: noise ridge is %g: expected 0 to 1000",
                       o->noise_ridge);
    if (!(o->row_floor >= 1e-9 && o->row_floor <= 1))
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: row floor is %g: expected 1e-9 to 1",
                       o->row_floor);
    if (!(o->row_noise >= 1e-6 && o->row_noise <= 1e3))
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: row noise is %g: expected 1e-6 to 1000",
                       o->row_noise);
    if (!(o->dielectric_weight >= 0 && o->dielectric_weight <= 1e3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "linear fit: weight of the dielectric row is %g: expected 0 to 1000",
                       o->dielectric_weight);
    return LS_OK;
}

static enum ls_err check_numbers(const char *what, const double *v, uint32_t n,
                                 struct ls_diag *diag)
{
    for (uint32_t k = 0; k < n; k++)
        if (!(v[k] > 0 && v[k] < 1e30))
            return ls_fail(diag, LS_ERR_INVALID, "linear fit: %s[%u] is %g: expected positive",
                           what, k, v[k]);
    return LS_OK;
}

static enum ls_err check_noise(const struct ls_linear_noise *noise, struct ls_diag *diag)
{
    if (!(noise->floor >= 0 && noise->floor < 1e30 && noise->shot >= 0 && noise->shot < 1e30))
        return ls_fail(diag, LS_ERR_INVALID,
                       "linear fit: noise floor %g, shot %g: expected 0 or more", noise->floor,
                       noise->shot);
    return LS_OK;
}

static enum ls_err check_shape(const struct ls_linear_pictures *p, uint32_t first_row,
                               uint32_t n_rows, struct ls_diag *diag)
{
    if (!p->width || !p->height || !n_rows || first_row >= p->height ||
        n_rows > p->height - first_row)
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: rows %u + %u of a band of %u x %u px",
                       first_row, n_rows, p->width, p->height);
    if (p->n_segments < 1 || p->n_segments > LS_LINEAR_MAX_SEGMENTS)
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: %u segments: expected 1 to %d",
                       p->n_segments, LS_LINEAR_MAX_SEGMENTS);
    if (p->n_lights < p->n_segments || p->n_lights > LS_LINEAR_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: %u lights: expected %u to %d",
                       p->n_lights, p->n_segments, LS_LINEAR_MAX_LIGHTS);
    if (p->n_in < 1 || p->n_in > LS_LINEAR_MAX_INPUTS || (p->n_out != 1 && p->n_out != 3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "linear fit: %u values to %u: expected 1 to %d values to 1 or 3", p->n_in,
                       p->n_out, LS_LINEAR_MAX_INPUTS);
    for (uint32_t c = 0; c < p->n_out; c++)
        if (p->inputs[c] >= p->n_in)
            return ls_fail(diag, LS_ERR_INVALID,
                           "linear fit: output %u scales input %u: expected less than %u", c,
                           p->inputs[c], p->n_in);
    return LS_OK;
}

static enum ls_err check(const struct ls_linear_pictures *p, const struct ls_linear_options *o,
                         uint32_t first_row, uint32_t n_rows, struct ls_diag *diag)
{
    enum ls_err err = check_shape(p, first_row, n_rows, diag);
    if (!err)
        err = check_options(o, diag);
    if (!err)
        err = check_numbers("p_in", p->p_in, p->n_in, diag);
    if (!err)
        err = check_numbers("p_out", p->p_out, p->n_out, diag);
    if (!err)
        err = check_noise(&p->total_noise, diag);
    for (uint32_t g = 0; g < p->n_segments && !err; g++) {
        err = check_noise(&p->v_noise[g], diag);
        if (!err)
            err = check_noise(&p->f_noise[g], diag);
    }
    return err;
}

/* sum[i] over pictures, in double; one picture is copied to the bit. */
static void sum_pictures(const float *const *pictures, uint32_t n_pictures, size_t n, float *sum)
{
    enum { BLOCK = 256 };
    for (size_t first = 0; first < n; first += BLOCK) {
        size_t m = n - first < BLOCK ? n - first : BLOCK;
        double block[BLOCK] = {0};
        for (uint32_t g = 0; g < n_pictures; g++)
            for (size_t i = 0; i < m; i++)
                block[i] += (double)pictures[g][first + i];
        for (size_t i = 0; i < m; i++)
            sum[first + i] = (float)block[i];
    }
}

/* The inputs that Eq. 1 scales, side by side. */
static void pick_inputs(const struct ls_linear_pictures *p, const float *from, size_t pixels,
                        float *to)
{
    for (size_t i = 0; i < pixels; i++)
        for (uint32_t c = 0; c < p->n_out; c++)
            to[i * p->n_out + c] = from[i * p->n_in + p->inputs[c]];
}

static void find_sigma(const struct ls_linear_pictures *p, size_t n, struct ls_linear_sums *sums)
{
    for (size_t i = 0; i < n; i++)
        sums->sigma[i] = (float)sqrt(
            p->total_noise.floor + p->total_noise.shot * (sums->v[i] > 0 ? (double)sums->v[i] : 0));
    if (p->demosaiced)
        ls_promote_add_contrast(sums->v, p->width, p->height, p->n_in, sums->sigma);
}

enum ls_err ls_linear_sums_init(const struct ls_linear_pictures *p,
                                const struct ls_linear_options *options, uint32_t first_row,
                                uint32_t n_rows, struct ls_linear_sums *sums, struct ls_diag *diag)
{
    *sums = (struct ls_linear_sums){0};
    enum ls_err err = check(p, options, first_row, n_rows, diag);
    if (err)
        return err;
    size_t pixels = (size_t)p->width * p->height, in = pixels * p->n_in, out = pixels * p->n_out;
    sums->room = malloc((2 * in + 4 * out) * sizeof *sums->room);
    if (!sums->room)
        return ls_fail(diag, LS_ERR_NOMEM, "linear fit: out of memory for %u x %u px", p->width,
                       p->height);
    sums->v = sums->room;
    sums->sigma = sums->v + in;
    sums->f = sums->sigma + in;
    sums->ratio = sums->f + out;
    float *v = sums->ratio + out, *sigma = v + out;
    sum_pictures(p->v, p->n_segments, in, sums->v);
    sum_pictures(p->f, p->n_segments, out, sums->f);
    find_sigma(p, in, sums);
    pick_inputs(p, sums->v, pixels, v);
    pick_inputs(p, sums->sigma, pixels, sigma);
    double neutral[LS_LINEAR_MAX_OUTPUTS];
    for (uint32_t c = 0; c < p->n_out; c++)
        neutral[c] = p->p_out[c] / p->p_in[p->inputs[c]];
    return ls_promote_ratio(sums->f, v, sigma, p->width, p->height, p->n_out, neutral, sums->ratio,
                            diag);
}

void ls_linear_sums_finish(struct ls_linear_sums *sums)
{
    free(sums->room);
    *sums = (struct ls_linear_sums){0};
}

void ls_linear_apply(const float *m, const float *v, size_t n, uint32_t n_in, uint32_t n_out,
                     float *out)
{
    for (size_t i = 0; i < n; i++)
        for (uint32_t c = 0; c < n_out; c++, out++) {
            const float *row = m + (i * n_out + c) * n_in, *in = v + i * n_in;
            *out = row[0] * in[0];
            for (uint32_t a = 1; a < n_in; a++)
                *out += row[a] * in[a];
        }
}

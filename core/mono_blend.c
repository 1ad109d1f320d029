#include "core/mono_blend.h"

#include "core/linear_block.h"
#include "core/segments.h"
#include "core/vec3.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double most_rescale = 2;

/* exp(G (cos - 1)) is a Gaussian of the angle with variance 1 / G, segments being 4 pi / G each. */
static void light_weights(const float direction[3], const double (*centre)[3], uint32_t n_segments,
                          double *phi)
{
    double d[3] = {(double)direction[0], (double)direction[1], (double)direction[2]};
    double length = sqrt(ls_dot3(d, d)), largest = -1, sum = 0;
    for (uint32_t g = 0; g < n_segments; g++) {
        phi[g] = ls_dot3(d, centre[g]) / length;
        largest = fmax(largest, phi[g]);
    }
    for (uint32_t g = 0; g < n_segments; g++) {
        phi[g] = exp(n_segments * (phi[g] - largest));
        sum += phi[g];
    }
    for (uint32_t g = 0; g < n_segments; g++)
        phi[g] /= sum;
}

enum ls_err ls_mono_blend_weights(const float (*directions)[3], uint32_t n_lights,
                                  const uint32_t *segment, uint32_t n_segments, double *phi,
                                  struct ls_diag *diag)
{
    if (n_segments < 1 || n_segments > n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "%u segments of %u lights: expected 1 to %u",
                       n_segments, n_lights, n_lights);
    LS_CLEANUP_FREE double(*centre)[3] = calloc(n_segments, sizeof *centre);
    if (!centre)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", n_segments);
    enum ls_err err = ls_segments_centres(directions, n_lights, segment, n_segments, centre, diag);
    for (uint32_t i = 0; i < n_lights && !err; i++)
        light_weights(directions[i], (const double(*)[3])centre, n_segments,
                      phi + (size_t)i * n_segments);
    return err;
}

void ls_mono_blend_others(const double *phi, uint32_t n_lights, const uint32_t *segment,
                          uint32_t n_segments, double *others)
{
    memset(others, 0, (size_t)n_segments * n_segments * sizeof *others);
    for (uint32_t i = 0; i < n_lights; i++)
        for (uint32_t h = 0; h < n_segments; h++)
            if (h != segment[i])
                others[segment[i] * n_segments + h] += phi[(size_t)i * n_segments + h];
    for (uint32_t g = 0; g < n_segments; g++) {
        double sum = 0, *row = others + (size_t)g * n_segments;
        for (uint32_t h = 0; h < n_segments; h++)
            sum += row[h];
        for (uint32_t h = 0; h < n_segments; h++)
            row[h] = h == g ? 0 : sum > 0 ? row[h] / sum : 1.0 / (n_segments - 1);
    }
}

/* Eq. 1's ratio, its numerator and denominator are those of the linear fit with one value. */
static struct ls_linear_pictures as_linear(const struct ls_mono_blend_pictures *p,
                                           const double *p_in, const double *p_out)
{
    return (struct ls_linear_pictures){.width = p->width,
                                       .height = p->height,
                                       .n_segments = p->n_segments,
                                       .n_lights = p->n_lights,
                                       .n_in = 1,
                                       .n_out = 1,
                                       .v = p->v,
                                       .f = p->f,
                                       .v_noise = p->v_noise,
                                       .f_noise = p->f_noise,
                                       .total_noise = p->total_noise,
                                       .p_in = p_in,
                                       .p_out = p_out};
}

/* F_g / V_g as far as V_g is known, else the full sphere's. */
static double segment_ratio(const struct ls_linear_noise *noise, double f, double v, double ratio,
                            double neutral)
{
    double sigma = sqrt(noise->floor + noise->shot * fmax(v, 0));
    double trust = !(v > 0) ? 0 : sigma > 0 ? ls_linear_trust(v / sigma) : 1;
    if (!(trust > 0) || !isfinite(f) || !isfinite(v) || !isfinite(f / v))
        return ratio;
    double limit = 8 * fmax(fabs(ratio), neutral);
    double own = trust < 1 ? fmax(-limit, fmin(limit, f / v)) : f / v;
    return trust * own + (1 - trust) * ratio;
}

/* What makes the full sphere exact: r_g becomes times r_g + plus. */
struct correction {
    double times, plus;
};

static struct correction correct(double f, double made, double u, double trust)
{
    double n = fmin(fmax(f / made, 1 / most_rescale), most_rescale);
    return (struct correction){1 + trust * (n - 1), trust * (f - n * made) / u};
}

static void blend_pixel(const struct ls_mono_blend_pictures *p, const struct ls_linear_sums *sums,
                        size_t pixel, float *out)
{
    double ratio = (double)sums->ratio[pixel], made = 0, u = 0;
    double v = (double)sums->v[pixel], f = (double)sums->f[pixel];
    double sigma = (double)sums->sigma[pixel];
    double trust = !(v > 0) ? 0 : sigma > 0 ? ls_linear_trust(v / sigma) : 1;
    for (uint32_t g = 0; g < p->n_segments; g++) {
        double r = segment_ratio(&p->v_noise[g], (double)p->f[g][pixel], (double)p->v[g][pixel],
                                 ratio, p->neutral);
        out[g] = (float)(trust * r + (1 - trust) * ratio);
        made += (double)out[g] * (double)p->u[g][pixel];
        u += (double)p->u[g][pixel];
    }
    struct correction n = correct(f, made, u, trust);
    for (uint32_t g = 0; g < p->n_segments; g++) {
        double r = (double)out[g] * n.times + n.plus;
        out[g] = trust > 0 && fabs(r) <= (double)FLT_MAX ? (float)r : (float)ratio;
    }
}

/* Each segment as the others' ratios @r foretell it. */
static void add_error(const struct ls_mono_blend_pictures *p, size_t pixel, const float *r,
                      struct ls_linear_error *error)
{
    struct ls_linear_error sum = {.pixels = 1};
    for (uint32_t g = 0; g < p->n_segments; g++) {
        double foretold = 0, v = (double)p->v[g][pixel], f = (double)p->f[g][pixel];
        for (uint32_t h = 0; h < p->n_segments; h++)
            foretold += p->others[(size_t)g * p->n_segments + h] * (double)r[h];
        double noise = p->v_noise[g].floor + p->v_noise[g].shot * fmax(v, 0);
        double difference = foretold * v - f;
        sum.difference += difference * difference;
        sum.noise +=
            foretold * foretold * noise + p->f_noise[g].floor + p->f_noise[g].shot * fmax(f, 0);
        sum.single += (double)r[g] * (double)r[g] * noise * p->n_lights / p->n_segments;
        sum.total += f * f;
    }
    if (isfinite(sum.difference) && isfinite(sum.noise) && isfinite(sum.single) &&
        isfinite(sum.total))
        ls_linear_error_add(error, &sum);
}

static void blend_row(const struct ls_mono_blend_pictures *p, const struct ls_linear_sums *sums,
                      const struct ls_linear_part *part, uint32_t y)
{
    size_t first = (size_t)(part->y + y) * p->width + part->x, n = p->n_segments;
    size_t stride = part->out_stride ? part->out_stride : part->width * n;
    bool taken = part->step && y >= part->first_y && (y - part->first_y) % part->step == 0;
    for (uint32_t x = 0; x < part->width; x++) {
        float *r = part->out + y * stride + x * n;
        if (n == 1)
            *r = sums->ratio[first + x];
        else
            blend_pixel(p, sums, first + x, r);
        if (taken && x >= part->first_x && (x - part->first_x) % part->step == 0)
            add_error(p, first + x, r, part->error);
    }
}

enum ls_err ls_mono_blend_fit(const struct ls_mono_blend_pictures *pictures,
                              const struct ls_linear_part *part, struct ls_diag *diag)
{
    const double p_in = 1, p_out = pictures->neutral;
    const struct ls_linear_pictures linear = as_linear(pictures, &p_in, &p_out);
    struct ls_linear_options options;
    struct ls_linear_sums sums = {0};
    ls_linear_options_default(&options);
    enum ls_err err = ls_linear_check_part(&linear, part, diag);
    if (!err)
        err = ls_linear_sums_init(&linear, &options, part->y, part->height, &sums, diag);
    for (uint32_t y = 0; y < part->height && !err; y++)
        blend_row(pictures, &sums, part, y);
    ls_linear_sums_finish(&sums);
    return err;
}

#include "core/promote.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { F, V, VARIANCE, PLANES };
enum { SMALL_PX = 2, LARGE_PX = LS_RATIO_HALO_PX };
enum { CONTRAST_PX = 128 };                         /* of a row at a time */
static const double trust_from = 4, trust_all = 10; /* sigma */
static const double departure = 8;
static const float demosaic_sigma = 0.05f; /* of the range of V around a sample */

double ls_promote_sphere_factor(const struct ls_field *field, uint32_t s)
{
    return field->factor[s] / field->duty[s];
}

/* sqrt(read sum r^2 + dark (sum r)^2 + shot x per_light x light). */
static void fill_sigma(const struct ls_field *field, const float *row, size_t n_row,
                       double per_light, const float *light, size_t n, float *sigma)
{
    double squares = 0, sum = 0;
    for (size_t i = 0; i < n_row; i++) {
        squares += (double)row[i] * (double)row[i];
        sum += (double)row[i];
    }
    double floor_variance =
        field->noise.read_variance * squares + field->noise.dark_variance * sum * sum;
    for (size_t j = 0; j < n; j++)
        sigma[j] =
            (float)sqrt(floor_variance + field->noise.shot * per_light * fmax((double)light[j], 0));
}

void ls_promote_sigma(const struct ls_field *field, const float *row, size_t n_row, const float *v,
                      size_t n, float *sigma)
{
    double largest = 0;
    for (size_t i = 0; i < n_row; i++)
        largest = fmax(largest, (double)row[i]);
    fill_sigma(field, row, n_row, largest, v, n, sigma);
}

void ls_promote_sigma_light(const struct ls_field *field, const float *row, size_t n_row,
                            const float *light, size_t n, float *sigma)
{
    fill_sigma(field, row, n_row, 1, light, n, sigma);
}

/* Largest and smallest of v over the rows [top, end) at one sample of each of @n pixels. */
static void range_down(const float *v, size_t row, uint32_t channels, uint32_t top, uint32_t end,
                       uint32_t n, float *restrict low, float *restrict high)
{
    for (uint32_t x = 0; x < n; x++) {
        low[x] = INFINITY;
        high[x] = -INFINITY;
    }
    for (uint32_t y = top; y < end; y++) {
        const float *from = v + y * row;
        for (uint32_t x = 0; x < n; x++) {
            float value = from[(size_t)x * channels];
            low[x] = value < low[x] ? value : low[x];
            high[x] = value > high[x] ? value : high[x];
        }
    }
}

/* Pixels [x, x + n) of a row of one channel; @v at its first sample. */
static void add_range(const float *v, uint32_t width, uint32_t channels, uint32_t y, uint32_t top,
                      uint32_t end, uint32_t x, uint32_t n, float *sigma)
{
    enum { HALO = LS_CONTRAST_HALO_PX };
    float low[CONTRAST_PX + 2 * HALO], high[CONTRAST_PX + 2 * HALO];
    size_t row = (size_t)width * channels;
    uint32_t first = x > HALO ? x - HALO : 0;
    uint32_t last = width - (x + n) > HALO ? x + n + HALO : width;
    range_down(v + (size_t)first * channels, row, channels, top, end, last - first, low, high);
    for (uint32_t k = x; k < x + n; k++) {
        size_t at = y * row + (size_t)k * channels;
        float least = v[at], most = v[at];
        uint32_t from = k > HALO ? k - HALO : 0, to = width - 1 - k < HALO ? width - 1 : k + HALO;
        for (uint32_t j = from - first; j <= to - first; j++) {
            least = low[j] < least ? low[j] : least;
            most = high[j] > most ? high[j] : most;
        }
        double step = (double)(demosaic_sigma * (most - least)), own = (double)sigma[at];
        sigma[at] = (float)sqrt(own * own + step * step);
    }
}

void ls_promote_add_contrast(const float *v, uint32_t width, uint32_t height, uint32_t channels,
                             float *sigma)
{
    for (uint32_t y = 0; y < height; y++) {
        uint32_t top = y > LS_CONTRAST_HALO_PX ? y - LS_CONTRAST_HALO_PX : 0;
        uint32_t end = height - 1 - y < LS_CONTRAST_HALO_PX ? height : y + LS_CONTRAST_HALO_PX + 1;
        for (uint32_t c = 0; c < channels; c++)
            for (uint32_t x = 0; x < width; x += CONTRAST_PX) {
                uint32_t n = width - x < CONTRAST_PX ? width - x : CONTRAST_PX;
                add_range(v + c, width, channels, y, top, end, x, n, sigma + c);
            }
    }
}

/** F, V and the variance of V of one channel; 0 where not measured. */
struct samples {
    uint32_t width, height;
    float *plane[PLANES];
};

/** Sums over a square window, row by row: horizontal sums of the last rows are kept in a ring. */
struct window {
    const struct samples *samples;
    uint32_t radius, next_row; /* next row to be summed horizontally */
    double *ring;              /* [2 radius + 1][PLANES][width] */
    double *sum;               /* [PLANES][width], of the current row */
};

static enum ls_err window_init(struct window *window, const struct samples *samples,
                               uint32_t radius)
{
    size_t row = (size_t)PLANES * samples->width;
    *window = (struct window){.samples = samples, .radius = radius};
    window->ring = calloc(row * (2 * radius + 1), sizeof *window->ring);
    window->sum = calloc(row, sizeof *window->sum);
    return window->ring && window->sum ? LS_OK : LS_ERR_NOMEM;
}

static void window_finish(struct window *window)
{
    free(window->ring);
    free(window->sum);
}

/* Every sum is added up from left to right. */
static void sum_across(const float *restrict in, uint32_t width, uint32_t radius,
                       double *restrict out)
{
    memset(out, 0, width * sizeof *out);
    for (int64_t step = -(int64_t)radius; step <= (int64_t)radius; step++) {
        int64_t first = step < 0 ? -step : 0, end = step > 0 ? width - step : width;
        for (int64_t x = first; x < end; x++)
            out[x] += (double)in[x + step];
    }
}

static double *ring_row(const struct window *window, uint32_t y)
{
    size_t slot = y % (2 * window->radius + 1);
    return window->ring + slot * PLANES * window->samples->width;
}

/* rows must be asked for in order; any may be left out */
static void window_row(struct window *window, uint32_t y)
{
    const struct samples *samples = window->samples;
    uint32_t width = samples->width, radius = window->radius;
    uint32_t y0 = y > radius ? y - radius : 0;
    uint32_t y1 = samples->height - 1 - y < radius ? samples->height - 1 : y + radius;
    if (window->next_row < y0)
        window->next_row = y0;
    for (; window->next_row <= y1; window->next_row++)
        for (int k = 0; k < PLANES; k++)
            sum_across(samples->plane[k] + (size_t)window->next_row * width, width, radius,
                       ring_row(window, window->next_row) + (size_t)k * width);
    memset(window->sum, 0, sizeof(double) * PLANES * width);
    for (uint32_t row = y0; row <= y1; row++) {
        const double *in = ring_row(window, row);
        for (size_t j = 0; j < (size_t)PLANES * width; j++)
            window->sum[j] += in[j];
    }
}

/* one level of the hierarchy: the quotient f / v as far as it is trusted, else @next */
static double level(double f, double v, double variance, double next, double neutral)
{
    double sigma = sqrt(variance), ratio = f / v;
    if (!(v > 0) || !(v > trust_from * sigma) || !(fabs(ratio) <= (double)FLT_MAX))
        return next;
    if (v >= trust_all * sigma)
        return ratio;
    double limit = departure * fmax(fabs(next), neutral);
    double t = (v / sigma - trust_from) / (trust_all - trust_from);
    double q = t * t * (3 - 2 * t);
    return q * fmax(-limit, fmin(limit, ratio)) + (1 - q) * next;
}

static double at_window(const struct window *window, uint32_t x, double next, double neutral)
{
    const double *sum = window->sum + x;
    size_t width = window->samples->width;
    return level(sum[F * width], sum[V * width], sum[VARIANCE * width], next, neutral);
}

/* Is the sample's own quotient all there is to it? As level() decides. */
static bool is_trusted(const struct samples *samples, size_t j)
{
    double f = (double)samples->plane[F][j], v = (double)samples->plane[V][j];
    double sigma = sqrt((double)samples->plane[VARIANCE][j]);
    return v > 0 && v >= trust_all * sigma && fabs(f / v) <= (double)FLT_MAX;
}

static double ratio_at(const struct samples *samples, const struct window *small,
                       const struct window *large, uint32_t x, size_t j, double neutral)
{
    double r = at_window(large, x, neutral, neutral);
    r = at_window(small, x, r, neutral);
    return level((double)samples->plane[F][j], (double)samples->plane[V][j],
                 (double)samples->plane[VARIANCE][j], r, neutral);
}

static void ratio_rows(const struct samples *samples, struct window *small, struct window *large,
                       double neutral, uint32_t channels, float *ratio)
{
    for (uint32_t y = 0; y < samples->height; y++) {
        bool windows = false; /* made for the first sample of a row that needs them */
        for (uint32_t x = 0; x < samples->width; x++) {
            size_t j = (size_t)y * samples->width + x;
            if (is_trusted(samples, j)) {
                ratio[j * channels] =
                    (float)((double)samples->plane[F][j] / (double)samples->plane[V][j]);
                continue;
            }
            if (!windows) {
                window_row(small, y);
                window_row(large, y);
                windows = true;
            }
            ratio[j * channels] = (float)ratio_at(samples, small, large, x, j, neutral);
        }
    }
}

static void gather(const float *f, const float *v, const float *sigma, uint32_t channels,
                   struct samples *samples)
{
    size_t n = (size_t)samples->width * samples->height;
    for (size_t j = 0; j < n; j++) {
        float a = f[j * channels], b = v[j * channels], s = sigma[j * channels];
        bool measured = isfinite(a) && isfinite(b) && s >= 0 && isfinite(s * s);
        samples->plane[F][j] = measured ? a : 0;
        samples->plane[V][j] = measured ? b : 0;
        samples->plane[VARIANCE][j] = measured ? s * s : 0;
    }
}

static enum ls_err check(uint32_t width, uint32_t height, uint32_t channels, const double *neutral,
                         struct ls_diag *diag)
{
    if (width < 1 || height < 1 || (channels != 1 && channels != 3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "ratio: %u x %u px of %u channels: expected at least 1 x 1 of 1 or 3", width,
                       height, channels);
    for (uint32_t c = 0; c < channels; c++)
        if (!(neutral[c] > 0 && neutral[c] < (double)FLT_MAX))
            return ls_fail(diag, LS_ERR_INVALID,
                           "ratio: p(s)/p(0) of channel %u is %g: expected a positive number", c,
                           neutral[c]);
    return LS_OK;
}

enum ls_err ls_promote_ratio(const float *f, const float *v, const float *sigma, uint32_t width,
                             uint32_t height, uint32_t channels, const double *neutral,
                             float *ratio, struct ls_diag *diag)
{
    enum ls_err err = check(width, height, channels, neutral, diag);
    if (err)
        return err;
    size_t n = (size_t)width * height;
    LS_CLEANUP_FREE float *planes = calloc(n * PLANES, sizeof *planes);
    if (!planes)
        return ls_fail(diag, LS_ERR_NOMEM, "ratio: out of memory");
    struct samples samples = {
        .width = width, .height = height, .plane = {planes, planes + n, planes + 2 * n}};
    for (uint32_t c = 0; !err && c < channels; c++) {
        struct window small = {0}, large = {0};
        gather(f + c, v + c, sigma + c, channels, &samples);
        err = window_init(&small, &samples, SMALL_PX);
        if (!err)
            err = window_init(&large, &samples, LARGE_PX);
        if (!err)
            ratio_rows(&samples, &small, &large, neutral[c], channels, ratio + c);
        window_finish(&small);
        window_finish(&large);
    }
    return err ? ls_fail(diag, err, "ratio: out of memory") : LS_OK;
}

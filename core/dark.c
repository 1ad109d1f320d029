#include "core/dark.h"

#include "core/sample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BLOCK = 256, FRAMES_MAX = 65536 };

struct ls_dark {
    const struct ls_pixel_format *format;
    uint32_t width, height, n_frames;
    uint64_t zeros, clipped; /* samples */
    uint32_t *sum;
    uint64_t *squares;
};

static size_t pixels(const struct ls_dark *d)
{
    return (size_t)d->width * d->height;
}

enum ls_err ls_dark_create(const struct ls_pixel_format *format, uint32_t width, uint32_t height,
                           struct ls_dark **out, struct ls_diag *diag)
{
    uint64_t n = (uint64_t)width * height;

    *out = NULL;
    if (!n)
        return ls_fail(diag, LS_ERR_INVALID, "dark: image of %u x %u pixels: expected at least one",
                       width, height);
    if (n > UINT32_MAX)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "dark: image of %u x %u pixels: expected fewer than 2^32", width, height);
    struct ls_dark *d = calloc(1, sizeof *d);
    if (!d)
        return LS_ERR_NOMEM;
    *d = (struct ls_dark){.format = format, .width = width, .height = height};
    d->sum = calloc(n, sizeof *d->sum);
    d->squares = calloc(n, sizeof *d->squares);
    if (!d->sum || !d->squares) {
        ls_dark_destroy(d);
        return LS_ERR_NOMEM;
    }
    *out = d;
    return LS_OK;
}

void ls_dark_destroy(struct ls_dark *dark)
{
    if (!dark)
        return;
    free(dark->sum);
    free(dark->squares);
    free(dark);
}

enum ls_err ls_dark_add(struct ls_dark *d, const void *raw)
{
    uint16_t dn[BLOCK];
    uint32_t max = ls_pixel_max_dn(d->format);

    if (d->n_frames == FRAMES_MAX)
        return LS_ERR_LIMIT;
    for (size_t at = 0, n = pixels(d); at < n; at += BLOCK) {
        size_t k = n - at < BLOCK ? n - at : BLOCK;
        uint32_t zeros = 0, clipped = 0;
        ls_pixel_unpack(d->format, raw, at, k, dn);
        for (size_t i = 0; i < k; i++) {
            d->sum[at + i] += dn[i];
            d->squares[at + i] += (uint64_t)dn[i] * dn[i];
            zeros += dn[i] == 0;
            clipped += dn[i] >= max;
        }
        d->zeros += zeros;
        d->clipped += clipped;
    }
    d->n_frames++;
    return LS_OK;
}

static float mean_of(const struct ls_dark *d, size_t p)
{
    return (float)((double)d->sum[p] / d->n_frames);
}

/* Exact integers: K sum x^2 and (sum x)^2 both stay below 2^64 for K <= 65536. */
static float variance_of(const struct ls_dark *d, size_t p)
{
    uint64_t k = d->n_frames, s = d->sum[p];
    return (float)((double)(k * d->squares[p] - s * s) / ((double)k * (double)(k - 1)));
}

enum ls_err ls_dark_mean(const struct ls_dark *d, float *mean_dn)
{
    if (!d->n_frames)
        return LS_ERR_STATE;
    for (size_t p = 0, n = pixels(d); p < n; p++)
        mean_dn[p] = mean_of(d, p);
    return LS_OK;
}

enum ls_err ls_dark_variance(const struct ls_dark *d, float *variance_dn2)
{
    if (d->n_frames < 2)
        return LS_ERR_STATE;
    for (size_t p = 0, n = pixels(d); p < n; p++)
        variance_dn2[p] = variance_of(d, p);
    return LS_OK;
}

/* Variance above which a pixel is noisier than chance allows; a floor of 4 DN^2 keeps quantised
 * variances (median 0) from being called noise. */
static enum ls_err variance_limit(const struct ls_dark *d, float *limit)
{
    LS_CLEANUP_FREE float *sample = malloc(LS_SAMPLES_MAX * sizeof *sample);
    size_t n = 0;

    if (!sample)
        return LS_ERR_NOMEM;
    for (size_t p = 0, end = pixels(d), step = ls_sample_step(end); p < end; p += step)
        sample[n++] = variance_of(d, p);
    *limit = fmaxf(36 * ls_median(sample, n), 4);
    return LS_OK;
}

static enum ls_err read_noise(const struct ls_dark *d, double *noise_dn)
{
    float limit;
    double sum = 0;
    uint64_t n = 0;
    enum ls_err err = variance_limit(d, &limit);

    if (err)
        return err;
    for (size_t p = 0, end = pixels(d); p < end; p++) {
        float v = variance_of(d, p);
        if (v <= limit) {
            sum += v;
            n++;
        }
    }
    *noise_dn = n ? sqrt(fmax(sum / (double)n - 1.0 / 12, 0)) : 0;
    return LS_OK;
}

enum ls_err ls_dark_stats(const struct ls_dark *d, struct ls_dark_stats *stats)
{
    double sum = 0, samples = (double)pixels(d) * d->n_frames;

    if (!d->n_frames)
        return LS_ERR_STATE;
    for (size_t p = 0, n = pixels(d); p < n; p++)
        sum += d->sum[p];
    *stats = (struct ls_dark_stats){
        .n_frames = d->n_frames,
        .mean_dn = sum / samples,
        .zero_fraction = (double)d->zeros / samples,
        .clipped_fraction = (double)d->clipped / samples,
    };
    return d->n_frames < 2 ? LS_OK : read_noise(d, &stats->read_noise_dn);
}

enum ls_err ls_dark_check_black(const struct ls_dark_stats *stats, struct ls_diag *diag)
{
    if (stats->zero_fraction < LS_DARK_ZERO_LIMIT)
        return LS_OK;
    return ls_fail(diag, LS_ERR_INVALID,
                   "dark frames: black level clips: %.2f %% of samples are at DN 0, expected below "
                   "%.1f %%; raise the camera's black level (mean dark is %.2f DN)",
                   100 * stats->zero_fraction, 100 * LS_DARK_ZERO_LIMIT, stats->mean_dn);
}

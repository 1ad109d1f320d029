/*
 * merge_cases: parameters, images and the long double reference that the merge tests share.
 * Layer: tests. Threads: one. Ownership: an image owns its buffers; image_finish frees them.
 */
#ifndef LS_TESTS_CORE_MERGE_CASES_H
#define LS_TESTS_CORE_MERGE_CASES_H

#include "core/merge_kernels.h"

#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static inline struct ls_merge_params params_for(const char *format, uint32_t width, uint32_t height,
                                                uint32_t n, const double *exposure_s)
{
    struct ls_merge_params p = {
        .format = ls_pixel_by_name(format),
        .width = width,
        .height = height,
        .n_exposures = n,
        .range_low = LS_MERGE_RANGE_LOW,
        .range_high = LS_MERGE_RANGE_HIGH,
        .read_noise_dn = 0.8,
        .electrons_per_dn = 40,
    };
    memcpy(p.exposure_s, exposure_s, n * sizeof *exposure_s);
    p.full_scale_dn = p.clip_dn = ls_pixel_max_dn(p.format);
    return p;
}

/* Buffers of an image, samples as uint16 beside the packed payload. */
struct image {
    struct ls_merge_params p;
    enum ls_isa isa; /* the processor's best, unless a test says otherwise */
    size_t n, bytes;
    uint16_t *dn[LS_MERGE_MAX_EXPOSURES];
    uint8_t *raw[LS_MERGE_MAX_EXPOSURES];
    float *dark[LS_MERGE_MAX_EXPOSURES];
    float *e, *variance;
    uint8_t *validity;
};

static inline void image_init(struct image *image, const struct ls_merge_params *p)
{
    *image = (struct image){.p = *p, .isa = ls_cpu_isa(), .n = (size_t)p->width * p->height};
    image->bytes = ls_pixel_payload_bytes(p->format, p->width, p->height);
    for (uint32_t i = 0; i < p->n_exposures; i++) {
        image->dn[i] = g_new0(uint16_t, image->n);
        image->raw[i] = g_malloc0(image->bytes);
        image->dark[i] = g_new0(float, image->n);
    }
    image->e = g_new0(float, image->n);
    image->variance = g_new0(float, image->n);
    image->validity = g_malloc0(image->n);
}

static inline void image_finish(struct image *image)
{
    for (uint32_t i = 0; i < image->p.n_exposures; i++) {
        g_free(image->dn[i]);
        g_free(image->raw[i]);
        g_free(image->dark[i]);
    }
    g_free(image->e);
    g_free(image->variance);
    g_free(image->validity);
}

static inline struct ls_merge_spans image_spans(struct image *image)
{
    struct ls_merge_spans s = {
        .e = image->e, .validity = image->validity, .variance = image->variance};
    for (uint32_t i = 0; i < image->p.n_exposures; i++) {
        s.raw[i] = image->raw[i];
        s.dark[i] = image->dark[i];
    }
    return s;
}

static inline void image_pack(struct image *image)
{
    for (uint32_t i = 0; i < image->p.n_exposures; i++)
        ls_pixel_pack(image->p.format, image->dn[i], 0, image->n, image->raw[i]);
}

static inline void image_merge(struct image *image)
{
    struct ls_merge_spans s = image_spans(image);
    struct ls_diag diag = {""};
    enum ls_err err = ls_merge_check(&image->p, &diag);

    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    image_pack(image);
    ls_merge_rows_with(ls_merge_kernels(image->isa), &image->p, &s, 0, image->p.height);
}

/* What the header promises, written again: exposures in any order, long double, no vectors. */
struct reference {
    long double e, scale, variance; /* scale: sum w'|y| / sum w't, what the error is relative to */
    uint8_t validity;
    int borderline; /* an expected value within 1e-5 of a range edge */
};

static inline long double model_variance(const struct ls_merge_params *p, long double signal)
{
    return (long double)p->read_noise_dn * p->read_noise_dn + 1.0L / 12 +
           fmaxl(signal, 0) / p->electrons_per_dn;
}

static inline struct reference reference_merge(const struct ls_merge_params *p, const uint16_t *x,
                                               const float *d)
{
    struct reference r = {0};
    long double sum = 0, norm = 0, absolute = 0, e = 0;
    uint32_t n = p->n_exposures, in = 0, high = 0, pick = 0;
    int have_pick = 0;

    for (uint32_t i = 0; i < n; i++)
        if (x[i] < p->clip_dn) {
            sum += x[i] - (long double)d[i];
            norm += p->exposure_s[i];
        }
    e = norm > 0 ? sum / norm : 0;
    sum = norm = 0;
    for (uint32_t i = 0; i < n; i++)
        if (x[i] < p->clip_dn) {
            long double t = p->exposure_s[i], w = t / model_variance(p, e * t);
            sum += w * (x[i] - (long double)d[i]);
            norm += w * t;
        }
    e = norm > 0 ? sum / norm : 0;
    sum = norm = 0;
    for (uint32_t i = 0; i < n; i++) {
        long double t = p->exposure_s[i], y = x[i] - (long double)d[i], expected = d[i] + e * t;
        long double low = p->range_low * p->full_scale_dn, top = p->range_high * p->full_scale_dn;
        int is_high = x[i] >= p->clip_dn || expected > top, is_low = !is_high && expected < low;
        r.borderline |= fabsl(expected - top) < 1e-5L * p->full_scale_dn ||
                        fabsl(expected - low) < 1e-5L * p->full_scale_dn;
        if (!is_high && (!have_pick || t > p->exposure_s[pick])) {
            pick = i;
            have_pick = 1;
        }
        high += is_high;
        if (is_high || is_low)
            continue;
        long double w = t / model_variance(p, e * t);
        in++;
        sum += w * y;
        absolute += w * fabsl(y);
        norm += w * t;
    }
    if (!have_pick)
        for (uint32_t i = 0; i < n; i++)
            if (p->exposure_s[i] < p->exposure_s[pick])
                pick = i;
    long double t = p->exposure_s[pick], y = x[pick] - (long double)d[pick];
    long double fs = p->full_scale_dn;
    r.validity = in          ? LS_VALIDITY_OK
                 : high == n ? LS_VALIDITY_SATURATED
                 : high      ? LS_VALIDITY_GAP
                             : LS_VALIDITY_DARK;
    r.e = (in ? sum / norm : y / t) / fs;
    r.scale = (in ? absolute / norm : fabsl(y) / t) / fs;
    r.variance = (in ? 1 / norm : model_variance(p, y) / (t * t)) / (fs * fs);
    return r;
}

#endif

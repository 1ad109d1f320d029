#include "core/merge.h"

#include "core/half.h"

#include <float.h>
#include <math.h>
#include <string.h>

static enum ls_err check_shape(const struct ls_merge_params *p, struct ls_diag *diag)
{
    if (!p->format)
        return ls_fail(diag, LS_ERR_INVALID, "merge: no pixel format");
    if (!p->width || !p->height || (uint64_t)p->width * p->height > UINT32_MAX)
        return ls_fail(diag, LS_ERR_INVALID,
                       "merge: image of %u x %u pixels: expected at least 1 x 1 and fewer than "
                       "2^32 pixels",
                       p->width, p->height);
    if (p->n_exposures < 1 || p->n_exposures > LS_MERGE_MAX_EXPOSURES)
        return ls_fail(diag, LS_ERR_INVALID, "merge: %u exposures: expected 1 to %d",
                       p->n_exposures, LS_MERGE_MAX_EXPOSURES);
    for (uint32_t i = 0; i < p->n_exposures; i++)
        if (!(p->exposure_s[i] >= 1e-9 && p->exposure_s[i] <= 1e6))
            return ls_fail(diag, LS_ERR_INVALID,
                           "merge: exposure %u of %g s: expected 1e-9 to 1e6 s", i,
                           p->exposure_s[i]);
    return LS_OK;
}

static enum ls_err check_numbers(const struct ls_merge_params *p, struct ls_diag *diag)
{
    double max = ls_pixel_max_dn(p->format);

    if (!(p->full_scale_dn > 0 && p->full_scale_dn <= max))
        return ls_fail(diag, LS_ERR_INVALID,
                       "merge: full scale of %g DN: expected above 0, at most %g for %s",
                       p->full_scale_dn, max, p->format->name);
    if (!(p->clip_dn > 0 && p->clip_dn <= p->full_scale_dn))
        return ls_fail(diag, LS_ERR_INVALID,
                       "merge: clip at %g DN: expected above 0, at most the full scale of %g DN",
                       p->clip_dn, p->full_scale_dn);
    if (!(p->range_low >= 0 && p->range_low < p->range_high && p->range_high <= 1))
        return ls_fail(diag, LS_ERR_INVALID,
                       "merge: linear range %g to %g of full scale: expected 0 <= low < high <= 1",
                       p->range_low, p->range_high);
    if (!(p->electrons_per_dn >= 1e-6 && p->electrons_per_dn <= 1e9))
        return ls_fail(diag, LS_ERR_INVALID,
                       "merge: %g electrons per DN: expected 1e-6 to 1e9, from the camera's data "
                       "sheet or a photon transfer curve",
                       p->electrons_per_dn);
    if (!(p->reference_exposure_s >= 0 && p->reference_exposure_s <= (double)FLT_MAX))
        return ls_fail(diag, LS_ERR_INVALID,
                       "merge: reference exposure of %g s: expected a positive time",
                       p->reference_exposure_s);
    if (!(p->read_noise_dn >= 0 && p->read_noise_dn <= max))
        return ls_fail(diag, LS_ERR_INVALID, "merge: read noise of %g DN: expected 0 to %g",
                       p->read_noise_dn, max);
    return LS_OK;
}

static enum ls_err check_defects(const struct ls_merge_params *p, struct ls_diag *diag)
{
    uint64_t pixels = (uint64_t)p->width * p->height;

    if (p->n_defects && !p->defects)
        return ls_fail(diag, LS_ERR_INVALID, "merge: %u defective pixels but no list",
                       p->n_defects);
    for (uint32_t i = 0; i < p->n_defects; i++)
        if (p->defects[i] >= pixels || (i && p->defects[i] <= p->defects[i - 1]))
            return ls_fail(diag, LS_ERR_INVALID,
                           "merge: defective pixel %u (entry %u): expected ascending indices below "
                           "%llu",
                           p->defects[i], i, (unsigned long long)pixels);
    return LS_OK;
}

enum ls_err ls_merge_check(const struct ls_merge_params *params, struct ls_diag *diag)
{
    enum ls_err err = check_shape(params, diag);

    if (!err)
        err = check_numbers(params, diag);
    if (!err)
        err = check_defects(params, diag);
    return err;
}

uint32_t ls_merge_bracket_gaps(const double *exposure_s, uint32_t n_exposures, double range_low,
                               double range_high, double *shorter_s)
{
    uint32_t gaps = 0;
    double first = INFINITY;

    for (uint32_t i = 0; i < n_exposures; i++) {
        double next = INFINITY;
        for (uint32_t k = 0; k < n_exposures; k++)
            if (exposure_s[k] > exposure_s[i] && exposure_s[k] < next)
                next = exposure_s[k];
        /* A bracket built on the exact ratio is no gap: allow for the rounding of times. */
        if (next == INFINITY || next * range_low <= exposure_s[i] * range_high * (1 + 1e-9))
            continue;
        gaps++;
        if (exposure_s[i] < first)
            first = exposure_s[i];
    }
    if (shorter_s && gaps)
        *shorter_s = first;
    return gaps;
}

/* Values are made safe first, so that the conversion itself can use the fast span. */
size_t ls_merge_store_half(const float *e, size_t n, double reference_exposure_s, uint16_t *half,
                           uint8_t *validity)
{
    enum { BLOCK = 256 };
    float scale = (float)reference_exposure_s;
    size_t beyond = 0;

    for (size_t at = 0; at < n; at += BLOCK) {
        float value[BLOCK];
        size_t k = n - at < BLOCK ? n - at : BLOCK;
        for (size_t i = 0; i < k; i++) {
            float v = e[at + i] * scale;
            value[i] = v;
            if (fabsf(v) <= LS_HALF_MAX)
                continue;
            value[i] = v > 0 ? LS_HALF_MAX : v < 0 ? -LS_HALF_MAX : 0;
            validity[at + i] = LS_VALIDITY_SATURATED;
            beyond++;
        }
        ls_half_from_floats(value, half + at, k);
    }
    return beyond;
}

#include "core/separated_kernels.h"

#include "core/half.h"

#include <assert.h>
#include <math.h>
#include <string.h>

enum { MAX_WIDEN = 68 };

static unsigned widen(const void *halfs, size_t n, float *out)
{
    uint16_t bits[MAX_WIDEN];
    unsigned not_finite = 0;
    assert(n <= MAX_WIDEN);
    memcpy(bits, halfs, 2 * n);
    for (size_t j = 0; j < n; j++) {
        int finite = (bits[j] & 0x7c00) != 0x7c00;
        out[j] = finite ? ls_half_to_float(bits[j]) : 0;
        not_finite += !finite;
    }
    return not_finite;
}

static void split(const struct ls_separated_terms *terms, const float *v, const float *h, size_t n,
                  float *d, float *s, float *variance)
{
    struct ls_split c = terms->split;
    for (size_t j = 0; j < n; j++) {
        float lit_v = v[j] > 0 ? v[j] : 0, lit_h = h[j] > 0 ? h[j] : 0;
        d[j] = c.d_v * v[j] + c.d_h * h[j];
        s[j] = c.s_v * v[j] + c.s_h * h[j];
        variance[j] = (terms->variance + terms->shot_v * lit_v) + terms->shot_h * lit_h;
    }
}

static void sigma(const float *row, const float *next, size_t n, float scale, float *out)
{
    for (size_t j = 0; j < n; j++) {
        float here = row[j] > next[j] ? row[j] : next[j];
        float right = row[j + 1] > next[j + 1] ? row[j + 1] : next[j + 1];
        out[j] = scale * sqrtf(here > right ? here : right);
    }
}

static void add(const float *w, uint32_t n_lights, const float *values, size_t stride, size_t n,
                float *sum)
{
    for (size_t j = 0; j < n; j++) {
        float part = w[0] * values[j];
        for (uint32_t k = 1; k < n_lights; k++)
            part += w[k] * values[k * stride + j];
        sum[j] += part;
    }
}

const struct ls_separated_kernels ls_separated_kernels_c = {widen, split, sigma, ls_conductor_part,
                                                            add};

const struct ls_separated_kernels *ls_separated_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_separated_kernels_c, &ls_separated_kernels_c,
                       &ls_separated_kernels_c);
}

#include "core/accumulate_kernels.h"
#include "core/half.h"

#include <assert.h>
#include <math.h>
#include <string.h>

static unsigned widen(const void *half, size_t j, float *out)
{
    uint16_t bits;
    memcpy(&bits, (const char *)half + 2 * j, sizeof bits);
    *out = ls_half_to_float(bits);
    if (isfinite(*out))
        return 0;
    *out = 0;
    return 1;
}

static unsigned add(const void *const *halfs, const void *const *next, const float *const *w,
                    uint32_t n, uint32_t count, uint32_t n_sums, float *acc, size_t stride)
{
    unsigned not_finite = 0;
    float e[LS_ACCUMULATE_GROUP];
    assert(n <= LS_ACCUMULATE_GROUP && n_sums >= 1);
    for (uint32_t j = 0; j < count; j++) {
        for (uint32_t i = 0; i < n; i++)
            not_finite += widen(halfs[i], j, &e[i]);
        for (uint32_t q = 0; q < n_sums; q++) {
            float part = 0;
            for (uint32_t i = 0; i < n; i++)
                part = fmaf(w[i][q], e[i], part);
            acc[q * stride + j] += part;
        }
    }
    return not_finite;
}

const struct ls_accumulate_kernels ls_accumulate_kernels_c = {add};

const struct ls_accumulate_kernels *ls_accumulate_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_accumulate_kernels_c, &ls_accumulate_kernels_avx2,
                       &ls_accumulate_kernels_avx512);
}

#include "core/accumulate_kernels.h"
#include "core/half.h"

#include <math.h>
#include <string.h>

enum { GROUP = LS_ACCUMULATE_GROUP };

void ls_accumulate_pack(const float *const *w, uint32_t n, uint32_t n_sums, float *packed)
{
    for (uint32_t b = 0; b < ls_accumulate_blocks(n_sums); b++) {
        uint32_t q = ls_accumulate_block_start(n_sums, b);
        uint32_t n_q = ls_accumulate_block_start(n_sums, b + 1) - q;
        for (uint32_t i = 0; i < n; i++, packed += n_q)
            memcpy(packed, w[i] + q, n_q * sizeof *packed);
        for (uint32_t k = (ls_accumulate_padded(n) - n) * n_q; k > 0; k--)
            *packed++ = 0;
    }
}

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

/* A group's samples of one pixel into every sum. */
static void add(const struct ls_accumulate_terms *t, uint32_t g, uint32_t n, const float *e,
                float *acc, size_t stride)
{
    for (uint32_t b = 0; b < ls_accumulate_blocks(t->n_sums); b++) {
        uint32_t q = ls_accumulate_block_start(t->n_sums, b);
        uint32_t n_q = ls_accumulate_block_start(t->n_sums, b + 1) - q;
        const float *w = t->weights + (size_t)q * ls_accumulate_padded(t->n) + (size_t)g * n_q;
        for (uint32_t k = 0; k < n_q; k++) {
            float part = 0;
            for (uint32_t i = 0; i < n; i++)
                part = fmaf(w[i * n_q + k], e[i], part);
            acc[(q + k) * stride] += part;
        }
    }
}

static unsigned sum(const struct ls_accumulate_terms *t, uint32_t first, uint32_t count, float *acc,
                    size_t row_stride, size_t stride)
{
    unsigned not_finite = 0;
    for (uint32_t j = 0; j < count; j++) {
        float *to = acc + j / LS_ACCUMULATE_ROW * row_stride + j % LS_ACCUMULATE_ROW;
        for (uint32_t q = 0; q < t->n_sums; q++)
            to[q * stride] = 0;
        for (uint32_t g = 0; g < t->n; g += GROUP) {
            uint32_t n = t->n - g < GROUP ? t->n - g : GROUP;
            float e[GROUP];
            for (uint32_t i = 0; i < n; i++)
                not_finite += widen(t->halfs[g + i], (size_t)first + j, &e[i]);
            add(t, g, n, e, to, stride);
        }
    }
    return not_finite;
}

const struct ls_accumulate_kernels ls_accumulate_kernels_c = {sum};

const struct ls_accumulate_kernels *ls_accumulate_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_accumulate_kernels_c, &ls_accumulate_kernels_avx2,
                       &ls_accumulate_kernels_avx512);
}

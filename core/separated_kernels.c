#include "core/separated_kernels.h"

#include "core/half.h"

#include <math.h>
#include <string.h>

static unsigned widen(const void *halfs, size_t n, float *out)
{
    unsigned not_finite = 0;
    for (size_t j = 0; j < n; j++) {
        uint16_t bits;
        memcpy(&bits, (const char *)halfs + 2 * j, sizeof bits);
        int finite = (bits & 0x7c00) != 0x7c00;
        out[j] = finite ? ls_half_to_float(bits) : 0;
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

static void conductor(const struct ls_conductor *o, float *const s[3], const float *sigmas,
                      size_t n)
{
    const float *const from[3] = {s[0], s[1], s[2]};
    ls_conductor_part(o, from, sigmas, n, s, NULL);
}

static void add(const struct ls_separated_add *a)
{
    for (uint32_t q = 0; q < a->n_rows; q++)
        for (size_t j = 0; j < a->n; j++) {
            float part = 0;
            for (uint32_t k = 0; k < a->n_lights; k++)
                part = fmaf(a->w[q][k], a->values[k * a->stride + j], part);
            a->sum[q * a->sum_stride + j] += part;
        }
}

const struct ls_separated_kernels ls_separated_kernels_c = {widen, split, sigma, conductor, add};

const struct ls_separated_kernels *ls_separated_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_separated_kernels_c, &ls_separated_kernels_avx2,
                       &ls_separated_kernels_avx512);
}

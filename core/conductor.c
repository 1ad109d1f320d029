#include "core/conductor.h"

#include <math.h>

enum ls_err ls_conductor_make(const double white[3], double t, bool plain, struct ls_conductor *out,
                              struct ls_diag *diag)
{
    for (int c = 0; c < 3; c++)
        if (!(white[c] >= 1e-6 && white[c] <= 1e6))
            return ls_fail(diag, LS_ERR_INVALID,
                           "conductor: colour %g %g %g of the polarised white: expected numbers "
                           "within [1e-6, 1e6]",
                           white[0], white[1], white[2]);
    if (!(t >= 1e-6 && t <= 1e6))
        return ls_fail(diag, LS_ERR_INVALID, "conductor: threshold %g: expected within [1e-6, 1e6]",
                       t);
    for (int c = 0; c < 3; c++)
        out->scale[c] = (float)(1 / white[c]);
    out->threshold_a = (float)(plain ? t * white[1] / white[0] : t);
    out->threshold_b = (float)(plain ? t * white[2] / white[0] : t);
    return LS_OK;
}

/* min(|c - r|/(t |c|), 1), also where c is 0 */
static float departure(float r, float c, float t)
{
    float x = fabsf(c - r), y = t * fabsf(c), safe = y > 0 ? y : 1;
    float quotient = x / safe;
    return x < y ? quotient : 1;
}

static float gate(float m, float sigma)
{
    float x = m - LS_CONDUCTOR_SIGMA_FROM * sigma;
    float y = (LS_CONDUCTOR_SIGMA_FULL - LS_CONDUCTOR_SIGMA_FROM) * sigma;
    float safe = y > 0 ? y : 1, q = x / safe;
    q = x > 0 ? (x < y ? q : 1) : 0;
    return q * q * (3 - 2 * q);
}

static float share_of(const struct ls_conductor *o, float red, float green, float blue, float sigma)
{
    float r = red * o->scale[0], g = green * o->scale[1], b = blue * o->scale[2];
    float m = fabsf(r), mg = fabsf(g), mb = fabsf(b);
    m = mg > m ? mg : m;
    m = mb > m ? mb : m;
    float sum = departure(r, g, o->threshold_a) + departure(r, b, o->threshold_b);
    return gate(m, sigma) * (0.5f * sum);
}

void ls_conductor_part(const struct ls_conductor *conductor, const float *const s[3],
                       const float *sigma, size_t n, float *const out[3], float *share)
{
    for (size_t j = 0; j < n; j++) {
        float w = share_of(conductor, s[0][j], s[1][j], s[2][j], sigma ? sigma[j] : 0);
        for (int c = 0; c < 3; c++)
            out[c][j] = w * s[c][j];
        if (share)
            share[j] = w;
    }
}

#include "core/bases.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

static bool is_prime(uint32_t v)
{
    for (uint32_t d = 2; d * d <= v; d++)
        if (v % d == 0)
            return false;
    return v >= 2;
}

uint32_t ls_multiplex_order(uint32_t n_lights)
{
    uint32_t p = n_lights + 1;
    while (p % 4 != 3 || !is_prime(p))
        p++;
    return p;
}

void ls_multiplex_row(uint32_t order, uint32_t row, uint8_t *on)
{
    memset(on, 0, order);
    for (uint64_t d = 0; d <= order / 2; d++)
        on[(row + d * d) % order] = 1;
}

static void unit(const float v[3], double out[3])
{
    double length = sqrt((double)v[0] * v[0] + (double)v[1] * v[1] + (double)v[2] * v[2]);
    for (int k = 0; k < 3; k++)
        out[k] = v[k] / length;
}

/* Associated Legendre function over sin^m, orthonormal: upwards in l from l = m. */
static double legendre(uint32_t l, uint32_t m, double y)
{
    double before = 0, now = sqrt(1 / (4 * M_PI));
    for (uint32_t k = 1; k <= m; k++)
        now *= sqrt((2.0 * k + 1) / (2.0 * k));
    for (uint32_t k = m + 1; k <= l; k++) {
        double a = sqrt((4.0 * k * k - 1) / ((double)k * k - (double)m * m));
        double q = k - 1.0;
        double b = k > m + 1 ? sqrt((q * q - (double)m * m) / (4 * q * q - 1)) : 0;
        double next = a * (y * now - b * before);
        before = now;
        now = next;
    }
    return now;
}

double ls_harmonic(uint32_t index, const float direction[3])
{
    uint32_t l = (uint32_t)sqrt(index + 0.5);
    int m = (int)index - (int)(l * l + l);
    uint32_t order = (uint32_t)(m < 0 ? -m : m);
    double v[3], cosine = 1, sine = 0;
    unit(direction, v);
    for (uint32_t k = 0; k < order; k++) { /* sin^m times cosine and sine of m azimuths */
        double c = cosine * v[2] - sine * v[0];
        sine = cosine * v[0] + sine * v[2];
        cosine = c;
    }
    return legendre(l, order, v[1]) * (m ? sqrt(2) * (m > 0 ? cosine : sine) : 1);
}

static double weight(double f, enum ls_basis_form form)
{
    if (form == LS_BASIS_BIASED)
        return 0.5 + 0.5 * f;
    return fmax(form == LS_BASIS_POSITIVE ? f : -f, 0);
}

double ls_harmonic_weights(uint32_t index, enum ls_basis_form form, const float (*directions)[3],
                           uint32_t n, double *weights)
{
    double peak = 0;
    for (uint32_t i = 0; i < n; i++) {
        weights[i] = ls_harmonic(index, directions[i]);
        peak = fmax(peak, fabs(weights[i]));
    }
    for (uint32_t i = 0; i < n; i++)
        weights[i] = weight(peak > 0 ? weights[i] / peak : 0, form);
    return peak;
}

void ls_gradient_weights(unsigned axis, const float (*directions)[3], uint32_t n, double *weights)
{
    for (uint32_t i = 0; i < n; i++) {
        double v[3];
        unit(directions[i], v);
        weights[i] = 0.5 + 0.5 * v[axis];
    }
}

void ls_harmonic_coefficient(enum ls_basis_form form, double peak, uint32_t n, const float *shown,
                             const float *other, size_t count, float *out)
{
    double scale = 4 * M_PI / n * peak, times = form == LS_BASIS_BIASED ? 2 : 1;
    for (size_t j = 0; j < count; j++)
        out[j] = (float)(scale * (times * (double)shown[j] - (double)other[j]));
}

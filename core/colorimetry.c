#include "core/primaries.h"
#include "core/spectrum.h"

#include <math.h>

/* S0, S1, S2 of CIE 15, 380 to 780 nm by 10 */
static const double components[41][3] = {
    {63.4, 38.5, 3.0},   {65.8, 35.0, 1.2},   {94.8, 43.4, -1.1},  {104.8, 46.3, -0.5},
    {105.9, 43.9, -0.7}, {96.8, 37.1, -1.2},  {113.9, 36.7, -2.6}, {125.6, 35.9, -2.9},
    {125.5, 32.6, -2.8}, {121.3, 27.9, -2.6}, {121.3, 24.3, -2.6}, {113.5, 20.1, -1.8},
    {113.1, 16.2, -1.5}, {110.8, 13.2, -1.3}, {106.5, 8.6, -1.2},  {108.8, 6.1, -1.0},
    {105.3, 4.2, -0.5},  {104.4, 1.9, -0.3},  {100.0, 0.0, 0.0},   {96.0, -1.6, 0.2},
    {95.1, -3.5, 0.5},   {89.1, -3.5, 2.1},   {90.5, -5.8, 3.2},   {90.3, -7.2, 4.1},
    {88.4, -8.6, 4.7},   {84.0, -9.5, 5.1},   {85.1, -10.9, 6.7},  {81.9, -10.7, 7.3},
    {82.6, -12.0, 8.6},  {84.9, -14.0, 9.8},  {81.3, -13.6, 10.2}, {71.9, -12.0, 8.3},
    {74.3, -13.3, 9.6},  {76.4, -12.9, 8.5},  {63.3, -10.6, 7.0},  {71.7, -11.6, 7.6},
    {77.0, -12.2, 8.0},  {65.2, -10.2, 6.7},  {47.7, -7.8, 5.2},   {68.6, -11.2, 7.4},
    {65.0, -10.4, 6.8},
};

static double locus_x(double t)
{
    if (t <= 7000)
        return ((-4.6070e9 / t + 2.9678e6) / t + 0.09911e3) / t + 0.244063;
    return ((-2.0064e9 / t + 1.9018e6) / t + 0.24748e3) / t + 0.237040;
}

enum ls_err ls_daylight(double kelvin, struct ls_spectrum *out)
{
    if (!(kelvin >= 4000 && kelvin <= 25000))
        return LS_ERR_INVALID;
    double x = locus_x(kelvin), y = (-3.0 * x + 2.870) * x - 0.275;
    double divisor = 0.0241 + 0.2562 * x - 0.7341 * y;
    double m1 = (-1.3515 - 1.7703 * x + 5.9114 * y) / divisor;
    double m2 = (0.0300 - 31.4424 * x + 30.0717 * y) / divisor;
    for (int i = 0; i < LS_SPECTRUM_N; i += 2) {
        const double *s = components[i / 2];
        out->v[i] = s[0] + m1 * s[1] + m2 * s[2];
    }
    for (int i = 1; i < LS_SPECTRUM_N; i += 2)
        out->v[i] = 0.5 * (out->v[i - 1] + out->v[i + 1]);
    return LS_OK;
}

void ls_rec709_functionals(struct ls_spectrum out[3])
{
    double row[3][3], y = ls_spectrum_integral(&ls_cie_1931[1]);
    ls_primaries_from_xyz(&ls_primaries_rec709, row);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            out[c].v[i] = (row[c][0] * ls_cie_1931[0].v[i] + row[c][1] * ls_cie_1931[1].v[i] +
                           row[c][2] * ls_cie_1931[2].v[i]) /
                          y;
}

enum ls_err ls_rec709_functionals_for(const struct ls_spectrum *green, struct ls_spectrum out[3],
                                      struct ls_diag *diag)
{
    struct ls_spectrum d65;
    enum ls_err err = ls_daylight(6503.616, &d65);
    if (err)
        return ls_fail(diag, err, "rec709: no daylight");
    ls_rec709_functionals(out);
    double reads = ls_spectrum_dot(&d65, green), luminance = ls_spectrum_dot(&d65, &out[1]);
    if (!(reads > 0) || !isfinite(reads))
        return ls_fail(diag, LS_ERR_INVALID,
                       "rec709: the green sensitivity reads %g under D65: expected a positive "
                       "number",
                       reads);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            out[c].v[i] *= reads / luminance;
    return LS_OK;
}

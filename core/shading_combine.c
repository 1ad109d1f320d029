#include "core/shading.h"
#include "core/vec3.h"

#include <string.h>

void ls_tangents(const double direction[3], double e1[3], double e2[3])
{
    int least = 0;
    for (int k = 1; k < 3; k++)
        if (fabs(direction[k]) < fabs(direction[least]))
            least = k;
    double other[3] = {least == 0, least == 1, least == 2};
    ls_cross3(direction, other, e1);
    ls_unit3(e1);
    ls_cross3(direction, e1, e2);
}

/* What a light says of the centre, its own two coordinates eliminated; they are known to be 0
 * within @spread2. */
static void add_centre(const struct ls_shading *s, double spread2, double score[3], double m[6])
{
    const double *i = s->place_information, *at = i + 9;
    double aa = i[0] * spread2 + 1, ab = i[1] * spread2, bb = i[5] * spread2 + 1;
    double det = aa * bb - ab * ab;
    for (int r = 0; r < 3; r++) {
        /* row r of the cross information times the inverse of that of the coordinates */
        double a = spread2 * (i[2 + r] * bb - i[6 + r] * ab) / det;
        double b = spread2 * (i[6 + r] * aa - i[2 + r] * ab) / det;
        score[r] += s->place_score[2 + r] - a * s->place_score[0] - b * s->place_score[1];
        for (int c = r; c < 3; c++)
            *m++ += *at++ - a * i[2 + c] - b * i[6 + c];
    }
}

enum ls_err ls_centre_step(const struct ls_shading *fits, uint32_t n, double spread_deg,
                           double step[3], double sigma[3], struct ls_diag *diag)
{
    double score[3] = {0}, m[6] = {0}, column[3], spread = spread_deg * M_PI / 180;
    uint32_t lights = 0;
    for (uint32_t i = 0; i < n; i++) {
        lights += fits[i].place_information[9] > 0;
        add_centre(&fits[i], spread * spread, score, m);
    }
    if (lights < 3 || ls_solve3(m, score, step))
        return ls_fail(diag, LS_ERR_INVALID,
                       "sphere: its place is not determined by the shading under %u lights",
                       lights);
    for (int k = 0; k < 3; k++) {
        double unit[3] = {k == 0, k == 1, k == 2};
        sigma[k] = ls_solve3(m, unit, column) ? 0 : sqrt(fmax(0, column[k]));
    }
    return LS_OK;
}

enum ls_err ls_direction_combine(const double nominal[3], const struct ls_shading *fits, uint32_t n,
                                 double direction[3], double *sigma_deg, struct ls_diag *diag)
{
    double m[3] = {0}, b[2] = {0}, e1[3], e2[3];
    for (uint32_t k = 0; k < n; k++) {
        if (!fits[k].has_direction)
            continue;
        const double *i = fits[k].information, *o = fits[k].offset;
        m[0] += i[0];
        m[1] += i[1];
        m[2] += i[2];
        b[0] += i[0] * o[0] + i[1] * o[1];
        b[1] += i[1] * o[0] + i[2] * o[1];
    }
    double det = m[0] * m[2] - m[1] * m[1];
    if (!(m[0] > 0 && det > 1e-9 * m[0] * m[2]))
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "light towards (%.3f, %.3f, %.3f): no camera saw enough of it to say where "
                       "it stands",
                       nominal[0], nominal[1], nominal[2]);
    ls_tangents(nominal, e1, e2);
    ls_along3(nominal, e1, (m[2] * b[0] - m[1] * b[1]) / det, direction);
    ls_along3(direction, e2, (m[0] * b[1] - m[1] * b[0]) / det, direction);
    ls_unit3(direction);
    *sigma_deg = sqrt(0.5 * (m[0] + m[2]) / det) * 180 / M_PI;
    return LS_OK;
}

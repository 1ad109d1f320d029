#include "core/shading.h"

#include "core/sample.h"

#include <math.h>
#include <stdlib.h>

static const double degree = M_PI / 180;
static const double most_sigma_deg = 0.2, least_lit = 1.0 / 3, most_chi2 = 2;
static const double median_chi2 = 1.3863; /* of two degrees of freedom: 2 ln 2 */

/* Variance of one of the two coordinates, their mean. */
static double variance(const struct ls_shading *s)
{
    double det = s->information[0] * s->information[2] - s->information[1] * s->information[1];
    return det > 0 ? 0.5 * (s->information[0] + s->information[2]) / det : INFINITY;
}

static int tells(const struct ls_shading *s)
{
    double limit = most_sigma_deg * degree;
    return s->has_direction && s->lit > least_lit && variance(s) < limit * limit;
}

/* Squared offset over its error, and beyond it; medians over the fits that tell. */
static void judge(const struct ls_shading *fits, uint32_t n, float *room, double *chi2,
                  double *spread2)
{
    uint32_t m = 0;
    float *beyond = room + n;
    for (uint32_t k = 0; k < n; k++) {
        const double *o = fits[k].offset, *i = fits[k].information;
        if (!tells(&fits[k]))
            continue;
        room[m] = (float)(i[0] * o[0] * o[0] + 2 * i[1] * o[0] * o[1] + i[2] * o[1] * o[1]);
        beyond[m++] = (float)(o[0] * o[0] + o[1] * o[1] - 2 * variance(&fits[k]));
    }
    *chi2 = m ? (double)ls_median(room, m) / median_chi2 : 0;
    *spread2 = m ? fmax(0, (double)ls_median(beyond, m) / median_chi2) : 0;
}

static void settle(struct ls_shading *s, double spread2)
{
    double turn2 = s->tilt[0] * s->tilt[0] + s->tilt[1] * s->tilt[1];
    int shared = (s->sigma[0] > 0) + (s->sigma[1] > 0) + (s->sigma[2] > 0);
    int found = s->has_direction && variance(s) < spread2;
    for (int c = 0; c < 3; c++) {
        if (found) {
            s->strength[c] = s->free_strength[c];
            s->sigma[c] = s->free_sigma[c];
        } else if (s->sigma[c] > 0)
            s->sigma[c] = hypot(s->sigma[c], s->strength[c] * sqrt(turn2 * spread2 * shared));
    }
}

enum ls_err ls_shading_settle(struct ls_shading *fits, uint32_t n, struct ls_shading_settled *out,
                              struct ls_diag *diag)
{
    LS_CLEANUP_FREE float *room = malloc((2 * (size_t)n + 1) * sizeof *room);
    double spread2;
    if (!room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the places of lights");
    judge(fits, n, room, &out->chi2, &spread2);
    out->spread_deg = sqrt(spread2) / degree;
    out->moved = out->chi2 > most_chi2 && spread2 > 0;
    for (uint32_t k = 0; k < n && out->moved; k++)
        settle(&fits[k], spread2);
    return LS_OK;
}

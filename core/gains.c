#include "core/gains.h"

#include "core/calibration.h"
#include "core/field.h"
#include "core/sample.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_CAMERAS = LS_CALIBRATION_MAX_CAMERAS, MOST = MOST_CAMERAS * 3 };
static const double dead_share = 0.02;
static const double one_sided_sigma = 0.02;
static const double floor_sigma = 1e-4;
static const double colour_sigmas = 4;
static const double least_spread = 0.01; /* of lights, relative */

/* The measurements of every light, in logarithms; j = camera * n_colours + colour. */
struct system {
    const struct ls_gains_input *in;
    uint32_t n, m;   /* lights, cameras x colours */
    double *y, *var; /* [light * m + j]; var = 0: not measured */
    double *w;       /* weights in the common fit */
    double *x;       /* [light] ln g */
    double *sigma;   /* [light] of ln g */
    uint8_t *flags;
    double level[MOST], level_var[MOST];
    double chi2;
    int dof;
};

/* ---- what was measured ---- */

static int usable(const struct ls_gains_input *in, size_t at)
{
    return in->sigma[at] > 0 && isfinite(in->sigma[at]) && isfinite(in->strength[at]);
}

/* Middle strength of each camera and colour, over lights seen well. */
static double middle(const struct system *s, uint32_t j, float *room)
{
    size_t count = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        size_t at = (size_t)i * s->m + j;
        double lit = s->in->lit[i * s->in->n_cameras + j / s->in->n_colours];
        if (usable(s->in, at) && lit >= LS_GAINS_MIN_LIT)
            room[count++] = (float)s->in->strength[at];
    }
    return count ? (double)ls_median(room, count) : 0;
}

static double taper(double lit)
{
    double t = (lit - LS_GAINS_MIN_LIT) / LS_GAINS_MIN_LIT;
    return t < 0 ? 0 : t > 1 ? 1 : t;
}

static void enter(struct system *s, uint32_t i, uint32_t j, int *alive, int *seen)
{
    size_t at = (size_t)i * s->m + j;
    double q = s->in->strength[at], sigma = s->in->sigma[at];
    *seen = 1;
    if (q < dead_share * exp(s->level[j]) + 3 * sigma && sigma < 0.1 * exp(s->level[j]))
        return; /* known well enough to be no light */
    *alive = 1;
    if (q <= 5 * sigma)
        return;
    s->y[at] = log(q);
    s->var[at] = sigma / q * (sigma / q);
    if (q >= LS_GAINS_MIN_SNR * sigma)
        s->w[at] = taper(s->in->lit[i * s->in->n_cameras + j / s->in->n_colours]) / s->var[at];
}

static enum ls_err gather(struct system *s, struct ls_diag *diag)
{
    LS_CLEANUP_FREE float *room = calloc(s->n, sizeof *room);
    if (!room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    int any = 0;
    for (uint32_t j = 0; j < s->m; j++) {
        double q = middle(s, j, room);
        any |= q > 0;
        s->level[j] = q > 0 ? log(q) : -INFINITY;
    }
    if (!any)
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: no light brightens the grey sphere in any camera: is it in place, "
                       "and did the lights come on?");
    for (uint32_t i = 0; i < s->n; i++) {
        int alive = 0, seen = 0;
        for (uint32_t j = 0; j < s->m; j++)
            if (usable(s->in, (size_t)i * s->m + j) && isfinite(s->level[j]))
                enter(s, i, j, &alive, &seen);
        if (seen && !alive)
            s->flags[i] |= LS_LIGHT_DEAD;
    }
    return LS_OK;
}

/* ---- levels from shared lights ---- */

static double row_weight(const struct system *s, uint32_t i)
{
    double sum = 0;
    for (uint32_t j = 0; j < s->m; j++)
        sum += s->w[(size_t)i * s->m + j];
    return sum;
}

/* Normal equations of the levels with every light eliminated. */
static void reduce(const struct system *s, double *a, double *b)
{
    for (uint32_t i = 0; i < s->n; i++) {
        const double *w = s->w + (size_t)i * s->m, *y = s->y + (size_t)i * s->m;
        double sum = row_weight(s, i), mean = 0;
        if (!(sum > 0))
            continue;
        for (uint32_t j = 0; j < s->m; j++)
            mean += w[j] * y[j] / sum;
        for (uint32_t j = 0; j < s->m; j++) {
            b[j] += w[j] * (y[j] - mean);
            a[j * s->m + j] += w[j];
            for (uint32_t k = 0; k < s->m; k++)
                a[j * s->m + k] -= w[j] * w[k] / sum;
        }
    }
}

/* Which of the cameras and colours have any measurement; their component among shared lights. */
static uint32_t components(const struct system *s, uint32_t *part)
{
    uint32_t n_parts = 0, changed = 1;
    for (uint32_t j = 0; j < s->m; j++)
        part[j] = MOST + 1;
    for (uint32_t i = 0; i < s->n; i++)
        for (uint32_t j = 0; j < s->m; j++)
            if (s->w[(size_t)i * s->m + j] > 0)
                part[j] = j;
    while (changed) {
        changed = 0;
        for (uint32_t i = 0; i < s->n; i++) {
            uint32_t least = MOST + 1;
            for (uint32_t j = 0; j < s->m; j++)
                if (s->w[(size_t)i * s->m + j] > 0 && part[j] < least)
                    least = part[j];
            for (uint32_t j = 0; j < s->m; j++)
                if (s->w[(size_t)i * s->m + j] > 0 && part[j] > least) {
                    part[j] = least;
                    changed = 1;
                }
        }
    }
    for (uint32_t j = 0; j < s->m; j++)
        n_parts += part[j] == j;
    return n_parts;
}

static enum ls_err solve_levels(struct system *s, struct ls_diag *diag)
{
    uint32_t part[MOST], list[MOST], n = 0;
    uint32_t n_parts = components(s, part);
    if (!n_parts)
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: no light was measured at a signal of %g times its error with 10 %% "
                       "of the sphere lit: expose longer, or look at the sphere",
                       LS_GAINS_MIN_SNR);
    if (n_parts > 1)
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: the cameras fall into %u groups that share no light well seen by "
                       "both, so that their scales cannot be compared",
                       n_parts);
    LS_CLEANUP_FREE double *a = calloc((size_t)s->m * s->m, sizeof *a);
    LS_CLEANUP_FREE double *reduced = calloc((size_t)s->m * s->m, sizeof *reduced);
    double b[MOST] = {0}, rhs[MOST];
    if (!a || !reduced)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    reduce(s, a, b);
    for (uint32_t j = 0; j < s->m; j++)
        if (part[j] <= MOST && part[j] != j)
            list[n++] = j; /* the first one stays at 0 */
    for (uint32_t r = 0; r < n; r++) {
        rhs[r] = b[list[r]];
        for (uint32_t c = 0; c < n; c++)
            reduced[r * n + c] = a[list[r] * s->m + list[c]];
    }
    if (n && LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', (int)n, 1, reduced, (int)n, rhs, 1))
        return ls_fail(diag, LS_ERR_INVALID, "gains: the cameras' scales are not determined");
    for (uint32_t j = 0; j < s->m; j++)
        s->level[j] = part[j] == j ? 0 : s->level[j];
    for (uint32_t r = 0; r < n; r++)
        s->level[list[r]] = rhs[r];
    for (uint32_t j = 0; j < s->m; j++)
        if (part[j] > MOST)
            s->level[j] = NAN;
    return LS_OK;
}

/* ---- lights ---- */

static void judge(struct system *s)
{
    for (uint32_t i = 0; i < s->n; i++) {
        int entries = 0;
        for (uint32_t j = 0; j < s->m; j++) {
            size_t at = (size_t)i * s->m + j;
            if (!(s->w[at] > 0))
                continue;
            double r = s->y[at] - s->level[j] - s->x[i];
            s->chi2 += s->w[at] * r * r;
            entries++;
        }
        s->dof += entries > 1 ? entries - 1 : 0;
    }
    for (uint32_t j = 0; j < s->m; j++)
        s->dof -= isfinite(s->level[j]);
    s->dof++;
    s->chi2 = s->dof > 0 ? s->chi2 / s->dof : 0;
}

/* Lights without a good measurement take what there is. */
static void solve_light(struct system *s, uint32_t i)
{
    double sum = 0, mean = 0, good = row_weight(s, i);
    for (uint32_t j = 0; j < s->m; j++) {
        size_t at = (size_t)i * s->m + j;
        double w = good > 0 ? s->w[at] : s->var[at] > 0 ? 1 / s->var[at] : 0;
        if (!(w > 0) || !isfinite(s->level[j]))
            continue;
        sum += w;
        mean += w * (s->y[at] - s->level[j]);
    }
    if (sum > 0) {
        s->x[i] = mean / sum;
        s->sigma[i] = 1 / sqrt(sum);
    } else if (!(s->flags[i] & LS_LIGHT_DEAD))
        s->flags[i] |= LS_LIGHT_UNCERTAIN;
}

static double clamped(double g)
{
    return g < 1e-5 ? 1e-5 : g > 1e5 ? 1e5 : g;
}

/* Mean and standard deviation of ln g over the lights measured well: what an unseen light is
 * expected to be. */
static uint32_t prior(const struct system *s, double *mean, double *spread)
{
    double sum = 0, square = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        if (!(row_weight(s, i) > 0))
            continue;
        sum += s->x[i];
        square += s->x[i] * s->x[i];
        n++;
    }
    *mean = sum / n;
    *spread = fmax(sqrt(fmax(0, square / n - *mean * *mean)), least_spread);
    return n;
}

/* A light known no better than a tenth of the spread leans on the others; one not known at all is
 * like them. */
static void lean(struct system *s)
{
    double mean, spread;
    prior(s, &mean, &spread);
    for (uint32_t i = 0; i < s->n; i++) {
        s->sigma[i] *= sqrt(fmax(1, s->chi2));
        if (s->flags[i] & (LS_LIGHT_DEAD | LS_LIGHT_UNCERTAIN)) {
            s->x[i] = mean;
            s->sigma[i] = spread;
        } else if (s->sigma[i] > 0.1 * spread) {
            double own = 1 / (s->sigma[i] * s->sigma[i]), theirs = 1 / (spread * spread);
            s->x[i] = (own * s->x[i] + theirs * mean) / (own + theirs);
            s->sigma[i] = 1 / sqrt(own + theirs);
        }
    }
}

/* Mean of g over the lights that shine, and its relative error. */
static double mean_gain(const struct system *s, double *sigma)
{
    double sum = 0, square = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        if (s->flags[i] & LS_LIGHT_DEAD)
            continue;
        double g = exp(s->x[i]);
        sum += g;
        square += g * s->sigma[i] * g * s->sigma[i];
        n++;
    }
    *sigma = sqrt(square) / sum;
    return sum / n;
}

static double sigma_of(struct system *s, uint32_t i, double sigma_mean)
{
    double sigma = hypot(hypot(s->sigma[i], floor_sigma), sigma_mean);
    if (s->in->one_sided && s->in->one_sided[i]) {
        s->flags[i] |= LS_LIGHT_ONE_SIDED;
        sigma = fmax(sigma, one_sided_sigma);
    }
    return s->flags[i] & LS_LIGHT_DEAD ? 1 : sigma;
}

static enum ls_err fill_gains(struct system *s, struct ls_gains *out, struct ls_diag *diag)
{
    double sigma_mean, mean = mean_gain(s, &sigma_mean);
    if (!(mean > 0) || !isfinite(mean))
        return ls_fail(diag, LS_ERR_INVALID, "gains: every light is dead or unknown");
    for (uint32_t i = 0; i < s->n; i++)
        out->g[i] = s->flags[i] & LS_LIGHT_DEAD ? 1 : clamped(exp(s->x[i]) / mean);
    enum ls_err err = ls_field_normalise_gains(out->g, s->n, out->k, out->g, diag);
    for (uint32_t i = 0; i < s->n; i++) {
        out->sigma_k[i] = sigma_of(s, i, sigma_mean) * out->k[i];
        out->flags[i] = s->flags[i];
    }
    for (uint32_t j = 0; j < s->m; j++)
        out->level[j / s->in->n_colours][j % s->in->n_colours] =
            isfinite(s->level[j]) ? mean * exp(s->level[j]) : 0;
    out->chi2 = s->chi2;
    out->sigma_mean = sigma_mean;
    return err;
}

/* Error of the mean of a level's lights; the levels' own correlation is not followed. */
static void fill_level_sigma(const struct system *s, struct ls_gains *out)
{
    for (uint32_t j = 0; j < s->m; j++) {
        double sum = 0;
        for (uint32_t i = 0; i < s->n; i++)
            sum += s->w[(size_t)i * s->m + j];
        out->level_sigma[j / s->in->n_colours][j % s->in->n_colours] =
            sum > 0 ? sqrt(fmax(1, s->chi2) / sum) : 0;
    }
}

static void colour_factor(const struct system *s, uint32_t i, uint32_t c, double *factor)
{
    double sum = 0, mean = 0;
    for (uint32_t k = 0; k < s->in->n_cameras; k++) {
        size_t at = (size_t)i * s->m + k * s->in->n_colours + c;
        double level = s->level[k * s->in->n_colours + c];
        if (!(s->w[at] > 0))
            continue;
        sum += s->w[at];
        mean += s->w[at] * (s->y[at] - level - s->x[i]);
    }
    double sigma = sum > 0 ? sqrt(fmax(1, s->chi2) / sum) : INFINITY;
    int known = sigma < LS_GAINS_COLOUR_SIGMA && fabs(mean / sum) > colour_sigmas * sigma;
    *factor = known && !s->flags[i] ? exp(-mean / sum) : 1;
}

/* ---- the whole ---- */

static enum ls_err run(struct system *s, struct ls_gains *out, struct ls_diag *diag)
{
    enum ls_err err = gather(s, diag);
    if (!err)
        err = solve_levels(s, diag);
    if (err)
        return err;
    for (uint32_t i = 0; i < s->n; i++) {
        out->n_snr += row_weight(s, i) > 0;
        solve_light(s, i);
    }
    judge(s);
    lean(s);
    err = fill_gains(s, out, diag);
    fill_level_sigma(s, out);
    for (uint32_t i = 0; i < s->n && out->colour; i++)
        for (uint32_t c = 0; c < s->in->n_colours; c++)
            colour_factor(s, i, c, &out->colour[i * s->in->n_colours + c]);
    return err;
}

enum ls_err ls_gains_solve(const struct ls_gains_input *in, struct ls_gains *out,
                           struct ls_diag *diag)
{
    if (in->n_lights < 1 || in->n_lights > LS_CALIBRATION_MAX_LIGHTS || in->n_cameras < 1 ||
        in->n_cameras > MOST_CAMERAS || (in->n_colours != 1 && in->n_colours != 3))
        return ls_fail(diag, LS_ERR_LIMIT, "gains: %u lights, %u cameras, %u colours", in->n_lights,
                       in->n_cameras, in->n_colours);
    size_t n = in->n_lights, m = (size_t)in->n_cameras * in->n_colours;
    LS_CLEANUP_FREE double *room = calloc(3 * n * m + 2 * n, sizeof *room);
    LS_CLEANUP_FREE uint8_t *flags = calloc(n, sizeof *flags);
    if (!room || !flags)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    struct system s = {.in = in,
                       .n = in->n_lights,
                       .m = (uint32_t)m,
                       .y = room,
                       .var = room + n * m,
                       .w = room + 2 * n * m,
                       .x = room + 3 * n * m,
                       .sigma = room + 3 * n * m + n,
                       .flags = flags};
    out->n_snr = 0;
    memset(out->level, 0, sizeof out->level);
    memset(out->level_sigma, 0, sizeof out->level_sigma);
    return run(&s, out, diag);
}

#include "core/gains_system.h"

#include "core/field.h"
#include "core/sample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double one_sided_sigma = 0.02;
static const double floor_sigma = 1e-4;
static const double colour_sigmas = 4.5;
static const double least_spread = 0.01; /* of lights, relative */

static void judge(struct ls_gains_system *s)
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
    s->dof += 1 - (int)s->n_taken;
    s->chi2 = s->dof > 0 ? s->chi2 / s->dof : 0;
}

/* Lights without a good measurement take what there is. */
static void solve_light(struct ls_gains_system *s, uint32_t i)
{
    double sum = 0, mean = 0, good = ls_gains_row_weight(s, i);
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
static uint32_t prior(const struct ls_gains_system *s, double *mean, double *spread)
{
    double sum = 0, square = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        if (!(ls_gains_row_weight(s, i) > 0))
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
static void lean(struct ls_gains_system *s)
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
static double mean_gain(const struct ls_gains_system *s, double *sigma)
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

static double sigma_of(struct ls_gains_system *s, uint32_t i, double sigma_mean)
{
    double sigma = hypot(hypot(s->sigma[i], floor_sigma), sigma_mean);
    if (s->in->one_sided && s->in->one_sided[i]) {
        s->flags[i] |= LS_LIGHT_ONE_SIDED;
        sigma = fmax(sigma, one_sided_sigma);
    }
    return s->flags[i] & LS_LIGHT_DEAD ? 1 : sigma;
}

static enum ls_err fill_gains(struct ls_gains_system *s, struct ls_gains *out, struct ls_diag *diag)
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
static void fill_level_sigma(const struct ls_gains_system *s, struct ls_gains *out)
{
    for (uint32_t j = 0; j < s->m; j++) {
        double sum = 0;
        for (uint32_t i = 0; i < s->n; i++)
            sum += s->w[(size_t)i * s->m + j];
        out->level_sigma[j / s->in->n_colours][j % s->in->n_colours] =
            sum > 0 ? sqrt(fmax(1, s->chi2) / sum) : 0;
    }
}

/* ---- colours ---- */

/* chi^2 per degree of freedom of the middle measurement: lights that differ in colour do not make
 * it larger. 0.455 is the middle of chi^2 of one degree of freedom. */
static enum ls_err middle_chi2(const struct ls_gains_system *s, double *out, struct ls_diag *diag)
{
    size_t n = 0, lights = 0, levels = 0;
    LS_CLEANUP_FREE float *room = malloc((size_t)s->n * s->m * sizeof *room);
    if (!room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    for (uint32_t i = 0; i < s->n; i++) {
        lights += ls_gains_row_weight(s, i) > 0;
        for (uint32_t j = 0; j < s->m; j++) {
            size_t at = (size_t)i * s->m + j;
            double r = s->y[at] - s->level[j] - s->x[i];
            if (s->w[at] > 0)
                room[n++] = (float)(s->w[at] * r * r);
        }
    }
    for (uint32_t j = 0; j < s->m; j++)
        levels += isfinite(s->level[j]);
    double free = (double)n - (double)lights - (double)levels + 1;
    *out = free > 0 ? (double)ls_median(room, n) / 0.455 * (double)n / free : 0;
    return LS_OK;
}

/* What is left of a light's measurements in one colour, averaged over cameras. */
struct residual {
    double mean, sigma; /* sigma: of the colour's own strength */
    bool differs;
};

static struct residual residual_of(const struct ls_gains_system *s, uint32_t i, uint32_t c,
                                   double chi2)
{
    double sum = 0, mean = 0, all = ls_gains_row_weight(s, i);
    for (uint32_t j = c; j < s->m; j += s->in->n_colours) {
        size_t at = (size_t)i * s->m + j;
        if (!(s->w[at] > 0))
            continue;
        sum += s->w[at];
        mean += s->w[at] * (s->y[at] - s->level[j] - s->x[i]);
    }
    if (!(sum > 0))
        return (struct residual){.sigma = INFINITY};
    double sigma = sqrt(fmax(1, chi2) / sum), left = sigma * sqrt(1 - sum / all);
    return (struct residual){mean / sum, sigma, fabs(mean / sum) > colour_sigmas * left};
}

/* Factors of a light, which are taken out of its measurements. */
static void take_light(struct ls_gains_system *s, uint32_t i, double chi2, double *factor)
{
    struct residual r[3];
    bool differs = false;
    for (uint32_t c = 0; c < s->in->n_colours; c++) {
        r[c] = residual_of(s, i, c, chi2);
        differs |= r[c].differs && r[c].sigma < LS_GAINS_COLOUR_SIGMA;
    }
    for (uint32_t c = 0; c < s->in->n_colours && differs; c++) {
        if (r[c].sigma >= LS_GAINS_COLOUR_SIGMA)
            continue;
        factor[c] = exp(-r[c].mean);
        for (uint32_t j = c; j < s->m; j += s->in->n_colours)
            s->y[(size_t)i * s->m + j] -= r[c].mean;
        s->n_taken++;
    }
}

static enum ls_err take_colours(struct ls_gains_system *s, double *colour, struct ls_diag *diag)
{
    uint32_t colours = s->in->n_colours;
    double chi2 = 0;
    enum ls_err err = middle_chi2(s, &chi2, diag);
    for (uint32_t k = 0; k < s->n * colours; k++)
        colour[k] = 1;
    for (uint32_t i = 0; i < s->n && colours > 1 && !err; i++)
        if (!s->flags[i] && !(s->in->one_sided && s->in->one_sided[i]))
            take_light(s, i, chi2, colour + (size_t)i * colours);
    return err;
}

/* ---- the whole ---- */

static enum ls_err run(struct ls_gains_system *s, struct ls_gains *out, struct ls_diag *diag)
{
    enum ls_err err = ls_gains_gather(s, diag);
    if (!err)
        err = ls_gains_levels(s, diag);
    if (err)
        return err;
    for (uint32_t i = 0; i < s->n; i++) {
        out->n_snr += ls_gains_row_weight(s, i) > 0;
        solve_light(s, i);
    }
    if (out->colour)
        err = take_colours(s, out->colour, diag);
    if (err)
        return err;
    judge(s);
    lean(s);
    err = fill_gains(s, out, diag);
    fill_level_sigma(s, out);
    return err;
}

enum ls_err ls_gains_solve(const struct ls_gains_input *in, struct ls_gains *out,
                           struct ls_diag *diag)
{
    if (in->n_lights < 1 || in->n_lights > LS_CALIBRATION_MAX_LIGHTS || in->n_cameras < 1 ||
        in->n_cameras > LS_CALIBRATION_MAX_CAMERAS || (in->n_colours != 1 && in->n_colours != 3))
        return ls_fail(diag, LS_ERR_LIMIT, "gains: %u lights, %u cameras, %u colours", in->n_lights,
                       in->n_cameras, in->n_colours);
    size_t n = in->n_lights, m = (size_t)in->n_cameras * in->n_colours;
    LS_CLEANUP_FREE double *room = calloc(3 * n * m + 2 * n, sizeof *room);
    LS_CLEANUP_FREE uint8_t *flags = calloc(n, sizeof *flags);
    if (!room || !flags)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for gains");
    struct ls_gains_system s = {.in = in,
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

#include "core/shading.h"

#include "core/merge.h"
#include "core/sample.h"
#include "core/vec3.h"

#include <stdlib.h>
#include <string.h>

enum {
    FEW = 200,
    LEAST = 20,
    ROUNDS = 4,
    STEPS = 10,
    MEDIAN_OF = 512, /* values that a median is taken of, at most */
};
static const double biweight_reach = 6;
static const double floor_share = 0.02;        /* of the largest m, in the weights */
static const double delta = 1e-4;              /* rad, for derivatives */
static const double highlight_cos = 0.9781476; /* 12 degrees */

struct lamp {
    double at[3], axis[3], r2;
};

static struct lamp lamp_at(const double position[3])
{
    struct lamp lamp;
    memcpy(lamp.at, position, sizeof lamp.at);
    memcpy(lamp.axis, position, sizeof lamp.axis);
    lamp.r2 = ls_dot3(position, position);
    ls_unit3(lamp.axis);
    return lamp;
}

/* The lamp turned by tangent coordinates, its distance kept. */
static struct lamp turned(const struct lamp *nominal, const double e1[3], const double e2[3],
                          double a, double b)
{
    double d[3];
    ls_along3(nominal->axis, e1, a, d);
    ls_along3(d, e2, b, d);
    ls_unit3(d);
    for (int k = 0; k < 3; k++)
        d[k] *= sqrt(nominal->r2);
    return lamp_at(d);
}

static double model(const struct lamp *lamp, const float x[3], const float n[3])
{
    double l[3] = {lamp->at[0] - (double)x[0], lamp->at[1] - (double)x[1],
                   lamp->at[2] - (double)x[2]};
    double emission = ls_dot3(lamp->axis, l), d2 = ls_dot3(l, l);
    double nl = (double)n[0] * l[0] + (double)n[1] * l[1] + (double)n[2] * l[2];
    return emission > 0 && nl > 0 ? lamp->r2 * emission * nl / (M_PI * d2 * d2) : 0;
}

/* A pixel in use. */
struct sample {
    const struct ls_sphere_pixel *pixel;
    double e, m;
    double w;     /* of the fit: the biweight's psi(r)/r, 0 = refused */
    double slope; /* psi'(r), which says how the estimate follows the data */
};

struct fit {
    const struct ls_sphere_view *view;
    struct lamp lamp;
    struct sample *sample;
    uint32_t n;
    double m_max;
    double scale[3]; /* robust sigma of residual * sqrt(1 / (m + floor)) */
    uint32_t used[3], refused;
    float *room; /* view->n */
};

/* ---- choosing pixels ---- */

static int near_highlight(const struct lamp *lamp, const struct ls_sphere_pixel *p)
{
    double h[3];
    for (int k = 0; k < 3; k++)
        h[k] = lamp->at[k] - (double)p->x[k];
    ls_unit3(h);
    for (int k = 0; k < 3; k++)
        h[k] += (double)p->v[k];
    double along = (double)p->n[0] * h[0] + (double)p->n[1] * h[1] + (double)p->n[2] * h[2];
    return along > highlight_cos * ls_length3(h);
}

static double cosine(const struct lamp *lamp, const struct ls_sphere_pixel *p)
{
    double l[3];
    for (int k = 0; k < 3; k++)
        l[k] = lamp->at[k] - (double)p->x[k];
    ls_unit3(l);
    return l[0] * (double)p->n[0] + l[1] * (double)p->n[1] + l[2] * (double)p->n[2];
}

static void choose(struct fit *f, const float *e, const uint8_t *validity, double least_nl,
                   double least_nv)
{
    f->n = 0;
    f->m_max = 0;
    for (uint32_t k = 0; k < f->view->n; k++) {
        const struct ls_sphere_pixel *p = &f->view->pixels[k];
        uint8_t v = validity ? validity[p->index] : LS_VALIDITY_OK;
        if (v == LS_VALIDITY_SATURATED || v == LS_VALIDITY_GAP || !isfinite(e[p->index]) ||
            (double)p->nv < least_nv || cosine(&f->lamp, p) < least_nl ||
            near_highlight(&f->lamp, p))
            continue;
        double m = model(&f->lamp, p->x, p->n);
        if (m > 0)
            f->sample[f->n++] = (struct sample){.pixel = p, .e = (double)e[p->index], .m = m};
        f->m_max = fmax(f->m_max, m);
    }
}

static double lit_part(const struct ls_sphere_view *view, const struct lamp *lamp)
{
    uint32_t lit = 0;
    for (uint32_t k = 0; k < view->n; k++)
        lit += cosine(lamp, &view->pixels[k]) > 0;
    return (double)lit / view->n;
}

/* ---- strength of one colour ---- */

static double root_weight(const struct fit *f, const struct sample *s)
{
    return 1 / sqrt(s->m + floor_share * f->m_max);
}

/* A step through the samples of all colours that takes enough of each. */
static uint32_t sparse(const struct fit *f)
{
    return f->n / (MEDIAN_OF * f->view->n_colours) + 1;
}

static double median_ratio(const struct fit *f, int colour)
{
    size_t n = 0;
    uint32_t seen = 0, step = sparse(f);
    for (uint32_t k = 0; k < f->n; k++)
        if (f->sample[k].pixel->colour == colour && f->sample[k].m > f->m_max / 3 &&
            seen++ % step == 0)
            f->room[n++] = (float)(f->sample[k].e / f->sample[k].m);
    return n ? (double)ls_median(f->room, n) : 0;
}

static double residual_scale(struct fit *f, int colour, double q)
{
    size_t n = 0;
    uint32_t seen = 0, step = sparse(f);
    for (uint32_t k = 0; k < f->n; k++) {
        const struct sample *s = &f->sample[k];
        if (s->pixel->colour == colour && seen++ % step == 0)
            f->room[n++] = (float)(fabs(s->e - q * s->m) * root_weight(f, s));
    }
    /* never quite 0, so that an exact picture is not divided by it */
    double floor_scale = 1e-7 * fabs(q) * sqrt(f->m_max) + 1e-30;
    return fmax(n ? 1.4826 * (double)ls_median(f->room, n) : 0, floor_scale);
}

static double reweight(struct fit *f, int colour, double q)
{
    double mm = 0, me = 0, reach = biweight_reach * f->scale[colour];
    for (uint32_t k = 0; k < f->n; k++) {
        struct sample *s = &f->sample[k];
        if (s->pixel->colour != colour)
            continue;
        double root = root_weight(f, s), u = (s->e - q * s->m) * root / reach;
        double inside = fabs(u) < 1 ? root * root * (1 - u * u) : 0;
        s->w = inside * (1 - u * u);
        s->slope = inside * (1 - 5 * u * u);
        mm += s->w * s->m * s->m;
        me += s->w * s->m * s->e;
    }
    return mm > 0 ? me / mm : q;
}

/* Standard error of q from the blocks' sums of w m (E - q m). */
static double cluster_sigma(const struct fit *f, int colour, double q)
{
    double sum[LS_SPHERE_BLOCKS * LS_SPHERE_BLOCKS] = {0}, mm = 0, square = 0;
    uint8_t there[LS_SPHERE_BLOCKS * LS_SPHERE_BLOCKS] = {0};
    int blocks = 0;
    for (uint32_t k = 0; k < f->n; k++) {
        const struct sample *s = &f->sample[k];
        if (s->pixel->colour != colour || !(s->w > 0))
            continue;
        sum[s->pixel->block] += s->w * s->m * (s->e - q * s->m);
        there[s->pixel->block] = 1;
        mm += s->slope * s->m * s->m;
    }
    for (size_t b = 0; b < sizeof there; b++) {
        blocks += there[b];
        square += sum[b] * sum[b];
    }
    return blocks > 1 && mm > 0 ? sqrt(square * blocks / (blocks - 1.0)) / mm : 0;
}

static void count(struct fit *f, int colour)
{
    f->used[colour] = 0;
    for (uint32_t k = 0; k < f->n; k++)
        if (f->sample[k].pixel->colour == colour) {
            f->used[colour] += f->sample[k].w > 0;
            f->refused += !(f->sample[k].w > 0);
        }
}

static void fit_strength(struct fit *f, int colour, struct ls_shading *out)
{
    double q = median_ratio(f, colour);
    for (int round = 0; round < ROUNDS; round++) {
        f->scale[colour] = residual_scale(f, colour, q);
        q = reweight(f, colour, q);
    }
    count(f, colour);
    out->n[colour] = f->used[colour];
    if (f->used[colour] < LEAST || !isfinite(q))
        return;
    out->strength[colour] = q;
    out->sigma[colour] = cluster_sigma(f, colour, q);
}

static double misfit(const struct fit *f, const struct ls_shading *out)
{
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t k = 0; k < f->n; k++) {
        const struct sample *s = &f->sample[k];
        double qm = out->strength[s->pixel->colour] * s->m;
        if (!(s->w > 0) || s->m < f->m_max / 3 || !(qm > 0))
            continue;
        sum += (s->e / qm - 1) * (s->e / qm - 1);
        n++;
    }
    return n ? sqrt(sum / n) : 0;
}

/* ---- derivatives, the strengths eliminated ---- */

enum { MOST_PARAMETERS = 3 };

/* Sums of one colour over samples: m and its derivatives among each other and with E. */
struct sums {
    double mm, me, md[MOST_PARAMETERS], de[MOST_PARAMETERS], dd[6];
};

static void add_sample(struct sums *s, double w, double e, double m, const double *d, int n)
{
    s->mm += w * m * m;
    s->me += w * m * e;
    for (int i = 0, at = 0; i < n; i++) {
        s->md[i] += w * m * d[i];
        s->de[i] += w * d[i] * e;
        for (int j = i; j < n; j++)
            s->dd[at++] += w * d[i] * d[j];
    }
}

/* Score and information of the parameters, added. */
static void eliminate(const struct sums *s, int n, double *score, double *information)
{
    if (!(s->mm > 0))
        return;
    double q = s->me / s->mm;
    for (int i = 0, at = 0; i < n; i++) {
        score[i] += q * (s->de[i] - q * s->md[i]);
        for (int j = i; j < n; j++, at++)
            information[at] += q * q * (s->dd[at] - s->md[i] * s->md[j] / s->mm);
    }
}

static double absolute_weight(const struct fit *f, const struct sample *s)
{
    double scale = f->scale[s->pixel->colour];
    return s->w / (scale * scale);
}

static void turn_sums(const struct fit *f, const struct ls_shading *out, const double e1[3],
                      const double e2[3], const double at[2], struct sums sums[3])
{
    struct lamp here = turned(&f->lamp, e1, e2, at[0], at[1]);
    struct lamp a = turned(&f->lamp, e1, e2, at[0] + delta, at[1]);
    struct lamp b = turned(&f->lamp, e1, e2, at[0], at[1] + delta);
    memset(sums, 0, 3 * sizeof *sums);
    for (uint32_t k = 0; k < f->n; k++) {
        const struct sample *s = &f->sample[k];
        const struct ls_sphere_pixel *p = s->pixel;
        if (!(s->w > 0) || !(out->sigma[p->colour] > 0))
            continue;
        double m = model(&here, p->x, p->n);
        const double d[2] = {(model(&a, p->x, p->n) - m) / delta,
                             (model(&b, p->x, p->n) - m) / delta};
        add_sample(&sums[p->colour], absolute_weight(f, s), s->e, m, d, 2);
    }
}

static int colours_seen(const struct ls_shading *out)
{
    return (out->sigma[0] > 0) + (out->sigma[1] > 0) + (out->sigma[2] > 0);
}

/* How much larger the errors are than independent pixels would make them, squared. */
static double excess(const struct fit *f, const struct ls_shading *out)
{
    double mm[3] = {0}, sum = 0;
    for (uint32_t k = 0; k < f->n; k++)
        mm[f->sample[k].pixel->colour] +=
            absolute_weight(f, &f->sample[k]) * f->sample[k].m * f->sample[k].m;
    for (int c = 0; c < 3; c++)
        sum += out->sigma[c] * out->sigma[c] * mm[c];
    return colours_seen(out) ? fmax(1, sum / colours_seen(out)) : 1;
}

static int solve2(const double m[3], const double b[2], double x[2])
{
    double det = m[0] * m[2] - m[1] * m[1];
    if (!(m[0] > 0 && det > 1e-9 * m[0] * m[2]))
        return 0;
    x[0] = (m[2] * b[0] - m[1] * b[1]) / det;
    x[1] = (m[0] * b[1] - m[1] * b[0]) / det;
    return 1;
}

/* Gauss-Newton from @at; 0 if it leads nowhere. */
static int descend(const struct fit *f, const struct ls_shading *out, const double e1[3],
                   const double e2[3], double at[2], double information[3])
{
    double step[2] = {1, 1}, score[2];
    struct sums sums[3];
    for (int k = 0; k < STEPS && hypot(step[0], step[1]) > 1e-5; k++) {
        turn_sums(f, out, e1, e2, at, sums);
        memset(information, 0, 3 * sizeof *information);
        memset(score, 0, sizeof score);
        for (int c = 0; c < 3; c++)
            eliminate(&sums[c], 2, score, information);
        if (!solve2(information, score, step))
            return 0;
        double length = hypot(step[0], step[1]), shorten = length > 0.1 ? 0.1 / length : 1;
        at[0] += shorten * step[0];
        at[1] += shorten * step[1];
        if (!(hypot(at[0], at[1]) < 0.5))
            return 0;
    }
    return hypot(step[0], step[1]) < 1e-3;
}

/* Weights and errors as they are with the light in its new place: where the nominal one is off, the
 * residuals about it are no noise. */
static void weigh_again(struct fit *f, const struct lamp *lamp, struct ls_shading *there)
{
    f->m_max = 0;
    for (uint32_t k = 0; k < f->n; k++) {
        struct sample *s = &f->sample[k];
        s->m = model(lamp, s->pixel->x, s->pixel->n);
        f->m_max = fmax(f->m_max, s->m);
    }
    for (uint32_t c = 0; c < f->view->n_colours; c++)
        fit_strength(f, (int)c, there);
}

/* d ln q / d(tangent coordinates) of the strengths of all colours together. */
static void tilt_at(const struct fit *f, const struct ls_shading *out, const double e1[3],
                    const double e2[3], const double at[2], double tilt[2])
{
    double md[2] = {0}, mm = 0;
    struct sums sums[3];
    turn_sums(f, out, e1, e2, at, sums);
    for (int c = 0; c < 3; c++) {
        mm += sums[c].mm;
        md[0] += sums[c].md[0];
        md[1] += sums[c].md[1];
    }
    tilt[0] = mm > 0 ? md[0] / mm : 0;
    tilt[1] = mm > 0 ? md[1] / mm : 0;
}

static void fill_tilt(const struct fit *f, struct ls_shading *out)
{
    const double origin[2] = {0};
    double e1[3], e2[3];
    ls_tangents(f->lamp.axis, e1, e2);
    tilt_at(f, out, e1, e2, origin, out->tilt);
}

/* Strengths in the new place; to their errors comes what that of the place does, which all colours
 * share: times their number, so that their mean does not seem to average it. */
static void free_strength(const struct fit *f, const double e1[3], const double e2[3],
                          const double at[2], const struct ls_shading *there,
                          struct ls_shading *out)
{
    double tilt[2], turn[2];
    tilt_at(f, there, e1, e2, at, tilt);
    double part2 =
        solve2(out->information, tilt, turn) ? tilt[0] * turn[0] + tilt[1] * turn[1] : INFINITY;
    int shared = colours_seen(there);
    for (int c = 0; c < 3; c++) {
        out->free_strength[c] = there->strength[c];
        out->free_sigma[c] =
            there->sigma[c] > 0 && isfinite(part2)
                ? hypot(there->sigma[c], there->strength[c] * sqrt(fmax(0, part2 * shared)))
                : 0;
    }
}

static void fit_direction(struct fit *f, struct ls_shading *out)
{
    struct ls_shading there = *out;
    double e1[3], e2[3], at[2] = {0}, information[3];
    ls_tangents(f->lamp.axis, e1, e2);
    if (!descend(f, out, e1, e2, at, information))
        return;
    struct lamp lamp = turned(&f->lamp, e1, e2, at[0], at[1]);
    weigh_again(f, &lamp, &there);
    if (!descend(f, &there, e1, e2, at, information))
        return;
    lamp = turned(&f->lamp, e1, e2, at[0], at[1]);
    weigh_again(f, &lamp, &there);
    double grown = excess(f, &there);
    for (int k = 0; k < 3; k++)
        out->information[k] = information[k] / grown;
    memcpy(out->offset, at, sizeof at);
    out->has_direction = true;
    free_strength(f, e1, e2, at, &there, out);
}

static void fill_centre(const struct fit *f, struct ls_shading *out)
{
    struct sums sums[3] = {{0}};
    for (uint32_t k = 0; k < f->n; k++) {
        const struct sample *s = &f->sample[k];
        const struct ls_sphere_pixel *p = s->pixel;
        double d[3];
        if (!(s->w > 0) || !(out->sigma[p->colour] > 0))
            continue;
        for (int axis = 0; axis < 3; axis++)
            d[axis] =
                (model(&f->lamp, p->shifted[axis], p->shifted[axis] + 3) - s->m) / f->view->shift_m;
        add_sample(&sums[p->colour], absolute_weight(f, s), s->e, s->m, d, 3);
    }
    for (int c = 0; c < 3; c++)
        eliminate(&sums[c], 3, out->centre_score, out->centre_information);
}

/* ---- the whole ---- */

static enum ls_err check(const struct ls_sphere_view *view, const double position[3],
                         struct ls_diag *diag)
{
    double from[3];
    ls_along3(position, view->sphere.centre_m, -1, from);
    double length = ls_length3(from);
    if (!(length > 1.01 * view->sphere.radius_m) || !(length < 1e6) ||
        !(ls_length3(position) > 1e-6))
        return ls_fail(diag, LS_ERR_INVALID,
                       "light at (%g, %g, %g): expected outside the sphere and not at the centre",
                       position[0], position[1], position[2]);
    return LS_OK;
}

static int lit_at_all(const struct ls_shading *out)
{
    for (int c = 0; c < 3; c++)
        if (out->sigma[c] > 0 && out->strength[c] > 10 * out->sigma[c])
            return 1;
    return 0;
}

static void run(struct fit *f, const float *e, const uint8_t *validity, struct ls_shading *out)
{
    choose(f, e, validity, 0.1, 0.1);
    if (f->n < FEW)
        choose(f, e, validity, 0.03, 0.05);
    for (uint32_t c = 0; c < f->view->n_colours; c++)
        fit_strength(f, (int)c, out);
    out->rejected = f->n ? (double)f->refused / f->n : 0;
    if (!lit_at_all(out))
        return;
    out->misfit = misfit(f, out);
    fill_tilt(f, out);
    fill_centre(f, out);
    fit_direction(f, out);
}

enum ls_err ls_shading_fit(const struct ls_sphere_view *view, const double position[3],
                           const float *e, const uint8_t *validity, struct ls_shading *out,
                           struct ls_diag *diag)
{
    memset(out, 0, sizeof *out);
    enum ls_err err = check(view, position, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE struct sample *sample = calloc(view->n, sizeof *sample);
    LS_CLEANUP_FREE float *room = calloc(view->n, sizeof *room);
    if (!sample || !room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a sphere's shading");
    struct fit f = {.view = view, .lamp = lamp_at(position), .sample = sample, .room = room};
    out->lit = lit_part(view, &f.lamp);
    run(&f, e, validity, out);
    return LS_OK;
}

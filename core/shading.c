#include "core/shading_fit.h"

#include "core/merge.h"
#include "core/sample.h"
#include "core/vec3.h"

#include <stdlib.h>
#include <string.h>

enum {
    FEW = 200,
    LEAST = 20,
    ROUNDS = 4,
    MEDIAN_OF = 512, /* values that a median is taken of, at most */
};
static const double biweight_reach = 6;
static const double floor_share = 0.02;        /* of the largest m, in the weights */
static const double highlight_cos = 0.9781476; /* 12 degrees */

struct ls_lamp ls_lamp_at(const double position[3])
{
    struct ls_lamp lamp;
    memcpy(lamp.at, position, sizeof lamp.at);
    memcpy(lamp.axis, position, sizeof lamp.axis);
    lamp.r2 = ls_dot3(position, position);
    ls_unit3(lamp.axis);
    return lamp;
}

double ls_lamp_model(const struct ls_lamp *lamp, const float x[3], const float n[3])
{
    double l[3] = {lamp->at[0] - (double)x[0], lamp->at[1] - (double)x[1],
                   lamp->at[2] - (double)x[2]};
    double emission = ls_dot3(lamp->axis, l), d2 = ls_dot3(l, l);
    double nl = (double)n[0] * l[0] + (double)n[1] * l[1] + (double)n[2] * l[2];
    return emission > 0 && nl > 0 ? lamp->r2 * emission * nl / (M_PI * d2 * d2) : 0;
}

/* ---- choosing pixels ---- */

static int near_highlight(const struct ls_lamp *lamp, const struct ls_sphere_pixel *p)
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

static double cosine(const struct ls_lamp *lamp, const struct ls_sphere_pixel *p)
{
    double l[3];
    for (int k = 0; k < 3; k++)
        l[k] = lamp->at[k] - (double)p->x[k];
    ls_unit3(l);
    return l[0] * (double)p->n[0] + l[1] * (double)p->n[1] + l[2] * (double)p->n[2];
}

static void choose(struct ls_shading_work *f, const float *e, const uint8_t *validity,
                   double least_nl, double least_nv)
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
        double m = ls_lamp_model(&f->lamp, p->x, p->n);
        if (m > 0)
            f->sample[f->n++] =
                (struct ls_shading_sample){.pixel = p, .e = (double)e[p->index], .m = m};
        f->m_max = fmax(f->m_max, m);
    }
}

static double lit_part(const struct ls_sphere_view *view, const struct ls_lamp *lamp)
{
    uint32_t lit = 0;
    for (uint32_t k = 0; k < view->n; k++)
        lit += cosine(lamp, &view->pixels[k]) > 0;
    return (double)lit / view->n;
}

/* ---- strength of one colour ---- */

static double root_weight(const struct ls_shading_work *f, const struct ls_shading_sample *s)
{
    return 1 / sqrt(s->m + floor_share * f->m_max);
}

/* A step through the samples of all colours that takes enough of each. */
static uint32_t sparse(const struct ls_shading_work *f)
{
    return f->n / (MEDIAN_OF * f->view->n_colours) + 1;
}

static double median_ratio(const struct ls_shading_work *f, int colour)
{
    size_t n = 0;
    uint32_t seen = 0, step = sparse(f);
    for (uint32_t k = 0; k < f->n; k++)
        if (f->sample[k].pixel->colour == colour && f->sample[k].m > f->m_max / 3 &&
            seen++ % step == 0)
            f->room[n++] = (float)(f->sample[k].e / f->sample[k].m);
    return n ? (double)ls_median(f->room, n) : 0;
}

static double residual_scale(struct ls_shading_work *f, int colour, double q)
{
    size_t n = 0;
    uint32_t seen = 0, step = sparse(f);
    for (uint32_t k = 0; k < f->n; k++) {
        const struct ls_shading_sample *s = &f->sample[k];
        if (s->pixel->colour == colour && seen++ % step == 0)
            f->room[n++] = (float)(fabs(s->e - q * s->m) * root_weight(f, s));
    }
    /* never quite 0, so that an exact picture is not divided by it */
    double floor_scale = 1e-7 * fabs(q) * sqrt(f->m_max) + 1e-30;
    return fmax(n ? 1.4826 * (double)ls_median(f->room, n) : 0, floor_scale);
}

static double reweight(struct ls_shading_work *f, int colour, double q)
{
    double mm = 0, me = 0, reach = biweight_reach * f->scale[colour];
    for (uint32_t k = 0; k < f->n; k++) {
        struct ls_shading_sample *s = &f->sample[k];
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
static double cluster_sigma(const struct ls_shading_work *f, int colour, double q)
{
    double sum[LS_SPHERE_BLOCKS * LS_SPHERE_BLOCKS] = {0}, mm = 0, square = 0;
    uint8_t there[LS_SPHERE_BLOCKS * LS_SPHERE_BLOCKS] = {0};
    int blocks = 0;
    for (uint32_t k = 0; k < f->n; k++) {
        const struct ls_shading_sample *s = &f->sample[k];
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

static void count(struct ls_shading_work *f, int colour)
{
    f->used[colour] = 0;
    for (uint32_t k = 0; k < f->n; k++)
        if (f->sample[k].pixel->colour == colour) {
            f->used[colour] += f->sample[k].w > 0;
            f->refused += !(f->sample[k].w > 0);
        }
}

void ls_shading_strength(struct ls_shading_work *f, int colour, struct ls_shading *out)
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

static double misfit(const struct ls_shading_work *f, const struct ls_shading *out)
{
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t k = 0; k < f->n; k++) {
        const struct ls_shading_sample *s = &f->sample[k];
        double qm = out->strength[s->pixel->colour] * s->m;
        if (!(s->w > 0) || s->m < f->m_max / 3 || !(qm > 0))
            continue;
        sum += (s->e / qm - 1) * (s->e / qm - 1);
        n++;
    }
    return n ? sqrt(sum / n) : 0;
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

static void run(struct ls_shading_work *f, const float *e, const uint8_t *validity,
                struct ls_shading *out)
{
    choose(f, e, validity, 0.1, 0.1);
    if (f->n < FEW)
        choose(f, e, validity, 0.03, 0.05);
    for (uint32_t c = 0; c < f->view->n_colours; c++)
        ls_shading_strength(f, (int)c, out);
    out->rejected = f->n ? (double)f->refused / f->n : 0;
    if (!lit_at_all(out))
        return;
    out->misfit = misfit(f, out);
    ls_shading_place(f, out);
}

enum ls_err ls_shading_fit(const struct ls_sphere_view *view, const double position[3],
                           const float *e, const uint8_t *validity, struct ls_shading *out,
                           struct ls_diag *diag)
{
    memset(out, 0, sizeof *out);
    enum ls_err err = check(view, position, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE struct ls_shading_sample *sample = calloc(view->n, sizeof *sample);
    LS_CLEANUP_FREE float *room = calloc(view->n, sizeof *room);
    if (!sample || !room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a sphere's shading");
    struct ls_shading_work f = {
        .view = view, .lamp = ls_lamp_at(position), .sample = sample, .room = room};
    out->lit = lit_part(view, &f.lamp);
    run(&f, e, validity, out);
    return LS_OK;
}

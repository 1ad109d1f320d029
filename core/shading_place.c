#include "core/shading_fit.h"

#include "core/vec3.h"

#include <string.h>

enum { STEPS = 10 };
static const double delta = 1e-4; /* rad, for derivatives */

/* The lamp turned by tangent coordinates, its distance kept. */
static struct ls_lamp turned(const struct ls_lamp *nominal, const double e1[3], const double e2[3],
                             double a, double b)
{
    double d[3];
    ls_along3(nominal->axis, e1, a, d);
    ls_along3(d, e2, b, d);
    ls_unit3(d);
    for (int k = 0; k < 3; k++)
        d[k] *= sqrt(nominal->r2);
    return ls_lamp_at(d);
}

enum { MOST_PARAMETERS = 5 };

/* Sums of one colour over samples: m and its derivatives among each other and with E. */
struct sums {
    double mm, me, md[MOST_PARAMETERS], de[MOST_PARAMETERS], dd[15];
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

static double absolute_weight(const struct ls_shading_work *f, const struct ls_shading_sample *s)
{
    double scale = f->scale[s->pixel->colour];
    return s->w / (scale * scale);
}

static void turn_sums(const struct ls_shading_work *f, const struct ls_shading *out,
                      const double e1[3], const double e2[3], const double at[2],
                      struct sums sums[3])
{
    struct ls_lamp here = turned(&f->lamp, e1, e2, at[0], at[1]);
    struct ls_lamp a = turned(&f->lamp, e1, e2, at[0] + delta, at[1]);
    struct ls_lamp b = turned(&f->lamp, e1, e2, at[0], at[1] + delta);
    memset(sums, 0, 3 * sizeof *sums);
    for (uint32_t k = 0; k < f->n; k++) {
        const struct ls_shading_sample *s = &f->sample[k];
        const struct ls_sphere_pixel *p = s->pixel;
        if (!(s->w > 0) || !(out->sigma[p->colour] > 0))
            continue;
        double m = ls_lamp_model(&here, p->x, p->n);
        const double d[2] = {(ls_lamp_model(&a, p->x, p->n) - m) / delta,
                             (ls_lamp_model(&b, p->x, p->n) - m) / delta};
        add_sample(&sums[p->colour], absolute_weight(f, s), s->e, m, d, 2);
    }
}

static int colours_seen(const struct ls_shading *out)
{
    return (out->sigma[0] > 0) + (out->sigma[1] > 0) + (out->sigma[2] > 0);
}

/* How much larger the errors are than independent pixels would make them, squared. */
static double excess(const struct ls_shading_work *f, const struct ls_shading *out)
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
static int descend(const struct ls_shading_work *f, const struct ls_shading *out,
                   const double e1[3], const double e2[3], double at[2], double information[3])
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
static void weigh_again(struct ls_shading_work *f, const struct ls_lamp *lamp,
                        struct ls_shading *there)
{
    f->m_max = 0;
    for (uint32_t k = 0; k < f->n; k++) {
        struct ls_shading_sample *s = &f->sample[k];
        s->m = ls_lamp_model(lamp, s->pixel->x, s->pixel->n);
        f->m_max = fmax(f->m_max, s->m);
    }
    for (uint32_t c = 0; c < f->view->n_colours; c++)
        ls_shading_strength(f, (int)c, there);
}

/* d ln q / d(tangent coordinates) of the strengths of all colours together. */
static void tilt_at(const struct ls_shading_work *f, const struct ls_shading *out,
                    const double e1[3], const double e2[3], const double at[2], double tilt[2])
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

static void fill_tilt(const struct ls_shading_work *f, struct ls_shading *out)
{
    const double origin[2] = {0};
    double e1[3], e2[3];
    ls_tangents(f->lamp.axis, e1, e2);
    tilt_at(f, out, e1, e2, origin, out->tilt);
}

/* Strengths in the new place; to their errors comes what that of the place does, which all colours
 * share: times their number, so that their mean does not seem to average it. */
static void free_strength(const struct ls_shading_work *f, const double e1[3], const double e2[3],
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

static void fit_direction(struct ls_shading_work *f, struct ls_shading *out)
{
    struct ls_shading there = *out;
    double e1[3], e2[3], at[2] = {0}, information[3];
    ls_tangents(f->lamp.axis, e1, e2);
    if (!descend(f, out, e1, e2, at, information))
        return;
    struct ls_lamp lamp = turned(&f->lamp, e1, e2, at[0], at[1]);
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

static void fill_place(const struct ls_shading_work *f, struct ls_shading *out)
{
    struct sums sums[3] = {{0}};
    double e1[3], e2[3];
    ls_tangents(f->lamp.axis, e1, e2);
    const struct ls_lamp a = turned(&f->lamp, e1, e2, delta, 0);
    const struct ls_lamp b = turned(&f->lamp, e1, e2, 0, delta);
    for (uint32_t k = 0; k < f->n; k++) {
        const struct ls_shading_sample *s = &f->sample[k];
        const struct ls_sphere_pixel *p = s->pixel;
        double d[5];
        if (!(s->w > 0) || !(out->sigma[p->colour] > 0))
            continue;
        d[0] = (ls_lamp_model(&a, p->x, p->n) - s->m) / delta;
        d[1] = (ls_lamp_model(&b, p->x, p->n) - s->m) / delta;
        for (int axis = 0; axis < 3; axis++)
            d[2 + axis] = (ls_lamp_model(&f->lamp, p->shifted[axis], p->shifted[axis] + 3) - s->m) /
                          f->view->shift_m;
        add_sample(&sums[p->colour], absolute_weight(f, s), s->e, s->m, d, 5);
    }
    for (int c = 0; c < 3; c++)
        eliminate(&sums[c], 5, out->place_score, out->place_information);
}

void ls_shading_place(struct ls_shading_work *f, struct ls_shading *out)
{
    fill_tilt(f, out);
    fill_place(f, out);
    fit_direction(f, out);
}

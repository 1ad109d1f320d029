#include "core/merge.h"

#include "core/merge_defects.h"
#include "core/merge_lanes.h"

#include <assert.h>

/* Pixels pass in runs short enough for what has to be unpacked or made up to stay in the
 * first-level cache; the rest of a run that fills no group is merged in a padded one. */
enum { RUN = 1024, GROUP = LS_MERGE_GROUP };

static const float no_dark[RUN];

static void run_c(const struct ls_merge_model *m, const struct ls_merge_lines *l, size_t n)
{
    merge_any(m, l, n);
}

const struct ls_merge_kernels ls_merge_kernels_c = {run_c};

const struct ls_merge_kernels *ls_merge_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_merge_kernels_c, &ls_merge_kernels_avx2, &ls_merge_kernels_avx512);
}

/* Products of two variances, times a sample, times their number, stay far inside float's range, and
 * so do the smallest ones times two exposures. */
static bool products_fit(const struct ls_merge_model *m)
{
    enum { LARGEST_PRODUCTS = 3 };
    double samples = 2 * 65535.0 * LARGEST_PRODUCTS, t = (double)m->t[0];
    double largest = (double)m->noise * LARGEST_PRODUCTS + (double)m->shot * samples;

    return m->n <= LARGEST_PRODUCTS && t > 1e-7 && largest / t < 1e15;
}

static void sort_exposures(const struct ls_merge_params *p, struct ls_merge_model *m)
{
    for (uint32_t i = 0; i < p->n_exposures; i++) {
        uint32_t k = i;
        for (; k > 0 && p->exposure_s[m->order[k - 1]] > p->exposure_s[i]; k--)
            m->order[k] = m->order[k - 1];
        m->order[k] = i;
    }
}

static void model_init(struct ls_merge_model *m, const struct ls_merge_params *p)
{
    double noise = p->read_noise_dn * p->read_noise_dn + 1.0 / 12;

    m->n = p->n_exposures;
    sort_exposures(p, m);
    double longest = p->exposure_s[m->order[m->n - 1]];
    for (uint32_t i = 0; i < m->n; i++) {
        double t = p->exposure_s[m->order[i]] / longest;
        m->t[i] = (float)t;
        m->floor_t[i] = (float)(noise / t);
    }
    m->low = (float)(p->range_low * p->full_scale_dn);
    m->high = (float)(p->range_high * p->full_scale_dn);
    m->clip = (float)p->clip_dn;
    m->noise = (float)noise;
    m->shot = (float)(1 / p->electrons_per_dn);
    m->scale = (float)(1 / (p->full_scale_dn * longest));
    m->scale2 = m->scale * m->scale;
    m->reference_s = (float)p->reference_exposure_s;
    m->wide = p->format->packing != LS_PACKING_8;
    m->products = products_fit(m);
}

static void merge_rest(const struct ls_merge_work *w, size_t first, size_t n)
{
    const struct ls_merge_spans *s = w->spans;
    struct ls_merge_group g = {0};

    ls_merge_group_load(w, &g, first, n, 0);
    ls_merge_group_run(w, &g);
    memcpy(s->validity + first, g.validity, n);
    if (s->e)
        memcpy(s->e + first, g.e, n * sizeof *g.e);
    if (s->half)
        memcpy(s->half + first, g.half, n * sizeof *g.half);
    if (s->variance)
        memcpy(s->variance + first, g.variance, n * sizeof *g.variance);
}

/* Where the samples of an exposure can be read: in place, or unpacked. */
static const void *samples(const struct ls_pixel_format *format, const uint8_t *raw, size_t first,
                           size_t n, uint16_t unpacked[RUN])
{
    if (format->packing == LS_PACKING_8)
        return raw + first;
    if (format->packing == LS_PACKING_16)
        return raw + 2 * first;
    ls_pixel_unpack(format, raw, first, n, unpacked);
    return unpacked;
}

static void merge_pixels(const struct ls_merge_work *w, size_t first, size_t n)
{
    const struct ls_merge_spans *s = w->spans;
    uint16_t unpacked[LS_MERGE_MAX_EXPOSURES][RUN];
    struct ls_merge_lines l = {.e = s->e ? s->e + first : NULL,
                               .variance = s->variance ? s->variance + first : NULL,
                               .half = s->half ? s->half + first : NULL,
                               .validity = s->validity + first};
    size_t whole = n - n % GROUP;

    for (uint32_t i = 0; i < w->model->n; i++) {
        uint32_t k = w->model->order[i];
        l.dark[i] = s->dark[k] ? s->dark[k] + first : no_dark;
        l.x[i] = samples(w->params->format, s->raw[k], first, whole, unpacked[i]);
    }
    w->kernels->run(w->model, &l, whole);
    if (n > whole)
        merge_rest(w, first + whole, n - whole);
}

void ls_merge_rows_with(const struct ls_merge_kernels *kernels,
                        const struct ls_merge_params *params, const struct ls_merge_spans *spans,
                        uint32_t first_row, uint32_t n_rows)
{
    struct ls_merge_model model = {0};
    const struct ls_merge_work work = {kernels, &model, params, spans};
    size_t begin = (size_t)first_row * params->width;
    size_t end = begin + (size_t)n_rows * params->width;

    assert(params->n_exposures >= 1 && params->n_exposures <= LS_MERGE_MAX_EXPOSURES);
    assert(first_row <= params->height && n_rows <= params->height - first_row);
    assert(!spans->half || params->reference_exposure_s > 0);
    model_init(&model, params);
    for (size_t at = begin; at < end; at += RUN)
        merge_pixels(&work, at, end - at < RUN ? end - at : RUN);
    for (size_t k = ls_merge_first_defect(params, begin);
         k < params->n_defects && params->defects[k] < end; k++)
        ls_merge_correct(&work, params->defects[k]);
}

void ls_merge_rows(const struct ls_merge_params *params, const struct ls_merge_spans *spans,
                   uint32_t first_row, uint32_t n_rows)
{
    ls_merge_rows_with(ls_merge_kernels(ls_cpu_isa()), params, spans, first_row, n_rows);
}

#include "core/linear_block.h"

#include <math.h>

/* One part of one call. */
struct work {
    const struct ls_linear_kernels *kernels;
    const struct ls_linear_pictures *pictures;
    const struct ls_linear_options *options;
    const struct ls_linear_part *part;
    struct ls_linear_sums sums;
};

static uint32_t at_most_a_block(uint32_t n)
{
    return n < LS_LINEAR_BLOCK ? n : LS_LINEAR_BLOCK;
}

static struct ls_linear_span span_at(const struct work *w, uint32_t x, uint32_t y, uint32_t n,
                                     uint32_t stride)
{
    size_t row = (size_t)(w->part->y + y) * w->pictures->width;
    return (struct ls_linear_span){row + w->part->x + x, at_most_a_block(n), stride};
}

static void fit_row(const struct work *w, uint32_t y)
{
    const struct ls_linear_part *part = w->part;
    size_t size = w->pictures->n_in * w->pictures->n_out;
    size_t stride = part->out_stride ? part->out_stride : part->width * size;
    for (uint32_t x = 0; x < part->width; x += LS_LINEAR_BLOCK) {
        struct ls_linear_span span = span_at(w, x, y, part->width - x, 1);
        w->kernels->fit(w->pictures, w->options, &w->sums, &span,
                        part->out + y * stride + x * size);
    }
}

static void add_errors(const struct ls_linear_span *span, const struct ls_linear_pixel_errors *e,
                       struct ls_linear_error *sum)
{
    for (uint32_t j = 0; j < span->n; j++) {
        bool known = isfinite(e->difference[j]) && isfinite(e->noise[j]) &&
                     isfinite(e->single[j]) && isfinite(e->total[j]);
        if (!known)
            continue;
        sum->difference += e->difference[j];
        sum->noise += e->noise[j];
        sum->single += e->single[j];
        sum->total += e->total[j];
        sum->pixels++;
    }
}

static void predict_row(const struct work *w, uint32_t y)
{
    const struct ls_linear_part *part = w->part;
    struct ls_linear_pixel_errors errors;
    for (uint32_t x = part->first_x; x < part->width; x += LS_LINEAR_BLOCK * part->step) {
        uint32_t left = (part->width - x + part->step - 1) / part->step;
        struct ls_linear_span span = span_at(w, x, y, left, part->step);
        w->kernels->predict(w->pictures, w->options, &w->sums, &span, &errors);
        add_errors(&span, &errors, part->error);
    }
}

enum ls_err ls_linear_check_part(const struct ls_linear_pictures *p,
                                 const struct ls_linear_part *part, struct ls_diag *diag)
{
    if (!part->width || part->x >= p->width || part->width > p->width - part->x)
        return ls_fail(diag, LS_ERR_INVALID, "linear fit: columns %u + %u of %u px", part->x,
                       part->width, p->width);
    if (part->step && p->n_segments < 3)
        return ls_fail(diag, LS_ERR_STATE,
                       "%u segments: without one there is nothing to fit; expected 3 or more",
                       p->n_segments);
    if (part->step > LS_LINEAR_MAX_STEP)
        return ls_fail(diag, LS_ERR_INVALID, "leave one out: step is %u: expected 1 to %d",
                       part->step, LS_LINEAR_MAX_STEP);
    return LS_OK;
}

enum ls_err ls_linear_fit_with(const struct ls_linear_kernels *kernels,
                               const struct ls_linear_pictures *pictures,
                               const struct ls_linear_options *options,
                               const struct ls_linear_part *part, struct ls_diag *diag)
{
    struct work w = {kernels, pictures, options, part, {0}};
    enum ls_err err = ls_linear_check_part(pictures, part, diag);
    if (!err)
        err = ls_linear_sums_init(pictures, options, part->y, part->height, &w.sums, diag);
    for (uint32_t y = 0; y < part->height && !err && part->out; y++)
        fit_row(&w, y);
    for (uint32_t y = part->first_y; y < part->height && !err && part->step; y += part->step)
        predict_row(&w, y);
    ls_linear_sums_finish(&w.sums);
    return err;
}

enum ls_err ls_linear_fit(const struct ls_linear_pictures *pictures,
                          const struct ls_linear_options *options,
                          const struct ls_linear_part *part, struct ls_diag *diag)
{
    return ls_linear_fit_with(ls_linear_kernels(ls_cpu_isa()), pictures, options, part, diag);
}

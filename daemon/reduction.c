#include "daemon/reduction.h"

#include "core/half.h"

#include <stdlib.h>

static const double rec709[3] = {0.2126, 0.7152, 0.0722};

enum ls_err ls_reduction_check_level(uint32_t level, struct ls_diag *diag)
{
    return level <= LS_LEVEL_MAX
               ? LS_OK
               : ls_fail(diag, LS_ERR_UNSUPPORTED,
                         "level %u: expected 0 (full size), 1 (half) or 2 (quarter)", level);
}

enum ls_err ls_reduction_make_mono(struct ls_reduction *r, const struct ls_take_facts *facts,
                                   struct ls_diag *diag)
{
    const struct ls_calibration *c = facts->calibration;
    r->luminance = facts->cfa != LS_CFA_NONE;
    if (!r->luminance)
        return LS_OK;
    if (!c || !c->has_m)
        return ls_fail(diag, LS_ERR_STATE,
                       "mono: the camera sees colours, and the take's calibration has no matrix M "
                       "to make their luminance by; ask for rgb");
    for (int j = 0; j < 3; j++)
        r->y[j] = rec709[0] * c->m[0][j] + rec709[1] * c->m[1][j] + rec709[2] * c->m[2][j];
    return LS_OK;
}

bool ls_reduction_any(const struct ls_reduction *r)
{
    return r->level > 0 || r->luminance;
}

enum ls_err ls_reduction_begin(struct ls_reduction *r, const struct ls_demosaic_region *needs,
                               uint32_t components, struct ls_diag *diag)
{
    ls_level_rows_finish(&r->rows);
    return ls_level_rows_init(&r->rows, r->level, needs, r->luminance ? 1 : components, diag);
}

static void make_mono(const struct ls_reduction *r, float *values, size_t n)
{
    for (size_t j = 0; j < n; j++) {
        const float *v = values + 3 * j;
        values[j] =
            (float)(r->y[0] * (double)v[0] + r->y[1] * (double)v[1] + r->y[2] * (double)v[2]);
    }
}

enum ls_err ls_reduction_add(struct ls_reduction *r, float *values, uint32_t n_rows, float **out,
                             uint32_t *made, struct ls_diag *diag)
{
    struct ls_level_rows *rows = &r->rows;
    size_t row = (size_t)ls_level_size(rows->width, r->level) * rows->components;
    *out = malloc(row * ((n_rows >> r->level) + 2) * sizeof **out);
    if (!*out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for rows of a picture");
    if (r->luminance)
        make_mono(r, values, (size_t)rows->width * n_rows);
    *made = ls_level_rows_add(rows, values, n_rows, *out);
    return LS_OK;
}

/* What is no number stays none. */
static float clamped(float v)
{
    return v > LS_HALF_MAX ? LS_HALF_MAX : v < -LS_HALF_MAX ? -LS_HALF_MAX : v;
}

void ls_reduction_clamp(float *values, size_t n)
{
    for (size_t j = 0; j < n; j++)
        values[j] = clamped(values[j]);
}

void ls_reduction_finish(struct ls_reduction *r)
{
    ls_level_rows_finish(&r->rows);
}

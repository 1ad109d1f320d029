#include "core/demosaic.h"

#include "core/demosaic_lanes.h"
#include "core/half_kernels.h"

#include <string.h>

/* A region passes in strips of STRIP columns, top to bottom, so that a row is loaded once for the
 * five output rows that read it and stays in a near cache. */
enum {
    HALO = LS_DEMOSAIC_HALO,
    ROWS = LS_DEMOSAIC_ROWS + 1, /* two are made at a time */
    STRIP = 2048,
    STRIDE = STRIP + 2 * HALO + LS_DEMOSAIC_SLACK,
};

static void line_c(const struct ls_demosaic_line *l)
{
    demosaic_line(l);
}

const struct ls_demosaic_kernels ls_demosaic_kernels_c = {line_c};

const struct ls_demosaic_kernels *ls_demosaic_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_demosaic_kernels_c, &ls_demosaic_kernels_avx2,
                       &ls_demosaic_kernels_avx512);
}

/* What is the same for every row. */
struct job {
    const struct ls_demosaic_source *source;
    const struct ls_demosaic_target *target;
    const struct ls_half_kernels *half;
    const struct ls_demosaic_kernels *kernels;
    struct ls_demosaic_region region;
    enum ls_demosaic_filter filter;
};

static uint32_t mirror(int64_t i, uint32_t n)
{
    if (n == 1)
        return 0;
    while (i < 0 || i >= n)
        i = i < 0 ? -i : 2 * ((int64_t)n - 1) - i;
    return (uint32_t)i;
}

/* The sample at column x, mirrored, of the row that begins at sample @row of the source. */
static float sample(const struct ls_demosaic_source *s, size_t row, int64_t x)
{
    size_t k = row + (mirror(x, s->image_width) - s->window.x);
    return s->half ? ls_half_to_float(s->half[k]) : s->data[k];
}

/* Pixels [x - HALO, x + n + HALO) of a row, and zeros after them. */
static void load_row(const struct job *job, uint32_t x, uint32_t n, int64_t y, float line[STRIDE])
{
    const struct ls_demosaic_source *s = job->source;
    size_t row = (size_t)(mirror(y, s->image_height) - s->window.y) * s->stride;
    uint32_t end = n + 2 * HALO, first = x < HALO ? HALO - x : 0; /* of what lies in the image */
    uint32_t inside = s->image_width + HALO - x < end ? s->image_width + HALO - x : end;
    size_t from = row + (x + first - HALO - s->window.x);

    for (uint32_t i = 0; i < first; i++)
        line[i] = sample(s, row, (int64_t)x + i - HALO);
    if (s->half)
        job->half->to_floats(s->half + from, line + first, inside - first);
    else
        memcpy(line + first, s->data + from, (inside - first) * sizeof *line);
    for (uint32_t i = inside; i < end; i++)
        line[i] = sample(s, row, (int64_t)x + i - HALO);
    memset(line + end, 0, LS_DEMOSAIC_SLACK * sizeof *line);
}

static bool is_woven(const struct ls_demosaic_target *t)
{
    return t->pixel_step == 3;
}

static void place(const struct job *job, uint32_t column, uint32_t row,
                  struct ls_demosaic_line *line)
{
    const struct ls_demosaic_target *t = job->target;
    size_t at = row * t->row_step + column * t->pixel_step;

    for (int c = 0; c < 3; c++)
        line->plane[c] = t->half[0] ? (void *)(t->half[c] + at) : (void *)(t->plane[c] + at);
    size_t of_ratio = row * t->ratio_step + 3 * (size_t)column;
    line->ratio = t->ratio ? t->ratio + of_ratio : NULL;
    line->half_ratio = t->half_ratio ? t->half_ratio + of_ratio : NULL;
}

static enum ls_demosaic_form form_of(const struct ls_demosaic_target *t)
{
    if (t->add)
        return LS_DEMOSAIC_ADD;
    if (t->half_ratio)
        return LS_DEMOSAIC_PROMOTED;
    return (t->half[0] ? LS_DEMOSAIC_HALF_PLANES : LS_DEMOSAIC_PLANES) + is_woven(t);
}

/* Columns [at, at + n) of the region. */
static void demosaic_strip(const struct job *job, uint32_t at, uint32_t n)
{
    const struct ls_demosaic_region *r = &job->region;
    enum ls_cfa cfa = job->source->cfa;
    float ring[ROWS][STRIDE];
    uint32_t x = r->x + at;
    const struct ls_demosaic_target *t = job->target;
    const bool green_first = ls_cfa_channel(cfa, x, r->y) == 1;
    struct ls_demosaic_line line = {.n = n,
                                    .green_first = green_first,
                                    .red_row = ls_cfa_channel(cfa, x + green_first, r->y) == 0,
                                    .filter = job->filter,
                                    .form = form_of(t),
                                    .step = t->row_step * (t->half[0] ? 2 : sizeof(float)),
                                    .scale = t->scale,
                                    .ratio_step = t->ratio_step};

    for (uint32_t k = 0; k < 2 * HALO; k++)
        load_row(job, x, n, (int64_t)r->y + k - HALO, ring[k]);
    for (uint32_t j = 0; j < r->height; j += 2) {
        uint32_t y = r->y + j;
        line.two = r->height - j > 1;
        for (uint32_t k = 2 * HALO; k < (line.two ? ROWS : ROWS - 1); k++)
            load_row(job, x, n, (int64_t)y + k - HALO, ring[(j + k) % ROWS]);
        for (uint32_t k = 0; k < ROWS; k++)
            line.row[k] = ring[(j + k) % ROWS] + HALO;
        place(job, at, j, &line);
        job->kernels->line(&line);
    }
}

static bool inside(struct ls_demosaic_region inner, struct ls_demosaic_region outer)
{
    return inner.x >= outer.x && inner.y >= outer.y &&
           (uint64_t)inner.x + inner.width <= (uint64_t)outer.x + outer.width &&
           (uint64_t)inner.y + inner.height <= (uint64_t)outer.y + outer.height;
}

struct ls_demosaic_region ls_demosaic_needs(struct ls_demosaic_region r, uint32_t image_width,
                                            uint32_t image_height)
{
    uint32_t x0 = r.x > HALO ? r.x - HALO : 0, y0 = r.y > HALO ? r.y - HALO : 0;
    uint64_t x1 = (uint64_t)r.x + r.width + HALO, y1 = (uint64_t)r.y + r.height + HALO;

    x1 = x1 < image_width ? x1 : image_width;
    y1 = y1 < image_height ? y1 : image_height;
    return (struct ls_demosaic_region){x0, y0, (uint32_t)(x1 - x0), (uint32_t)(y1 - y0)};
}

/* One place to read from, one form to write. */
static bool is_clear(const struct ls_demosaic_source *s, const struct ls_demosaic_target *t)
{
    bool woven = t->half[0] ? t->half[1] == t->half[0] + 1 && t->half[2] == t->half[0] + 2
                            : t->plane[1] == t->plane[0] + 1 && t->plane[2] == t->plane[0] + 2;
    return !s->data != !s->half && !t->plane[0] != !t->half[0] &&
           (!t->add || (t->plane[0] && is_woven(t))) &&
           (!t->half_ratio || (t->half[0] && is_woven(t))) &&
           (is_woven(t) ? woven : t->pixel_step == 1);
}

enum ls_err ls_demosaic_with(enum ls_isa isa, const struct ls_demosaic_source *source,
                             struct ls_demosaic_region region, enum ls_demosaic_method method,
                             const struct ls_demosaic_target *target)
{
    struct ls_demosaic_region image = {0, 0, source->image_width, source->image_height};
    struct job job = {.source = source,
                      .target = target,
                      .half = ls_half_kernels(isa),
                      .kernels = ls_demosaic_kernels(isa),
                      .region = region,
                      .filter = source->cfa == LS_CFA_NONE       ? LS_DEMOSAIC_FILTER_COPY
                                : method == LS_DEMOSAIC_GRADIENT ? LS_DEMOSAIC_FILTER_GRADIENT
                                                                 : LS_DEMOSAIC_FILTER_BILINEAR};

    if (!is_clear(source, target) || !inside(region, image) || !inside(source->window, image) ||
        !inside(ls_demosaic_needs(region, image.width, image.height), source->window))
        return LS_ERR_INVALID;
    for (uint32_t at = 0; region.height && at < region.width; at += STRIP)
        demosaic_strip(&job, at, region.width - at < STRIP ? region.width - at : STRIP);
    return LS_OK;
}

enum ls_err ls_demosaic(const struct ls_demosaic_source *source, struct ls_demosaic_region region,
                        enum ls_demosaic_method method, const struct ls_demosaic_target *target)
{
    return ls_demosaic_with(ls_cpu_isa(), source, region, method, target);
}

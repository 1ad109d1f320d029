#include "core/separated.h"

#include "core/half.h"
#include "core/left_out.h"
#include "core/separated_kernels.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum {
    GROUP = LS_SEPARATED_GROUP,
    STRIP_ROWS = 32, /* what a group of lights makes of a strip stays in the second cache */
    STRIP_PX = STRIP_ROWS * LS_TILE_SIDE,
    WINDOW_SIDE = LS_TILE_SIDE + 2 * LS_DEMOSAIC_HALO,
    WINDOW_PX = (STRIP_ROWS + 2 * LS_DEMOSAIC_HALO) * WINDOW_SIDE,
};

_Static_assert(WINDOW_PX % LS_SEPARATED_PAD == 0 && STRIP_PX % LS_SEPARATED_PAD == 0,
               "the kernels round up");

/* What a group of lights sends to one strip. */
struct group {
    uint32_t light[GROUP], n;
    uint16_t half_v[WINDOW_PX], half_h[WINDOW_PX];
    float v[WINDOW_PX], h[WINDOW_PX];
    float d[GROUP][WINDOW_PX], s[GROUP][WINDOW_PX];
    float variance[WINDOW_PX + LS_SEPARATED_PAD + 1], sigma[STRIP_PX + LS_SEPARATED_PAD];
    float metal[GROUP][3][STRIP_PX];
    float w[LS_SEPARATED_MAX_ROWS][GROUP];
};

/* One call of ls_separated_accumulate. */
struct pass {
    const struct ls_separated_job *job;
    const struct ls_separated_field *field;
    const struct ls_separated_kernels *kernels;
    float *out[3];                /* diffuse, specular, conductor */
    uint32_t *shining, n_shining; /* lights with a weight */
    uint32_t *used, n_used;       /* of those, what the tile at hand takes */
    struct ls_left_out *left_out; /* NULL without max_error */
    uint32_t tiles_x, tiles_y;
    struct group *group;
    float *diffuse, *specular; /* [n_rows][WINDOW_PX], of a strip */
    float *conductor;          /* [n_rows][3][STRIP_PX] */
    float *rgb;                /* [STRIP_PX][n_channels] */
    float sigma_scale;         /* 1 over the smallest of p(w,.) */
    uint64_t not_finite;
    struct ls_separated_report *report; /* or NULL */
};

/* A part of the region, and what of the picture its demosaic reads. */
struct strip {
    struct ls_demosaic_region at, window;
};

static bool has_conductor(const struct pass *pass)
{
    return pass->out[2] && pass->field->n_channels == 3;
}

static float weight(const struct ls_separated_job *job, uint32_t q, uint32_t light)
{
    return job->weights[(size_t)q * job->field->n_lights + light];
}

static const void *samples(const struct ls_picture *picture, size_t tile, size_t offset)
{
    const char *at = picture->tiles[tile];
    return at ? at + 2 * offset : NULL;
}

static struct ls_separated_terms terms_of(const struct pass *pass, uint32_t light)
{
    const struct ls_split *c = &pass->field->split[light];
    const struct ls_field_noise *noise = &pass->field->noise;
    double v2 = (double)c->s_v * (double)c->s_v, h2 = (double)c->s_h * (double)c->s_h;
    double both = (double)c->s_v + (double)c->s_h;
    return (struct ls_separated_terms){
        .split = *c,
        .variance = (float)((v2 + h2) * noise->read_variance + both * both * noise->dark_variance),
        .shot_v = (float)(v2 * noise->shot),
        .shot_h = (float)(h2 * noise->shot)};
}

/* Halves of a row; nearly always 64 or 2 of them. */
static void copy_halves(uint16_t *to, const void *from, size_t n)
{
    if (!from)
        memset(to, 0, 2 * n);
    else if (n == LS_TILE_SIDE)
        memcpy(to, from, 2 * LS_TILE_SIDE);
    else if (n == LS_DEMOSAIC_HALO)
        memcpy(to, from, 2 * LS_DEMOSAIC_HALO);
    else
        memcpy(to, from, 2 * n);
}

/* The part of one tile row that lies in the window, from column x to @end of the picture. */
static bool load_piece(struct pass *pass, const struct strip *strip, uint32_t light, uint32_t x,
                       uint32_t end, uint32_t y)
{
    const struct ls_separated_field *f = pass->field;
    uint32_t tx = x / LS_TILE_SIDE, ty = y / LS_TILE_SIDE, left = tx * LS_TILE_SIDE;
    size_t tile = (size_t)ty * pass->tiles_x + tx;
    uint32_t wide = f->width - left < LS_TILE_SIDE ? f->width - left : LS_TILE_SIDE;
    size_t offset = (size_t)(y - ty * LS_TILE_SIDE) * wide + (x - left);
    const void *v = samples(&f->v[light], tile, offset), *h = samples(&f->h[light], tile, offset);
    size_t at = (size_t)(y - strip->window.y) * strip->window.width + (x - strip->window.x);
    copy_halves(pass->group->half_v + at, v, end - x);
    copy_halves(pass->group->half_h + at, h, end - x);
    return v || h;
}

/* D, S and the variance of S of light k of the group over the window; false: nothing stored. */
static bool load(struct pass *pass, const struct strip *strip, uint32_t k)
{
    struct group *g = pass->group;
    const struct ls_demosaic_region *w = &strip->window;
    struct ls_separated_terms terms = terms_of(pass, g->light[k]);
    bool any = false;
    for (uint32_t y = w->y; y < w->y + w->height; y++)
        for (uint32_t x = w->x, end; x < w->x + w->width; x = end) {
            end = (x / LS_TILE_SIDE + 1) * LS_TILE_SIDE;
            end = end < w->x + w->width ? end : w->x + w->width;
            any |= load_piece(pass, strip, g->light[k], x, end, y);
        }
    size_t n = (size_t)w->width * w->height;
    pass->not_finite += pass->kernels->widen(g->half_v, n, g->v);
    pass->not_finite += pass->kernels->widen(g->half_h, n, g->h);
    pass->kernels->split(&terms, g->v, g->h, n, g->d[k], g->s[k], g->variance);
    return any;
}

/* The largest variance of the cell right of and below each pixel, as sigma over p(w,.). */
static void find_sigma(const struct pass *pass, const struct strip *strip)
{
    const struct ls_separated_field *f = pass->field;
    const struct ls_demosaic_region *w = &strip->window, *at = &strip->at;
    struct group *g = pass->group;
    for (uint32_t j = 0; j < at->height; j++) {
        uint32_t y = at->y + j, below = y + 1 < f->height ? y + 1 : y ? y - 1 : 0;
        const float *row = g->variance + (size_t)(y - w->y) * w->width + (at->x - w->x);
        const float *next = g->variance + (size_t)(below - w->y) * w->width + (at->x - w->x);
        bool inside = at->x + at->width < f->width;
        float *sigma = g->sigma + (size_t)j * at->width;
        pass->kernels->sigma(row, next, inside ? at->width : at->width - 1, pass->sigma_scale,
                             sigma);
        if (!inside) {
            uint32_t last = at->width - 1, x = f->width > 1 ? f->width - 2 : 0, to = x - w->x;
            const float *mirror[2] = {g->variance + (size_t)(y - w->y) * w->width,
                                      g->variance + (size_t)(below - w->y) * w->width};
            float most[2] = {fmaxf(row[last], next[last]), fmaxf(mirror[0][to], mirror[1][to])};
            sigma[last] = pass->sigma_scale * sqrtf(fmaxf(most[0], most[1]));
        }
    }
}

static enum ls_err demosaic(const struct pass *pass, const struct strip *strip, const float *mosaic,
                            const struct ls_demosaic_target *target)
{
    const struct ls_separated_field *f = pass->field;
    struct ls_demosaic_source source = {.data = mosaic,
                                        .stride = strip->window.width,
                                        .window = strip->window,
                                        .image_width = f->width,
                                        .image_height = f->height,
                                        .cfa = f->cfa};
    return ls_demosaic(&source, strip->at, pass->job->method, target);
}

/* Is S so dark everywhere that the gate of core/conductor.h lets nothing through? Demosaicing makes
 * at most 2.5 times a sample (core/demosaic_lanes.h) of it, and its noise is no less than that of a
 * sample without light. */
static bool is_dark(const struct pass *pass, const struct strip *strip, uint32_t k)
{
    struct ls_separated_terms terms = terms_of(pass, pass->group->light[k]);
    const float *s = pass->group->s[k];
    size_t n = (size_t)strip->window.width * strip->window.height;
    float limit = 0.999f * LS_CONDUCTOR_SIGMA_FROM / 2.5f * sqrtf(terms.variance);
    uint32_t brighter = 0;
    for (size_t j = 0; j < n; j++)
        brighter |= (s[j] > limit) | (s[j] < -limit);
    return !brighter;
}

static enum ls_err find_metal(struct pass *pass, const struct strip *strip, uint32_t k)
{
    struct group *g = pass->group;
    size_t n = (size_t)strip->at.width * strip->at.height;
    float *plane[3] = {g->metal[k][0], g->metal[k][1], g->metal[k][2]};
    struct ls_demosaic_target target = {
        .plane = {plane[0], plane[1], plane[2]}, .pixel_step = 1, .row_step = strip->at.width};
    enum ls_err err = demosaic(pass, strip, g->s[k], &target);
    if (err)
        return err;
    find_sigma(pass, strip);
    pass->kernels->conductor(&pass->field->conductor, plane, g->sigma, n);
    return LS_OK;
}

static void add_sums(const struct pass *pass, const float *values, size_t stride, size_t n,
                     size_t sum_stride, float *sums)
{
    const struct group *g = pass->group;
    struct ls_separated_add add = {.w = (const float(*)[GROUP])g->w,
                                   .n_rows = pass->job->n_rows,
                                   .n_lights = g->n,
                                   .values = values,
                                   .stride = stride,
                                   .n = n,
                                   .sum = sums,
                                   .sum_stride = sum_stride};
    pass->kernels->add(&add);
}

static void load_weights(const struct pass *pass)
{
    struct group *g = pass->group;
    for (uint32_t q = 0; q < pass->job->n_rows; q++)
        for (uint32_t k = 0; k < g->n; k++)
            g->w[q][k] = weight(pass->job, q, g->light[k]);
}

static enum ls_err run_group(struct pass *pass, const struct strip *strip)
{
    struct group *g = pass->group;
    size_t n = (size_t)strip->at.width * strip->at.height;
    size_t n_window = (size_t)strip->window.width * strip->window.height;
    bool any = false, metal = false;
    for (uint32_t k = 0; k < g->n; k++) {
        bool stored = load(pass, strip, k), shines = stored && !is_dark(pass, strip, k);
        enum ls_err err = LS_OK;
        if (has_conductor(pass) && shines)
            err = find_metal(pass, strip, k);
        else if (has_conductor(pass))
            memset(g->metal[k], 0, sizeof g->metal[k]);
        if (err)
            return err;
        any |= stored;
        metal |= shines;
    }
    if (!any)
        return LS_OK;
    load_weights(pass);
    if (pass->out[0])
        add_sums(pass, g->d[0], WINDOW_PX, n_window, WINDOW_PX, pass->diffuse);
    if (pass->out[1])
        add_sums(pass, g->s[0], WINDOW_PX, n_window, WINDOW_PX, pass->specular);
    for (uint32_t c = 0; has_conductor(pass) && metal && c < 3; c++)
        add_sums(pass, g->metal[0][c], 3 * STRIP_PX, n, 3 * STRIP_PX,
                 pass->conductor + c * STRIP_PX);
    return LS_OK;
}

static float *out_row(const struct pass *pass, float *out, uint32_t q, uint32_t x, uint32_t y)
{
    const struct ls_demosaic_region *r = &pass->job->region;
    size_t row = (size_t)q * r->height + (y - r->y);
    return out + (row * r->width + (x - r->x)) * pass->field->n_channels;
}

static enum ls_err hand_over_mosaic(const struct pass *pass, const struct strip *strip,
                                    const float *sums, float *out)
{
    const struct ls_demosaic_region *at = &strip->at;
    for (uint32_t q = 0; q < pass->job->n_rows; q++) {
        const float *sum = sums + (size_t)q * WINDOW_PX;
        float *to = out_row(pass, out, q, at->x, at->y);
        size_t stride = (size_t)pass->job->region.width * pass->field->n_channels;
        struct ls_demosaic_target target = {
            .plane = {to, to + 1, to + 2}, .pixel_step = 3, .row_step = stride};
        enum ls_err err = LS_OK;
        if (pass->field->n_channels == 3)
            err = demosaic(pass, strip, sum, &target);
        for (uint32_t j = 0; pass->field->n_channels == 1 && j < at->height; j++)
            memcpy(to + j * stride, sum + (size_t)j * at->width, sizeof *to * at->width);
        if (err)
            return err;
    }
    return LS_OK;
}

static void hand_over_planes(const struct pass *pass, const struct strip *strip)
{
    const struct ls_demosaic_region *at = &strip->at;
    for (uint32_t q = 0; q < pass->job->n_rows; q++)
        for (uint32_t j = 0; j < at->height; j++) {
            float *to = out_row(pass, pass->out[2], q, at->x, at->y + j);
            const float *from = pass->conductor + (size_t)q * 3 * STRIP_PX + (size_t)j * at->width;
            for (uint32_t x = 0; x < at->width; x++)
                for (uint32_t c = 0; c < 3; c++)
                    to[3 * x + c] = from[c * STRIP_PX + x];
        }
}

static enum ls_err run_strip(struct pass *pass, const struct strip *strip)
{
    size_t rows = pass->job->n_rows;
    memset(pass->diffuse, 0, sizeof(float) * rows * WINDOW_PX);
    memset(pass->specular, 0, sizeof(float) * rows * WINDOW_PX);
    memset(pass->conductor, 0, sizeof(float) * rows * 3 * STRIP_PX);
    enum ls_err err = LS_OK;
    for (uint32_t at = 0; at < pass->n_used && !err; at += GROUP) {
        uint32_t left = pass->n_used - at;
        pass->group->n = left < GROUP ? left : GROUP;
        memcpy(pass->group->light, pass->used + at, sizeof(uint32_t) * pass->group->n);
        err = run_group(pass, strip);
    }
    if (!err && pass->out[0])
        err = hand_over_mosaic(pass, strip, pass->diffuse, pass->out[0]);
    if (!err && pass->out[1])
        err = hand_over_mosaic(pass, strip, pass->specular, pass->out[1]);
    if (!err && has_conductor(pass))
        hand_over_planes(pass, strip);
    return err;
}

/* ---- which lights ---- */

/* The largest stored value of a light around a tile. */
static double largest(const struct pass *pass, const float *max, uint32_t light, uint32_t tx,
                      uint32_t ty)
{
    double most = 0;
    for (uint32_t y = ty ? ty - 1 : 0; y <= ty + 1 && y < pass->tiles_y; y++)
        for (uint32_t x = tx ? tx - 1 : 0; x <= tx + 1 && x < pass->tiles_x; x++) {
            size_t tile = (size_t)y * pass->tiles_x + x;
            most = fmax(most, fabs((double)max[tile * pass->field->n_lights + light]));
        }
    return most;
}

static double reach(const struct pass *pass, uint32_t light, uint32_t tx, uint32_t ty)
{
    const struct ls_separated_field *f = pass->field;
    const struct ls_split *c = &f->split[light];
    double v = fabs((double)c->d_v) + fabs((double)c->s_v);
    double h = fabs((double)c->d_h) + fabs((double)c->s_h);
    return v * largest(pass, f->v_max, light, tx, ty) + h * largest(pass, f->h_max, light, tx, ty);
}

static void choose_lights(struct pass *pass, uint32_t tx, uint32_t ty)
{
    struct ls_left_out *left_out = pass->left_out;
    for (uint32_t i = 0; left_out && i < pass->field->n_lights; i++)
        left_out->reach[i] = reach(pass, i, tx, ty);
    if (left_out)
        ls_left_out_choose(left_out, pass->job->max_error);
    pass->n_used = 0;
    for (uint32_t k = 0; k < pass->n_shining; k++)
        if (!left_out || !left_out->skip[pass->shining[k]])
            pass->used[pass->n_used++] = pass->shining[k];
}

static uint32_t next(uint32_t at, uint32_t end, uint32_t step)
{
    uint32_t multiple = (at / step + 1) * step;
    return multiple < end ? multiple : end;
}

static enum ls_err run_strips(struct pass *pass)
{
    const struct ls_demosaic_region *r = &pass->job->region;
    const struct ls_separated_field *f = pass->field;
    for (uint32_t y = r->y, y1; y < r->y + r->height; y = y1) {
        y1 = next(y, r->y + r->height, STRIP_ROWS);
        for (uint32_t x = r->x, x1; x < r->x + r->width; x = x1) {
            x1 = next(x, r->x + r->width, LS_TILE_SIDE);
            struct strip strip = {.at = {x, y, x1 - x, y1 - y}};
            strip.window =
                f->n_channels == 3 ? ls_demosaic_needs(strip.at, f->width, f->height) : strip.at;
            choose_lights(pass, x / LS_TILE_SIDE, y / LS_TILE_SIDE);
            enum ls_err err = run_strip(pass, &strip);
            if (err)
                return err;
        }
    }
    return LS_OK;
}

static enum ls_err check(const struct ls_separated_job *job, struct ls_diag *diag)
{
    const struct ls_separated_field *f = job->field;
    const struct ls_demosaic_region *r = &job->region;
    if (!f->width || !f->height || f->width > 1u << 20 || f->height > 1u << 20 || !r->width ||
        !r->height || r->x >= f->width || r->y >= f->height || r->width > f->width - r->x ||
        r->height > f->height - r->y)
        return ls_fail(diag, LS_ERR_INVALID,
                       "separated: %u x %u px at (%u, %u): expected a part of %u x %u", r->width,
                       r->height, r->x, r->y, f->width, f->height);
    if (f->n_channels != (f->cfa == LS_CFA_NONE ? 1 : 3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "separated: %u channels: expected 3, or 1 without a colour filter",
                       f->n_channels);
    if (job->n_rows < 1 || job->n_rows > LS_SEPARATED_MAX_ROWS)
        return ls_fail(diag, LS_ERR_INVALID, "separated: %u rows of weights: expected 1..%d",
                       job->n_rows, LS_SEPARATED_MAX_ROWS);
    if (!(job->max_error >= 0) || (job->max_error > 0 && (!f->v_max || !f->h_max)))
        return ls_fail(diag, LS_ERR_INVALID,
                       "separated: an error of %g is asked for: expected a number >= 0, and the "
                       "maxima of the tiles",
                       job->max_error);
    for (uint32_t q = 0; q < job->n_rows; q++)
        for (uint32_t i = 0; i < f->n_lights; i++)
            if (!isfinite(weight(job, q, i)))
                return ls_fail(diag, LS_ERR_INVALID,
                               "separated: weight of light %u in row %u is not a finite number", i,
                               q);
    return LS_OK;
}

static void list_shining(struct pass *pass)
{
    for (uint32_t i = 0; i < pass->field->n_lights; i++) {
        bool shines = false;
        for (uint32_t q = 0; q < pass->job->n_rows; q++)
            shines |= weight(pass->job, q, i) != 0;
        if (shines)
            pass->shining[pass->n_shining++] = i;
    }
}

static void count_tiles(struct pass *pass, struct ls_separated_report *report)
{
    const struct ls_demosaic_region *r = &pass->job->region;
    uint32_t x1 = (r->x + r->width - 1) / LS_TILE_SIDE, y1 = (r->y + r->height - 1) / LS_TILE_SIDE;
    for (uint32_t ty = r->y / LS_TILE_SIDE; ty <= y1; ty++)
        for (uint32_t tx = r->x / LS_TILE_SIDE; tx <= x1; tx++) {
            size_t tile = (size_t)ty * pass->tiles_x + tx;
            uint64_t read = 0;
            choose_lights(pass, tx, ty);
            for (uint32_t k = 0; k < pass->n_used; k++)
                read += pass->field->v[pass->used[k]].tiles[tile] ||
                        pass->field->h[pass->used[k]].tiles[tile];
            report->tiles_read += read;
            report->tiles_skipped += pass->field->n_lights - read;
        }
}

static void make_report(struct pass *pass, struct ls_separated_report *report)
{
    *report = (struct ls_separated_report){.not_finite = pass->not_finite,
                                           .bound = pass->left_out ? pass->left_out->bound : 0};
    count_tiles(pass, report);
}

static enum ls_err run(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_separated_job *job = pass->job;
    struct ls_left_out left_out = {0};
    if (job->max_error > 0) {
        if (ls_left_out_init(&left_out, job->weights, pass->field->n_lights, job->n_rows))
            return ls_fail(diag, LS_ERR_NOMEM, "separated: out of memory");
        pass->left_out = &left_out;
    }
    enum ls_err err = run_strips(pass);
    if (err)
        err = ls_fail(diag, err, "separated: a strip cannot be demosaiced");
    else if (pass->report)
        make_report(pass, pass->report);
    ls_left_out_finish(&left_out);
    return err;
}

enum ls_err ls_separated_accumulate_with(const struct ls_separated_kernels *kernels,
                                         const struct ls_separated_job *job, float *diffuse,
                                         float *specular, float *conductor,
                                         struct ls_separated_report *report, struct ls_diag *diag)
{
    enum ls_err err = check(job, diag);
    if (err)
        return err;
    const struct ls_separated_field *f = job->field;
    size_t rows = job->n_rows;
    LS_CLEANUP_FREE uint32_t *lights = calloc(2 * f->n_lights + 1u, sizeof *lights);
    LS_CLEANUP_FREE struct group *group = calloc(1, sizeof *group);
    LS_CLEANUP_FREE float *sums = calloc(rows * (2 * WINDOW_PX + 3 * STRIP_PX), sizeof *sums);
    if (!lights || !group || !sums)
        return ls_fail(diag, LS_ERR_NOMEM, "separated: out of memory");
    struct pass pass = {.job = job,
                        .field = f,
                        .kernels = kernels,
                        .out = {diffuse, specular, conductor},
                        .report = report,
                        .shining = lights,
                        .used = lights + f->n_lights,
                        .tiles_x = (f->width + LS_TILE_SIDE - 1) / LS_TILE_SIDE,
                        .tiles_y = (f->height + LS_TILE_SIDE - 1) / LS_TILE_SIDE,
                        .group = group,
                        .diffuse = sums,
                        .specular = sums + rows * WINDOW_PX,
                        .conductor = sums + 2 * rows * WINDOW_PX};
    list_shining(&pass);
    for (int c = 0; f->n_channels == 3 && c < 3; c++)
        pass.sigma_scale = fmaxf(pass.sigma_scale, f->conductor.scale[c]);
    if (conductor && f->n_channels == 1)
        memset(conductor, 0, sizeof *conductor * rows * job->region.width * job->region.height);
    return run(&pass, diag);
}

enum ls_err ls_separated_accumulate(const struct ls_separated_job *job, float *diffuse,
                                    float *specular, float *conductor,
                                    struct ls_separated_report *report, struct ls_diag *diag)
{
    return ls_separated_accumulate_with(ls_separated_kernels(ls_cpu_isa()), job, diffuse, specular,
                                        conductor, report, diag);
}

void ls_separated_sigma(const struct ls_separated_field *field, const float *row,
                        const float *total, size_t n, float *sigma)
{
    const struct ls_field_noise *noise = &field->noise;
    double squares = 0, sum = 0, largest = 0;
    for (uint32_t i = 0; i < field->n_lights; i++) {
        const struct ls_split *c = &field->split[i];
        double w = (double)row[i], v = (double)c->d_v, h = (double)c->d_h;
        double k_v = v + (double)c->s_v, k_h = h + (double)c->s_h; /* as D + S = V + H */
        squares += w * w * (v * v + h * h);
        sum += w * (v + h);
        largest = fmax(largest, w * fmax(v * v / k_v, h * h / k_h));
    }
    double floor_variance = noise->read_variance * squares + noise->dark_variance * sum * sum;
    for (size_t j = 0; j < n; j++)
        sigma[j] = (float)sqrt(floor_variance + noise->shot * largest * fmax((double)total[j], 0));
}

void ls_separated_finish(const float *diffuse, const float *specular, const float *conductor,
                         const float *ratio, const double *tint, double scale, size_t n_px,
                         uint32_t n_channels, float *out)
{
    float by = (float)scale;
    for (size_t j = 0; j < n_px; j++)
        for (uint32_t c = 0; c < n_channels; c++) {
            size_t k = j * n_channels + c;
            float metal = conductor ? conductor[k] : 0;
            float of_material = diffuse[k] + metal, of_light = specular[k] - metal;
            if (ratio)
                out[k] += by * (ratio[k] * of_material + (float)tint[c] * of_light);
            else
                out[k] += by * (of_material + of_light);
        }
}

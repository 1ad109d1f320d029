#include "compare.h"

#include "core/half.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Small enough for what the block's pixels see to stay in the cache from light to light. */
enum { BLOCK_WIDTH = 4 * LS_TILE_SIDE, BLOCK_HEIGHT = LS_TILE_SIDE };

/* One block and the buffers for it. Planes of the pixels judged, of the window they need. */
struct block {
    struct ls_demosaic_region pixels, window;
    size_t n, n_window;
    bool has_samples;
    struct sim_sweep_region *truth;
    float *room;
    double *sums;
    float *mosaic;                                     /* [spectrum][window], true */
    float *stored, *specular;                          /* [window] */
    float *promoted;                                   /* [spectrum][pixels][colour] */
    float *rgb;                                        /* [pixels][colour], true in one spectrum */
    float *difference, *total;                         /* [pixels], squares of one light */
    double *difference_sum, *total_sum;                /* [pixels], of all lights */
    double *black_relit, *black_true, *black_variance; /* [pixels], mosaic */
};

static size_t area(const struct ls_demosaic_region *r)
{
    return (size_t)r->width * r->height;
}

static uint32_t blocks_x(const struct ls_field *f)
{
    return (f->width + BLOCK_WIDTH - 1) / BLOCK_WIDTH;
}

uint32_t judge_n_blocks(const struct ls_field *f)
{
    return blocks_x(f) * ((f->height + BLOCK_HEIGHT - 1) / BLOCK_HEIGHT);
}

/* The part of a tile's row that lies in [x0, x1), as floats. */
static void load_span(const struct ls_field *f, const struct ls_picture *picture, uint32_t x0,
                      uint32_t x1, uint32_t y, float *out)
{
    uint32_t tx = x0 / LS_TILE_SIDE, ty = y / LS_TILE_SIDE;
    uint32_t left = f->width - tx * LS_TILE_SIDE;
    uint32_t tile_width = left < LS_TILE_SIDE ? left : LS_TILE_SIDE;
    const uint8_t *tile = picture->tiles[ty * ls_field_tiles_x(f) + tx];
    uint16_t half[LS_TILE_SIDE] = {0};
    if (tile)
        memcpy(half, tile + 2 * ((y % LS_TILE_SIDE) * tile_width + x0 % LS_TILE_SIDE),
               2 * (x1 - x0));
    ls_half_to_floats(half, out, x1 - x0);
}

void judge_load(const struct ls_field *f, const struct ls_picture *picture,
                const struct ls_demosaic_region *window, float *out)
{
    uint32_t end = window->x + window->width;
    for (uint32_t y = window->y; y < window->y + window->height; y++)
        for (uint32_t x = window->x, stop; x < end; out += stop - x, x = stop) {
            stop = (x / LS_TILE_SIDE + 1) * LS_TILE_SIDE;
            stop = stop < end ? stop : end;
            load_span(f, picture, x, stop, y, out);
        }
}

static enum ls_err demosaic(const struct ls_field *f, const struct block *b, const float *mosaic,
                            float *rgb)
{
    const struct ls_demosaic_source source = {.data = mosaic,
                                              .stride = b->window.width,
                                              .window = b->window,
                                              .image_width = f->width,
                                              .image_height = f->height,
                                              .cfa = f->cfa};
    const struct ls_demosaic_target target = {
        {rgb, rgb + 1, rgb + 2}, JUDGE_COLOURS, (size_t)JUDGE_COLOURS * b->pixels.width};
    return ls_demosaic(&source, b->pixels, LS_DEMOSAIC_GRADIENT, &target);
}

/* What of a sample's rectangle lies in the block: 0 or its area. */
static size_t overlap(const struct block *b, const struct sim_sample *r,
                      struct ls_demosaic_region *out)
{
    const struct ls_demosaic_region *p = &b->pixels;
    uint32_t x0 = r->x > p->x ? r->x : p->x, y0 = r->y > p->y ? r->y : p->y;
    uint32_t x1 = r->x + r->width, y1 = r->y + r->height;
    x1 = x1 < p->x + p->width ? x1 : p->x + p->width;
    y1 = y1 < p->y + p->height ? y1 : p->y + p->height;
    if (x0 >= x1 || y0 >= y1)
        return 0;
    *out = (struct ls_demosaic_region){x0, y0, x1 - x0, y1 - y0};
    return area(out);
}

/* Pixel of the block, of its window. */
static size_t at(const struct block *b, uint32_t x, uint32_t y)
{
    return (size_t)(y - b->pixels.y) * b->pixels.width + (x - b->pixels.x);
}

static size_t at_window(const struct block *b, uint32_t x, uint32_t y)
{
    return (size_t)(y - b->window.y) * b->window.width + (x - b->window.x);
}

static const float *promoted_of(const struct block *b, uint32_t spectrum)
{
    return b->promoted + spectrum * JUDGE_COLOURS * b->n;
}

static void add_sample(const struct block *b, const struct ls_demosaic_region *r, uint32_t spectrum,
                       struct judge_sample_sum *sum)
{
    const float *promoted = promoted_of(b, spectrum);
    for (uint32_t y = r->y; y < r->y + r->height; y++)
        for (uint32_t x = r->x; x < r->x + r->width; x++)
            for (uint32_t c = 0; c < JUDGE_COLOURS; c++) {
                size_t j = JUDGE_COLOURS * at(b, x, y) + c;
                sum->promoted[c] += promoted[j];
                sum->truth[c] += b->rgb[j];
            }
}

static void add_samples(const struct judge_comparison *s, struct judge_tally *t,
                        const struct block *b, uint32_t light, uint32_t spectrum)
{
    struct ls_demosaic_region r;
    struct judge_sample_sum *sums =
        t->samples + ((size_t)light * s->field->n_spectra + spectrum) * SIM_SAMPLES;
    for (uint32_t k = 0; k < SIM_SAMPLES && b->has_samples; k++)
        if (overlap(b, &s->samples[k], &r))
            add_sample(b, &r, spectrum, &sums[k]);
}

static void add_difference(const struct block *b, uint32_t spectrum)
{
    const float *promoted = promoted_of(b, spectrum);
    for (size_t j = 0; j < b->n; j++)
        for (size_t k = JUDGE_COLOURS * j; k < JUDGE_COLOURS * (j + 1); k++) {
            float d = promoted[k] - b->rgb[k];
            b->difference[j] += d * d;
            b->total[j] += b->rgb[k] * b->rgb[k];
        }
}

static void add_ratio(struct judge_ratio_sum *sum, double difference, double truth)
{
    sum->difference += difference;
    sum->truth += truth;
}

/* One light's squares to the block's, and to the highlights'. */
static void close_light(struct judge_tally *t, const struct block *b)
{
    for (uint32_t y = 0; y < b->pixels.height; y++) {
        const float *specular = b->specular + at_window(b, b->pixels.x, b->pixels.y + y);
        for (uint32_t x = 0; x < b->pixels.width; x++) {
            size_t j = (size_t)y * b->pixels.width + x;
            b->difference_sum[j] += b->difference[j];
            b->total_sum[j] += b->total[j];
            if (specular[x] > 0.5f)
                add_ratio(&t->highlight, b->difference[j], b->total[j]);
        }
    }
}

static void close_block(const struct judge_comparison *s, struct judge_tally *t,
                        const struct block *b)
{
    for (uint32_t y = b->pixels.y; y < b->pixels.y + b->pixels.height; y++)
        for (uint32_t x = b->pixels.x; x < b->pixels.x + b->pixels.width; x++) {
            size_t j = at(b, x, y);
            add_ratio(&t->field, b->difference_sum[j], b->total_sum[j]);
            if (s->bounced[(size_t)y * s->field->width + x] > 0.2f)
                add_ratio(&t->interreflection, b->difference_sum[j], b->total_sum[j]);
            if (b->black_variance[j] <= 0)
                continue;
            t->black_difference +=
                (b->black_relit[j] - b->black_true[j]) / sqrt(b->black_variance[j]);
            t->black_pixels++;
        }
}

/*
 * Variance of a merged E from its own frames' noise, in (R / k)^2: 1 / sum t^2 / sigma^2 over the
 * exposures in range (or the longest), sigma^2 = read + shot + quantisation.
 */
static double frame_variance(const struct ls_take_facts *facts, double e_full_scale_per_s)
{
    const struct ls_calibration_camera *camera = &facts->calibration->camera;
    double information = 0;
    for (uint32_t i = 0; i < facts->n_exposures; i++) {
        double t = facts->exposure_s[i];
        double signal_dn = e_full_scale_per_s * t * facts->full_scale_dn;
        double raw = (signal_dn + camera->black_dn) / facts->full_scale_dn;
        bool longest = i + 1 == facts->n_exposures;
        bool in_range = raw >= camera->range_low && raw <= camera->range_high;
        if (!in_range && !(longest && information == 0))
            continue;
        double variance_dn = facts->read_noise_dn * facts->read_noise_dn + 1.0 / 12 +
                             fmax(signal_dn, 0) / facts->electrons_per_dn;
        information += t * t / variance_dn;
    }
    return 1 / (information * facts->full_scale_dn * facts->full_scale_dn);
}

/* The constant map of radiance 1 through channel W, on the mosaic. */
static void add_black(const struct judge_comparison *s, const struct block *b, uint32_t light)
{
    const struct ls_field *f = s->field;
    const struct ls_take_facts *facts = s->judge->source->facts;
    /* stored = E x reference: R = k scale stored, so R = gain E with E in full scale / s */
    double gain = f->k[light] * f->scale * facts->reference_exposure_s;
    double omega = f->omega_sr[light];
    struct ls_demosaic_region r;
    for (uint32_t k = 0; k < SIM_SAMPLES; k++) {
        if (strcmp(s->samples[k].group, "velvet") || !overlap(b, &s->samples[k], &r))
            continue;
        for (uint32_t y = r.y; y < r.y + r.height; y++)
            for (uint32_t x = r.x; x < r.x + r.width; x++) {
                size_t j = at(b, x, y), w = at_window(b, x, y);
                b->black_relit[j] += omega * b->stored[w];
                b->black_true[j] += omega * b->mosaic[w];
                b->black_variance[j] +=
                    omega * omega * gain * gain * frame_variance(facts, b->mosaic[w] / gain);
            }
    }
}

/* E of one light over the window, as R: k E scale. */
static void load_light(const struct ls_field *f, const struct block *b, uint32_t light)
{
    double gain = f->k[light] * f->scale;
    judge_load(f, &f->white[light], &b->window, b->stored);
    for (size_t j = 0; j < b->n_window; j++)
        b->stored[j] = (float)(gain * b->stored[j]);
}

static enum ls_err compare_light(const struct judge_comparison *s, struct judge_tally *t,
                                 struct block *b, uint32_t light, struct ls_diag *diag)
{
    const struct ls_field *f = s->field;
    sim_sweep_light(b->truth, light, b->mosaic, b->specular);
    load_light(f, b, light);
    add_black(s, b, light);
    memset(b->difference, 0, b->n * sizeof *b->difference);
    memset(b->total, 0, b->n * sizeof *b->total);
    enum ls_err err = judge_promoted(s, light, &b->pixels, b->promoted, diag);
    for (uint32_t k = b->has_samples ? 0 : 1; k < f->n_spectra && !err; k++) {
        err = demosaic(f, b, b->mosaic + k * b->n_window, b->rgb);
        if (err)
            return err;
        add_samples(s, t, b, light, k);
        if (k)
            add_difference(b, k);
    }
    close_light(t, b);
    return err;
}

static float *carve(float **from, size_t n)
{
    float *start = *from;
    *from += n;
    return start;
}

static enum ls_err allocate(const struct judge_comparison *s, struct block *b)
{
    size_t n = b->n, colour = JUDGE_COLOURS * n, spectra = s->field->n_spectra;
    b->room = calloc((spectra + 2) * b->n_window + (spectra + 1) * colour + 2 * n, sizeof *b->room);
    b->sums = calloc(5 * n, sizeof *b->sums);
    if (!b->room || !b->sums)
        return LS_ERR_NOMEM;
    float *room = b->room;
    b->mosaic = carve(&room, spectra * b->n_window);
    b->stored = carve(&room, b->n_window);
    b->specular = carve(&room, b->n_window);
    b->promoted = carve(&room, spectra * colour);
    b->rgb = carve(&room, colour);
    b->difference = carve(&room, n);
    b->total = carve(&room, n);
    b->difference_sum = b->sums;
    b->total_sum = b->sums + n;
    b->black_relit = b->sums + 2 * n;
    b->black_true = b->sums + 3 * n;
    b->black_variance = b->sums + 4 * n;
    return LS_OK;
}

static enum ls_err open_block(const struct judge_comparison *s, uint32_t index, struct block *b,
                              struct ls_diag *diag)
{
    const struct ls_field *f = s->field;
    uint32_t x = index % blocks_x(f) * BLOCK_WIDTH, y = index / blocks_x(f) * BLOCK_HEIGHT;
    uint32_t width = f->width - x < BLOCK_WIDTH ? f->width - x : BLOCK_WIDTH;
    uint32_t height = f->height - y < BLOCK_HEIGHT ? f->height - y : BLOCK_HEIGHT;
    *b = (struct block){.pixels = {x, y, width, height}};
    b->window = ls_demosaic_needs(b->pixels, f->width, f->height);
    b->n = area(&b->pixels);
    b->n_window = area(&b->window);
    struct ls_demosaic_region r;
    for (uint32_t k = 0; k < SIM_SAMPLES; k++)
        b->has_samples |= overlap(b, &s->samples[k], &r) > 0;
    enum ls_err err = allocate(s, b);
    if (err)
        return ls_fail(diag, err, "out of memory for a block of %u x %u pixels", width, height);
    const struct sim_region window = {s->judge->source->camera, b->window.x, b->window.y,
                                      b->window.width, b->window.height};
    return sim_sweep_open(s->truth, &window, &b->truth, diag);
}

static void free_block(struct block *b)
{
    sim_sweep_close(b->truth);
    free(b->room);
    free(b->sums);
}

enum ls_err judge_compare_block(const struct judge_comparison *s, uint32_t index,
                                struct judge_tally *tally, struct ls_diag *diag)
{
    struct block b;
    enum ls_err err = open_block(s, index, &b, diag);
    for (uint32_t i = 0; i < s->field->n_lights && !err; i++)
        err = compare_light(s, tally, &b, i, diag);
    if (!err)
        close_block(s, tally, &b);
    free_block(&b);
    return err;
}

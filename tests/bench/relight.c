#include "tests/bench/relight.h"

#include "tests/bench/bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HALO = LS_DEMOSAIC_HALO, KEPT = 2 * HALO, WINDOW_ROWS = LS_TILE_SIDE + KEPT };

/* Rows of one thread. */
struct share {
    struct bench_relight *r;
    unsigned thread, n;
    uint32_t y0, y1; /* px */
    float *window;   /* [n_sums][WINDOW_ROWS][width] */
    struct ls_accumulate_report report;
};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err) {
        fprintf(stderr, "%s\n", diag->text);
        exit(1);
    }
}

static uint32_t first_tile_row(const struct bench_relight *r, unsigned thread, unsigned n)
{
    return ls_field_tiles_y(r->field) * thread / n;
}

/* Rows [y0, y1) of the picture from sums of rows [window_y, ...) that lie @stride apart. */
static void finish_rows(const struct bench_relight *r, const float *sums, size_t stride,
                        uint32_t window_y, uint32_t window_rows, uint32_t y0, uint32_t y1)
{
    struct ls_relight_term terms[BENCH_MAX_TERMS];
    struct ls_diag diag = {""};
    uint32_t width = r->field->width;
    for (uint32_t q = 0; q < r->n_sums; q++)
        terms[q] = (struct ls_relight_term){
            .sum = sums + q * stride,
            .ratio = r->ratio[q] ? r->ratio[q] + (size_t)y0 * width * 3 : NULL,
            .matrix = r->matrix[q] ? r->matrix[q] + (size_t)y0 * width * 9 : NULL,
            .channel = -1};
    must(ls_relight_finish(r->field, (struct ls_demosaic_region){0, window_y, width, window_rows},
                           (struct ls_demosaic_region){0, y0, width, y1 - y0}, terms, r->n_sums,
                           NULL, r->out + (size_t)y0 * width * 3, &diag),
         &diag);
}

/* the rows beside the seam after @thread - 1: four from above, four from below */
static void keep_for_seam(struct share *s, unsigned seam, int below, uint32_t row)
{
    size_t width = s->r->field->width;
    for (uint32_t q = 0; q < s->r->n_sums; q++)
        memcpy(s->r->seam[seam] + (q * 2 * KEPT + (below ? KEPT : 0)) * width,
               s->window + (q * WINDOW_ROWS + row) * width, KEPT * width * sizeof(float));
}

static void sum_tile_row(struct share *s, uint32_t tile_row)
{
    const struct bench_relight *r = s->r;
    size_t width = r->field->width;
    struct ls_diag diag = {""};
    struct ls_accumulate_job job = {.pictures = r->field->white,
                                    .n_pictures = r->field->n_lights,
                                    .n_sums = r->n_sums,
                                    .weights = r->weights,
                                    .sum_stride = WINDOW_ROWS * width,
                                    .tile_max = r->tile_max,
                                    .max_error = r->max_error};
    struct ls_accumulate_report report;
    struct ls_tile_region tiles = {0, tile_row, ls_field_tiles_x(r->field), tile_row + 1};
    must(ls_accumulate_with(r->kernels, r->field, &job, &tiles, s->window + KEPT * width, &report,
                            &diag),
         &diag);
    s->report.bound = fmax(s->report.bound, report.bound);
    s->report.tiles_read += report.tiles_read;
    s->report.tiles_skipped += report.tiles_skipped;
}

static void roll(struct share *s, uint32_t rows)
{
    size_t width = s->r->field->width;
    for (uint32_t q = 0; q < s->r->n_sums; q++) {
        float *sum = s->window + q * WINDOW_ROWS * width;
        memcpy(sum, sum + rows * width, KEPT * width * sizeof *sum);
    }
}

static void finish_tile_row(struct share *s, uint32_t y, uint32_t rows)
{
    const struct bench_relight *r = s->r;
    bool first = y == s->y0, last = y + rows == s->y1;
    uint32_t kept = first ? 0 : KEPT;
    uint32_t from = first ? (s->thread > 0 ? y + HALO : y) : y - HALO;
    uint32_t to = last && s->thread + 1 == s->n ? y + rows : y + rows - HALO;
    finish_rows(r, s->window + (size_t)(KEPT - kept) * r->field->width,
                (size_t)WINDOW_ROWS * r->field->width, y - kept, rows + kept, from, to);
    if (first && s->thread > 0)
        keep_for_seam(s, s->thread, 1, KEPT);
    if (last && s->thread + 1 < s->n)
        keep_for_seam(s, s->thread + 1, 0, rows);
}

static void run_share(void *data, unsigned thread, unsigned n)
{
    struct bench_relight *r = data;
    uint32_t height = r->field->height;
    uint32_t t0 = first_tile_row(r, thread, n), t1 = first_tile_row(r, thread + 1, n);
    struct share s = {r, thread, n, t0 * LS_TILE_SIDE, t1 * LS_TILE_SIDE, r->window[thread], {0}};
    s.y1 = s.y1 < height ? s.y1 : height;
    for (uint32_t t = t0; t < t1; t++) {
        uint32_t y = t * LS_TILE_SIDE, rows = s.y1 - y < LS_TILE_SIDE ? s.y1 - y : LS_TILE_SIDE;
        sum_tile_row(&s, t);
        if (r->out)
            finish_tile_row(&s, y, rows);
        roll(&s, rows);
    }
    r->report[thread] = s.report;
    if (thread == 0)
        r->anonymous_mib = fmax(r->anonymous_mib, bench_anonymous_mib());
}

void bench_relight_init(struct bench_relight *r)
{
    size_t row = r->n_sums * (size_t)r->field->width * sizeof(float);
    for (unsigned t = 0; t < r->n_threads; t++) {
        r->window[t] = bench_alloc(WINDOW_ROWS * row);
        r->seam[t] = bench_alloc(2 * KEPT * row);
    }
}

void bench_relight_finish(struct bench_relight *r)
{
    for (unsigned t = 0; t < r->n_threads; t++) {
        free(r->window[t]);
        free(r->seam[t]);
    }
}

struct ls_accumulate_report bench_relight_report(const struct bench_relight *r)
{
    struct ls_accumulate_report all = {0};
    for (unsigned t = 0; t < r->n_threads; t++) {
        all.bound = fmax(all.bound, r->report[t].bound);
        all.tiles_read += r->report[t].tiles_read;
        all.tiles_skipped += r->report[t].tiles_skipped;
    }
    return all;
}

void bench_relight(void *data)
{
    struct bench_relight *r = data;
    size_t width = r->field->width;
    bench_parallel(r->n_threads, run_share, r);
    for (unsigned t = 1; t < r->n_threads && r->out; t++) {
        uint32_t y = first_tile_row(r, t, r->n_threads) * LS_TILE_SIDE;
        finish_rows(r, r->seam[t], 2 * KEPT * width, y - KEPT, 2 * KEPT, y - HALO, y + HALO);
    }
}

#include "tests/bench/relight.h"

#include "daemon/row_sums.h"
#include "tests/bench/bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { HALO = LS_DEMOSAIC_HALO, PIECE_ROWS = 16 };

/* Rows that are finished together. */
struct band {
    const struct bench_relight *r;
    const struct ls_relight_rows *rows;
    uint32_t y, end;
};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err) {
        fprintf(stderr, "%s\n", diag->text);
        exit(1);
    }
}

static enum ls_err finish_piece(void *data, uint32_t piece, unsigned thread, struct ls_diag *diag)
{
    const struct band *band = data;
    const struct bench_relight *r = band->r;
    struct ls_relight_term terms[BENCH_MAX_TERMS];
    uint32_t width = r->field->width, y = band->y + piece * PIECE_ROWS, left = band->end - y;
    struct ls_demosaic_region part = {0, y, width, left < PIECE_ROWS ? left : PIECE_ROWS};
    size_t at = (size_t)y * width;
    for (uint32_t q = 0; q < r->n_sums; q++)
        terms[q] = (struct ls_relight_term){.sum = ls_relight_rows_get(band->rows, q),
                                            .ratio = r->ratio[q] ? r->ratio[q] + at * 3 : NULL,
                                            .matrix = r->matrix[q] ? r->matrix[q] + at * 9 : NULL,
                                            .channel = -1};
    return ls_relight_finish(r->field, band->rows->window, part, terms, r->n_sums, NULL,
                             r->out + at * 3, diag);
}

void bench_relight(void *data)
{
    struct bench_relight *r = data;
    const struct ls_demosaic_region whole = {0, 0, r->field->width, r->field->height};
    const struct ls_crew crew = {.n_threads = r->n_threads};
    const struct ls_accumulate_job job = {.pictures = r->field->white,
                                          .n_pictures = r->field->n_lights,
                                          .n_sums = r->n_sums,
                                          .weights = r->weights,
                                          .tile_max = r->tile_max,
                                          .max_error = r->max_error};
    struct ls_relight_rows rows;
    struct ls_diag diag = {""};
    ls_relight_rows_init(&rows, r->field, &job, &whole, HALO);
    uint32_t tile_rows = ls_relight_tile_rows(whole.width, r->n_sums + 3);
    for (uint32_t y = 0, end; y < whole.height; y = end) {
        end = ls_relight_band_end(r->field, &whole, y, HALO, tile_rows);
        struct band band = {r, &rows, y, end};
        must(ls_row_sums_need(&rows, &crew, y > HALO ? y - HALO : 0,
                              whole.height - end > HALO ? end + HALO : whole.height, &diag),
             &diag);
        if (r->out)
            must(ls_crew_run(&crew, (end - y + PIECE_ROWS - 1) / PIECE_ROWS, finish_piece, &band,
                             &diag),
                 &diag);
    }
    r->anonymous_mib = fmax(r->anonymous_mib, bench_anonymous_mib());
    r->report = rows.report;
    ls_relight_rows_finish(&rows);
}

#include "daemon/row_sums.h"

/* More shares than threads: who is done early takes another. */
enum { SHARES_EACH = 2, MAX_SHARES = SHARES_EACH * LS_CREW_MAX_THREADS };

struct tile_row {
    const struct ls_relight_rows *rows;
    uint32_t n_shares;
    struct ls_accumulate_report report[MAX_SHARES];
};

static enum ls_err sum_share(void *data, uint32_t share, unsigned thread, struct ls_diag *diag)
{
    struct tile_row *row = data;
    return ls_relight_rows_sum(row->rows, share, row->n_shares, &row->report[share], diag);
}

static uint32_t count_shares(const struct ls_crew *crew)
{
    unsigned n = crew->n_threads < LS_CREW_MAX_THREADS ? crew->n_threads : LS_CREW_MAX_THREADS;
    return n > 1 ? n * SHARES_EACH : 1;
}

enum ls_err ls_row_sums_next(struct ls_relight_rows *rows, const struct ls_crew *crew, uint32_t y0,
                             struct ls_diag *diag)
{
    struct tile_row row = {.rows = rows, .n_shares = count_shares(crew)};
    enum ls_err err = ls_relight_rows_roll(rows, y0, diag);
    if (!err)
        err = ls_crew_run(crew, row.n_shares, sum_share, &row, diag);
    if (!err)
        ls_relight_rows_add(rows, row.report, row.n_shares);
    return err;
}

enum ls_err ls_row_sums_need(struct ls_relight_rows *rows, const struct ls_crew *crew, uint32_t y0,
                             uint32_t y1, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    while (!err && rows->window.y + rows->window.height < y1)
        err = ls_row_sums_next(rows, crew, y0, diag);
    return err;
}

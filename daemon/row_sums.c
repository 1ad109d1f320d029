#include "daemon/row_sums.h"

/* More shares than threads: who is done early takes another. */
enum { SHARES_EACH = 8, MAX_SHARES = SHARES_EACH * LS_CREW_MAX_THREADS };

struct tile_rows {
    const struct ls_relight_rows *rows;
    uint32_t n_shares;
    struct ls_accumulate_report report[MAX_SHARES];
};

static enum ls_err sum_share(void *data, uint32_t share, unsigned thread, struct ls_diag *diag)
{
    struct tile_rows *some = data;
    return ls_relight_rows_sum(some->rows, share, some->n_shares, &some->report[share], diag);
}

static uint32_t count_shares(const struct ls_crew *crew)
{
    unsigned n = crew->n_threads < LS_CREW_MAX_THREADS ? crew->n_threads : LS_CREW_MAX_THREADS;
    return n > 1 ? n * SHARES_EACH : 1;
}

enum ls_err ls_row_sums_need(struct ls_relight_rows *rows, const struct ls_crew *crew, uint32_t y0,
                             uint32_t y1, struct ls_diag *diag)
{
    struct tile_rows some = {.rows = rows, .n_shares = count_shares(crew)};
    if (rows->window.y + rows->window.height >= y1)
        return LS_OK;
    enum ls_err err = ls_relight_rows_roll(rows, y0, y1, diag);
    if (!err)
        err = ls_crew_run(crew, some.n_shares, sum_share, &some, diag);
    if (!err)
        ls_relight_rows_add(rows, some.report, some.n_shares);
    return err;
}

#include "core/exr_rows.h"

#include "core/exr_part.h"

#include <stdlib.h>
#include <string.h>

struct ls_exr_rows {
    ls_exr_put *put;
    void *user;
    exr_context_t context;
    struct ls_exr_channel channels[3];
    struct ls_exr_part part;
    int index;
    float *rows;         /* [64][width][n_channels] */
    uint8_t *tile;       /* one, packed */
    uint32_t n, written; /* rows there, and rows in the file */
    bool refused;        /* by put */
};

static int64_t write_at(exr_const_context_t context, void *user, const void *buffer, uint64_t n,
                        uint64_t offset, exr_stream_error_func_ptr_t error)
{
    struct ls_exr_rows *rows = user;
    if (!rows->refused && !rows->put(rows->user, buffer, n, offset))
        rows->refused = true;
    return rows->refused ? -1 : (int64_t)n;
}

static enum ls_err result(const struct ls_exr_rows *rows, exr_result_t r, struct ls_diag *diag)
{
    if (!r && !rows->refused)
        return LS_OK;
    return ls_fail(diag, r == EXR_ERR_OUT_OF_MEMORY ? LS_ERR_NOMEM : LS_ERR_INVALID,
                   "OpenEXR: cannot write: %s",
                   rows->refused ? "the file does not take it" : exr_get_default_error_message(r));
}

static void describe(const struct ls_exr_rows_of *of, struct ls_exr_rows *rows)
{
    static const char *const names[2][3] = {{"Y"}, {"R", "G", "B"}};
    for (uint32_t c = 0; c < of->n_channels; c++)
        rows->channels[c] = (struct ls_exr_channel){
            .name = names[of->n_channels == 3][c],
            .type = of->type,
            .source = LS_EXR_FROM_FLOAT,
            .pixels = rows->rows + c,
            .pixel_stride_bytes = of->n_channels * sizeof(float),
            .row_stride_bytes = (size_t)of->width * of->n_channels * sizeof(float)};
    rows->part = (struct ls_exr_part){.width = of->width,
                                      .height = of->height,
                                      .x = of->x,
                                      .y = of->y,
                                      .display_width = of->display_width,
                                      .display_height = of->display_height,
                                      .channels = rows->channels,
                                      .n_channels = of->n_channels,
                                      .attrs = of->attrs};
}

static enum ls_err start(struct ls_exr_rows *rows, struct ls_diag *diag)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = ls_exr_part_quiet;
    init.user_data = rows;
    init.write_fn = write_at;
    init.max_image_width = init.max_image_height = LS_EXR_MAX_PX;
    init.max_tile_width = init.max_tile_height = LS_EXR_MAX_PX;
    exr_result_t r = exr_start_write(&rows->context, "picture", EXR_WRITE_FILE_DIRECTLY, &init);
    if (!r)
        r = ls_exr_part_declare(rows->context, &rows->part, &rows->index);
    if (!r)
        r = exr_write_header(rows->context);
    rows->part.attrs = NULL;
    return result(rows, r, diag);
}

enum ls_err ls_exr_rows_begin(const struct ls_exr_rows_of *of, struct ls_exr_rows **out,
                              struct ls_diag *diag)
{
    if (of->n_channels != 1 && of->n_channels != 3)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a picture of %u channels: expected 1 or 3",
                       of->n_channels);
    if (of->width > LS_EXR_MAX_PX)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a picture %u px wide: expected at most %d",
                       of->width, LS_EXR_MAX_PX);
    struct ls_exr_rows *rows = calloc(1, sizeof *rows);
    if (!rows)
        return ls_fail(diag, LS_ERR_NOMEM, "OpenEXR: no memory");
    rows->put = of->put;
    rows->user = of->user;
    rows->rows = calloc((size_t)LS_EXR_TILE_PX * of->width * of->n_channels + 1, sizeof(float));
    if (rows->rows)
        describe(of, rows);
    rows->tile = malloc(LS_EXR_TILE_PX * LS_EXR_TILE_PX * ls_exr_part_pixel_bytes(&rows->part));
    enum ls_err err =
        rows->rows && rows->tile ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "OpenEXR: no memory");
    if (!err)
        err = ls_exr_part_check(&rows->part, 1, diag);
    if (!err)
        err = start(rows, diag);
    if (err) {
        ls_exr_rows_destroy(rows);
        return err;
    }
    *out = rows;
    return LS_OK;
}

/* The rows that wait make a row of tiles. */
static enum ls_err write_rows(struct ls_exr_rows *rows, struct ls_diag *diag)
{
    exr_result_t r = ls_exr_part_write_row(rows->context, rows->index, &rows->part, rows->written,
                                           rows->written, rows->tile);
    rows->written = rows->n;
    return result(rows, r, diag);
}

enum ls_err ls_exr_rows_add(struct ls_exr_rows *rows, const float *pixels, uint32_t n_rows,
                            struct ls_diag *diag)
{
    size_t row = rows->part.width * rows->part.n_channels;
    enum ls_err err = LS_OK;
    if (n_rows > rows->part.height - rows->n)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: %u rows more than the picture has",
                       n_rows - (rows->part.height - rows->n));
    for (uint32_t k = 0; k < n_rows && !err; k++, pixels += row) {
        memcpy(rows->rows + (rows->n - rows->written) * row, pixels, row * sizeof *pixels);
        rows->n++;
        if (rows->n - rows->written == LS_EXR_TILE_PX || rows->n == rows->part.height)
            err = write_rows(rows, diag);
    }
    return err;
}

enum ls_err ls_exr_rows_end(struct ls_exr_rows *rows, struct ls_diag *diag)
{
    if (rows->n < rows->part.height)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: %u of %u rows are missing",
                       rows->part.height - rows->n, rows->part.height);
    return result(rows, exr_finish(&rows->context), diag);
}

void ls_exr_rows_destroy(struct ls_exr_rows *rows)
{
    if (!rows)
        return;
    if (rows->context)
        exr_finish(&rows->context);
    free(rows->rows);
    free(rows->tile);
    free(rows);
}

#include "core/picture_sums.h"

#include "core/half.h"
#include "core/merge.h"

#include <math.h>
#include <stdlib.h>

enum {
    FAR_OFF = 8, /* medians of what is left: five sigma of noise */
    ROUNDS = 8,
};

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* Of pixels [x, end) of a row, by the parity of x. */
struct block_sum {
    double sum[2];
    bool bad[2];
    uint32_t n_saturated;
};

static bool are_ok(const uint8_t *validity, uint32_t n)
{
    uint8_t any = LS_VALIDITY_OK;
    for (uint32_t k = 0; k < n; k++)
        any |= validity[k];
    return any == LS_VALIDITY_OK;
}

/* Halves have 40 bits between the smallest and the largest: doubles hold sums of thousands exactly,
 * in any order. False: something is not finite. */
static bool add_plain(const float *row, uint32_t x, uint32_t end, struct block_sum *out)
{
    double sum[4] = {0};
    uint32_t at = x;
    for (; at + 4 <= end; at += 4)
        for (int k = 0; k < 4; k++)
            sum[k] += (double)row[at + k];
    for (; at < end; at++)
        sum[(at - x) & 1] += (double)row[at];
    *out = (struct block_sum){0};
    out->sum[x & 1] = sum[0] + sum[2];
    out->sum[~x & 1] = sum[1] + sum[3];
    return isfinite(sum[0] + sum[1] + sum[2] + sum[3]);
}

static void add_checked(const float *row, const uint8_t *validity, uint32_t x, uint32_t end,
                        struct block_sum *out)
{
    *out = (struct block_sum){0};
    for (; x < end; x++) {
        uint8_t v = validity ? validity[x] : LS_VALIDITY_OK;
        bool saturated = v == LS_VALIDITY_SATURATED || !isfinite(row[x]);
        out->bad[x & 1] |= saturated || v == LS_VALIDITY_GAP;
        out->sum[x & 1] += saturated ? 0 : (double)row[x];
        out->n_saturated += saturated;
    }
}

static void add_row(const struct ls_picture_view *p, uint32_t y, const float *row, uint32_t columns,
                    uint32_t first_block, struct ls_picture_sums *out)
{
    const uint8_t *validity = p->validity ? p->validity + (size_t)y * p->width : NULL;
    uint32_t colour[2] = {ls_cfa_channel(p->cfa, 0, y), ls_cfa_channel(p->cfa, 1, y)};
    for (uint32_t block = 0; block < columns; block++) {
        uint32_t x = (uint32_t)((uint64_t)p->width * block / columns);
        uint32_t end = (uint32_t)((uint64_t)p->width * (block + 1) / columns);
        struct block_sum s;
        if ((validity && !are_ok(validity + x, end - x)) || !add_plain(row, x, end, &s))
            add_checked(row, validity, x, end, &s);
        for (int k = 0; k < 2; k++) {
            float *to = &out->sum[colour[k] * out->n_blocks + first_block + block];
            *to = s.bad[k] ? NAN : *to + (float)s.sum[k];
            out->total[colour[k]] += s.sum[k];
        }
        out->n_saturated += s.n_saturated;
    }
    out->n_px += p->width;
}

enum ls_err ls_picture_sums_make(const struct ls_picture_view *p, uint32_t every,
                                 struct ls_picture_sums *out, struct ls_diag *diag)
{
    if (!p->width || !p->height || !every)
        return ls_fail(diag, LS_ERR_INVALID, "a picture without pixels cannot be added up");
    uint32_t columns = least(p->width, LS_SUMS_GRID), rows = least(p->height, LS_SUMS_GRID);
    *out = (struct ls_picture_sums){.n_colours = p->cfa == LS_CFA_NONE ? 1 : LS_SUMS_COLOURS,
                                    .n_blocks = columns * rows};
    out->sum = calloc((size_t)out->n_colours * out->n_blocks, sizeof *out->sum);
    LS_CLEANUP_FREE float *row = malloc(p->width * sizeof *row);
    if (!out->sum || !row) {
        ls_picture_sums_finish(out);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the sums of a picture");
    }
    for (uint32_t y = 0; y < p->height; y++) {
        if (y / 2 % every)
            continue;
        ls_half_to_floats(p->half + (size_t)y * p->width, row, p->width);
        add_row(p, y, row, columns, (uint32_t)((uint64_t)y * rows / p->height) * columns, out);
    }
    return LS_OK;
}

void ls_picture_sums_finish(struct ls_picture_sums *sums)
{
    free(sums->sum);
    *sums = (struct ls_picture_sums){0};
}

static int by_value(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Blocks that both pictures can be trusted in, side by side. */
static uint32_t pair_up(const struct ls_picture_sums *first, const struct ls_picture_sums *now,
                        uint32_t colour, float (*pairs)[2])
{
    const float *a = first->sum + (size_t)colour * first->n_blocks;
    const float *b = now->sum + (size_t)colour * now->n_blocks;
    uint32_t n = 0;
    for (uint32_t i = 0; i < first->n_blocks; i++) {
        if (isnan(a[i]) || isnan(b[i]))
            continue;
        pairs[n][0] = a[i];
        pairs[n++][1] = b[i];
    }
    return n;
}

static bool compare(float (*pairs)[2], uint32_t n, struct ls_light_drift *out)
{
    double sum_a = 0, sum_b = 0, squares = 0;
    for (uint32_t i = 0; i < n; i++) {
        sum_a += (double)pairs[i][0];
        sum_b += (double)pairs[i][1];
    }
    if (n < 2 || !(sum_a > 0))
        return false;
    for (uint32_t i = 0; i < n; i++) {
        double rest = (double)pairs[i][1] - sum_b / sum_a * (double)pairs[i][0];
        squares += rest * rest;
    }
    *out = (struct ls_light_drift){sum_b / sum_a - 1, sqrt(squares * n / (n - 1)) / sum_a};
    return true;
}

/* Without the blocks that are far off what @drift makes of the others. */
static uint32_t drop_outliers(float (*pairs)[2], uint32_t n, const struct ls_light_drift *drift)
{
    float rest[LS_SUMS_GRID * LS_SUMS_GRID];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++)
        rest[i] = fabsf(pairs[i][1] - (float)(1 + drift->change) * pairs[i][0]);
    qsort(rest, n, sizeof *rest, by_value);
    float limit = FAR_OFF * rest[n / 2];
    for (uint32_t i = 0; i < n; i++) {
        if (fabsf(pairs[i][1] - (float)(1 + drift->change) * pairs[i][0]) > limit)
            continue;
        pairs[kept][0] = pairs[i][0];
        pairs[kept++][1] = pairs[i][1];
    }
    return kept;
}

bool ls_picture_drift(const struct ls_picture_sums *first, const struct ls_picture_sums *now,
                      uint32_t colour, struct ls_light_drift *out)
{
    float pairs[LS_SUMS_GRID * LS_SUMS_GRID][2];
    if (first->n_blocks != now->n_blocks || first->n_colours != now->n_colours ||
        colour >= first->n_colours)
        return false;
    uint32_t n = pair_up(first, now, colour, pairs);
    bool known = compare(pairs, n, out);
    for (int round = 0; known && round < ROUNDS; round++) {
        uint32_t kept = drop_outliers(pairs, n, out);
        if (kept == n)
            break;
        n = kept;
        known = compare(pairs, n, out);
    }
    return known;
}

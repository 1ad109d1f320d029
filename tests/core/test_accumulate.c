#include "core/relight.h"

#include "core/accumulate_kernels.h"
#include "core/half.h"
#include "tests/core/isas.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/** Pictures in tiles that end where readable memory ends. */
struct pictures {
    struct ls_field field;
    struct ls_picture *picture;
    const void ***tiles; /* [n][tiles] */
    float *value;        /* [n][height][width], as stored */
    uint32_t n;
};

/* @bytes readable bytes with nothing readable behind them, nor before their first page; odd sizes
 * start unaligned */
static uint8_t *guarded(size_t bytes)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), whole = (bytes + page - 1) / page * page;
    uint8_t *base =
        mmap(NULL, whole + 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    g_assert_true(base != MAP_FAILED);
    g_assert_cmpint(mprotect(base, page, PROT_NONE), ==, 0);
    g_assert_cmpint(mprotect(base + page + whole, page, PROT_NONE), ==, 0);
    return base + page + whole - bytes;
}

static void guarded_free(const void *tile, size_t bytes)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), whole = (bytes + page - 1) / page * page;
    g_assert_cmpint(munmap((uint8_t *)tile - (whole - bytes) - page, whole + 2 * page), ==, 0);
}

static size_t tile_bytes(const struct ls_field *field, uint32_t tx, uint32_t ty)
{
    struct ls_tile_region one = {tx, ty, tx + 1, ty + 1};
    return 2 * (size_t)ls_region_width_px(field, &one) * ls_region_height_px(field, &one);
}

static void pictures_init(struct pictures *p, uint32_t n, uint32_t width, uint32_t height,
                          GRand *rand)
{
    *p = (struct pictures){.n = n, .field = {.width = width, .height = height}};
    uint32_t tx_n = ls_field_tiles_x(&p->field), ty_n = ls_field_tiles_y(&p->field);
    p->picture = g_new0(struct ls_picture, n);
    p->tiles = g_new0(const void **, n);
    p->value = g_new(float, (size_t)n *width *height);
    for (uint32_t i = 0; i < n; i++) {
        p->tiles[i] = g_new0(const void *, tx_n *ty_n);
        p->picture[i].tiles = p->tiles[i];
        for (uint32_t ty = 0; ty < ty_n; ty++)
            for (uint32_t tx = 0; tx < tx_n; tx++) {
                uint8_t *tile = guarded(tile_bytes(&p->field, tx, ty));
                p->tiles[i][ty * tx_n + tx] = tile;
                for (uint32_t y = ty * 64; y < MIN(height, ty * 64 + 64); y++)
                    for (uint32_t x = tx * 64; x < MIN(width, tx * 64 + 64); x++) {
                        double v = g_rand_double_range(rand, -0.1, 1);
                        uint16_t half = ls_half_from_float((float)(x % 7 ? v : v * 1e-7));
                        memcpy(tile, &half, 2);
                        tile += 2;
                        p->value[((size_t)i * height + y) * width + x] = ls_half_to_float(half);
                    }
            }
    }
}

static void pictures_finish(struct pictures *p)
{
    uint32_t tx_n = ls_field_tiles_x(&p->field), ty_n = ls_field_tiles_y(&p->field);
    for (uint32_t i = 0; i < p->n; i++) {
        for (uint32_t t = 0; t < tx_n * ty_n; t++)
            if (p->tiles[i][t])
                guarded_free(p->tiles[i][t], tile_bytes(&p->field, t % tx_n, t / tx_n));
        g_free(p->tiles[i]);
    }
    g_free(p->tiles);
    g_free(p->picture);
    g_free(p->value);
}

static struct ls_tile_region whole(const struct ls_field *field)
{
    return (struct ls_tile_region){0, 0, ls_field_tiles_x(field), ls_field_tiles_y(field)};
}

static float *weights(uint32_t n_sums, uint32_t n, GRand *rand)
{
    float *w = g_new(float, (size_t)n_sums *n);
    for (uint32_t k = 0; k < n_sums * n; k++)
        w[k] = k / n % 3 == 0   ? (float)g_rand_double_range(rand, 0, 1)
               : k / n % 3 == 1 ? (k % 2 ? 1e4f : -1e4f)
                                : (float)(g_rand_double(rand) * 1e-3) * (float)(k % 5 == 0);
    return w;
}

static void test_sums_are_within_the_stated_bound(const void *data)
{
    static const struct {
        uint32_t n, width, height, sums;
    } c[] = {{1, 1, 1, 1},    {12, 63, 65, 3}, {346, 65, 3, 16},
             {346, 3, 65, 6}, {9, 130, 70, 2}, {8, 7, 64, 40}};
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    double worst = 0;
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < G_N_ELEMENTS(c); k++) {
        struct pictures p;
        pictures_init(&p, c[k].n, c[k].width, c[k].height, rand);
        size_t px = (size_t)c[k].width * c[k].height;
        g_autofree float *w = weights(c[k].sums, c[k].n, rand);
        g_autofree float *sums = g_new(float, c[k].sums *px);
        struct ls_accumulate_job job = {
            .pictures = p.picture, .n_pictures = c[k].n, .n_sums = c[k].sums, .weights = w};
        struct ls_tile_region all = whole(&p.field);
        struct ls_accumulate_report report;
        g_assert_cmpint(ls_accumulate_with(ls_accumulate_kernels(isas_of(data)), &p.field, &job,
                                           &all, sums, &report, NULL),
                        ==, LS_OK);
        g_assert_cmpfloat(report.bound, ==, 0);
        g_assert_cmpuint(report.not_finite, ==, 0);
        for (uint32_t q = 0; q < c[k].sums; q++)
            for (size_t j = 0; j < px; j++) {
                long double sum = 0, size = 0;
                for (uint32_t i = 0; i < c[k].n; i++) {
                    long double term = (long double)w[q * c[k].n + i] * p.value[i * px + j];
                    sum += term;
                    size += fabsl(term);
                }
                double steps = MIN(c[k].n, 8) + ceil(c[k].n / 8.0);
                double bound = steps * 0x1p-24 * (double)size;
                double error = fabs((double)(sums[q * px + j] - sum));
                /* products below the smallest normal float round absolutely */
                g_assert_cmpfloat(error, <=, bound + c[k].n * 0x1p-149);
                worst = fmax(worst, bound > 0 ? error / bound : 0);
            }
        pictures_finish(&p);
    }
    g_test_message("largest error: %.3f of the bound", worst);
}

/* What the header says, one operation after the other. */
static unsigned sum_plainly(const uint16_t *const *e, const float *const *w, uint32_t n,
                            uint32_t first, uint32_t count, uint32_t n_sums, float *acc,
                            size_t stride)
{
    unsigned not_finite = 0;
    for (uint32_t q = 0; q < n_sums; q++)
        for (uint32_t j = 0; j < count; j++) {
            float part = 0, sum = 0;
            for (uint32_t i = 0; i < n; i++) {
                uint16_t bits;
                memcpy(&bits, (const char *)e[i] + 2 * ((size_t)first + j), 2);
                gboolean finite = (bits & 0x7c00) != 0x7c00;
                not_finite += q == 0 && !finite;
                part = fmaf(w[i][q], finite ? ls_half_to_float(bits) : 0, i % 8 ? part : 0);
                if (i % 8 == 7 || i + 1 == n)
                    sum += part;
            }
            acc[q * stride + j] = sum;
        }
    return not_finite;
}

enum { KINDS = 6 };

static uint16_t sample(GRand *rand, int kind)
{
    switch (kind) {
    case 0: /* zero, of either sign */
        return g_rand_boolean(rand) ? 0x8000 : 0;
    case 1: /* saturated and just below */
        return (uint16_t)(0x7bff - g_rand_int_range(rand, 0, 3));
    case 2: /* denormal */
        return (uint16_t)g_rand_int_range(rand, 0, 0x400);
    case 3: /* one Inf or NaN in a hundred */
        return g_rand_int_range(rand, 0, 100) ? 0x3c00 : (uint16_t)(0x7c00 | g_rand_int(rand));
    case 4: /* every half there is */
        return (uint16_t)g_rand_int(rand);
    default:
        return (uint16_t)g_rand_int_range(rand, 0x1000, 0x3c00);
    }
}

enum { MOST = 40 };

/* What a kernel makes of some pictures' pixels. */
static unsigned run(const struct ls_accumulate_kernels *kernels, const void *const *halfs,
                    const float *const *w, uint32_t n, uint32_t n_sums, uint32_t first,
                    uint32_t count, float *acc, size_t stride)
{
    size_t padded = ls_accumulate_padded(n);
    g_autofree float *packed = g_new(float, padded *n_sums);
    g_autofree uint8_t *room = g_malloc(ls_accumulate_room(n, n_sums) + 1);
    struct ls_accumulate_terms terms = {halfs, packed, n, n_sums, room};
    ls_accumulate_pack(w, n, n_sums, packed);
    return kernels->sum(&terms, first, count, acc, LS_ACCUMULATE_ROW, stride);
}

/* One call on rows that touch unreadable memory at their end (side 1) or their beginning. */
static void check_bits(const struct ls_accumulate_kernels *kernels, GRand *rand, uint32_t n,
                       uint32_t first, uint32_t count, uint32_t n_sums, int kind, int side)
{
    enum { ROW = LS_ACCUMULATE_ROW };
    uint8_t *row[MOST];
    const void *halfs[MOST];
    const float *w[MOST];
    size_t page = (size_t)sysconf(_SC_PAGESIZE), stride = (count + ROW - 1) / ROW * ROW;
    g_autofree float *weight = g_new(float, n *n_sums);
    g_autofree float *expected = g_new(float, n_sums *stride), *got = g_new(float, n_sums *stride);
    for (uint32_t i = 0; i < n; i++) {
        size_t bytes = side ? 2 * (size_t)(first + count) : page;
        row[i] = guarded(bytes);
        halfs[i] = row[i];
        for (uint32_t j = 0; j < first + count; j++) {
            uint16_t half = sample(rand, kind);
            memcpy(row[i] + 2 * (size_t)j, &half, 2);
        }
        w[i] = weight + i * n_sums;
    }
    for (uint32_t k = 0; k < n * n_sums; k++)
        weight[k] = k % 5 ? (float)g_rand_double_range(rand, -10, 10) : 0;
    for (uint32_t k = 0; k < n_sums * stride; k++)
        got[k] = (float)(k % 100);
    unsigned bad =
        sum_plainly((const uint16_t *const *)halfs, w, n, first, count, n_sums, expected, stride);
    g_assert_cmpuint(run(kernels, halfs, w, n, n_sums, first, count, got, stride), ==, bad);
    for (uint32_t q = 0; q < n_sums; q++)
        g_assert_cmpmem(got + q * stride, 4 * (size_t)count, expected + q * stride,
                        4 * (size_t)count);
    for (uint32_t i = 0; i < n; i++)
        guarded_free(row[i], side ? 2 * (size_t)(first + count) : page);
}

static void test_a_kernel_sums_as_its_header_says(const void *data)
{
    const struct ls_accumulate_kernels *kernels = ls_accumulate_kernels(isas_of(data));
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (uint32_t n_sums = 1; n_sums <= 14; n_sums++)
        for (int kind = 0; kind < KINDS; kind++)
            for (int side = 0; side < 2; side++)
                check_bits(kernels, rand, (uint32_t)g_rand_int_range(rand, 1, MOST + 1),
                           (uint32_t)g_rand_int_range(rand, 0, 3) * 512,
                           (uint32_t)g_rand_int_range(rand, 1, 300), n_sums, kind, side);
    for (uint32_t count = 1; count <= 140; count++)
        check_bits(kernels, rand, 3, 0, count, count % 2 ? 2 : 8, (int)count % KINDS, 1);
    check_bits(kernels, rand, 32, 0, 1029, 6, 4, 1);
    check_bits(kernels, rand, 32, 512, 1029, 13, 4, 1);
}

/* Weights so large that sums overflow: what is finite stays so, and nothing is counted. */
static void test_an_overflow_is_no_stored_infinity(const void *data)
{
    const struct ls_accumulate_kernels *kernels = ls_accumulate_kernels(isas_of(data));
    const uint16_t half[2][3] = {{0x7bff, 0x3c00, 0x7c00}, {0x7bff, 0, 0x3c00}};
    const float weight[2][1] = {{1e38f}, {1e38f}};
    const void *halfs[2] = {half[0], half[1]};
    const float *w[2] = {weight[0], weight[1]};
    float acc[LS_ACCUMULATE_ROW] = {0};
    g_assert_cmpuint(run(kernels, halfs, w, 2, 1, 0, 3, acc, LS_ACCUMULATE_ROW), ==, 1);
    g_assert_cmpfloat(acc[0], ==, INFINITY);
    g_assert_cmpfloat(acc[1], ==, 1e38f);
    g_assert_cmpfloat(acc[2], ==, 1e38f);
}

static void test_any_split_into_regions_gives_the_same_bits(void)
{
    const guint32 seed = 6;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    enum { N = 21, W = 150, H = 140, SUMS = 3 };
    struct pictures p;
    pictures_init(&p, N, W, H, rand);
    g_autofree float *w = weights(SUMS, N, rand);
    g_autofree float *sums = g_new(float, SUMS *W *H), *part = g_new(float, SUMS * 64 * 64);
    struct ls_accumulate_job job = {
        .pictures = p.picture, .n_pictures = N, .n_sums = SUMS, .weights = w};
    struct ls_tile_region all = whole(&p.field);
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, sums, NULL, NULL), ==, LS_OK);
    for (uint32_t ty = 0; ty < 3; ty++)
        for (uint32_t tx = 0; tx < 3; tx++) {
            struct ls_tile_region one = {tx, ty, tx + 1, ty + 1};
            uint32_t w_px = ls_region_width_px(&p.field, &one);
            uint32_t h_px = ls_region_height_px(&p.field, &one);
            g_assert_cmpint(ls_accumulate(&p.field, &job, &one, part, NULL, NULL), ==, LS_OK);
            for (uint32_t q = 0; q < SUMS; q++)
                for (uint32_t y = 0; y < h_px; y++)
                    g_assert_cmpmem(part + ((size_t)q * h_px + y) * w_px, w_px * sizeof *part,
                                    sums + ((size_t)q * H + ty * 64 + y) * W + tx * 64,
                                    w_px * sizeof *part);
        }
    pictures_finish(&p);
}

static void test_a_light_of_no_weight_is_never_read(void)
{
    const guint32 seed = 7;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    struct pictures p;
    float sums[2 * 10 * 10];
    const float w[2 * 3] = {0, 1, 0, 0, 2, 0};
    pictures_init(&p, 3, 10, 10, rand);
    void *forbidden = mmap(NULL, 4096, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    const void *kept = p.tiles[0][0];
    p.tiles[0][0] = forbidden; /* a read would be the end of this test */
    struct ls_accumulate_job job = {
        .pictures = p.picture, .n_pictures = 3, .n_sums = 2, .weights = w};
    struct ls_tile_region all = whole(&p.field);
    struct ls_accumulate_report report;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, sums, &report, NULL), ==, LS_OK);
    g_assert_cmpuint(report.tiles_read, ==, 1);
    g_assert_cmpuint(report.tiles_skipped, ==, 2);
    g_assert_cmpfloat(sums[100], ==, 2 * p.value[100]);
    p.tiles[0][0] = kept;
    munmap(forbidden, 4096);
    pictures_finish(&p);
}

/* The second of two tiles is 0 in whatever has a weight; only the last picture, which has none,
 * shows something there. */
static void test_a_tile_empty_in_all_that_counts_is_not_read(void)
{
    g_autoptr(GRand) rand = g_rand_new_with_seed(9);
    enum { N = 70, W = 128, H = 64, SUMS = 2 };
    struct pictures p;
    pictures_init(&p, N, W, H, rand);
    g_autofree float *w = g_new0(float, SUMS *N), *tile_max = g_new0(float, 2 * N);
    g_autofree float *all = g_new(float, SUMS *W *H), *skipped = g_new(float, SUMS *W *H);
    g_autofree uint16_t *zeros = g_new0(uint16_t, 64 * 64);
    void *forbidden = mmap(NULL, 8192, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    const void *kept[N];
    for (int j = 0; j < 64 * 64; j += 2)
        zeros[j] = 0x8000; /* -0 */
    for (uint32_t i = 0; i < N; i++) {
        for (int q = 0; q < SUMS && i < N - 1; q++)
            w[q * N + i] = (float)g_rand_double_range(rand, -1, 1);
        tile_max[i] = 1;
        tile_max[N + i] = i == N - 1;
        kept[i] = p.tiles[i][1];
        p.tiles[i][1] = zeros;
    }
    struct ls_accumulate_job job = {
        .pictures = p.picture, .n_pictures = N, .n_sums = SUMS, .weights = w};
    struct ls_tile_region region = whole(&p.field);
    struct ls_accumulate_report report;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &region, all, NULL, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < N; i++)
        p.tiles[i][1] = forbidden; /* a read would be the end of this test */
    job.tile_max = tile_max;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &region, skipped, &report, NULL), ==, LS_OK);
    g_assert_cmpmem(all, SUMS * W * H * sizeof *all, skipped, SUMS * W * H * sizeof *skipped);
    g_assert_cmpuint(report.tiles_read, ==, N - 1);
    g_assert_cmpuint(report.tiles_skipped, ==, N + 1);
    g_assert_cmpfloat(report.bound, ==, 0);
    for (uint32_t i = 0; i < N; i++)
        p.tiles[i][1] = kept[i];
    munmap(forbidden, 8192);
    pictures_finish(&p);
}

static void test_what_is_left_out_stays_under_the_requested_error(void)
{
    const guint32 seed = 8;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    enum { N = 40, W = 70, H = 66, SUMS = 2, TILES = 4 };
    struct pictures p;
    pictures_init(&p, N, W, H, rand);
    g_autofree float *w = g_new(float, SUMS *N), *tile_max = g_new0(float, TILES *N);
    g_autofree float *exact = g_new(float, SUMS *W *H), *cut = g_new(float, SUMS *W *H);
    for (int k = 0; k < SUMS * N; k++)
        w[k] = (float)exp(g_rand_double_range(rand, -12, 0)) * (k % 3 ? 1 : -1);
    for (uint32_t i = 0; i < N; i++)
        for (uint32_t y = 0; y < H; y++)
            for (uint32_t x = 0; x < W; x++) {
                float *most = &tile_max[(y / 64 * 2 + x / 64) * N + i];
                *most = fmaxf(*most, fabsf(p.value[(i * H + y) * W + x]));
            }
    struct ls_accumulate_job job = {
        .pictures = p.picture, .n_pictures = N, .n_sums = SUMS, .weights = w, .tile_max = tile_max};
    struct ls_tile_region all = whole(&p.field);
    struct ls_accumulate_report report;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, exact, NULL, NULL), ==, LS_OK);
    for (double error = 1e-4; error < 100; error *= 10) {
        job.max_error = error;
        g_assert_cmpint(ls_accumulate(&p.field, &job, &all, cut, &report, NULL), ==, LS_OK);
        g_assert_cmpfloat(report.bound, <=, error);
        g_assert_cmpuint(report.tiles_read + report.tiles_skipped, ==, TILES * N);
        for (int j = 0; j < SUMS * W * H; j++)
            /* and the rounding of 40 terms below 1 */
            g_assert_cmpfloat(fabs((double)(cut[j] - exact[j])), <=, report.bound + 5e-6);
        if (error >= 1e-2)
            g_assert_cmpuint(report.tiles_skipped, >, TILES * N / 4);
    }
    g_assert_cmpuint(report.tiles_read, ==, 0);
    job.tile_max = NULL;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, cut, &report, NULL), ==, LS_ERR_INVALID);
    pictures_finish(&p);
}

static void test_rows_and_sums_lie_as_far_apart_as_asked(void)
{
    const guint32 seed = 9;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    enum { N = 5, W = 70, H = 66, SUMS = 3, ROW = W + 3, APART = ROW * H + 17 };
    struct pictures p;
    pictures_init(&p, N, W, H, rand);
    g_autofree float *w = weights(SUMS, N, rand);
    g_autofree float *dense = g_new(float, SUMS *W *H), *spread = g_new0(float, SUMS *APART);
    struct ls_accumulate_job job = {
        .pictures = p.picture, .n_pictures = N, .n_sums = SUMS, .weights = w};
    struct ls_tile_region all = whole(&p.field);
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, dense, NULL, NULL), ==, LS_OK);
    job.row_stride = ROW;
    job.sum_stride = APART;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, spread, NULL, NULL), ==, LS_OK);
    for (int k = 0; k < SUMS * APART; k++) {
        int q = k / APART, y = k % APART / ROW, x = k % APART % ROW;
        g_assert_cmpfloat(spread[k], ==, y < H && x < W ? dense[(q * H + y) * W + x] : 0);
    }
    job.sum_stride = ROW * (H - 1) + W - 1;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, spread, NULL, NULL), ==, LS_ERR_INVALID);
    job.sum_stride = 0;
    job.row_stride = W - 1;
    g_assert_cmpint(ls_accumulate(&p.field, &job, &all, spread, NULL, NULL), ==, LS_ERR_INVALID);
    pictures_finish(&p);
}

static void test_stored_infinities_count_as_nothing_and_are_counted(void)
{
    const uint16_t half[2][4] = {{0x7c00, 0xfc00, 0x7e01, 0x3c00},
                                 {0x3c00, 0x3c00, 0x3c00, 0x0001}};
    const void *tiles[2][1] = {{half[0]}, {half[1]}};
    struct ls_picture pictures[2] = {{tiles[0]}, {tiles[1]}};
    struct ls_field field = {.width = 4, .height = 1};
    float w[2] = {2, 1}, sums[4];
    struct ls_accumulate_job job = {
        .pictures = pictures, .n_pictures = 2, .n_sums = 1, .weights = w};
    struct ls_tile_region all = whole(&field);
    struct ls_accumulate_report report;
    g_assert_cmpint(ls_accumulate(&field, &job, &all, sums, &report, NULL), ==, LS_OK);
    g_assert_cmpuint(report.not_finite, ==, 3);
    g_assert_cmpfloat(sums[0], ==, 1);
    g_assert_cmpfloat(sums[2], ==, 1);
    g_assert_cmpfloat(sums[3], ==, 2 + 0x1p-24f);
    w[1] = NAN;
    g_assert_cmpint(ls_accumulate(&field, &job, &all, sums, &report, NULL), ==, LS_ERR_INVALID);
    all.x1 = 2;
    w[1] = 1;
    g_assert_cmpint(ls_accumulate(&field, &job, &all, sums, &report, NULL), ==, LS_ERR_INVALID);
}

static void test_an_absent_tile_is_black(void)
{
    const void *none[1] = {NULL};
    struct ls_picture picture = {none};
    struct ls_field field = {.width = 3, .height = 2};
    const float w[1] = {1};
    float sums[6] = {1, 1, 1, 1, 1, 1};
    struct ls_accumulate_job job = {
        .pictures = &picture, .n_pictures = 1, .n_sums = 1, .weights = w};
    struct ls_tile_region all = whole(&field);
    g_assert_cmpint(ls_accumulate(&field, &job, &all, sums, NULL, NULL), ==, LS_OK);
    for (int j = 0; j < 6; j++)
        g_assert_cmpfloat(sums[j], ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/accumulate/sums-are-within-the-stated-bound", test_sums_are_within_the_stated_bound);
    isas_add("/accumulate/a-kernel-sums-as-its-header-says", test_a_kernel_sums_as_its_header_says);
    isas_add("/accumulate/an-overflow-is-no-stored-infinity",
             test_an_overflow_is_no_stored_infinity);
    g_test_add_func("/accumulate/any-split-into-regions-gives-the-same-bits",
                    test_any_split_into_regions_gives_the_same_bits);
    g_test_add_func("/accumulate/a-light-of-no-weight-is-never-read",
                    test_a_light_of_no_weight_is_never_read);
    g_test_add_func("/accumulate/a-tile-empty-in-all-that-counts-is-not-read",
                    test_a_tile_empty_in_all_that_counts_is_not_read);
    g_test_add_func("/accumulate/what-is-left-out-stays-under-the-requested-error",
                    test_what_is_left_out_stays_under_the_requested_error);
    g_test_add_func("/accumulate/stored-infinities-count-as-nothing-and-are-counted",
                    test_stored_infinities_count_as_nothing_and_are_counted);
    g_test_add_func("/accumulate/rows-and-sums-lie-as-far-apart-as-asked",
                    test_rows_and_sums_lie_as_far_apart_as_asked);
    g_test_add_func("/accumulate/an-absent-tile-is-black", test_an_absent_tile_is_black);
    return g_test_run();
}

/* serving_left_out: under a max_error a tile stays away if, and only if, no sample of it is farther
 * from 0, whatever is asked for. */
#include "core/half.h"
#include "daemon/tiles.h"
#include "proto/errors.h"
#include "tests/daemon/fetched_tiles.h"

#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

static double largest(const uint8_t *tile, bool half)
{
    double most = 0;
    for (size_t k = 0; k < SIDE * SIDE * 3; k++) {
        uint16_t h;
        float f;
        memcpy(&h, tile + 2 * k, sizeof h);
        memcpy(&f, tile + (half ? 0 : 4 * k), sizeof f);
        most = fmax(most, fabs((double)(half ? ls_half_to_float(h) : f)));
    }
    return most;
}

/* Of one that was fetched whole. */
static double largest_of(const struct tiles *exact, uint32_t i, size_t pixel, bool half)
{
    g_autofree uint8_t *room = g_malloc0(SIDE * SIDE * 3 * 4);
    memcpy(room, exact->bytes->data + i * SIDE * SIDE * pixel, SIDE * SIDE * pixel);
    return largest(room, half);
}

static bool is_left_out(const struct tiles *t, uint32_t i)
{
    return g_array_index(t->hash, uint64_t, i) == 0;
}

/* Each stays away or is what it is without a bound. Returns how many stay away. */
static uint32_t assert_bounded(const struct tiles *t, const struct tiles *exact, size_t pixel,
                               bool half, double max_error)
{
    size_t at = 0, bytes = SIDE * SIDE * pixel;
    uint32_t n = 0;
    double worst = 0;
    g_assert_cmpuint(t->refused, ==, 0);
    g_assert_cmpuint(t->number->len, ==, exact->number->len);
    for (uint32_t i = 0; i < t->number->len; i++) {
        double most = largest_of(exact, i, pixel, half);
        g_assert_cmpuint(is_left_out(t, i), ==, most <= max_error);
        g_assert_cmpuint(g_array_index(t->unchanged, uint32_t, i), ==, 0);
        n += is_left_out(t, i);
        if (is_left_out(t, i)) {
            worst = fmax(worst, most);
            continue;
        }
        g_assert_cmpmem(t->bytes->data + at, bytes, exact->bytes->data + i * bytes, bytes);
        at += bytes;
    }
    g_assert_cmpuint(at, ==, t->bytes->len);
    g_assert_cmpfloat(worst, <=, t->error_bound);
    g_assert_cmpfloat(t->error_bound, <=, max_error);
    return n;
}

/* At, and just below, what each tile has: a bound that was taken too low would show. */
static void a_tile_stays_away_if_none_of_it_is_farther_from_0(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1};
    for (size_t w = 0; w < N_WAYS; w++) {
        bool half = ways[w].sample == LIGHTSTAGE__SAMPLE__HALF;
        size_t pixel = pixel_of(&ways[w]);
        uint32_t away = 0;
        Lightstage__Fetch fetch;
        struct tiles exact, t;
        ask_for(&fetch, hall, &ways[w], lights);
        fetch_tiles(hall, &fetch, NULL, 0, &exact);
        g_assert_cmpfloat(exact.error_bound, ==, 0);
        for (uint32_t i = 0; i < exact.number->len; i++)
            for (int below = 0; below < 2; below++) {
                double most = largest_of(&exact, i, pixel, half);
                g_assert_cmpfloat(most, >, 0);
                fetch.max_error = below ? nextafter(most, 0) : most;
                fetch_tiles(hall, &fetch, NULL, 0, &t);
                away += assert_bounded(&t, &exact, pixel, half, fetch.max_error);
                tiles_finish(&t);
            }
        g_assert_cmpuint(away, >, 0);
        tiles_finish(&exact);
    }
}

static void nothing_stays_away_without_a_bound(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1};
    for (size_t w = 0; w < N_WAYS; w++) {
        Lightstage__Fetch fetch;
        struct tiles t;
        ask_for(&fetch, hall, &ways[w], lights);
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        for (uint32_t i = 0; i < t.number->len; i++)
            g_assert_false(is_left_out(&t, i));
        tiles_finish(&t);
    }
}

/* Made by rows: of 2 x 2 tiles those stay that have more than the darkest. */
static void a_level_is_bounded_too(struct hall *hall, gconstpointer data)
{
    const size_t pixel = 3 * sizeof(float), bytes = SIDE * SIDE * pixel;
    Lightstage__Fetch fetch;
    uint32_t light = 6, number;
    a_fetch(&fetch, hall);
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    fetch.lights = &light;
    fetch.n_lights = 1;
    fetch.level = 1;
    fetch.tiles = true;
    GByteArray *exact = fetched(hall, &fetch, &number), *expected = g_byte_array_new();
    g_assert_cmpuint(exact->len, ==, 4 * bytes);
    fetch.max_error = HUGE_VAL;
    for (int i = 0; i < 4; i++)
        fetch.max_error = fmin(fetch.max_error, largest(exact->data + i * bytes, false));
    for (int i = 0; i < 4; i++)
        if (largest(exact->data + i * bytes, false) > fetch.max_error)
            g_byte_array_append(expected, exact->data + i * bytes, bytes);
    GByteArray *some = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpuint(expected->len, ==, 3 * bytes);
    g_assert_cmpmem(some->data, some->len, expected->data, expected->len);
    g_byte_array_unref(some);
    g_byte_array_unref(expected);
    g_byte_array_unref(exact);
}

static void conditions_are_bounded_too(struct hall *hall, gconstpointer data)
{
    static char *names[] = {(char *)"W-0003", (char *)"W-0000"};
    for (int half = 0; half < 2; half++) {
        Lightstage__Fetch fetch = LIGHTSTAGE__FETCH__INIT;
        struct tiles exact, t;
        fetch.take = hall->take->id;
        fetch.conditions = names;
        fetch.n_conditions = G_N_ELEMENTS(names);
        fetch.quantity = LIGHTSTAGE__QUANTITY__ESTIMATE;
        fetch.sample = half ? LIGHTSTAGE__SAMPLE__HALF : LIGHTSTAGE__SAMPLE__FLOAT;
        size_t pixel = half ? 2 : 4;
        fetch_tiles(hall, &fetch, NULL, 0, &exact);
        fetch.max_error = largest_of(&exact, 4, pixel, half);
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_cmpuint(assert_bounded(&t, &exact, pixel, half, fetch.max_error), >, 0);
        tiles_finish(&t);
        tiles_finish(&exact);
    }
}

/* It is not had: the hash of what is there says so, and 0 is nobody's. */
static void what_stays_away_is_not_unchanged(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1};
    Lightstage__Fetch fetch;
    struct tiles exact, t;
    ask_for(&fetch, hall, &ways[0], lights);
    fetch_tiles(hall, &fetch, NULL, 0, &exact);
    fetch.max_error = largest_of(&exact, 4, 2, true);
    g_autofree uint64_t *have = g_memdup2(exact.hash->data, exact.hash->len * sizeof *have);
    have[4] = 0;
    fetch_tiles(hall, &fetch, have, exact.hash->len, &t);
    for (uint32_t i = 0; i < t.number->len; i++)
        g_assert_cmpuint(g_array_index(t.unchanged, uint32_t, i), ==, !is_left_out(&t, i));
    g_assert_true(is_left_out(&t, 4));
    g_assert_cmpuint(t.bytes->len, ==, 0);
    tiles_finish(&t);
    tiles_finish(&exact);
}

static void a_bound_that_is_none_is_refused(struct hall *hall, gconstpointer data)
{
    const double bad[] = {-1, -0x1p-1074, NAN, INFINITY};
    uint32_t lights[2] = {6, 1}, number;
    Lightstage__Fetch fetch;
    struct tiles t;
    ask_for(&fetch, hall, &ways[0], lights);
    for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
        fetch.max_error = bad[i];
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_cmpuint(t.refused, ==, LS_PROTO_BAD_ARGUMENT);
        tiles_finish(&t);
    }
    fetch.max_error = 1; /* of rows */
    g_byte_array_unref(fetched(hall, &fetch, &number));
    g_assert_cmpuint(number, ==, LS_PROTO_BAD_ARGUMENT);
}

/* ---- what is known before ---- */

static double most_is_its_number(const void *user, uint32_t number)
{
    return number;
}

/* A pixel of 8. */
static enum ls_err make_8(void *user, struct ls_demosaic_region region, uint8_t *out,
                          struct ls_diag *diag)
{
    uint16_t eight = ls_half_from_float(8);
    for (uint32_t k = 0; k < region.width * region.height; k++)
        memcpy(out + 2 * k, &eight, sizeof eight);
    g_atomic_int_inc((int *)user);
    return LS_OK;
}

/* Tiles 0, 1 and 2 of nine. */
static void what_is_known_to_be_dark_is_not_made(struct hall *hall, gconstpointer data)
{
    struct ls_tiles tiles = {.wanted = true, .half = true, .max_error = 2.5};
    struct ls_demosaic_region region = {0, 0, TAKE_W, TAKE_H};
    const struct ls_crew alone = {0};
    struct ls_chunk chunk = {0};
    Lightstage__FetchReply body = LIGHTSTAGE__FETCH_REPLY__INIT;
    bool there = false;
    int made = 0;
    g_assert_cmpint(ls_tiles_begin(&tiles, TAKE_W, TAKE_H, 2, &region, NULL), ==, LS_OK);
    tiles.bounds.most = most_is_its_number;
    g_assert_cmpint(ls_tiles_make(&tiles, &alone, make_8, &made, &chunk, &body, &there, NULL), ==,
                    LS_OK);
    g_assert_true(there);
    g_assert_cmpint(made, ==, TILES - 3);
    g_assert_cmpuint(body.n_tile, ==, TILES);
    g_assert_cmpuint(chunk.payload_bytes, ==, (TILES - 3) * SIDE * SIDE * 2);
    g_assert_cmpfloat(tiles.error_bound, ==, 2);
    ls_chunk_finish(&chunk);
    ls_tiles_finish(&tiles);
}

/* The pixels of the last tile become 100, behind the journal's back. */
static void blind(const struct hall *hall, const char *file)
{
    uint16_t most[(TAKE_W - 2 * SIDE) * (TAKE_H - 2 * SIDE)];
    g_autofree char *path =
        g_build_filename(hall->stage.storage, hall->take->id, "cam0", file, NULL);
    int fd = open(path, O_WRONLY);
    for (size_t k = 0; k < G_N_ELEMENTS(most); k++)
        most[k] = ls_half_from_float(100);
    g_assert_cmpint(fd, >=, 0);
    off_t end = lseek(fd, 0, SEEK_END);
    g_assert_cmpint(pwrite(fd, most, sizeof most, end - (off_t)sizeof most), ==, sizeof most);
    g_assert_cmpint(close(fd), ==, 0);
}

static void what_is_stored_as_dark_is_not_read(struct hall *hall, gconstpointer data)
{
    static const int by_tile[] = {0, 2, 4, 6};
    uint32_t lights[2] = {6, 1};
    blind(hall, "W-0006.exr");
    for (size_t k = 0; k < G_N_ELEMENTS(by_tile); k++) {
        const struct way *way = &ways[by_tile[k]];
        Lightstage__Fetch fetch;
        struct tiles exact, t;
        ask_for(&fetch, hall, way, lights);
        fetch_tiles(hall, &fetch, NULL, 0, &exact);
        fetch.max_error = largest_of(&exact, TILES - 1, pixel_of(way), true) / 2;
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_true(is_left_out(&t, TILES - 1));
        g_assert_cmpfloat(t.error_bound, <, fetch.max_error);
        tiles_finish(&t);
        tiles_finish(&exact);
    }
}

/* ---- what a filter makes of it ---- */

enum { IMPULSES = 12 };

static void add_response(uint32_t at, enum ls_demosaic_method method, double *sum)
{
    float mosaic[IMPULSES * IMPULSES] = {0}, rgb[3 * IMPULSES * IMPULSES];
    const struct ls_demosaic_region all = {0, 0, IMPULSES, IMPULSES};
    const struct ls_demosaic_source source = {.data = mosaic,
                                              .stride = IMPULSES,
                                              .window = all,
                                              .image_width = IMPULSES,
                                              .image_height = IMPULSES,
                                              .cfa = LS_CFA_RGGB};
    const struct ls_demosaic_target target = {
        .plane = {rgb, rgb + 1, rgb + 2}, .pixel_step = 3, .row_step = 3 * IMPULSES};
    mosaic[at] = 1;
    g_assert_cmpint(ls_demosaic(&source, all, method, &target), ==, LS_OK);
    for (size_t k = 0; k < G_N_ELEMENTS(rgb); k++)
        sum[k] += fabs((double)rgb[k]);
}

/* The most that samples of magnitude 1 can make: all their signs as they should be. */
static double gain_of(enum ls_demosaic_method method)
{
    double sum[3 * IMPULSES * IMPULSES] = {0}, most = 0;
    for (uint32_t at = 0; at < IMPULSES * IMPULSES; at++)
        add_response(at, method, sum);
    for (size_t k = 0; k < G_N_ELEMENTS(sum); k++)
        most = fmax(most, sum[k]);
    return most;
}

/* As the bounds of daemon/fetch_bounds.c take it; to the rounding of floats. */
static void demosaicing_makes_at_most_two_and_a_half_times_as_much(struct hall *hall,
                                                                   gconstpointer data)
{
    g_assert_cmpfloat_with_epsilon(gain_of(LS_DEMOSAIC_GRADIENT), 2.5, 1e-6);
    g_assert_cmpfloat_with_epsilon(gain_of(LS_DEMOSAIC_BILINEAR), 1, 1e-6);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("a-tile-stays-away-if-none-of-it-is-farther-from-0", with_take,
        a_tile_stays_away_if_none_of_it_is_farther_from_0);
    ADD("nothing-stays-away-without-a-bound", with_take, nothing_stays_away_without_a_bound);
    ADD("a-level-is-bounded-too", with_take, a_level_is_bounded_too);
    ADD("conditions-are-bounded-too", with_take, conditions_are_bounded_too);
    ADD("what-stays-away-is-not-unchanged", with_take, what_stays_away_is_not_unchanged);
    ADD("a-bound-that-is-none-is-refused", with_take, a_bound_that_is_none_is_refused);
    ADD("what-is-known-to-be-dark-is-not-made", with_take, what_is_known_to_be_dark_is_not_made);
    ADD("what-is-stored-as-dark-is-not-read", with_take, what_is_stored_as_dark_is_not_read);
    ADD("demosaicing-makes-at-most-two-and-a-half-times-as-much", with_take,
        demosaicing_makes_at_most_two_and_a_half_times_as_much);
    return g_test_run();
}

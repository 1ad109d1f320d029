/* serving_tiles: tiles are the pictures that rows of pixels make, whatever is asked for, and none
 * is sent that the client has. */
#include "core/half.h"
#include "proto/errors.h"
#include "tests/daemon/fetched_tiles.h"

#include <string.h>
#include <xxhash.h>

/* All that were sent, picture after picture, are those of @whole. */
static void assert_cut_from(const struct tiles *t, const GByteArray *whole, size_t pixel,
                            uint32_t per_picture)
{
    size_t at = 0, tile = SIDE * SIDE * pixel;
    for (uint32_t i = 0; i < t->number->len; i++) {
        const uint8_t *picture = whole->data + (t->first + i) / per_picture * TAKE_PIXELS * pixel;
        uint8_t *expected = cut_tile(picture, g_array_index(t->number, uint32_t, i), pixel);
        g_assert_cmphex(g_array_index(t->hash, uint64_t, i), ==, XXH3_64bits(expected, tile));
        if (!g_array_index(t->unchanged, uint32_t, i)) {
            g_assert_cmpmem(t->bytes->data + at, tile, expected, tile);
            at += tile;
        }
        g_free(expected);
    }
    g_assert_cmpuint(at, ==, t->bytes->len);
}

/* ---- whatever is asked for ---- */

static void tiles_are_cut_from_the_rows(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1}, number;
    for (size_t i = 0; i < N_WAYS; i++) {
        Lightstage__Fetch fetch;
        struct tiles t;
        ask_for(&fetch, hall, &ways[i], lights);
        GByteArray *whole = fetched(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, 0);
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_cmpuint(t.refused, ==, 0);
        uint32_t pictures = ways[i].full_sphere ? 1 : 2;
        g_assert_cmpuint(t.pictures, ==, ways[i].full_sphere ? 0 : 2);
        g_assert_cmpuint(t.number->len, ==, pictures * TILES);
        assert_cut_from(&t, whole, pixel_of(&ways[i]), TILES);
        tiles_finish(&t);
        g_byte_array_unref(whole);
    }
}

/* 70 to 129 touches the middle and the right tiles, 10 to 63 the upper ones. */
static void a_region_brings_every_tile_it_touches(struct hall *hall, gconstpointer data)
{
    static const uint32_t expected[] = {1, 2, 1, 2};
    uint32_t lights[2] = {6, 1}, number;
    Lightstage__Region region = LIGHTSTAGE__REGION__INIT;
    region.x = 70, region.y = 10, region.width = 60, region.height = 54;
    for (size_t i = 0; i < N_WAYS; i++) {
        Lightstage__Fetch fetch;
        struct tiles t;
        ask_for(&fetch, hall, &ways[i], lights);
        GByteArray *whole = fetched(hall, &fetch, &number);
        fetch.region = &region;
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_cmpuint(t.refused, ==, 0);
        g_assert_cmpmem(t.number->data, t.number->len * 4, expected,
                        ways[i].full_sphere ? 8 : sizeof expected);
        assert_cut_from(&t, whole, pixel_of(&ways[i]), 2);
        tiles_finish(&t);
        g_byte_array_unref(whole);
    }
}

static void a_fetch_goes_on_where_it_was_cut(struct hall *hall, gconstpointer data)
{
    static const uint32_t firsts[] = {1, 4, 8, 9, 13, 17};
    uint32_t lights[2] = {6, 1}, number;
    for (size_t i = 0; i < N_WAYS; i++) {
        Lightstage__Fetch fetch;
        struct tiles t;
        ask_for(&fetch, hall, &ways[i], lights);
        GByteArray *whole = fetched(hall, &fetch, &number);
        uint32_t n = ways[i].full_sphere ? TILES : 2 * TILES;
        for (size_t k = 0; k < G_N_ELEMENTS(firsts) && firsts[k] < n; k++) {
            fetch.first_tile = firsts[k];
            fetch_tiles(hall, &fetch, NULL, 0, &t);
            g_assert_cmpuint(t.refused, ==, 0);
            g_assert_cmpuint(t.first, ==, firsts[k]);
            g_assert_cmpuint(t.number->len, ==, n - firsts[k]);
            assert_cut_from(&t, whole, pixel_of(&ways[i]), TILES);
            tiles_finish(&t);
        }
        fetch.first_tile = n;
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_cmpuint(t.refused, ==, LS_PROTO_OVER_LIMIT);
        tiles_finish(&t);
        g_byte_array_unref(whole);
    }
}

static void what_the_client_has_is_listed_and_not_sent(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1}, number;
    for (size_t i = 0; i < N_WAYS; i++) {
        Lightstage__Fetch fetch;
        struct tiles all, some;
        ask_for(&fetch, hall, &ways[i], lights);
        GByteArray *whole = fetched(hall, &fetch, &number);
        fetch_tiles(hall, &fetch, NULL, 0, &all);
        uint64_t *have = g_memdup2(all.hash->data, all.hash->len * 8);
        fetch_tiles(hall, &fetch, have, all.hash->len, &some);
        g_assert_cmpuint(some.bytes->len, ==, 0);
        g_assert_cmpmem(some.hash->data, some.hash->len * 8, all.hash->data, all.hash->len * 8);
        tiles_finish(&some);
        have[4] ^= 1;
        have[5] = 0;
        fetch_tiles(hall, &fetch, have, 7, &some); /* and nothing is known of the rest */
        for (uint32_t k = 0; k < some.number->len; k++)
            g_assert_cmpuint(g_array_index(some.unchanged, uint32_t, k), ==,
                             k < 7 && k != 4 && k != 5);
        assert_cut_from(&some, whole, pixel_of(&ways[i]), TILES);
        tiles_finish(&some);
        tiles_finish(&all);
        g_free(have);
        g_byte_array_unref(whole);
    }
}

/* ---- what core says ---- */

static void stored_tiles_are_the_merge_s_own_halves(struct hall *hall, gconstpointer data)
{
    uint32_t light = 6;
    Lightstage__Fetch fetch;
    struct tiles t;
    GByteArray *halfs = g_byte_array_new();
    g_byte_array_set_size(halfs, 2 * TAKE_PIXELS);
    ls_half_from_floats(hall->take->light[light], (uint16_t *)(void *)halfs->data, TAKE_PIXELS);
    ask_for(&fetch, hall, &ways[0], &light);
    fetch.n_lights = 1;
    fetch_tiles(hall, &fetch, NULL, 0, &t);
    assert_cut_from(&t, halfs, 2, TILES);
    tiles_finish(&t);
    g_byte_array_unref(halfs);
}

static void conditions_come_in_tiles_too(struct hall *hall, gconstpointer data)
{
    static char *names[] = {(char *)"W-0003", (char *)"W-0000"};
    for (int half = 0; half < 2; half++) {
        Lightstage__Fetch fetch = LIGHTSTAGE__FETCH__INIT;
        struct tiles t;
        uint32_t number;
        fetch.take = hall->take->id;
        fetch.conditions = names;
        fetch.n_conditions = G_N_ELEMENTS(names);
        fetch.quantity = LIGHTSTAGE__QUANTITY__ESTIMATE;
        fetch.sample = half ? LIGHTSTAGE__SAMPLE__HALF : LIGHTSTAGE__SAMPLE__FLOAT;
        GByteArray *whole = fetched(hall, &fetch, &number);
        fetch.first_tile = 5;
        fetch_tiles(hall, &fetch, NULL, 0, &t);
        g_assert_cmpuint(t.refused, ==, 0);
        g_assert_cmpuint(t.number->len, ==, 2 * TILES - 5);
        assert_cut_from(&t, whole, half ? 2 : 4, TILES);
        tiles_finish(&t);
        g_byte_array_unref(whole);
    }
}

static void what_goes_with_rows_is_refused(struct hall *hall, gconstpointer data)
{
    uint32_t light = 6;
    uint64_t have = 1;
    Lightstage__Fetch fetch;
    struct tiles t;
    ask_for(&fetch, hall, &ways[0], &light);
    fetch.n_lights = 1;
    fetch.validity = true;
    fetch_tiles(hall, &fetch, NULL, 0, &t);
    g_assert_cmpuint(t.refused, ==, LS_PROTO_UNSUPPORTED);
    tiles_finish(&t);
    fetch.validity = false;
    uint32_t request = send_request(hall, LS_MESSAGE_FETCH, &fetch.base, &have, sizeof have), n;
    g_byte_array_unref(receive_all(hall, request, &n));
    g_assert_cmpuint(n, ==, LS_PROTO_BAD_ARGUMENT);
    fetch.tiles = true;
    request = send_request(hall, LS_MESSAGE_FETCH, &fetch.base, &have, 3);
    g_byte_array_unref(receive_all(hall, request, &n));
    g_assert_cmpuint(n, ==, LS_PROTO_BAD_ARGUMENT);
}

/* ---- credit ---- */

static void give(struct hall *hall, uint32_t request, uint64_t bytes)
{
    Lightstage__Credit credit = LIGHTSTAGE__CREDIT__INIT;
    credit.request = request;
    credit.bytes = bytes;
    send_request(hall, LS_MESSAGE_CREDIT, &credit.base, NULL, 0);
}

/* The next frame, whosever it is: its payload's length. */
static size_t next_frame(struct hall *hall, uint16_t *type, bool *found, uint64_t *waits)
{
    struct ls_reply reply;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_connection_receive(hall->client, 0, &reply, &diag), ==, LS_OK);
    *type = reply.type & ~LS_MESSAGE_REPLY;
    if (*type == LS_MESSAGE_CREDIT)
        *found = ((Lightstage__CreditReply *)reply.message)->found;
    if (*type == LS_MESSAGE_METRICS)
        *waits = ((Lightstage__MetricsReply *)reply.message)->credit_waits;
    size_t n = reply.payload_bytes;
    ls_reply_finish(&reply);
    return n;
}

/* No more of the picture comes, and that is counted soon. Asked now and then: who serves gives way
 * to who asks. */
static void assert_waits(struct hall *hall, uint64_t times)
{
    Lightstage__Metrics ask = LIGHTSTAGE__METRICS__INIT;
    uint64_t waits = 0;
    gint64 end = g_get_monotonic_time() + 20 * G_USEC_PER_SEC;
    while (waits < times && g_get_monotonic_time() < end) {
        uint16_t type = 0;
        g_usleep(1000);
        send_request(hall, LS_MESSAGE_METRICS, &ask.base, NULL, 0);
        next_frame(hall, &type, NULL, &waits);
        g_assert_cmpuint(type, ==, LS_MESSAGE_METRICS);
    }
    g_assert_cmpuint(waits, ==, times);
}

/* A picture of this size is one frame. */
static void who_has_no_credit_waits(struct hall *hall, gconstpointer data)
{
    enum { PICTURE = TILES * SIDE * SIDE * 4 };
    Lightstage__Fetch fetch;
    uint16_t type;
    bool found = false;
    a_fetch(&fetch, hall);
    fetch.tiles = true;
    fetch.credit_bytes = PICTURE + 1;
    uint32_t request = send_request(hall, LS_MESSAGE_FETCH, &fetch.base, NULL, 0);
    for (int k = 0; k < 2; k++) {
        g_assert_cmpuint(next_frame(hall, &type, NULL, NULL), ==, PICTURE);
        g_assert_cmpuint(type, ==, LS_MESSAGE_FETCH);
    }
    assert_waits(hall, 1);
    give(hall, request + 100, PICTURE);
    next_frame(hall, &type, &found, NULL);
    g_assert_false(found);
    give(hall, request, 1);
    size_t n = 0;
    for (int k = 0; k < 2; k++) /* whichever comes first */
        n += next_frame(hall, &type, &found, NULL);
    g_assert_true(found);
    g_assert_cmpuint(n, ==, PICTURE);
    assert_waits(hall, 2);
    give(hall, request, UINT64_MAX);
    uint32_t refused;
    GByteArray *rest = receive_all(hall, request, &refused);
    g_assert_cmpuint(refused, ==, 0);
    g_byte_array_unref(rest);
}

static void who_waits_for_credit_can_be_cancelled(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    Lightstage__Cancel cancel = LIGHTSTAGE__CANCEL__INIT;
    uint32_t refused;
    uint16_t type;
    a_fetch(&fetch, hall);
    fetch.credit_bytes = 1;
    cancel.request = send_request(hall, LS_MESSAGE_FETCH, &fetch.base, NULL, 0);
    next_frame(hall, &type, NULL, NULL);
    assert_waits(hall, 1);
    send_request(hall, LS_MESSAGE_CANCEL, &cancel.base, NULL, 0);
    g_byte_array_unref(receive_all(hall, cancel.request, &refused));
    g_assert_cmpuint(refused, ==, LS_PROTO_CANCELLED);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("tiles-are-cut-from-the-rows", with_take, tiles_are_cut_from_the_rows);
    ADD("a-region-brings-every-tile-it-touches", with_take, a_region_brings_every_tile_it_touches);
    ADD("a-fetch-goes-on-where-it-was-cut", with_take, a_fetch_goes_on_where_it_was_cut);
    ADD("what-the-client-has-is-listed-and-not-sent", with_take,
        what_the_client_has_is_listed_and_not_sent);
    ADD("stored-tiles-are-the-merge-s-own-halves", with_take,
        stored_tiles_are_the_merge_s_own_halves);
    ADD("conditions-come-in-tiles-too", with_take, conditions_come_in_tiles_too);
    ADD("what-goes-with-rows-is-refused", with_take, what_goes_with_rows_is_refused);
    ADD("who-has-no-credit-waits", with_take, who_has_no_credit_waits);
    ADD("who-waits-for-credit-can-be-cancelled", with_take, who_waits_for_credit_can_be_cancelled);
    return g_test_run();
}

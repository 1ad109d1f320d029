/* liblightstage: tiles, which come once, or not at all. */
#include "tests/clients/library_fixture.h"

#include <math.h>
#include <string.h>

enum { SIDE = 64, ACROSS = 3, TILES = ACROSS * 3 };

struct tiles {
    float *picture; /* put together */
    uint64_t hash[TILES];
    uint32_t sent, kept, first, stop_at;
};

static int take_tile(const struct lightstage_tile *tile, void *user)
{
    struct tiles *t = user;
    uint32_t x = tile->number % ACROSS * SIDE, y = tile->number / ACROSS * SIDE;
    g_assert_cmpuint(tile->picture->width, ==, TAKE_W);
    g_assert_cmpuint(tile->index, ==, tile->number); /* of one picture */
    t->hash[tile->number] = tile->hash;
    if (t->sent + t->kept == 0)
        t->first = tile->index;
    t->sent += tile->values != NULL;
    t->kept += !tile->values;
    for (uint32_t r = 0; tile->values && r < SIDE && y + r < TAKE_H; r++)
        memcpy(t->picture + (size_t)(y + r) * TAKE_W + x,
               (const float *)tile->values + (size_t)r * SIDE,
               sizeof(float) * MIN(SIDE, TAKE_W - x));
    return t->sent + t->kept == t->stop_at;
}

static void tiles_come_once_and_go_on_where_they_were_left(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    static const uint32_t light[] = {5};
    struct lightstage_fetch fetch = stored(take);
    struct lightstage_have have = {.size = sizeof have};
    struct tiles t = {.picture = g_new0(float, TAKE_PIXELS), .stop_at = 4};
    const size_t bytes = sizeof(float) * TAKE_PIXELS;
    uint64_t hashes[TILES];
    fetch.lights = light;
    fetch.n_lights = 1;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_tile, &t, NULL), ==,
                     LIGHTSTAGE_CANCELLED);
    have.first_tile = 4;
    t.sent = t.stop_at = 0;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, &have, take_tile, &t, NULL), ==, 0);
    g_assert_cmpuint(t.first, ==, 4);
    g_assert_cmpuint(t.sent, ==, TILES - 4);
    g_assert_cmpmem(t.picture, bytes, take->light[5], bytes);
    memcpy(hashes, t.hash, sizeof hashes);
    hashes[2] ^= 1;
    have = (struct lightstage_have){.size = sizeof have, .hashes = hashes, .n_hashes = TILES - 1};
    t.sent = 0;
    memset(t.picture, 0, bytes);
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, &have, take_tile, &t, NULL), ==, 0);
    g_assert_cmpuint(t.sent, ==, 2); /* the one that differs and the one not named */
    g_assert_cmpuint(t.kept, ==, TILES - 2);
    for (uint32_t y = 0; y < SIDE; y++)
        g_assert_cmpmem(t.picture + y * TAKE_W + 2 * SIDE, 4 * (TAKE_W - 2 * SIDE),
                        take->light[5] + y * TAKE_W + 2 * SIDE, 4 * (TAKE_W - 2 * SIDE));
    g_assert_cmpfloat(t.picture[0], ==, 0);
    have.first_tile = TILES;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, &have, take_tile, &t, NULL), ==,
                     LIGHTSTAGE_OVER_LIMIT);
    g_free(t.picture);
    lightstage_close(client);
    made_take_free(take);
}

/* Of a tile that comes whole. */
static double brightest(const struct lightstage_tile *tile)
{
    double most = 0;
    float value;
    for (size_t at = 0; at < tile->values_bytes; at += sizeof value) {
        memcpy(&value, (const char *)tile->values + at, sizeof value); /* of any alignment */
        most = fmax(most, fabs((double)value));
    }
    return most;
}

struct bounded {
    double brightest[TILES], error_bound;
    uint32_t n, n_out;
    double max_error;
};

static int take_bounded(const struct lightstage_tile *tile, void *user)
{
    struct bounded *b = user;
    bool out = tile->hash == 0;
    if (b->max_error == 0)
        b->brightest[tile->number] = brightest(tile);
    g_assert_cmpint(out, ==, b->brightest[tile->number] <= b->max_error);
    g_assert_cmpint(out, ==, tile->values == NULL);
    b->error_bound = tile->picture->error_bound;
    b->n_out += out;
    b->n++;
    return 0;
}

static void what_is_under_max_error_does_not_come(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    static const uint32_t light[] = {5};
    struct lightstage_fetch fetch = stored(take);
    struct bounded b = {.n = 0};
    fetch.lights = light;
    fetch.n_lights = 1;
    g_assert_true(lightstage_can(client, "max_error"));
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_bounded, &b, NULL), ==, 0);
    g_assert_cmpuint(b.n, ==, TILES);
    g_assert_cmpfloat(b.error_bound, ==, 0);
    fetch.max_error = b.max_error = b.brightest[4];
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_bounded, &b, NULL), ==, 0);
    g_assert_cmpuint(b.n, ==, 2 * TILES);
    g_assert_cmpuint(b.n_out, >, 0);
    g_assert_cmpfloat(b.error_bound, ==, b.brightest[4]);
    fetch.max_error = -1;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_bounded, &b, NULL), ==,
                     LIGHTSTAGE_BAD_ARGUMENT);
    lightstage_close(client);
    made_take_free(take);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("tiles-come-once-and-go-on-where-they-were-left",
                tiles_come_once_and_go_on_where_they_were_left);
    ADD_LIBRARY("what-is-under-max-error-does-not-come", what_is_under_max_error_does_not_come);
    return g_test_run();
}

/* serving_levels: half and quarter size, and one component, are what the full picture says. */
#include "core/half.h"
#include "core/level.h"
#include "proto/errors.h"
#include "tests/daemon/serving_fixture.h"

#include <string.h>

static const struct way {
    const char *channel;
    Lightstage__Model model;
    Lightstage__Layout layout;
    Lightstage__Quantity quantity;
    bool full_sphere;
} ways[] = {
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__ESTIMATE,
     false},
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     false},
    {"R", LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     false},
    {"R", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__ESTIMATE,
     true},
};

static void ask_for(Lightstage__Fetch *fetch, const struct hall *hall, const struct way *way,
                    uint32_t *lights)
{
    a_fetch(fetch, hall);
    fetch->channel = (char *)way->channel;
    fetch->model = way->model;
    fetch->layout = way->layout;
    fetch->quantity = way->quantity;
    fetch->full_sphere = way->full_sphere;
    fetch->sample = LIGHTSTAGE__SAMPLE__FLOAT;
    fetch->lights = lights;
    fetch->n_lights = way->full_sphere ? 0 : 2;
}

/* Pictures of floats, one after the other, by core/level.h. */
static GByteArray *reduced(const GByteArray *whole, uint32_t w, uint32_t h, uint32_t components,
                           uint32_t level)
{
    GByteArray *out = g_byte_array_new();
    size_t in = (size_t)w * h * components * sizeof(float);
    size_t size = (size_t)ls_level_size(w, level) * ls_level_size(h, level) * components;
    const struct ls_demosaic_region all = {0, 0, w, h};
    g_autofree float *picture = g_new(float, size);
    for (size_t at = 0; at < whole->len; at += in) {
        struct ls_level_rows rows = {0};
        g_assert_cmpint(ls_level_rows_init(&rows, level, &all, components, NULL), ==, LS_OK);
        g_assert_cmpuint(
            ls_level_rows_add(&rows, (const float *)(const void *)(whole->data + at), h, picture),
            ==, ls_level_size(h, level));
        ls_level_rows_finish(&rows);
        g_byte_array_append(out, (const uint8_t *)picture, (guint)(size * sizeof *picture));
    }
    return out;
}

static void assert_same(GByteArray *got, GByteArray *expected)
{
    g_assert_cmpmem(got->data, got->len, expected->data, expected->len);
    g_byte_array_unref(got);
    g_byte_array_unref(expected);
}

static GByteArray *as_halves(const GByteArray *floats)
{
    GByteArray *out = g_byte_array_sized_new(floats->len / 2);
    g_byte_array_set_size(out, floats->len / 2);
    ls_half_from_floats((const float *)(const void *)floats->data, (uint16_t *)(void *)out->data,
                        floats->len / 4);
    return out;
}

static void a_level_is_the_mean_of_the_full_picture(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1}, number;
    for (size_t i = 0; i < G_N_ELEMENTS(ways); i++)
        for (uint32_t level = 1; level <= LS_LEVEL_MAX; level++) {
            Lightstage__Fetch fetch;
            ask_for(&fetch, hall, &ways[i], lights);
            GByteArray *whole = fetched(hall, &fetch, &number);
            g_assert_cmpuint(number, ==, 0);
            GByteArray *expected = reduced(whole, TAKE_W, TAKE_H, 3, level);
            g_assert_cmpuint(expected->len, >, 0);
            fetch.level = level;
            fetch.sample = LIGHTSTAGE__SAMPLE__HALF;
            assert_same(fetched(hall, &fetch, &number), as_halves(expected));
            fetch.sample = LIGHTSTAGE__SAMPLE__FLOAT;
            assert_same(fetched(hall, &fetch, &number), expected);
            g_byte_array_unref(whole);
        }
}

/* 53 to 88 and 71 to 139 touch 13 to 22 and 17 to 34 of the quarter. */
static void a_region_is_of_full_size_pixels(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1}, number;
    Lightstage__Region touched = LIGHTSTAGE__REGION__INIT, region = LIGHTSTAGE__REGION__INIT;
    region.x = 53, region.y = 71, region.width = 36, region.height = 69;
    touched.x = 52, touched.y = 68, touched.width = 40, touched.height = 72;
    for (size_t i = 0; i < G_N_ELEMENTS(ways); i++) {
        Lightstage__Fetch fetch;
        ask_for(&fetch, hall, &ways[i], lights);
        fetch.region = &touched;
        GByteArray *whole = fetched(hall, &fetch, &number);
        fetch.region = &region;
        fetch.level = 2;
        assert_same(fetched(hall, &fetch, &number), reduced(whole, 40, 72, 3, 2));
        g_byte_array_unref(whole);
    }
}

/* 75 x 70 pixels are two tiles across and two down. */
static void tiles_of_a_level_are_cut_from_it(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1}, number;
    enum { W = 75, H = 70, SIDE = 64, PIXEL = 12 };
    for (size_t i = 0; i < G_N_ELEMENTS(ways); i++) {
        Lightstage__Fetch fetch;
        ask_for(&fetch, hall, &ways[i], lights);
        fetch.level = 1;
        GByteArray *rows = fetched(hall, &fetch, &number);
        fetch.tiles = true;
        GByteArray *tiles = fetched(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, 0);
        GByteArray *expected = g_byte_array_new();
        static const uint8_t zeros[SIDE * PIXEL];
        for (size_t at = 0; at < rows->len; at += W * H * PIXEL)
            for (uint32_t y = 0; y < 2 * SIDE * 2; y++) { /* [row of tiles][tile][row] */
                uint32_t ty = y / (2 * SIDE), tx = y / SIDE % 2, row = ty * SIDE + y % SIDE;
                uint32_t n = row >= H ? 0 : tx == 0 ? SIDE : W - SIDE;
                g_byte_array_append(expected, rows->data + at + (row * W + tx * SIDE) * PIXEL,
                                    n * PIXEL);
                g_byte_array_append(expected, zeros, (SIDE - n) * PIXEL);
            }
        assert_same(tiles, expected);
        fetch.first_tile = 2; /* the lower ones of the first picture */
        tiles = fetched(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, 0);
        g_assert_cmpuint(tiles->len, ==, (ways[i].full_sphere ? 2 : 6) * SIDE * SIDE * PIXEL);
        g_byte_array_unref(tiles);
        g_byte_array_unref(rows);
    }
}

static GByteArray *relit_at(struct hall *hall, struct relight *r, uint32_t level)
{
    uint32_t number;
    r->body.level = level;
    GByteArray *got = relit(hall, r, &number);
    g_assert_cmpuint(number, ==, 0);
    return got;
}

static void relit_pictures_have_levels(struct hall *hall, gconstpointer data)
{
    struct relight r;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__PER_TARGET);
    for (uint32_t level = 1; level <= LS_LEVEL_MAX; level++) {
        GByteArray *whole = relit_at(hall, &r, 0);
        assert_same(relit_at(hall, &r, level), reduced(whole, TAKE_W, TAKE_H, 3, level));
        g_byte_array_unref(whole);
    }
    r.region.x = 20, r.region.y = 60, r.region.width = 8, r.region.height = 8;
    GByteArray *whole = relit_at(hall, &r, 0);
    r.region.x = 21, r.region.y = 62, r.region.width = 4, r.region.height = 3;
    assert_same(relit_at(hall, &r, 2), reduced(whole, 8, 8, 3, 2));
    g_byte_array_unref(whole);
}

/* Bands of two pictures come row by row, and go where they belong. */
static void several_relit_pictures_have_levels(struct hall *hall, gconstpointer data)
{
    struct relight r, one;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.body.n_pictures = 2;
    r.n_rows = 4;
    one = r;
    one.body.channels = one.channels;
    one.body.region = &one.region;
    one.body.n_pictures = 1;
    one.n_rows = 2;
    memcpy(one.weights, r.weights + 2 * TAKE_LIGHTS, 2 * TAKE_LIGHTS * sizeof *r.weights);
    r.body.level = 2;
    enum { W = 38, H = 35 };
    GByteArray *second = g_byte_array_new();
    uint32_t request = send_request(hall, LS_MESSAGE_RELIGHT, &r.body.base, r.weights,
                                    r.n_rows * TAKE_LIGHTS * sizeof(float)),
             rows[2] = {0};
    for (bool last = false; !last;) {
        struct ls_reply reply;
        g_assert_cmpint(ls_connection_receive(hall->client, request, &reply, NULL), ==, LS_OK);
        const Lightstage__RelightReply *body = (const Lightstage__RelightReply *)reply.message;
        g_assert_cmpuint(body->width, ==, W);
        g_assert_cmpuint(body->height, ==, H);
        g_assert_cmpuint(body->level, ==, 2);
        g_assert_cmpuint(reply.payload_bytes, ==, body->n_rows * W * 12);
        last = reply.last;
        g_assert_cmpuint(body->first_row, ==, last ? H : rows[body->picture]);
        rows[body->picture] += body->n_rows;
        if (body->picture == 1)
            g_byte_array_append(second, reply.payload, (guint)reply.payload_bytes);
        ls_reply_finish(&reply);
    }
    g_assert_cmpuint(rows[0], ==, H);
    g_assert_cmpuint(rows[1], ==, H);
    assert_same(second, relit_at(hall, &one, 2));
}

/* ---- one component ---- */

static void mono_is_the_luminance_of_rgb(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1}, number;
    const struct ls_calibration *c = hall->take->calibration;
    double y[3];
    for (int j = 0; j < 3; j++)
        y[j] = 0.2126 * c->m[0][j] + 0.7152 * c->m[1][j] + 0.0722 * c->m[2][j];
    for (size_t i = 0; i < G_N_ELEMENTS(ways); i++) {
        Lightstage__Fetch fetch;
        ask_for(&fetch, hall, &ways[i], lights);
        GByteArray *rgb = fetched(hall, &fetch, &number);
        GByteArray *expected = g_byte_array_new();
        const float *v = (const float *)(const void *)rgb->data;
        for (size_t j = 0; j < rgb->len / 12; j++) {
            float one = (float)(y[0] * (double)v[3 * j] + y[1] * (double)v[3 * j + 1] +
                                y[2] * (double)v[3 * j + 2]);
            g_byte_array_append(expected, (const uint8_t *)&one, sizeof one);
        }
        fetch.layout = LIGHTSTAGE__LAYOUT__MONO;
        GByteArray *got = fetched(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, 0);
        fetch.sample = LIGHTSTAGE__SAMPLE__HALF;
        assert_same(fetched(hall, &fetch, &number), as_halves(expected));
        fetch.sample = LIGHTSTAGE__SAMPLE__FLOAT;
        fetch.level = 2;
        assert_same(fetched(hall, &fetch, &number), reduced(expected, TAKE_W, TAKE_H, 1, 2));
        assert_same(got, expected);
        g_byte_array_unref(rgb);
    }
}

/* ---- refused ---- */

static void assert_refused(struct hall *hall, const Lightstage__Fetch *fetch, uint32_t expected)
{
    uint32_t number;
    g_byte_array_unref(fetched(hall, fetch, &number));
    g_assert_cmpuint(number, ==, expected);
}

static void what_would_not_be_true_is_refused(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1};
    char name[] = "W-0001", *names[] = {name};
    Lightstage__Fetch fetch;
    ask_for(&fetch, hall, &ways[0], lights);
    fetch.level = LS_LEVEL_MAX + 1;
    assert_refused(hall, &fetch, LS_PROTO_UNSUPPORTED);
    fetch.level = 1;
    fetch.layout = LIGHTSTAGE__LAYOUT__MOSAIC;
    assert_refused(hall, &fetch, LS_PROTO_UNSUPPORTED);
    fetch.variance = true;
    assert_refused(hall, &fetch, LS_PROTO_UNSUPPORTED);
    fetch.level = 0;
    fetch.layout = LIGHTSTAGE__LAYOUT__MONO;
    assert_refused(hall, &fetch, LS_PROTO_UNSUPPORTED);
    fetch.variance = false;
    fetch.layout = LIGHTSTAGE__LAYOUT__MONO + 1;
    assert_refused(hall, &fetch, LS_PROTO_UNSUPPORTED);
    a_fetch(&fetch, hall);
    fetch.channel = (char *)"";
    fetch.conditions = names;
    fetch.n_conditions = 1;
    fetch.level = 1;
    assert_refused(hall, &fetch, LS_PROTO_UNSUPPORTED);
    struct relight r;
    uint32_t number;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.body.level = LS_LEVEL_MAX + 1;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, LS_PROTO_UNSUPPORTED);
}

static void mono_without_a_matrix_is_refused(struct hall *hall, gconstpointer data)
{
    uint32_t lights[2] = {6, 1};
    Lightstage__Fetch fetch;
    ask_for(&fetch, hall, &ways[0], lights);
    fetch.layout = LIGHTSTAGE__LAYOUT__MONO;
    assert_refused(hall, &fetch, LS_PROTO_INCOMPLETE);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("a-level-is-the-mean-of-the-full-picture", with_take,
        a_level_is_the_mean_of_the_full_picture);
    ADD("a-region-is-of-full-size-pixels", with_take, a_region_is_of_full_size_pixels);
    ADD("tiles-of-a-level-are-cut-from-it", with_take, tiles_of_a_level_are_cut_from_it);
    ADD("relit-pictures-have-levels", with_take, relit_pictures_have_levels);
    ADD("several-relit-pictures-have-levels", with_take, several_relit_pictures_have_levels);
    ADD("mono-is-the-luminance-of-rgb", with_take, mono_is_the_luminance_of_rgb);
    ADD("what-would-not-be-true-is-refused", with_take, what_would_not_be_true_is_refused);
    ADD("mono-without-a-matrix-is-refused", with_uncalibrated_take,
        mono_without_a_matrix_is_refused);
    return g_test_run();
}

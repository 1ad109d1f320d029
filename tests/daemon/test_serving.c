/* serving: what is relit of a take over the wire is what core makes of its pictures. */
#include "proto/errors.h"
#include "tests/daemon/serving_fixture.h"

#include <math.h>
#include <string.h>

static void relighting_over_the_wire_equals_the_long_way(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    float *expected = g_new0(float, 3 * TAKE_PIXELS), *ratio = ratio_of_red(hall->take);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    add_lights(expected, hall->take, r.weights, NULL, -1);
    add_lights(expected, hall->take, r.weights + TAKE_LIGHTS, ratio, -1);
    assert_close(got, expected, 3 * TAKE_PIXELS, hall->take->scale * 7);
    g_byte_array_unref(got);
    g_free(expected);
    g_free(ratio);
}

static void per_target_weights_go_to_their_own_channel(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    float *expected = g_new0(float, 3 * TAKE_PIXELS), *ratio = ratio_of_red(hall->take);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__PER_TARGET);
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    for (int c = 0; c < 3; c++) {
        add_lights(expected, hall->take, r.weights + (2 * c) * TAKE_LIGHTS, NULL, c);
        add_lights(expected, hall->take, r.weights + (2 * c + 1) * TAKE_LIGHTS, ratio, c);
    }
    assert_close(got, expected, 3 * TAKE_PIXELS, hall->take->scale * 7);
    g_byte_array_unref(got);
    g_free(expected);
    g_free(ratio);
}

static void tristimulus_weights_divide_by_the_white_of_each_channel(struct hall *hall,
                                                                    gconstpointer data)
{
    struct relight r;
    uint32_t number;
    float *expected = g_new0(float, 3 * TAKE_PIXELS);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS);
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    for (int c = 0; c < 3; c++)
        add_lights(expected, hall->take, r.weights + c * TAKE_LIGHTS, NULL, c);
    for (int i = 0; i < 3 * TAKE_PIXELS; i++)
        expected[i] /= hall->take->calibration->p[0][i % 3];
    assert_close(got, expected, 3 * TAKE_PIXELS, hall->take->scale * 7);
    g_byte_array_unref(got);
    g_free(expected);
}

static void a_region_is_the_crop_of_the_whole(struct hall *hall, gconstpointer data)
{
    static const uint32_t regions[][4] = {{0, 0, 1, 1},     {149, 139, 1, 1}, {1, 63, 149, 2},
                                          {63, 62, 3, 70},  {0, 64, 150, 64}, {65, 127, 64, 13},
                                          {37, 11, 50, 129}};
    struct relight r;
    uint32_t number;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    GByteArray *whole = relit(hall, &r, &number);
    for (size_t k = 0; k < G_N_ELEMENTS(regions); k++) {
        const uint32_t *g = regions[k];
        r.region.x = g[0];
        r.region.y = g[1];
        r.region.width = g[2];
        r.region.height = g[3];
        GByteArray *part = relit(hall, &r, &number);
        g_assert_cmpuint(number, ==, 0);
        g_assert_cmpuint(part->len, ==, 12 * g[2] * g[3]);
        for (uint32_t y = 0; y < g[3]; y++)
            g_assert_cmpmem(part->data + (size_t)y * g[2] * 12, g[2] * 12,
                            whole->data + ((size_t)(g[1] + y) * TAKE_W + g[0]) * 12, g[2] * 12);
        g_byte_array_unref(part);
    }
    g_byte_array_unref(whole);
}

static void skipped_lights_are_counted_and_bounded(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.weights[2] = r.weights[TAKE_LIGHTS + 2] = 0;
    r.weights[5] = r.weights[TAKE_LIGHTS + 5] = 1e-6f;
    GByteArray *exact = relit(hall, &r, &number);
    r.body.max_error = 1e-3 * hall->take->scale;
    uint32_t request = send_request(hall, LS_MESSAGE_RELIGHT, &r.body.base, r.weights,
                                    r.n_rows * TAKE_LIGHTS * sizeof(float));
    double bound = 0, worst = 0;
    uint32_t skipped = 0;
    uint64_t tiles = 0;
    for (bool last = false; !last;) {
        struct ls_reply reply;
        g_assert_cmpint(ls_connection_receive(hall->client, request, &reply, NULL), ==, LS_OK);
        const Lightstage__RelightReply *band = (const Lightstage__RelightReply *)reply.message;
        const float *e = (const float *)(const void *)exact->data;
        for (size_t i = 0; i < (size_t)band->n_rows * TAKE_W * 3; i++) {
            float value;
            memcpy(&value, reply.payload + 4 * i, 4);
            worst = fmax(worst,
                         fabs((double)value - (double)e[(size_t)band->first_row * TAKE_W * 3 + i]));
        }
        skipped = band->lights_skipped;
        bound = band->error_bound;
        tiles = band->tiles_skipped;
        last = reply.last;
        ls_reply_finish(&reply);
    }
    g_assert_cmpuint(skipped, ==, 1);
    g_assert_cmpuint(tiles, ==, 18); /* lights 2 and 5, everywhere */
    g_assert_cmpfloat(bound, >, 0);
    g_assert_cmpfloat(bound, <=, r.body.max_error);
    g_assert_cmpfloat(worst, >, 0);
    /* two sums may be off by the bound each; demosaicing and the ratio (<= 0.8) amplify by < 3 */
    g_assert_cmpfloat(worst, <=, 6 * bound);
    g_byte_array_unref(exact);
}

static void no_light_gives_black(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    memset(r.weights, 0, sizeof r.weights);
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpuint(got->len, ==, 12 * TAKE_PIXELS);
    for (size_t i = 0; i < got->len; i++)
        g_assert_cmpuint(got->data[i], ==, 0);
    g_byte_array_unref(got);
}

static void wrong_relights_are_refused(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    static char none[] = "Q", polarised[] = "V";
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.weights[3] = NAN;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 107);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.n_rows = 1;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 107);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.channels[1] = none;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 202);
    r.channels[1] = polarised;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 108);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.region.x = 100;
    r.region.width = 51;
    r.region.height = 1;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 109);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.region.x = r.region.width = UINT32_MAX;
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 109);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    r.body.n_lights = TAKE_LIGHTS - 1;
    r.body.n_channels = 1;
    uint32_t request = send_request(hall, LS_MESSAGE_RELIGHT, &r.body.base, r.weights,
                                    (TAKE_LIGHTS - 1) * sizeof(float));
    g_byte_array_unref(receive_all(hall, request, &number));
    g_assert_cmpuint(number, ==, 109);
}

static void an_incomplete_take_says_what_it_lacks(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, LS_PROTO_INCOMPLETE);
    memset(r.weights + TAKE_LIGHTS, 0, TAKE_LIGHTS * sizeof(float));
    r.weights[3] = 0; /* without light 3 and without promotion it has all it needs */
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("relighting-over-the-wire-equals-the-long-way", with_take,
        relighting_over_the_wire_equals_the_long_way);
    ADD("per-target-weights-go-to-their-own-channel", with_take,
        per_target_weights_go_to_their_own_channel);
    ADD("tristimulus-weights-divide-by-the-white-of-each-channel", with_take,
        tristimulus_weights_divide_by_the_white_of_each_channel);
    ADD("a-region-is-the-crop-of-the-whole", with_take, a_region_is_the_crop_of_the_whole);
    ADD("skipped-lights-are-counted-and-bounded", with_take,
        skipped_lights_are_counted_and_bounded);
    ADD("no-light-gives-black", with_take, no_light_gives_black);
    ADD("wrong-relights-are-refused", with_take, wrong_relights_are_refused);
    ADD("an-incomplete-take-says-what-it-lacks", with_take_lacking_light_3,
        an_incomplete_take_says_what_it_lacks);
    return g_test_run();
}

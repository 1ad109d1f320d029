/* serving: what comes over the wire of a take is what core makes of its pictures. */
#include "core/demosaic.h"
#include "core/half.h"
#include "daemon/field_source.h"
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/server_fixture.h"
#include "tests/daemon/take_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

struct hall {
    struct stage stage;
    struct made_take *take;
    struct ls_connection *client;
};

static void open_hall(struct hall *hall, bool calibrated, int missing, uint64_t spare_bytes)
{
    stage_init(&hall->stage);
    hall->stage.limits.spare_bytes = spare_bytes;
    hall->stage.limits.stall_ms = 400;
    hall->take = make_take(hall->stage.storage, calibrated, missing);
    stage_open(&hall->stage);
    hall->client = a_client(&hall->stage);
}

static void with_take(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, -1, 0);
}

static void with_take_on_a_full_disk(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, -1, UINT64_C(1) << 60);
}

static void with_take_lacking_light_3(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, 3, 0);
}

static void with_uncalibrated_take(struct hall *hall, gconstpointer data)
{
    open_hall(hall, false, -1, 0);
}

static void leave(struct hall *hall, gconstpointer data)
{
    ls_connection_close(hall->client);
    stage_close(&hall->stage);
    made_take_free(hall->take);
}

/* ---- asking ---- */

static uint32_t send_request(struct hall *hall, uint16_t type, const ProtobufCMessage *body,
                             const void *payload, size_t n)
{
    uint32_t request = 0;
    g_assert_cmpint(ls_connection_send(hall->client, type, body, payload, n, &request, NULL), ==,
                    LS_OK);
    return request;
}

/* Every payload of the answer, one after the other. *number: 0, or the refusal's. */
static GByteArray *receive_all(struct hall *hall, uint32_t request, uint32_t *number)
{
    GByteArray *out = g_byte_array_new();
    *number = 0;
    for (bool last = false; !last;) {
        struct ls_reply reply;
        struct ls_diag diag = {0};
        if (ls_connection_receive(hall->client, request, &reply, &diag)) {
            g_test_message("refused: %s", diag.text);
            *number = ls_connection_error(hall->client);
            return out;
        }
        g_byte_array_append(out, reply.payload ? reply.payload : (const uint8_t *)"",
                            (guint)reply.payload_bytes);
        last = reply.last;
        ls_reply_finish(&reply);
    }
    return out;
}

struct relight {
    Lightstage__Relight body;
    Lightstage__Region region;
    char *channels[2];
    float weights[6 * TAKE_LIGHTS];
    size_t n_rows;
};

static void a_relight(struct relight *r, const struct hall *hall, Lightstage__WeightMode mode)
{
    static char white[] = "W", red[] = "R";
    memset(r, 0, sizeof *r);
    lightstage__relight__init(&r->body);
    lightstage__region__init(&r->region);
    r->channels[0] = white;
    r->channels[1] = red;
    r->body.take = hall->take->id;
    r->body.mode = mode;
    r->body.channels = r->channels;
    r->body.n_channels = mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS ? 0 : 2;
    r->body.n_lights = TAKE_LIGHTS;
    r->body.region = &r->region;
    r->n_rows = mode == LIGHTSTAGE__WEIGHT_MODE__SHARED        ? 2
                : mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS ? 3
                                                               : 6;
    for (size_t i = 0; i < r->n_rows * TAKE_LIGHTS; i++)
        r->weights[i] = (float)g_test_rand_double_range(-0.5, 2);
}

static GByteArray *relit(struct hall *hall, const struct relight *r, uint32_t *number)
{
    return receive_all(hall,
                       send_request(hall, LS_MESSAGE_RELIGHT, &r->body.base, r->weights,
                                    r->n_rows * TAKE_LIGHTS * sizeof(float)),
                       number);
}

/* ---- expected, the long way ---- */

static void demosaic(const float *mosaic, float *rgb)
{
    struct ls_demosaic_source source = {mosaic, TAKE_W, {0, 0, TAKE_W, TAKE_H},
                                        TAKE_W, TAKE_H, LS_CFA_RGGB};
    struct ls_demosaic_target target = {{rgb, rgb + 1, rgb + 2}, 3, 3 * TAKE_W};
    g_assert_cmpint(ls_demosaic(&source, (struct ls_demosaic_region){0, 0, TAKE_W, TAKE_H},
                                LS_DEMOSAIC_GRADIENT, &target),
                    ==, LS_OK);
}

/* Demosaiced sum of the lights under w k. */
static float *summed(const struct made_take *take, const double w[TAKE_LIGHTS])
{
    float *mosaic = g_new0(float, TAKE_PIXELS), *rgb = g_new0(float, 3 * TAKE_PIXELS);
    for (int p = 0; p < TAKE_PIXELS; p++) {
        double sum = 0;
        for (int i = 0; i < TAKE_LIGHTS; i++)
            sum += w[i] * take->k[0][i] * (double)take->light[i][p];
        mosaic[p] = (float)sum;
    }
    demosaic(mosaic, rgb);
    g_free(mosaic);
    return rgb;
}

/* Eq. 1's ratio for R, which for these pictures is plain F / V. */
static float *ratio_of_red(const struct made_take *take)
{
    double g[TAKE_LIGHTS];
    float *f = g_new0(float, TAKE_PIXELS), *ratio = g_new0(float, 3 * TAKE_PIXELS);
    for (int i = 0; i < TAKE_LIGHTS; i++)
        g[i] = 1 / take->k[1][i];
    float *v = summed(take, g);
    for (int p = 0; p < TAKE_PIXELS; p++)
        f[p] = (float)((double)take->sphere_r[p] / (TAKE_LEVEL / 65535.0) * 1.2);
    demosaic(f, ratio);
    for (int i = 0; i < 3 * TAKE_PIXELS; i++)
        ratio[i] /= v[i];
    g_free(f);
    g_free(v);
    return ratio;
}

static void add(float *out, const struct made_take *take, const float *weights, const float *ratio,
                int only)
{
    double w[TAKE_LIGHTS];
    for (int i = 0; i < TAKE_LIGHTS; i++)
        w[i] = (double)weights[i];
    float *rgb = summed(take, w);
    for (int i = 0; i < 3 * TAKE_PIXELS; i++)
        if (only < 0 || i % 3 == only)
            out[i] += (float)(take->scale * (double)rgb[i] * (ratio ? (double)ratio[i] : 1));
    g_free(rgb);
}

/* Values reach a few hundred; halves are exact, sums of seven floats and a demosaic are not. */
static void assert_close(const GByteArray *got, const float *expected, size_t n, double scale)
{
    const float *values = (const float *)(const void *)got->data;
    g_assert_cmpuint(got->len, ==, n * sizeof(float));
    for (size_t i = 0; i < n; i++)
        if (!(fabs((double)values[i] - (double)expected[i]) <= 2e-5 * scale))
            g_error("value %zu (row %zu) is %g, expected %g", i, i / (3 * TAKE_W),
                    (double)values[i], (double)expected[i]);
}

/* ---- relight ---- */

static void relighting_over_the_wire_equals_the_long_way(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    float *expected = g_new0(float, 3 * TAKE_PIXELS), *ratio = ratio_of_red(hall->take);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    add(expected, hall->take, r.weights, NULL, -1);
    add(expected, hall->take, r.weights + TAKE_LIGHTS, ratio, -1);
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
        add(expected, hall->take, r.weights + (2 * c) * TAKE_LIGHTS, NULL, c);
        add(expected, hall->take, r.weights + (2 * c + 1) * TAKE_LIGHTS, ratio, c);
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
        add(expected, hall->take, r.weights + c * TAKE_LIGHTS, NULL, c);
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

/* ---- fetch ---- */

static void a_fetch(Lightstage__Fetch *fetch, const struct hall *hall)
{
    static char white[] = "W";
    lightstage__fetch__init(fetch);
    fetch->take = hall->take->id;
    fetch->channel = white;
}

static GByteArray *fetched(struct hall *hall, const Lightstage__Fetch *fetch, uint32_t *number)
{
    return receive_all(hall, send_request(hall, LS_MESSAGE_FETCH, &fetch->base, NULL, 0), number);
}

static void stored_halves_come_bit_for_bit(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t lights[2] = {6, 1}, number;
    uint16_t *expected = g_new(uint16_t, 2 * TAKE_PIXELS);
    a_fetch(&fetch, hall);
    fetch.lights = lights;
    fetch.n_lights = 2;
    fetch.quantity = LIGHTSTAGE__QUANTITY__ESTIMATE;
    fetch.sample = LIGHTSTAGE__SAMPLE__HALF;
    GByteArray *got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    ls_half_from_floats(hall->take->light[6], expected, TAKE_PIXELS);
    ls_half_from_floats(hall->take->light[1], expected + TAKE_PIXELS, TAKE_PIXELS);
    g_assert_cmpmem(got->data, got->len, expected, 4 * TAKE_PIXELS);
    g_byte_array_unref(got);
    g_free(expected);
}

static void reflectance_carries_gain_and_scale(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t light = 4, number;
    float *expected = g_new(float, TAKE_PIXELS);
    a_fetch(&fetch, hall);
    fetch.lights = &light;
    fetch.n_lights = 1;
    GByteArray *got = fetched(hall, &fetch, &number);
    for (int p = 0; p < TAKE_PIXELS; p++)
        expected[p] =
            (float)(hall->take->scale * hall->take->k[0][4] * (double)hall->take->light[4][p]);
    assert_close(got, expected, TAKE_PIXELS, hall->take->scale);
    g_byte_array_unref(got);
    g_free(expected);
}

static void a_promoted_fetch_is_white_times_the_ratio(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    static char red[] = "R";
    uint32_t light = 2, number;
    float one[TAKE_LIGHTS] = {0}, *expected = g_new0(float, 3 * TAKE_PIXELS);
    float *ratio = ratio_of_red(hall->take);
    one[2] = 1;
    a_fetch(&fetch, hall);
    fetch.channel = red;
    fetch.lights = &light;
    fetch.n_lights = 1;
    fetch.model = LIGHTSTAGE__MODEL__SPHERE;
    GByteArray *got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_UNSUPPORTED); /* as a mosaic */
    g_byte_array_unref(got);
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    fetch.full_sphere = true;
    got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_UNSUPPORTED); /* is photographed */
    g_byte_array_unref(got);
    fetch.full_sphere = false;
    got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    add(expected, hall->take, one, ratio, -1);
    assert_close(got, expected, 3 * TAKE_PIXELS, hall->take->scale);
    g_byte_array_unref(got);
    g_free(expected);
    g_free(ratio);
}

static char *refusal_of_fetch(struct hall *hall, const Lightstage__Fetch *fetch, uint32_t *number)
{
    struct ls_reply reply;
    struct ls_diag diag = {0};
    uint32_t request = send_request(hall, LS_MESSAGE_FETCH, &fetch->base, NULL, 0);
    g_assert_cmpint(ls_connection_receive(hall->client, request, &reply, &diag), ==,
                    LS_ERR_REFUSED);
    *number = ls_connection_error(hall->client);
    return g_strdup(diag.text);
}

/* R was photographed only as a sphere: nothing is missing, resuming would not bring it. */
static void a_picture_outside_the_plan_is_not_called_missing(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t light = 1, number;
    static char red[] = "R", polarised[] = "V";
    for (int named = 0; named < 2; named++) {
        a_fetch(&fetch, hall);
        fetch.channel = red;
        fetch.lights = &light;
        fetch.n_lights = (size_t)named;
        char *text = refusal_of_fetch(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, LS_PROTO_NOT_FOUND);
        g_assert_nonnull(strstr(text, "the plan of take"));
        g_assert_nonnull(strstr(text, "model sphere"));
        g_free(text);
        fetch.channel = polarised;
        text = refusal_of_fetch(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, LS_PROTO_NOT_FOUND);
        g_assert_null(strstr(text, "model sphere")); /* not promotable */
        g_free(text);
    }
}

static void all_lights_come_when_none_is_named(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t number;
    a_fetch(&fetch, hall);
    fetch.sample = LIGHTSTAGE__SAMPLE__HALF;
    GByteArray *got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpuint(got->len, ==, 2 * TAKE_PIXELS * TAKE_LIGHTS);
    g_byte_array_unref(got);
}

static void a_full_sphere_needs_its_calibrated_duty(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    static char red[] = "R";
    uint32_t number;
    float *expected = g_new(float, TAKE_PIXELS);
    a_fetch(&fetch, hall);
    fetch.channel = red;
    fetch.full_sphere = true;
    GByteArray *got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    for (int p = 0; p < TAKE_PIXELS; p++)
        expected[p] = (float)((double)hall->take->sphere_r[p] * hall->take->scale * 1.2 /
                              (TAKE_LEVEL / 65535.0));
    assert_close(got, expected, TAKE_PIXELS, hall->take->scale * 7);
    g_byte_array_unref(got);
    g_free(expected);
}

/* Room that takes may not use is not for maps either; what needs none is served. */
static void maps_leave_the_reserve_free(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    static char red[] = "R";
    uint32_t number, light = 0;
    a_fetch(&fetch, hall);
    fetch.lights = &light;
    fetch.n_lights = 1;
    g_byte_array_unref(fetched(hall, &fetch, &number));
    g_assert_cmpuint(number, ==, 0);
    fetch.channel = red;
    fetch.model = LIGHTSTAGE__MODEL__SPHERE;
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    char *text = refusal_of_fetch(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_STORAGE_FULL);
    g_assert_nonnull(strstr(text, "stay reserved"));
    g_free(text);
}

/* ---- takes ---- */

static void a_take_is_listed_shown_and_verified(struct hall *hall, gconstpointer data)
{
    Lightstage__TakeShow show = LIGHTSTAGE__TAKE_SHOW__INIT;
    Lightstage__TakeVerify verify = LIGHTSTAGE__TAKE_VERIFY__INIT;
    Lightstage__TakeList list = LIGHTSTAGE__TAKE_LIST__INIT;
    struct ls_reply reply;
    g_assert_cmpint(
        ls_connection_call(hall->client, LS_MESSAGE_TAKE_LIST, &list.base, NULL, 0, &reply, NULL),
        ==, LS_OK);
    g_assert_cmpuint(((const Lightstage__TakeListReply *)reply.message)->n_takes, ==, 1);
    ls_reply_finish(&reply);
    show.take = verify.take = hall->take->id;
    g_assert_cmpint(
        ls_connection_call(hall->client, LS_MESSAGE_TAKE_SHOW, &show.base, NULL, 0, &reply, NULL),
        ==, LS_OK);
    const Lightstage__TakeSummary *s = ((const Lightstage__TakeShowReply *)reply.message)->summary;
    g_assert_cmpstr(s->state, ==, "complete");
    g_assert_cmpuint(s->n_lights, ==, TAKE_LIGHTS);
    g_assert_cmpuint(s->width, ==, TAKE_W);
    g_assert_nonnull(g_strstr_len((const char *)reply.payload, (gssize)reply.payload_bytes,
                                  "reference_exposure_s"));
    ls_reply_finish(&reply);
    g_assert_cmpint(ls_connection_call(hall->client, LS_MESSAGE_TAKE_VERIFY, &verify.base, NULL, 0,
                                       &reply, NULL),
                    ==, LS_OK);
    g_assert_cmpuint(((const Lightstage__TakeVerifyReply *)reply.message)->conditions_damaged, ==,
                     0);
    ls_reply_finish(&reply);
}

static void a_damaged_picture_is_refused(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t number;
    char *path = g_build_filename(hall->stage.storage, hall->take->id, "cam0", "W-0000.exr", NULL);
    g_assert_true(g_file_set_contents(path, "not a picture", -1, NULL));
    a_fetch(&fetch, hall);
    g_byte_array_unref(fetched(hall, &fetch, &number));
    g_assert_cmpuint(number / 100, ==, 4);
    g_free(path);
}

/* The sentence of the refusal, or "" if the relight was answered. */
static char *refusal_of(struct hall *hall, const struct relight *r, uint32_t *number)
{
    struct ls_diag diag = {0};
    uint32_t request = send_request(hall, LS_MESSAGE_RELIGHT, &r->body.base, r->weights,
                                    r->n_rows * TAKE_LIGHTS * sizeof(float));
    for (bool last = false; !last;) {
        struct ls_reply reply;
        if (ls_connection_receive(hall->client, request, &reply, &diag))
            break;
        last = reply.last;
        ls_reply_finish(&reply);
    }
    *number = diag.text[0] ? ls_connection_error(hall->client) : 0;
    return g_strdup(diag.text);
}

static void a_picture_cut_short_between_two_relights_is_named(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    char *path = g_build_filename(hall->stage.storage, hall->take->id, "cam0", "W-0002.exr", NULL);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpint(truncate(path, 5000), ==, 0);
    char *text = refusal_of(hall, &r, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_DAMAGED);
    g_assert_nonnull(strstr(text, "W-0002.exr"));
    g_free(text);
    g_assert_cmpint(unlink(path), ==, 0);
    text = refusal_of(hall, &r, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_DAMAGED);
    g_assert_nonnull(strstr(text, "W-0002.exr: No such file"));
    g_free(text);
    g_free(path);
    ls_connection_close(hall->client); /* the daemon lives */
    hall->client = a_client(&hall->stage);
}

/* The file is cut while the source is open, after its length was looked at: the pages are gone
 * under the mapping. */
static void a_picture_cut_short_under_the_mapping_is_named(struct hall *hall, gconstpointer data)
{
    struct ls_field_source *source = NULL;
    struct ls_diag diag = {0};
    float pixels[64];
    char *path = g_build_filename(hall->stage.storage, hall->take->id, "cam0", "W-0002.exr", NULL);
    g_assert_cmpint(ls_field_source_open(hall->stage.storage, hall->take->id, 0, &source, &diag),
                    ==, LS_OK);
    const struct ls_picture_map *cut = ls_field_source_picture(source, 0, 2, NULL);
    const struct ls_picture_map *other = ls_field_source_picture(source, 0, 3, NULL);
    g_assert_cmpint(ls_field_source_sound(source, true, &diag), ==, LS_OK);
    g_assert_cmpint(truncate(path, 5000), ==, 0);
    ls_picture_map_read(other, 0, TAKE_H - 1, 64, 1, 1, pixels);
    g_assert_cmpint(ls_field_source_sound(source, false, &diag), ==, LS_OK);
    ls_picture_map_read(cut, 0, TAKE_H - 1, 64, 1, 1, pixels);
    g_assert_cmpfloat(pixels[0], ==, 0);
    g_assert_cmpint(ls_field_source_sound(source, false, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "W-0002.exr"));
    g_assert_true(ls_picture_map_sound(other));
    ls_field_source_close(source);
    g_free(path);
}

static void a_bus_error_elsewhere_still_ends_the_process(void)
{
    if (!g_test_subprocess()) {
        g_test_trap_subprocess(NULL, 0, 0);
        g_test_trap_assert_failed();
        return;
    }
    char *path = NULL, bytes[64] = "some bytes";
    struct ls_map_guard guard;
    int fd = g_file_open_tmp("lightstage-XXXXXX", &path, NULL);
    unlink(path);
    ls_map_guard_add(&guard, bytes, 1); /* of this stack's page: not what faults */
    g_assert_cmpint(ftruncate(fd, 1), ==, 0);
    volatile char *mapped = mmap(NULL, 1, PROT_READ, MAP_SHARED, fd, 0);
    g_assert_true(mapped != MAP_FAILED);
    g_assert_cmpint(ftruncate(fd, 0), ==, 0);
    exit(mapped[0]);
}

static void an_uncalibrated_take_is_served_as_stored(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    float *expected = g_new0(float, 3 * TAKE_PIXELS);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    memset(r.weights + TAKE_LIGHTS, 0, TAKE_LIGHTS * sizeof(float));
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    add(expected, hall->take, r.weights, NULL, -1);
    assert_close(got, expected, 3 * TAKE_PIXELS, 7);
    g_byte_array_unref(got);
    g_free(expected);
}

/* ---- slow clients ---- */

/* A client asks for everything, reads nothing, and is closed in time; another works meanwhile. */
static void a_stalled_client_holds_nobody_up(struct hall *hall, gconstpointer data)
{
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    Lightstage__Fetch fetch;
    uint32_t lights[24], number;
    int stalled[8];
    uint8_t *bytes = NULL;
    size_t n = 0;
    hello.version = LS_FRAME_VERSION;
    for (int i = 0; i < 24; i++)
        lights[i] = (uint32_t)i % TAKE_LIGHTS;
    a_fetch(&fetch, hall);
    fetch.lights = lights;
    fetch.n_lights = 24;
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB; /* 6 MB of answer per request */
    for (size_t k = 0; k < G_N_ELEMENTS(stalled); k++) {
        int fd = a_bare_socket(&hall->stage);
        g_assert_cmpint(ls_message_frame(LS_MESSAGE_HELLO, 1, 1, &hello.base, 0, &bytes, &n, NULL),
                        ==, LS_OK);
        g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
        free(bytes);
        g_assert_cmpint(ls_message_frame(LS_MESSAGE_FETCH, 2, 1, &fetch.base, 0, &bytes, &n, NULL),
                        ==, LS_OK);
        g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
        free(bytes);
        stalled[k] = fd;
    }
    GByteArray *got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpuint(got->len, ==, 12u * TAKE_PIXELS * 24);
    g_byte_array_unref(got);
    wait_for_connections(&hall->stage, 1);
    for (size_t k = 0; k < G_N_ELEMENTS(stalled); k++)
        close(stalled[k]);
}

static void a_client_that_leaves_in_the_middle_frees_its_job(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    a_fetch(&fetch, hall);
    for (int k = 0; k < 20; k++) {
        struct ls_connection *client = a_client(&hall->stage);
        struct ls_reply reply;
        uint32_t request;
        g_assert_cmpint(
            ls_connection_send(client, LS_MESSAGE_FETCH, &fetch.base, NULL, 0, &request, NULL), ==,
            LS_OK);
        if (k % 2)
            g_assert_cmpint(ls_connection_receive(client, request, &reply, NULL), ==, LS_OK);
        if (k % 2)
            ls_reply_finish(&reply);
        ls_connection_close(client);
    }
    wait_for_connections(&hall->stage, 1);
}

static void cancel_ends_a_fetch(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    Lightstage__Cancel cancel = LIGHTSTAGE__CANCEL__INIT;
    uint32_t lights[4096] = {0}, number, cancel_request;
    a_fetch(&fetch, hall);
    fetch.lights = lights;
    fetch.n_lights = 4096;
    cancel.request = send_request(hall, LS_MESSAGE_FETCH, &fetch.base, NULL, 0);
    cancel_request = send_request(hall, LS_MESSAGE_CANCEL, &cancel.base, NULL, 0);
    g_assert_cmpuint(cancel_request, !=, cancel.request);
    GByteArray *got = receive_all(hall, cancel.request, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_CANCELLED);
    g_assert_cmpuint(got->len, <, 4096u * 4 * TAKE_PIXELS);
    g_byte_array_unref(got);
}

static void too_many_requests_in_flight_are_refused(struct hall *hall, gconstpointer data)
{
    Lightstage__TakeVerify verify = LIGHTSTAGE__TAKE_VERIFY__INIT;
    uint32_t refused = 0, done = 0;
    verify.take = hall->take->id;
    for (int i = 0; i < 40; i++)
        send_request(hall, LS_MESSAGE_TAKE_VERIFY, &verify.base, NULL, 0);
    while (refused + done < 40) {
        struct ls_reply reply;
        enum ls_err err = ls_connection_receive(hall->client, 0, &reply, NULL);
        if (err == LS_ERR_REFUSED) {
            g_assert_cmpuint(ls_connection_error(hall->client), ==, LS_PROTO_TOO_MANY);
            refused++;
            continue;
        }
        g_assert_cmpint(err, ==, LS_OK);
        ls_reply_finish(&reply);
        done++;
    }
    g_assert_cmpuint(done, >=, 8);
    g_assert_cmpuint(refused, >, 0);
}

#define ADD(name, setup, function) \
    g_test_add("/serving/" name, struct hall, NULL, setup, function, leave)

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
    ADD("stored-halves-come-bit-for-bit", with_take, stored_halves_come_bit_for_bit);
    ADD("reflectance-carries-gain-and-scale", with_take, reflectance_carries_gain_and_scale);
    ADD("a-promoted-fetch-is-white-times-the-ratio", with_take,
        a_promoted_fetch_is_white_times_the_ratio);
    ADD("a-picture-outside-the-plan-is-not-called-missing", with_take,
        a_picture_outside_the_plan_is_not_called_missing);
    ADD("all-lights-come-when-none-is-named", with_take, all_lights_come_when_none_is_named);
    ADD("maps-leave-the-reserve-free", with_take_on_a_full_disk, maps_leave_the_reserve_free);
    ADD("a-full-sphere-needs-its-calibrated-duty", with_take,
        a_full_sphere_needs_its_calibrated_duty);
    ADD("a-take-is-listed-shown-and-verified", with_take, a_take_is_listed_shown_and_verified);
    ADD("a-damaged-picture-is-refused", with_take, a_damaged_picture_is_refused);
    ADD("a-picture-cut-short-between-two-relights-is-named", with_take,
        a_picture_cut_short_between_two_relights_is_named);
    ADD("a-picture-cut-short-under-the-mapping-is-named", with_take,
        a_picture_cut_short_under_the_mapping_is_named);
    g_test_add_func("/serving/a-bus-error-elsewhere-still-ends-the-process",
                    a_bus_error_elsewhere_still_ends_the_process);
    ADD("an-uncalibrated-take-is-served-as-stored", with_uncalibrated_take,
        an_uncalibrated_take_is_served_as_stored);
    ADD("a-stalled-client-holds-nobody-up", with_take, a_stalled_client_holds_nobody_up);
    ADD("a-client-that-leaves-in-the-middle-frees-its-job", with_take,
        a_client_that_leaves_in_the_middle_frees_its_job);
    ADD("cancel-ends-a-fetch", with_take, cancel_ends_a_fetch);
    ADD("too-many-requests-in-flight-are-refused", with_take,
        too_many_requests_in_flight_are_refused);
    return g_test_run();
}

/* serving: what is fetched of a take over the wire is what core makes of its pictures. */
#include "core/half.h"
#include "core/merge_variance.h"
#include "proto/errors.h"
#include "tests/daemon/serving_fixture.h"

#include <string.h>

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
    add_lights(expected, hall->take, one, ratio, -1);
    assert_close(got, expected, 3 * TAKE_PIXELS, hall->take->scale);
    g_byte_array_unref(got);
    g_free(expected);
    g_free(ratio);
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

/* ---- validity and variance ---- */

/* A region that no tile, band or colour starts with, and two bands high. */
enum { QX = 37, QY = 61, QW = 101, QH = 70, QN = QW * QH };

/* What came of some pictures, put together from their bands. */
struct quality {
    uint32_t n; /* pictures */
    float e[2][QN], variance[2][QN];
    uint8_t validity[2][QN];
};

static void put_band(struct quality *q, const struct ls_reply *reply)
{
    const Lightstage__FetchReply *band = (const Lightstage__FetchReply *)reply->message;
    size_t n = (size_t)band->width * band->n_rows, at = (size_t)band->first_row * QW;
    g_assert_cmpuint(reply->payload_bytes, ==, n * (2 * sizeof(float) + 1));
    g_assert_cmpuint(band->width, ==, QW);
    g_assert_true(band->variance && band->validity);
    memcpy(q->e[q->n] + at, reply->payload, n * 4);
    memcpy(q->variance[q->n] + at, reply->payload + n * 4, n * 4);
    memcpy(q->validity[q->n] + at, reply->payload + n * 8, n);
    q->n += band->first_row + band->n_rows == QH;
}

static struct quality *receive_quality(struct hall *hall, const Lightstage__Fetch *fetch)
{
    struct quality *q = g_new0(struct quality, 1);
    uint32_t request = send_request(hall, LS_MESSAGE_FETCH, &fetch->base, NULL, 0);
    for (bool last = false; !last;) {
        struct ls_reply reply;
        g_assert_cmpint(ls_connection_receive(hall->client, request, &reply, NULL), ==, LS_OK);
        put_band(q, &reply);
        last = reply.last;
        ls_reply_finish(&reply);
    }
    return q;
}

/* @gain: of the values sent. The numbers are those of the take's take.json. */
static void check_quality(const struct quality *q, int k, int light, double gain)
{
    const struct ls_merge_params params = {.n_exposures = 2,
                                           .exposure_s = {TAKE_SHORT_S, TAKE_LONG_S},
                                           .range_low = 0.1,
                                           .range_high = 0.85,
                                           .full_scale_dn = 4095,
                                           .electrons_per_dn = 10,
                                           .read_noise_dn = 2};
    double unit = gain * TAKE_REFERENCE_S;
    int flagged = 0;
    for (int p = 0; p < QN; p++) {
        float e = (float)((double)q->e[k][p] / unit), variance;
        int pixel = (QY + p / QW) * TAKE_W + QX + p % QW;
        ls_merge_variance(&params, 64, &e, 1, &variance);
        /* float arithmetic in another order; no value lies at an edge of the range */
        g_assert_cmpfloat_with_epsilon((double)q->variance[k][p] / (unit * unit * (double)variance),
                                       1, 1e-5);
        g_assert_cmpuint(q->validity[k][p], ==, made_validity(light, pixel));
        flagged += q->validity[k][p] != LS_VALIDITY_OK;
    }
    g_assert_true((flagged > 0) == (light == TAKE_FLAGGED));
}

static void validity_and_variance_come_with_the_pixels(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    Lightstage__Region region = LIGHTSTAGE__REGION__INIT;
    uint32_t lights[2] = {TAKE_FLAGGED, 5};
    static char first[] = "W-0002", second[] = "W-0005", none[] = "";
    char *names[] = {first, second};
    const struct made_take *take = hall->take;
    a_fetch(&fetch, hall);
    region.x = QX;
    region.y = QY;
    region.width = QW;
    region.height = QH;
    fetch.region = &region;
    fetch.lights = lights;
    fetch.n_lights = 2;
    fetch.variance = fetch.validity = true;
    struct quality *gained = receive_quality(hall, &fetch);
    for (int k = 0; k < 2; k++)
        check_quality(gained, k, (int)lights[k], take->scale * take->k[0][lights[k]]);
    g_free(gained);
    fetch.quantity = LIGHTSTAGE__QUANTITY__ESTIMATE;
    struct quality *stored = receive_quality(hall, &fetch);
    for (int k = 0; k < 2; k++)
        check_quality(stored, k, (int)lights[k], 1);
    fetch.channel = none;
    fetch.n_lights = 0;
    fetch.conditions = names;
    fetch.n_conditions = 2;
    struct quality *named = receive_quality(hall, &fetch);
    g_assert_cmpmem(named, sizeof *named, stored, sizeof *stored);
    g_free(named);
    g_free(stored);
}

static void what_is_made_of_several_pixels_has_no_validity(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t number;
    a_fetch(&fetch, hall);
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    for (int k = 0; k < 2; k++) {
        fetch.variance = k == 0;
        fetch.validity = k == 1;
        char *text = refusal_of_fetch(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, LS_PROTO_UNSUPPORTED);
        g_assert_nonnull(strstr(text, "ask for the mosaic"));
        g_free(text);
    }
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

static void an_uncalibrated_take_is_served_as_stored(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    float *expected = g_new0(float, 3 * TAKE_PIXELS);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    memset(r.weights + TAKE_LIGHTS, 0, TAKE_LIGHTS * sizeof(float));
    GByteArray *got = relit(hall, &r, &number);
    g_assert_cmpuint(number, ==, 0);
    add_lights(expected, hall->take, r.weights, NULL, -1);
    assert_close(got, expected, 3 * TAKE_PIXELS, 7);
    g_byte_array_unref(got);
    g_free(expected);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("stored-halves-come-bit-for-bit", with_take, stored_halves_come_bit_for_bit);
    ADD("reflectance-carries-gain-and-scale", with_take, reflectance_carries_gain_and_scale);
    ADD("a-promoted-fetch-is-white-times-the-ratio", with_take,
        a_promoted_fetch_is_white_times_the_ratio);
    ADD("a-picture-outside-the-plan-is-not-called-missing", with_take,
        a_picture_outside_the_plan_is_not_called_missing);
    ADD("all-lights-come-when-none-is-named", with_take, all_lights_come_when_none_is_named);
    ADD("validity-and-variance-come-with-the-pixels", with_take,
        validity_and_variance_come_with_the_pixels);
    ADD("what-is-made-of-several-pixels-has-no-validity", with_take,
        what_is_made_of_several_pixels_has_no_validity);
    ADD("maps-leave-the-reserve-free", with_take_on_a_full_disk, maps_leave_the_reserve_free);
    ADD("a-full-sphere-needs-its-calibrated-duty", with_take,
        a_full_sphere_needs_its_calibrated_duty);
    ADD("an-uncalibrated-take-is-served-as-stored", with_uncalibrated_take,
        an_uncalibrated_take_is_served_as_stored);
    return g_test_run();
}

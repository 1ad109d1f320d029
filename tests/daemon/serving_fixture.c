#include "tests/daemon/serving_fixture.h"

#include "core/demosaic.h"

#include <math.h>
#include <string.h>

/* @stall_ms: 0 = the default. */
static void open_hall(struct hall *hall, bool calibrated, int missing, uint64_t spare_bytes,
                      unsigned stall_ms)
{
    stage_init(&hall->stage);
    hall->stage.limits.spare_bytes = spare_bytes;
    hall->stage.limits.stall_ms = stall_ms;
    hall->take = make_take(hall->stage.storage, calibrated, missing);
    stage_open(&hall->stage);
    hall->client = a_client(&hall->stage);
}

void with_take(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, -1, 0, 0);
}

void with_take_and_little_patience(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, -1, 0, 400);
}

void with_take_on_a_full_disk(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, -1, UINT64_C(1) << 60, 0);
}

void with_take_lacking_light_3(struct hall *hall, gconstpointer data)
{
    open_hall(hall, true, 3, 0, 0);
}

void with_uncalibrated_take(struct hall *hall, gconstpointer data)
{
    open_hall(hall, false, -1, 0, 0);
}

void leave(struct hall *hall, gconstpointer data)
{
    ls_connection_close(hall->client);
    stage_close(&hall->stage);
    made_take_free(hall->take);
}

uint32_t send_request(struct hall *hall, uint16_t type, const ProtobufCMessage *body,
                      const void *payload, size_t n)
{
    uint32_t request = 0;
    g_assert_cmpint(ls_connection_send(hall->client, type, body, payload, n, &request, NULL), ==,
                    LS_OK);
    return request;
}

GByteArray *receive_all(struct hall *hall, uint32_t request, uint32_t *number)
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

void a_relight(struct relight *r, const struct hall *hall, Lightstage__WeightMode mode)
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

GByteArray *relit(struct hall *hall, const struct relight *r, uint32_t *number)
{
    return receive_all(hall,
                       send_request(hall, LS_MESSAGE_RELIGHT, &r->body.base, r->weights,
                                    r->n_rows * TAKE_LIGHTS * sizeof(float)),
                       number);
}

void demosaic(const float *mosaic, float *rgb)
{
    struct ls_demosaic_source source = {mosaic, TAKE_W, {0, 0, TAKE_W, TAKE_H},
                                        TAKE_W, TAKE_H, LS_CFA_RGGB};
    struct ls_demosaic_target target = {{rgb, rgb + 1, rgb + 2}, 3, 3 * TAKE_W};
    g_assert_cmpint(ls_demosaic(&source, (struct ls_demosaic_region){0, 0, TAKE_W, TAKE_H},
                                LS_DEMOSAIC_GRADIENT, &target),
                    ==, LS_OK);
}

float *summed(const struct made_take *take, const double w[TAKE_LIGHTS])
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

float *ratio_of_red(const struct made_take *take)
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

void add_lights(float *out, const struct made_take *take, const float *weights, const float *ratio,
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

void assert_close(const GByteArray *got, const float *expected, size_t n, double scale)
{
    const float *values = (const float *)(const void *)got->data;
    g_assert_cmpuint(got->len, ==, n * sizeof(float));
    for (size_t i = 0; i < n; i++)
        if (!(fabs((double)values[i] - (double)expected[i]) <= 2e-5 * scale))
            g_error("value %zu (row %zu) is %g, expected %g", i, i / (3 * TAKE_W),
                    (double)values[i], (double)expected[i]);
}

void a_fetch(Lightstage__Fetch *fetch, const struct hall *hall)
{
    static char white[] = "W";
    lightstage__fetch__init(fetch);
    fetch->take = hall->take->id;
    fetch->channel = white;
}

GByteArray *fetched(struct hall *hall, const Lightstage__Fetch *fetch, uint32_t *number)
{
    return receive_all(hall, send_request(hall, LS_MESSAGE_FETCH, &fetch->base, NULL, 0), number);
}

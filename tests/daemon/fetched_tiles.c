#include "tests/daemon/fetched_tiles.h"

#include <string.h>

void tiles_finish(struct tiles *t)
{
    g_array_unref(t->number);
    g_array_unref(t->hash);
    g_array_unref(t->unchanged);
    g_byte_array_unref(t->bytes);
}

static void note_frame(struct tiles *t, const struct ls_reply *reply)
{
    const Lightstage__FetchReply *body = (const Lightstage__FetchReply *)reply->message;
    g_assert_cmpuint(body->width, ==, TAKE_W);
    g_assert_cmpuint(body->height, ==, TAKE_H);
    g_assert_cmpuint(body->n_rows, ==, 0);
    g_assert_cmpuint(body->n_tile, >, 0);
    g_assert_cmpuint(body->n_tile_hash, ==, body->n_tile);
    g_assert_true(body->n_tile_unchanged == 0 || body->n_tile_unchanged == body->n_tile);
    if (t->number->len == 0)
        t->first = body->first_tile;
    g_assert_cmpuint(body->first_tile, ==, t->first + t->number->len);
    t->pictures += body->spectrum != NULL;
    t->error_bound = body->error_bound;
    g_assert_true(reply->last || body->error_bound == 0);
    g_array_append_vals(t->number, body->tile, (guint)body->n_tile);
    g_array_append_vals(t->hash, body->tile_hash, (guint)body->n_tile);
    for (size_t i = 0; i < body->n_tile; i++) {
        uint32_t unchanged = body->n_tile_unchanged && body->tile_unchanged[i];
        g_array_append_val(t->unchanged, unchanged);
    }
    if (reply->payload_bytes)
        g_byte_array_append(t->bytes, reply->payload, (guint)reply->payload_bytes);
}

void fetch_tiles(struct hall *hall, Lightstage__Fetch *fetch, const uint64_t *have, size_t n,
                 struct tiles *t)
{
    *t = (struct tiles){.number = g_array_new(FALSE, FALSE, 4),
                        .hash = g_array_new(FALSE, FALSE, 8),
                        .unchanged = g_array_new(FALSE, FALSE, 4),
                        .bytes = g_byte_array_new()};
    fetch->tiles = true;
    uint32_t request = send_request(hall, LS_MESSAGE_FETCH, &fetch->base, have, n * sizeof *have);
    for (bool last = false; !last;) {
        struct ls_reply reply;
        struct ls_diag diag = {0};
        if (ls_connection_receive(hall->client, request, &reply, &diag)) {
            g_test_message("refused: %s", diag.text);
            t->refused = ls_connection_error(hall->client);
            break;
        }
        note_frame(t, &reply);
        last = reply.last;
        ls_reply_finish(&reply);
    }
    fetch->tiles = false;
}

uint8_t *cut_tile(const uint8_t *picture, uint32_t number, size_t pixel)
{
    uint8_t *tile = g_malloc0(SIDE * SIDE * pixel);
    uint32_t x = number % ACROSS * SIDE, y = number / ACROSS * SIDE;
    uint32_t w = MIN(SIDE, TAKE_W - x), h = MIN(SIDE, TAKE_H - y);
    for (uint32_t r = 0; r < h; r++)
        memcpy(tile + r * SIDE * pixel, picture + ((y + r) * TAKE_W + x) * pixel, w * pixel);
    return tile;
}

const struct way ways[N_WAYS] = {
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__MOSAIC, LIGHTSTAGE__QUANTITY__ESTIMATE,
     LIGHTSTAGE__SAMPLE__HALF, false},
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__MOSAIC, LIGHTSTAGE__QUANTITY__ESTIMATE,
     LIGHTSTAGE__SAMPLE__FLOAT, false},
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__MOSAIC,
     LIGHTSTAGE__QUANTITY__REFLECTANCE, LIGHTSTAGE__SAMPLE__HALF, false},
    {"R", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__MOSAIC, LIGHTSTAGE__QUANTITY__ESTIMATE,
     LIGHTSTAGE__SAMPLE__HALF, true},
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__ESTIMATE,
     LIGHTSTAGE__SAMPLE__HALF, false},
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     LIGHTSTAGE__SAMPLE__FLOAT, false},
    {"R", LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     LIGHTSTAGE__SAMPLE__HALF, false},
    {"R", LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     LIGHTSTAGE__SAMPLE__FLOAT, false},
};

void ask_for(Lightstage__Fetch *fetch, const struct hall *hall, const struct way *way,
             uint32_t *lights)
{
    a_fetch(fetch, hall);
    fetch->channel = (char *)way->channel;
    fetch->model = way->model;
    fetch->layout = way->layout;
    fetch->quantity = way->quantity;
    fetch->sample = way->sample;
    fetch->full_sphere = way->full_sphere;
    fetch->lights = lights;
    fetch->n_lights = way->full_sphere ? 0 : 2;
}

size_t pixel_of(const struct way *way)
{
    return (way->layout == LIGHTSTAGE__LAYOUT__RGB ? 3 : 1) *
           (way->sample == LIGHTSTAGE__SAMPLE__HALF ? 2 : 4);
}

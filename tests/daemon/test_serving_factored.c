/* serving_factored: what a client makes of white and ratios is what the daemon sends as halves. */
#include "core/factored.h"
#include "core/half.h"
#include "proto/errors.h"
#include "tests/daemon/full_take.h"
#include "tests/daemon/server_fixture.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

enum { MOST = 8 };

struct room {
    struct stage stage;
    struct full_take *take;
    struct ls_connection *client;
    Lightstage__Fetch fetch;
    Lightstage__Region region;
    uint32_t lights[2];
    char *spectra[MOST];
};

static void enter(struct room *room, gconstpointer data)
{
    static const struct full_take_options plain;
    stage_init(&room->stage);
    room->take = make_full_take(data ? data : &plain);
    g_autofree char *from = g_build_filename(room->take->root, room->take->id, NULL);
    g_autofree char *to = g_build_filename(room->stage.storage, room->take->id, NULL);
    g_assert_cmpint(symlink(from, to), ==, 0);
    stage_open(&room->stage);
    room->client = a_client(&room->stage);
    lightstage__region__init(&room->region);
    lightstage__fetch__init(&room->fetch);
    room->lights[0] = 7;
    room->lights[1] = 0;
    room->spectra[0] = (char *)"R";
    room->fetch.take = room->take->id;
    room->fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    room->fetch.sample = LIGHTSTAGE__SAMPLE__HALF;
    room->fetch.model = LIGHTSTAGE__MODEL__SPHERE;
    room->fetch.region = &room->region;
    room->fetch.lights = room->lights;
    room->fetch.n_lights = 2;
    room->fetch.factored = true;
    room->fetch.spectra = room->spectra;
    room->fetch.n_spectra = 1;
}

static void leave(struct room *room, gconstpointer data)
{
    ls_connection_close(room->client);
    stage_close(&room->stage);
    full_take_free(room->take);
}

struct picture {
    Lightstage__Factor factor;
    uint32_t light;
    float gain;
    char channel[32]; /* of its report */
    GByteArray *bytes;
};

/* All pictures, whatever they come in. *number: 0, or the refusal's. */
static uint32_t fetched(struct room *room, const Lightstage__Fetch *fetch, struct picture *out,
                        uint32_t *number)
{
    uint32_t request = 0, n = 0;
    *number = 0;
    g_assert_cmpint(
        ls_connection_send(room->client, LS_MESSAGE_FETCH, &fetch->base, NULL, 0, &request, NULL),
        ==, LS_OK);
    for (bool last = false; !last;) {
        struct ls_reply reply;
        struct ls_diag diag = {{0}};
        if (ls_connection_receive(room->client, request, &reply, &diag)) {
            g_test_message("refused: %s", diag.text);
            *number = ls_connection_error(room->client);
            break;
        }
        const Lightstage__FetchReply *body = (const Lightstage__FetchReply *)reply.message;
        if (body->spectrum) {
            g_assert_cmpuint(n, <, MOST);
            out[n] =
                (struct picture){.factor = body->factor, .light = body->light, .gain = body->gain};
            g_strlcpy(out[n].channel, body->spectrum->channel, sizeof out->channel);
            out[n++].bytes = g_byte_array_new();
        }
        g_byte_array_append(out[n - 1].bytes, reply.payload, (guint)reply.payload_bytes);
        last = reply.last;
        ls_reply_finish(&reply);
    }
    return n;
}

static void finish(struct picture *pictures, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        g_byte_array_unref(pictures[i].bytes);
}

static const uint16_t *halves(const struct picture *p)
{
    return (const uint16_t *)(const void *)p->bytes->data;
}

/* Ratio, then the lights as asked for; multiplied, they are the lights under R. */
static void assert_expands(struct room *room)
{
    struct picture parts[MOST], whole[MOST];
    uint32_t number;
    Lightstage__Fetch plain = room->fetch;
    g_assert_cmpuint(fetched(room, &room->fetch, parts, &number), ==, 3);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpint(parts[0].factor, ==, LIGHTSTAGE__FACTOR__RATIO);
    g_assert_cmpstr(parts[0].channel, ==, "R");
    plain.factored = false;
    plain.n_spectra = 0;
    plain.channel = (char *)"R";
    g_assert_cmpuint(fetched(room, &plain, whole, &number), ==, 2);
    for (uint32_t i = 0; i < 2; i++) {
        const struct picture *white = &parts[1 + i];
        size_t n = white->bytes->len / 2;
        g_assert_cmpint(white->factor, ==, LIGHTSTAGE__FACTOR__WHITE);
        g_assert_cmpint(whole[i].factor, ==, LIGHTSTAGE__FACTOR__WHOLE);
        g_assert_cmpuint(white->light, ==, room->lights[i]);
        g_assert_cmpstr(white->channel, ==, "W");
        g_assert_cmpuint(parts[0].bytes->len, ==, 2 * n);
        g_autofree uint16_t *out = g_new(uint16_t, n);
        g_assert_cmpuint(ls_factored_expand(halves(white), white->gain, halves(&parts[0]), n, out),
                         ==, 0);
        g_assert_cmpmem(whole[i].bytes->data, whole[i].bytes->len, out, 2 * n);
    }
    finish(parts, 3);
    finish(whole, 2);
}

static void a_client_expands_what_the_daemon_says(struct room *room, gconstpointer data)
{
    static const Lightstage__Model models[] = {LIGHTSTAGE__MODEL__SPHERE,
                                               LIGHTSTAGE__MODEL__HEADLIGHT};
    for (int k = 0; k < 8; k++) {
        bool cut = k & 2;
        room->fetch.model = models[k % 2];
        room->region.x = cut ? 5 : 0;
        room->region.y = cut ? 61 : 0;
        room->region.width = cut ? 100 : 0;
        room->region.height = cut ? 70 : 0;
        room->fetch.tiles = k & 4;
        assert_expands(room);
    }
}

/* One rounding of white as it is sent, another of the product. */
static void white_itself_is_within_two_roundings(struct room *room, gconstpointer data)
{
    struct picture parts[MOST], whole[MOST];
    uint32_t number;
    Lightstage__Fetch plain = room->fetch;
    g_assert_cmpuint(fetched(room, &room->fetch, parts, &number), ==, 3);
    plain.factored = false;
    plain.n_spectra = 0;
    plain.channel = (char *)"W";
    plain.sample = LIGHTSTAGE__SAMPLE__FLOAT;
    g_assert_cmpuint(fetched(room, &plain, whole, &number), ==, 2);
    size_t n = parts[1].bytes->len / 2;
    g_autofree uint16_t *out = g_new(uint16_t, n);
    g_assert_cmpuint(ls_factored_expand(halves(&parts[1]), parts[1].gain, NULL, n, out), ==, 0);
    double floor = 0x1p-24 * (1 + (double)parts[1].gain), worst = 0;
    for (size_t j = 0; j < n; j++) {
        float f;
        memcpy(&f, whole[0].bytes->data + 4 * j, sizeof f);
        double d = fabs((double)ls_half_to_float(out[j]) - (double)f) - floor;
        worst = fmax(worst, d / fmax(fabs((double)f), 1e-9));
    }
    g_test_message("apart by %.3g", worst);
    g_assert_cmpfloat(worst, <=, 0x1p-10);
    finish(parts, 3);
    finish(whole, 2);
}

struct bounded {
    GByteArray *bytes; /* of all pictures; of what stays away, 0 */
    double gain[MOST], error_bound;
    uint32_t n_away;
};

static void keep_tiles(struct bounded *b, const struct ls_reply *reply)
{
    enum { BYTES = 64 * 64 * 3 * 2 };
    const Lightstage__FetchReply *body = (const Lightstage__FetchReply *)reply->message;
    const uint8_t *at = reply->payload;
    g_autofree uint8_t *none = g_malloc0(BYTES);
    for (size_t i = 0; i < body->n_tile; i++) {
        bool away = body->tile_hash[i] == 0;
        g_byte_array_append(b->bytes, away ? none : at, BYTES);
        at += away ? 0 : BYTES;
        b->n_away += away;
        g_assert_false(away && body->factor == LIGHTSTAGE__FACTOR__RATIO);
    }
    g_assert_true(at == reply->payload + reply->payload_bytes);
    b->error_bound = body->error_bound;
}

static void in_tiles(struct room *room, Lightstage__Fetch fetch, struct bounded *b)
{
    uint32_t request = 0, n = 0;
    *b = (struct bounded){.bytes = g_byte_array_new()};
    fetch.tiles = true;
    g_assert_cmpint(
        ls_connection_send(room->client, LS_MESSAGE_FETCH, &fetch.base, NULL, 0, &request, NULL),
        ==, LS_OK);
    for (bool last = false; !last;) {
        struct ls_reply reply;
        g_assert_cmpint(ls_connection_receive(room->client, request, &reply, NULL), ==, LS_OK);
        const Lightstage__FetchReply *body = (const Lightstage__FetchReply *)reply.message;
        if (body->spectrum)
            b->gain[n++] = (double)body->gain;
        keep_tiles(b, &reply);
        last = reply.last;
        ls_reply_finish(&reply);
    }
}

/* What a client makes of it, under the ratio or (NULL) alone, against what it makes of all. */
static double farthest(const struct bounded *some, const struct bounded *all, bool promoted)
{
    size_t n = all->bytes->len / 2 / 3; /* samples of a picture: R's ratio, then two lights */
    g_autofree uint16_t *a = g_new(uint16_t, n), *b = g_new(uint16_t, n);
    const uint16_t *s = (const uint16_t *)(const void *)some->bytes->data,
                   *w = (const uint16_t *)(const void *)all->bytes->data;
    double worst = 0;
    for (size_t i = 1; i < 3; i++) {
        g_assert_cmpuint(
            ls_factored_expand(s + i * n, (float)some->gain[i], promoted ? s : NULL, n, a), ==, 0);
        g_assert_cmpuint(
            ls_factored_expand(w + i * n, (float)all->gain[i], promoted ? w : NULL, n, b), ==, 0);
        for (size_t j = 0; j < n; j++)
            worst = fmax(worst, fabs((double)(ls_half_to_float(a[j]) - ls_half_to_float(b[j]))));
    }
    return worst;
}

/* Of white too: it is expanded by 1. */
static void a_bound_is_of_what_the_client_makes(struct room *room, gconstpointer data)
{
    struct bounded all, some;
    uint32_t most_away = 0;
    in_tiles(room, room->fetch, &all);
    g_assert_cmpuint(all.n_away, ==, 0);
    for (int k = -20; k < 10; k++) {
        room->fetch.max_error = ldexp(1, k);
        in_tiles(room, room->fetch, &some);
        g_assert_cmpuint(some.bytes->len, ==, all.bytes->len);
        double worst = fmax(farthest(&some, &all, true), farthest(&some, &all, false));
        g_assert_cmpfloat(worst, <=, some.error_bound);
        g_assert_cmpfloat(some.error_bound, <=, room->fetch.max_error);
        g_assert_cmpuint(some.n_away, >=, most_away);
        most_away = some.n_away;
        g_byte_array_unref(some.bytes);
    }
    g_assert_cmpuint(most_away, ==, 2 * 9); /* every tile of the lights */
    g_byte_array_unref(all.bytes);
}

/* What the wire carries: 2 lights and 5 ratios in place of 10 pictures. */
static void a_ratio_comes_once_for_all_lights(struct room *room, gconstpointer data)
{
    struct picture parts[MOST];
    uint32_t number;
    for (int k = 0; k < 5; k++)
        room->spectra[k] = (char *)"R";
    room->fetch.n_spectra = 5;
    g_assert_cmpuint(fetched(room, &room->fetch, parts, &number), ==, 7);
    for (uint32_t i = 0; i < 7; i++) {
        g_assert_cmpint(parts[i].factor, ==,
                        i < 5 ? LIGHTSTAGE__FACTOR__RATIO : LIGHTSTAGE__FACTOR__WHITE);
        g_assert_cmpuint(parts[i].light, ==, i < 5 ? i : room->lights[i - 5]);
        g_assert_cmpuint(parts[i].bytes->len, ==, 6 * FULL_PIXELS);
    }
    finish(parts, 7);
}

static void assert_refused(struct room *room, uint32_t expected)
{
    struct picture parts[MOST];
    uint32_t number, n = fetched(room, &room->fetch, parts, &number);
    g_assert_cmpuint(number, ==, expected);
    g_assert_cmpuint(n, ==, 0);
}

static void what_is_no_product_is_refused(struct room *room, gconstpointer data)
{
    static const Lightstage__Model others[] = {
        LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__MODEL__LINEAR, LIGHTSTAGE__MODEL__SEPARATED};
    const Lightstage__Fetch good = room->fetch;
    for (size_t i = 0; i < G_N_ELEMENTS(others); i++) {
        room->fetch.model = others[i];
        assert_refused(room, LS_PROTO_UNSUPPORTED);
    }
    room->fetch = good;
    room->fetch.level = 1;
    assert_refused(room, LS_PROTO_UNSUPPORTED);
    room->fetch = good;
    room->fetch.layout = LIGHTSTAGE__LAYOUT__MONO;
    assert_refused(room, LS_PROTO_UNSUPPORTED);
    room->fetch = good;
    room->fetch.sample = LIGHTSTAGE__SAMPLE__FLOAT;
    assert_refused(room, LS_PROTO_UNSUPPORTED);
    room->fetch = good;
    room->spectra[0] = (char *)"W"; /* is what is sent */
    assert_refused(room, LS_PROTO_UNSUPPORTED);
    room->spectra[0] = (char *)"no such";
    assert_refused(room, LS_PROTO_NOT_FOUND);
    room->spectra[0] = (char *)"R";
    room->fetch.channel = room->spectra[0];
    assert_refused(room, LS_PROTO_BAD_ARGUMENT);
    room->fetch = good;
    room->fetch.n_spectra = 0;
    assert_refused(room, LS_PROTO_BAD_ARGUMENT);
    room->fetch = good;
    room->fetch.factored = false;
    room->fetch.channel = room->spectra[0];
    assert_refused(room, LS_PROTO_BAD_ARGUMENT);
}

static void a_light_of_several_pictures_is_refused(struct room *room, gconstpointer data)
{
    assert_refused(room, LS_PROTO_UNSUPPORTED);
}

int main(int argc, char **argv)
{
    static const struct full_take_options mono = {.mono = true}, rows = {.multiplexed = true},
                                          coloured = {.coloured = true};
    g_test_init(&argc, &argv, NULL);
#define ADD(name, options, test) \
    g_test_add("/serving/" name, struct room, options, enter, test, leave)
    ADD("a-client-expands-what-the-daemon-says", NULL, a_client_expands_what_the_daemon_says);
    ADD("a-client-expands-what-a-mono-camera-saw", &mono, a_client_expands_what_the_daemon_says);
    ADD("white-itself-is-within-two-roundings", NULL, white_itself_is_within_two_roundings);
    ADD("a-bound-is-of-what-the-client-makes", NULL, a_bound_is_of_what_the_client_makes);
    ADD("a-ratio-comes-once-for-all-lights", NULL, a_ratio_comes_once_for_all_lights);
    ADD("what-is-no-product-is-refused", NULL, what_is_no_product_is_refused);
    ADD("a-light-of-several-pictures-is-refused", &rows, a_light_of_several_pictures_is_refused);
    ADD("lights-of-every-colour-are-refused", &coloured, a_light_of_several_pictures_is_refused);
    return g_test_run();
}

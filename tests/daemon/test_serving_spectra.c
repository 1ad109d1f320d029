/* serving_spectra: a fetch of several spectra is one fetch for each, light by light. */
#include "core/field.h"
#include "proto/errors.h"
#include "tests/daemon/serving_fixture.h"

#include <string.h>

enum { LIGHTS = 2, SPECTRA = 3 };

static char *names[SPECTRA] = {(char *)"R", (char *)"W", (char *)"R"};

static const struct form {
    Lightstage__Layout layout;
    Lightstage__Sample sample;
    uint32_t level;
    bool tiles, cropped;
    double max_error;
} forms[] = {
    {LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__SAMPLE__HALF, 0, false, false, 0},
    {LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__SAMPLE__FLOAT, 0, false, true, 0},
    {LIGHTSTAGE__LAYOUT__MONO, LIGHTSTAGE__SAMPLE__HALF, 1, false, true, 0},
    {LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__SAMPLE__HALF, 0, true, false, 0},
    {LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__SAMPLE__FLOAT, 0, true, true, 0},
    {LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__SAMPLE__HALF, 0, true, false, 100},
};

struct asked {
    Lightstage__Fetch fetch;
    Lightstage__Region region;
    uint32_t lights[LIGHTS];
};

static void ask_for(struct asked *a, const struct hall *hall, const struct form *form)
{
    a_fetch(&a->fetch, hall);
    lightstage__region__init(&a->region);
    if (form->cropped)
        a->region.x = 30, a->region.y = 50, a->region.width = 90, a->region.height = 33;
    a->lights[0] = 6;
    a->lights[1] = 1;
    a->fetch.channel = (char *)"";
    a->fetch.spectra = names;
    a->fetch.n_spectra = SPECTRA;
    a->fetch.model = LIGHTSTAGE__MODEL__SPHERE;
    a->fetch.layout = form->layout;
    a->fetch.sample = form->sample;
    a->fetch.level = form->level;
    a->fetch.tiles = form->tiles;
    a->fetch.max_error = form->max_error;
    a->fetch.region = &a->region;
    a->fetch.lights = a->lights;
    a->fetch.n_lights = LIGHTS;
}

/* One light under one spectrum. */
static GByteArray *alone(struct hall *hall, struct asked a, uint32_t light, uint32_t s)
{
    uint32_t number;
    a.fetch.channel = names[s];
    a.fetch.n_spectra = 0;
    a.fetch.lights = &light;
    a.fetch.n_lights = 1;
    GByteArray *bytes = fetched(hall, &a.fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    return bytes;
}

/* Every frame says what it is of; a picture's first has a report, which names it. */
static GByteArray *together(struct hall *hall, const struct asked *a)
{
    GByteArray *bytes = g_byte_array_new();
    uint32_t request = send_request(hall, LS_MESSAGE_FETCH, &a->fetch.base, NULL, 0), picture = 0;
    for (bool last = false; !last;) {
        struct ls_reply reply;
        g_assert_cmpint(ls_connection_receive(hall->client, request, &reply, NULL), ==, LS_OK);
        const Lightstage__FetchReply *body = (const Lightstage__FetchReply *)reply.message;
        picture += body->spectrum != NULL;
        g_assert_cmpuint(body->light, ==, a->lights[(picture - 1) / SPECTRA]);
        g_assert_cmpuint(body->spectrum_number, ==, (picture - 1) % SPECTRA);
        if (body->spectrum)
            g_assert_cmpstr(body->spectrum->channel, ==, names[body->spectrum_number]);
        if (reply.payload_bytes)
            g_byte_array_append(bytes, reply.payload, (guint)reply.payload_bytes);
        last = reply.last;
        ls_reply_finish(&reply);
    }
    g_assert_cmpuint(picture, ==, LIGHTS * SPECTRA);
    return bytes;
}

static void each_light_comes_under_one_after_the_other(struct hall *hall, gconstpointer data)
{
    for (size_t i = 0; i < G_N_ELEMENTS(forms); i++) {
        struct asked a;
        ask_for(&a, hall, &forms[i]);
        GByteArray *got = together(hall, &a);
        size_t at = 0;
        for (uint32_t k = 0; k < LIGHTS * SPECTRA; k++) {
            GByteArray *one = alone(hall, a, a.lights[k / SPECTRA], k % SPECTRA);
            g_assert_cmpuint(at + one->len, <=, got->len);
            g_assert_cmpmem(got->data + at, one->len, one->data, one->len);
            at += one->len;
            g_byte_array_unref(one);
        }
        g_assert_cmpuint(at, ==, got->len);
        g_byte_array_unref(got);
    }
}

static void full_spheres_come_one_after_the_other(struct hall *hall, gconstpointer data)
{
    struct asked a;
    uint32_t number;
    ask_for(&a, hall, &forms[0]);
    a.fetch.model = LIGHTSTAGE__MODEL__MEASURED;
    a.fetch.full_sphere = true;
    a.fetch.n_lights = 0;
    GByteArray *got = fetched(hall, &a.fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpuint(got->len, ==, SPECTRA * 6 * TAKE_PIXELS);
    for (uint32_t s = 0; s < SPECTRA; s++) {
        a.fetch.n_spectra = 0;
        a.fetch.channel = names[s];
        GByteArray *one = fetched(hall, &a.fetch, &number);
        g_assert_cmpmem(got->data + s * one->len, one->len, one->data, one->len);
        g_byte_array_unref(one);
    }
    g_byte_array_unref(got);
}

static void assert_refused(struct hall *hall, const struct asked *a, uint32_t expected)
{
    uint32_t number;
    g_byte_array_unref(fetched(hall, &a->fetch, &number));
    g_assert_cmpuint(number, ==, expected);
}

static void names_that_are_none_are_refused(struct hall *hall, gconstpointer data)
{
    char *bad[LS_FIELD_MAX_SPECTRA + 1];
    struct asked a;
    ask_for(&a, hall, &forms[0]);
    a.fetch.channel = (char *)"R";
    assert_refused(hall, &a, LS_PROTO_BAD_ARGUMENT);
    a.fetch.channel = (char *)"";
    a.fetch.spectra = bad;
    for (size_t s = 0; s < G_N_ELEMENTS(bad); s++)
        bad[s] = (char *)"R";
    a.fetch.n_spectra = G_N_ELEMENTS(bad);
    assert_refused(hall, &a, LS_PROTO_BAD_ARGUMENT);
    a.fetch.n_spectra = 2;
    bad[1] = (char *)"";
    assert_refused(hall, &a, LS_PROTO_BAD_ARGUMENT);
    bad[1] = (char *)"a name of more than 31 characters";
    assert_refused(hall, &a, LS_PROTO_BAD_ARGUMENT);
    bad[1] = (char *)"no such";
    assert_refused(hall, &a, LS_PROTO_NOT_FOUND);
    a.fetch.n_spectra = 0;
    assert_refused(hall, &a, LS_PROTO_BAD_ARGUMENT);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("each-light-comes-under-one-after-the-other", with_take,
        each_light_comes_under_one_after_the_other);
    ADD("full-spheres-come-one-after-the-other", with_take, full_spheres_come_one_after_the_other);
    ADD("names-that-are-none-are-refused", with_take, names_that_are_none_are_refused);
    return g_test_run();
}

/* halves: pictures fetched as RGB halves are what they are as floats, within what is stated. */
#include "core/half.h"
#include "daemon/fetch_job.h"
#include "tests/daemon/full_take.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct room {
    struct full_take *take;
    struct ls_field_cache *cache;
    Lightstage__Fetch fetch;
    Lightstage__Region region;
    uint32_t lights[2];
    char channel[2];
};

static void enter(struct room *room, gconstpointer data)
{
    static const struct full_take_options plain;
    room->take = make_full_take(data ? data : &plain);
    room->cache = ls_field_cache_create(room->take->root, 1, 0);
    lightstage__region__init(&room->region);
    room->region.x = 5;
    room->region.y = 1;
    room->region.width = FULL_W - 6;
    room->region.height = FULL_H - 3;
    room->lights[0] = 7;
    room->lights[1] = 0;
    lightstage__fetch__init(&room->fetch);
    room->fetch.take = room->take->id;
    room->fetch.channel = room->channel;
    room->fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    room->fetch.region = &room->region;
    room->fetch.lights = room->lights;
    room->fetch.n_lights = 2;
}

static void leave(struct room *room, gconstpointer data)
{
    ls_field_cache_destroy(room->cache);
    full_take_free(room->take);
}

static GByteArray *fetched(struct room *room, char channel, Lightstage__Sample sample)
{
    GByteArray *all = g_byte_array_new();
    struct ls_diag diag = {{0}};
    struct ls_job *job = NULL;
    struct ls_tiles rows = {0};
    room->channel[0] = channel;
    room->fetch.sample = sample;
    enum ls_err err = ls_fetch_job_create(1, room->cache, &room->fetch, &rows, &job, &diag);
    for (bool last = false; !last && !err;) {
        struct ls_chunk chunk = {0};
        err = job->ops->step(job, &chunk, &last, &diag);
        g_byte_array_append(all, chunk.payload, (guint)chunk.payload_bytes);
        free(chunk.head);
        free(chunk.payload);
    }
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    job->ops->destroy(job);
    return all;
}

/* Largest |half - float| beyond @floor, relative; both fetched. */
static double apart(struct room *room, char channel, double floor)
{
    GByteArray *floats = fetched(room, channel, LIGHTSTAGE__SAMPLE__FLOAT);
    GByteArray *halves = fetched(room, channel, LIGHTSTAGE__SAMPLE__HALF);
    size_t n = floats->len / sizeof(float);
    double worst = 0;
    g_assert_cmpuint(n, >, 2 * 144 * 137 - 1);
    g_assert_cmpuint(halves->len, ==, 2 * n);
    for (size_t j = 0; j < n; j++) {
        float f;
        uint16_t h;
        memcpy(&f, floats->data + 4 * j, sizeof f);
        memcpy(&h, halves->data + 2 * j, sizeof h);
        double d = fabs((double)ls_half_to_float(h) - (double)f) - floor;
        worst = fmax(worst, d / fmax(fabs((double)f), 1e-9));
    }
    g_byte_array_unref(floats);
    g_byte_array_unref(halves);
    return worst;
}

/* One rounding: half a unit in the last place, or of the denormals. */
static const double nearest = 0x1p-11, denormal = 0x1p-25;

static void photographs_are_the_nearest_halves(struct room *room, gconstpointer data)
{
    room->fetch.quantity = LIGHTSTAGE__QUANTITY__ESTIMATE;
    g_assert_cmpfloat(apart(room, 'W', denormal), <=, nearest);
    room->fetch.quantity = LIGHTSTAGE__QUANTITY__REFLECTANCE;
    g_assert_cmpfloat(apart(room, 'W', denormal), <=, nearest);
    room->fetch.full_sphere = true;
    g_assert_cmpfloat(apart(room, 'R', denormal), <=, nearest);
}

static void promoted_lights_are_within_three_roundings(struct room *room, gconstpointer data)
{
    static const Lightstage__Model models[] = {LIGHTSTAGE__MODEL__SPHERE,
                                               LIGHTSTAGE__MODEL__HEADLIGHT};
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++) {
        room->fetch.model = models[m];
        /* white and ratio are below 16: their denormal roundings, through each other */
        double d = apart(room, 'R', 33 * 0x1p-25);
        g_test_message("%s: apart by %.3g", m ? "headlight" : "sphere", d);
        g_assert_cmpfloat(d, <=, 1.5e-3);
        g_assert_cmpfloat(d, >, nearest); /* else this is not what it says it is */
    }
}

/* Where more than one picture makes a light, floats are made and rounded once. */
static void other_ways_are_the_nearest_halves(struct room *room, gconstpointer data)
{
    room->fetch.model = LIGHTSTAGE__MODEL__SEPARATED;
    g_assert_cmpfloat(apart(room, 'R', denormal), <=, nearest);
    room->fetch.model = LIGHTSTAGE__MODEL__LINEAR;
    g_assert_cmpfloat(apart(room, 'R', denormal), <=, nearest);
}

static void sums_of_pictures_are_the_nearest_halves(struct room *room, gconstpointer data)
{
    room->fetch.model = LIGHTSTAGE__MODEL__SPHERE;
    g_assert_cmpfloat(apart(room, 'R', denormal), <=, nearest);
}

/* Largest error of light 7 as floats, mosaic or where the camera has that colour itself, against
 * k E with the factors of its colour, or E. */
static double off_by(struct room *room, Lightstage__Quantity quantity, Lightstage__Layout layout)
{
    const struct full_take *take = room->take;
    const Lightstage__Region *r = &room->region;
    room->fetch.n_lights = 1;
    room->fetch.quantity = quantity;
    room->fetch.layout = layout;
    GByteArray *got = fetched(room, 'W', LIGHTSTAGE__SAMPLE__FLOAT);
    size_t components = layout == LIGHTSTAGE__LAYOUT__RGB ? 3 : 1;
    bool gained = quantity == LIGHTSTAGE__QUANTITY__REFLECTANCE;
    double worst = 0;
    for (size_t j = 0; j < (size_t)r->width * r->height; j++) {
        int p = (int)((r->y + j / r->width) * FULL_W + r->x + j % r->width);
        int c = full_take_colour_at(p, false);
        double gain = gained ? take->scale * take->k[FULL_CW][7] * take->colour[FULL_CW][7][c] : 1;
        double expected = gain * (double)take->light[FULL_CW][7][p];
        float f;
        size_t at = components * j + (components == 3 ? (size_t)c : 0);
        memcpy(&f, got->data + at * sizeof f, sizeof f);
        worst = fmax(worst, fabs((double)f / expected - 1));
    }
    g_byte_array_unref(got);
    return worst;
}

/* A mono camera's one component, whatever makes it; its mosaic has levels, too. */
static void mono_is_what_a_mono_camera_saw(struct room *room, gconstpointer data)
{
    static const Lightstage__Model all[] = {LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__MODEL__SPHERE};
    static const Lightstage__Sample samples[] = {LIGHTSTAGE__SAMPLE__FLOAT,
                                                 LIGHTSTAGE__SAMPLE__HALF};
    for (int k = 0; k < 8; k++) {
        room->fetch.model = all[k % 2];
        room->fetch.level = (uint32_t)k / 4;
        room->fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
        GByteArray *rgb = fetched(room, k % 2 ? 'R' : 'W', samples[k / 2 % 2]);
        room->fetch.layout = k % 2 ? LIGHTSTAGE__LAYOUT__MONO : LIGHTSTAGE__LAYOUT__MOSAIC;
        GByteArray *mono = fetched(room, k % 2 ? 'R' : 'W', samples[k / 2 % 2]);
        g_assert_cmpuint(mono->len, >, 0);
        g_assert_cmpmem(mono->data, mono->len, rgb->data, rgb->len);
        g_byte_array_unref(mono);
        g_byte_array_unref(rgb);
    }
}

/* A few roundings of a float. */
static void lights_of_every_colour_have_their_own_gains(struct room *room, gconstpointer data)
{
    for (int layout = 0; layout < 2; layout++) {
        Lightstage__Layout l = layout ? LIGHTSTAGE__LAYOUT__RGB : LIGHTSTAGE__LAYOUT__MOSAIC;
        g_assert_cmpfloat(off_by(room, LIGHTSTAGE__QUANTITY__REFLECTANCE, l), <, 1e-6);
        g_assert_cmpfloat(off_by(room, LIGHTSTAGE__QUANTITY__ESTIMATE, l), <, 1e-6);
    }
}

int main(int argc, char **argv)
{
    static const struct full_take_options mono = {.mono = true}, rows = {.multiplexed = true};
    static const struct full_take_options coloured = {.coloured = true};
    g_test_init(&argc, &argv, NULL);
#define ADD(name, options, test) \
    g_test_add("/halves/" name, struct room, options, enter, test, leave)
    ADD("photographs-are-the-nearest-halves", NULL, photographs_are_the_nearest_halves);
    ADD("mono-photographs-are-the-nearest-halves", &mono, photographs_are_the_nearest_halves);
    ADD("promoted-lights-are-within-three-roundings", NULL,
        promoted_lights_are_within_three_roundings);
    ADD("promoted-mono-lights-are-within-three-roundings", &mono,
        promoted_lights_are_within_three_roundings);
    ADD("mono-is-what-a-mono-camera-saw", &mono, mono_is_what_a_mono_camera_saw);
    ADD("other-ways-are-the-nearest-halves", NULL, other_ways_are_the_nearest_halves);
    ADD("sums-of-pictures-are-the-nearest-halves", &rows, sums_of_pictures_are_the_nearest_halves);
    ADD("lights-of-every-colour-have-their-own-gains", &coloured,
        lights_of_every_colour_have_their_own_gains);
    ADD("lights-of-every-colour-are-the-nearest-halves", &coloured,
        photographs_are_the_nearest_halves);
    return g_test_run();
}

/* liblightstage: pictures in rows: stored, by name, factored, into a buffer. */
#include "tests/clients/library_fixture.h"

#include <stdio.h>
#include <string.h>

static void pictures_come_into_a_buffer_as_they_are_stored(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_fetch fetch = stored(take);
    struct lightstage_shape shape = {0};
    struct lightstage_error error = {0};
    float *pixels = g_new(float, TAKE_LIGHTS *TAKE_PIXELS);
    size_t bytes = sizeof(float) * TAKE_LIGHTS * TAKE_PIXELS;
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, pixels, bytes, &shape, &error), ==, 0);
    g_assert_cmpuint(shape.pictures, ==, TAKE_LIGHTS);
    g_assert_cmpuint(shape.height, ==, TAKE_H);
    g_assert_cmpuint(shape.width, ==, TAKE_W);
    g_assert_cmpuint(shape.components, ==, 1);
    for (size_t i = 0; i < TAKE_LIGHTS; i++)
        g_assert_cmpmem(pixels + i * TAKE_PIXELS, bytes / TAKE_LIGHTS, take->light[i],
                        bytes / TAKE_LIGHTS);
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, pixels, bytes - 1, &shape, &error), ==,
                     LIGHTSTAGE_OVER_LIMIT);
    g_assert_nonnull(strstr(error.text, "150 x 140"));
    /* the connection is as good as before */
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, pixels, bytes, &shape, &error), ==, 0);
    g_assert_cmpuint(lightstage_in_flight(client), ==, 0);
    lightstage_close(client);
    g_free(pixels);
    made_take_free(take);
}

struct quality {
    uint32_t rows, strange;
    uint32_t valid[4];
    size_t bytes;
    float *pixels;
};

static int take_quality(const struct lightstage_band *band, void *user)
{
    struct quality *q = user;
    size_t n = (size_t)band->n_rows * band->width;
    for (size_t i = 0; i < n; i++) {
        float variance;
        memcpy(&variance, (const char *)band->variance + i * sizeof variance, sizeof variance);
        q->strange += !(variance > 0) || band->validity[i] > 3;
        q->valid[band->validity[i] & 3]++;
        q->strange += band->validity[i] !=
                      made_validity(TAKE_FLAGGED, (int)(band->first_row * band->width + i));
    }
    memcpy(q->pixels + (size_t)band->first_row * band->width, band->values, band->values_bytes);
    q->rows += band->n_rows;
    return 0;
}

static void pictures_come_by_name_with_what_is_known_of_their_pixels(struct stage *stage,
                                                                     gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    static const char *const names[] = {"W-0002"};
    struct lightstage_fetch fetch = {.size = sizeof fetch,
                                     .take = take->id,
                                     .quantity = LIGHTSTAGE_ESTIMATE,
                                     .conditions = names,
                                     .n_conditions = 1,
                                     .variance = 1,
                                     .validity = 1};
    struct quality q = {.pixels = g_new(float, TAKE_PIXELS)};
    g_assert_cmpuint(lightstage_fetch(client, &fetch, take_quality, &q, NULL), ==, 0);
    g_assert_cmpuint(q.rows, ==, TAKE_H);
    g_assert_cmpuint(q.strange, ==, 0);
    for (int i = 0; i < 4; i++)
        g_assert_cmpuint(q.valid[i], >, 0);
    g_assert_cmpmem(q.pixels, sizeof(float) * TAKE_PIXELS, take->light[TAKE_FLAGGED],
                    sizeof(float) * TAKE_PIXELS);
    g_free(q.pixels);
    lightstage_close(client);
    made_take_free(take);
}

enum { RGB_VALUES = 3 * TAKE_PIXELS };

struct factored {
    uint16_t ratio[RGB_VALUES], white[RGB_VALUES], whole[RGB_VALUES];
    float gain;
    uint32_t ratios;
};

static int take_factor(const struct lightstage_band *band, void *user)
{
    struct factored *f = user;
    uint16_t *to = band->factor == LIGHTSTAGE_RATIO   ? f->ratio
                   : band->factor == LIGHTSTAGE_WHITE ? f->white
                                                      : f->whole;
    if (band->factor == LIGHTSTAGE_RATIO && band->spectrum)
        f->ratios += !strcmp(band->spectrum, "R");
    if (band->factor == LIGHTSTAGE_WHITE)
        f->gain = band->gain;
    memcpy(to + (size_t)band->first_row * band->width * 3, band->values, band->values_bytes);
    return 0;
}

static void a_factored_fetch_expands_to_what_the_daemon_sends(struct stage *stage,
                                                              gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct factored *f = g_new0(struct factored, 1);
    uint16_t *expanded = g_new0(uint16_t, RGB_VALUES);
    struct lightstage_shape shape;
    static const char *const spectra[] = {"R"};
    static const uint32_t light[] = {4};
    struct lightstage_promotion sphere = {.size = sizeof sphere, .model = LIGHTSTAGE_SPHERE};
    struct lightstage_fetch fetch = {.size = sizeof fetch,
                                     .take = take->id,
                                     .lights = light,
                                     .n_lights = 1,
                                     .promotion = &sphere,
                                     .layout = LIGHTSTAGE_RGB,
                                     .sample = LIGHTSTAGE_HALF,
                                     .factored = 1,
                                     .spectra = spectra,
                                     .n_spectra = 1};
    g_assert_cmpuint(lightstage_fetch(client, &fetch, take_factor, f, NULL), ==, 0);
    g_assert_cmpuint(f->ratios, ==, 1);
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, expanded, sizeof f->white, &shape, NULL),
                     ==, LIGHTSTAGE_BAD_ARGUMENT);
    fetch.factored = 0;
    fetch.n_spectra = 0;
    fetch.channel = "R";
    g_assert_cmpuint(lightstage_fetch(client, &fetch, take_factor, f, NULL), ==, 0);
    g_assert_cmpuint(lightstage_expand(f->white, f->gain, f->ratio, RGB_VALUES, expanded), ==, 0);
    g_assert_cmpmem(expanded, sizeof f->whole, f->whole, sizeof f->whole);
    g_assert_true(memcmp(f->white, f->whole, sizeof f->whole));
    g_free(expanded);
    g_free(f);
    lightstage_close(client);
    made_take_free(take);
}

static void the_example_prints_a_pictures_mean(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    char *words[] = {(char *)g_getenv("LIGHTSTAGE_EXAMPLE"), stage->socket_path, take->id,
                     (char *)"W", NULL};
    char *out = NULL;
    int status = -1;
    g_assert_true(
        g_spawn_sync(NULL, words, NULL, G_SPAWN_DEFAULT, NULL, NULL, &out, NULL, &status, NULL));
    g_assert_cmpint(status, ==, 0);
    double mean = 0;
    g_assert_cmpint(sscanf(out, "150 x 140 x 3, mean %lf", &mean), ==, 1);
    g_assert_cmpfloat(mean, >, 0);
    g_free(out);
    made_take_free(take);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("pictures-come-into-a-buffer-as-they-are-stored",
                pictures_come_into_a_buffer_as_they_are_stored);
    ADD_LIBRARY("pictures-come-by-name-with-what-is-known-of-their-pixels",
                pictures_come_by_name_with_what_is_known_of_their_pixels);
    ADD_LIBRARY("a-factored-fetch-expands-to-what-the-daemon-sends",
                a_factored_fetch_expands_to_what_the_daemon_sends);
    ADD_LIBRARY("the-example-prints-a-pictures-mean", the_example_prints_a_pictures_mean);
    return g_test_run();
}

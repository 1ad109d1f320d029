/* liblightstage: memory that the daemon shares, of pictures and of a camera's frames. */
#include "daemon/preview.h"
#include "daemon/ring.h"
#include "tests/clients/library_fixture.h"

#include <dirent.h>
#include <string.h>

enum { SIDE = 64, ACROSS = 3, TILES = ACROSS * 3 };

/* Also the daemon's, which keeps those of stored pictures, and some others while it sends. What the
 * library left open would be one for each picture. */
static unsigned open_files(void)
{
    unsigned n = 0;
    DIR *folder = opendir("/proc/self/fd");
    while (readdir(folder))
        n++;
    closedir(folder);
    return n;
}

/* Of one kind of fetch. */
struct wanted {
    enum lightstage_sample sample;
    enum lightstage_model model;
    enum lightstage_quantity quantity;
    enum lightstage_layout layout;
};
static const struct wanted kinds[] = {
    {LIGHTSTAGE_HALF, LIGHTSTAGE_MEASURED, LIGHTSTAGE_ESTIMATE, LIGHTSTAGE_MOSAIC}, /* as stored */
    {LIGHTSTAGE_FLOAT, LIGHTSTAGE_MEASURED, LIGHTSTAGE_REFLECTANCE, LIGHTSTAGE_RGB},
    {LIGHTSTAGE_HALF, LIGHTSTAGE_SPHERE, LIGHTSTAGE_REFLECTANCE, LIGHTSTAGE_RGB},
};

/* All tiles of a fetch, one after the other. */
struct kept {
    GByteArray *bytes;
    uint32_t n, stop_at;
};

static int keep_tile(const struct lightstage_tile *tile, void *user)
{
    struct kept *kept = user;
    g_assert_cmpuint(tile->index, ==, kept->n);
    g_assert_cmpuint(tile->number, ==, kept->n % TILES);
    if (kept->bytes)
        g_byte_array_append(kept->bytes, tile->values, (guint)tile->values_bytes);
    return ++kept->n == kept->stop_at;
}

static void shared_tiles_are_those_that_the_socket_brings(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    unsigned files = 0;
    for (size_t i = 0; i < 2 * G_N_ELEMENTS(kinds); i++) {
        const struct wanted *kind = &kinds[i % G_N_ELEMENTS(kinds)];
        const struct lightstage_promotion promotion = {.size = sizeof promotion,
                                                       .model = kind->model};
        struct lightstage_fetch fetch = {.size = sizeof fetch,
                                         .take = take->id,
                                         .channel = kind->model == LIGHTSTAGE_MEASURED ? "W" : "R",
                                         .promotion = &promotion,
                                         .layout = kind->layout,
                                         .quantity = kind->quantity,
                                         .sample = kind->sample};
        struct kept plain = {.bytes = g_byte_array_new()}, shared = {.bytes = g_byte_array_new()};
        struct lightstage_error error = {0};
        lightstage_fetch_tiles(client, &fetch, NULL, keep_tile, &plain, &error);
        g_assert_cmpstr(error.text, ==, "");
        fetch.memfd = 1;
        lightstage_fetch_tiles(client, &fetch, NULL, keep_tile, &shared, &error);
        g_assert_cmpstr(error.text, ==, "");
        g_assert_cmpuint(plain.n, ==, TAKE_LIGHTS * TILES);
        g_assert_cmpmem(shared.bytes->data, shared.bytes->len, plain.bytes->data, plain.bytes->len);
        g_byte_array_unref(plain.bytes);
        g_byte_array_unref(shared.bytes);
        if (i == G_N_ELEMENTS(kinds) - 1)
            files = open_files();
    }
    g_assert_cmpuint(open_files(), <, files + TAKE_LIGHTS); /* after the second round */
    lightstage_close(client);
    made_take_free(take);
}

/* 300 MB of values go through the 256 MB that may be shared at once: they are given back. */
static void what_was_seen_is_given_back(struct stage *stage, gconstpointer data)
{
    enum { PICTURES = 300000000 / (TILES * SIDE * SIDE * 4) };
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    uint32_t *lights = g_new(uint32_t, PICTURES);
    struct kept kept = {.stop_at = TAKE_LIGHTS * TILES};
    const struct lightstage_fetch fetch = {.size = sizeof fetch,
                                           .take = take->id,
                                           .channel = "W",
                                           .lights = lights,
                                           .n_lights = PICTURES,
                                           .memfd = 1};
    for (uint32_t i = 0; i < PICTURES; i++)
        lights[i] = i % TAKE_LIGHTS;
    lightstage_fetch_tiles(client, &fetch, NULL, keep_tile, &kept, NULL); /* each light once */
    unsigned files = open_files();
    kept = (struct kept){.stop_at = PICTURES * TILES - 3};
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, keep_tile, &kept, NULL), ==,
                     LIGHTSTAGE_CANCELLED);
    g_assert_cmpuint(kept.n, ==, kept.stop_at);
    g_assert_cmpuint(open_files(), <, files + TAKE_LIGHTS); /* of the cancelled too */
    lightstage_close(client);
    g_free(lights);
    made_take_free(take);
}

/* As a driver does: it takes a slot, writes, hands the frame on. */
static void frame_lands(struct ls_ring *ring, uint32_t slot, uint8_t value)
{
    memset((void *)ls_ring_payload(ring, slot), value, 140);
    g_assert_cmpint(ls_ring_take(ring, slot), ==, LS_OK);
}

static void the_newest_frame_is_looked_at(struct stage *stage, gconstpointer data)
{
    const struct ls_camera_info info = {.width = 10, .height = 7, .pixel_format = "BayerRG12"};
    struct ls_preview *preview = ls_engine_preview(stage->engine);
    struct lightstage *client = connected(stage);
    struct lightstage_ring *ring = NULL;
    struct ls_ring *frames = NULL;
    uint8_t frame[140], expected[140];
    g_assert_cmpuint(lightstage_ring(client, 0, &ring, NULL), ==, 200);
    g_assert_cmpint(ls_ring_create(4, sizeof frame, &frames, NULL), ==, LS_OK);
    unsigned files = open_files();
    ls_preview_set_ring(preview, 0, frames, &info);
    for (int i = 0; i < 20; i++) {
        lightstage_ring_free(ring);
        g_assert_cmpuint(lightstage_ring(client, 0, &ring, NULL), ==, 0);
    }
    g_assert_cmpuint(open_files(), <, files + 20); /* it is mapped, not open */
    g_assert_cmpuint(ring->slots, ==, 4);
    g_assert_cmpuint(ring->payload_bytes, ==, sizeof frame);
    g_assert_cmpuint(ring->width, ==, 10);
    g_assert_cmpstr(ring->pixel_format, ==, "BayerRG12");
    g_assert_cmpuint(lightstage_ring_newest(ring, frame), ==, 0);
    ls_ring_queue(frames);
    frame_lands(frames, 2, 7);
    g_assert_cmpuint(lightstage_ring_newest(ring, frame), ==, 1);
    memset(expected, 7, sizeof expected);
    g_assert_cmpmem(frame, sizeof frame, expected, sizeof expected);
    frame_lands(frames, 0, 9);
    g_assert_cmpuint(lightstage_ring_newest(ring, frame), ==, 2);
    g_assert_cmpuint(frame[0], ==, 9);
    ls_preview_set_ring(preview, 0, NULL, NULL);
    ls_ring_destroy(frames);
    g_assert_cmpuint(lightstage_ring_newest(ring, frame), ==, 2); /* it stays */
    lightstage_ring_free(ring);
    lightstage_close(client);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("shared-tiles-are-those-that-the-socket-brings",
                shared_tiles_are_those_that_the_socket_brings);
    ADD_LIBRARY("what-was-seen-is-given-back", what_was_seen_is_given_back);
    ADD_LIBRARY("the-newest-frame-is-looked-at", the_newest_frame_is_looked_at);
    return g_test_run();
}

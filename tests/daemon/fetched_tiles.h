/*
 * fetched_tiles: tiles of the take of take_fixture, asked for and received in every way.
 * Layer: tests. Threads: the test's one. Ownership: tiles_finish.
 */
#ifndef LS_TESTS_DAEMON_FETCHED_TILES_H
#define LS_TESTS_DAEMON_FETCHED_TILES_H

#include "tests/daemon/serving_fixture.h"

enum { SIDE = 64, ACROSS = 3, DOWN = 3, TILES = ACROSS * DOWN, N_WAYS = 8 };

/* What came of some pictures. */
struct tiles {
    GArray *number, *hash, *unchanged; /* uint32_t, uint64_t, uint32_t */
    GByteArray *bytes;                 /* of those that were sent */
    uint32_t first, pictures;          /* of the first frame; with a report */
    uint32_t refused;
    double error_bound; /* of the last frame */
};

/** @have: the payload, @n hashes. */
void fetch_tiles(struct hall *hall, Lightstage__Fetch *fetch, const uint64_t *have, size_t n,
                 struct tiles *t);
void tiles_finish(struct tiles *t);

/** Tile @number of a whole picture, as it has to be. g_free. */
uint8_t *cut_tile(const uint8_t *picture, uint32_t number, size_t pixel);

/** What can be asked for. */
extern const struct way {
    const char *channel;
    Lightstage__Model model;
    Lightstage__Layout layout;
    Lightstage__Quantity quantity;
    Lightstage__Sample sample;
    bool full_sphere;
} ways[N_WAYS];

/** Two of @lights, or the full sphere. */
void ask_for(Lightstage__Fetch *fetch, const struct hall *hall, const struct way *way,
             uint32_t *lights);

/** Its bytes. */
size_t pixel_of(const struct way *way);

#endif

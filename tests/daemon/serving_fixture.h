/*
 * serving_fixture: a server with a take, a client of it, and what core makes of the take's
 * pictures. Layer: tests. Threads: the test's one, and the server's own. Ownership: with_... /
 * leave.
 */
#ifndef LS_TESTS_DAEMON_SERVING_FIXTURE_H
#define LS_TESTS_DAEMON_SERVING_FIXTURE_H

#include "tests/daemon/server_fixture.h"
#include "tests/daemon/take_fixture.h"

struct hall {
    struct stage stage;
    struct made_take *take;
    struct ls_connection *client;
};

void with_take(struct hall *hall, gconstpointer data);
void with_take_and_little_patience(struct hall *hall, gconstpointer data); /* for who stalls */
void with_take_on_a_full_disk(struct hall *hall, gconstpointer data);
void with_take_lacking_light_3(struct hall *hall, gconstpointer data);
void with_uncalibrated_take(struct hall *hall, gconstpointer data);
void leave(struct hall *hall, gconstpointer data);

/* ---- asking ---- */

/** Returns the request's number. */
uint32_t send_request(struct hall *hall, uint16_t type, const ProtobufCMessage *body,
                      const void *payload, size_t n);

/** Every payload of the answer, one after the other. *number: 0, or the refusal's. */
GByteArray *receive_all(struct hall *hall, uint32_t request, uint32_t *number);

/** A request to relight in white and red; its own storage. */
struct relight {
    Lightstage__Relight body;
    Lightstage__Region region;
    char *channels[2];
    float weights[6 * TAKE_LIGHTS];
    size_t n_rows;
};

/** Whole pictures of the take, with random weights. */
void a_relight(struct relight *r, const struct hall *hall, Lightstage__WeightMode mode);
GByteArray *relit(struct hall *hall, const struct relight *r, uint32_t *number);

/** All lights in white, as stored. */
void a_fetch(Lightstage__Fetch *fetch, const struct hall *hall);
GByteArray *fetched(struct hall *hall, const Lightstage__Fetch *fetch, uint32_t *number);

/* ---- the long way ---- */

/** A mosaic of the take's size to RGB. */
void demosaic(const float *mosaic, float *rgb);

/** Demosaiced sum of the lights under w k. */
float *summed(const struct made_take *take, const double w[TAKE_LIGHTS]);

/** Eq. 1's ratio for R, which for these pictures is plain F / V. */
float *ratio_of_red(const struct made_take *take);

/** Add the lights under @weights times @ratio (NULL: 1) to channel @only of @out; -1: to all. */
void add_lights(float *out, const struct made_take *take, const float *weights, const float *ratio,
                int only);

/** Values reach a few hundred; halves are exact, sums of seven floats and a demosaic are not. */
void assert_close(const GByteArray *got, const float *expected, size_t n, double scale);

#define ADD(name, setup, function) \
    g_test_add("/serving/" name, struct hall, NULL, setup, function, leave)

#endif

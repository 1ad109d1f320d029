/*
 * serving: a server with a take of large pictures, and clients that do nothing but receive.
 * Layer: tests. Threads: the server has its own; a client is one thread's. Ownership: as stated.
 */
#ifndef LS_TESTS_BENCH_SERVING_H
#define LS_TESTS_BENCH_SERVING_H

#include "proto/message.h"
#include "tests/daemon/server_fixture.h"

#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

struct serving {
    struct stage stage;
    char *id;
    uint32_t side, n_lights;
};

/** A take of @n_lights of white, light by light, and spheres of W and R, @side px square, a Bayer
 * mosaic; and a server of it. Files are in the page cache. Ends the program where that cannot be.
 * @clients: as many may connect. */
void serving_open(struct serving *serving, uint32_t n_lights, uint32_t side, unsigned clients);
void serving_close(struct serving *serving);

/** serving_open in two steps: between them stage.limits may be changed. */
void serving_make(struct serving *serving, uint32_t n_lights, uint32_t side, unsigned clients);
void serving_start(struct serving *serving);

/** Where the stored tiles of all lights lie: spans of a mapped file each, as the server sees them.
 * (transfer full), g_free; the mappings stay until the program ends. */
struct iovec *serving_spans(const struct serving *serving, size_t *n);

/** Path of the picture of a light. g_free. */
char *serving_picture(const struct serving *serving, uint32_t light);

/** A client on the socket @fd (transfer full), greeted. Its buffer is reused. */
struct receiver {
    int fd;
    uint8_t *bytes; /* of the last payload */
    size_t capacity;
    uint64_t received; /* of payload, in all */
    uint32_t request;
    GHashTable *mapped; /* inode -> struct iovec of it */
    int passed;         /* descriptor that came with the last frame, or -1 */
};

void receiver_open(struct receiver *receiver, const struct serving *serving);
void receiver_close(struct receiver *receiver);

/** All tiles of @fetch, received and dropped. Ends the program on an Error. */
void receive_all(struct receiver *receiver, const Lightstage__Fetch *fetch);

/** All pictures of @fetch, which asks for memfds, mapped and read once. @keep: a mapping stays, and
 * serves whenever the same memory comes again, until receiver_close. Returns a sum of what was
 * read. */
uint64_t read_memfds(struct receiver *receiver, const Lightstage__Fetch *fetch, bool keep);

/** Tiles of every light, as stored; or promoted to R, halves of RGB. Its take is the serving's. */
void stored_fetch(Lightstage__Fetch *fetch, const struct serving *serving);
void promoted_fetch(Lightstage__Fetch *fetch, const struct serving *serving);

/** Receive @n bytes from @fd into @bytes; ends the program where they do not come. */
void receive_bytes(int fd, void *bytes, size_t n);

#endif

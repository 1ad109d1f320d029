/* serving_memfd: a picture in a memfd is the one that comes over the socket, sealed, and stored
 * ones are the same memory for everybody. */
#include "core/half.h"
#include "daemon/tiles.h"
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/serving_fixture.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

enum { SIDE = 64, ACROSS = 3, TILES = 9 };

/* ---- a client that takes descriptors ---- */

struct taker {
    int socket, fd; /* fd: the last that came, or -1 */
    uint32_t request;
    struct ls_frame_header header;
    Lightstage__FetchReply *reply; /* of the last frame; NULL: it is none */
    GByteArray *payload;
};

static void take_fd(struct taker *t, struct msghdr *message)
{
    struct cmsghdr *c = CMSG_FIRSTHDR(message);
    if (!c)
        return;
    g_assert_cmpint(c->cmsg_type, ==, SCM_RIGHTS);
    g_assert_cmpuint(c->cmsg_len, ==, CMSG_LEN(sizeof(int)));
    g_assert_cmpint(t->fd, ==, -1);
    memcpy(&t->fd, CMSG_DATA(c), sizeof t->fd);
}

static void take_bytes(struct taker *t, void *bytes, size_t n)
{
    for (size_t got = 0; got < n;) {
        char control[CMSG_SPACE(sizeof(int))];
        struct iovec span = {(char *)bytes + got, n - got};
        struct msghdr message = {.msg_iov = &span,
                                 .msg_iovlen = 1,
                                 .msg_control = control,
                                 .msg_controllen = sizeof control};
        ssize_t k = recvmsg(t->socket, &message, MSG_CMSG_CLOEXEC);
        g_assert_cmpint(k, >, 0);
        g_assert_cmpint(message.msg_flags & MSG_CTRUNC, ==, 0);
        take_fd(t, &message);
        got += (size_t)k;
    }
}

static void forget(struct taker *t)
{
    ls_message_free((ProtobufCMessage *)t->reply);
    t->reply = NULL;
    if (t->fd >= 0)
        close(t->fd);
    t->fd = -1;
}

/* The next frame; its Error's number, or 0. */
static uint32_t take_frame(struct taker *t)
{
    uint8_t head[LS_FRAME_HEADER_BYTES], body[LS_FRAME_MAX_MESSAGE];
    ProtobufCMessage *message = NULL;
    uint32_t number = 0;
    forget(t);
    take_bytes(t, head, sizeof head);
    g_assert_cmpint(ls_frame_get(head, UINT32_MAX, &t->header, NULL), ==, LS_OK);
    take_bytes(t, body, t->header.message_bytes);
    g_byte_array_set_size(t->payload, (guint)t->header.payload_bytes);
    take_bytes(t, t->payload->data, t->payload->len);
    g_assert_cmpint(
        ls_message_decode(t->header.type, body, t->header.message_bytes, &message, NULL), ==,
        LS_OK);
    if (t->header.type == (LS_MESSAGE_FETCH | LS_MESSAGE_REPLY)) {
        t->reply = (Lightstage__FetchReply *)message;
        return 0;
    }
    if (t->header.type == LS_MESSAGE_ERROR)
        number = ((Lightstage__Error *)message)->number;
    ls_message_free(message);
    return number;
}

static void say(struct taker *t, uint16_t type, const ProtobufCMessage *body)
{
    uint8_t *bytes = NULL;
    size_t n = 0;
    g_assert_cmpint(ls_message_frame(type, ++t->request, LS_FRAME_LAST, body, 0, &bytes, &n, NULL),
                    ==, LS_OK);
    g_assert_cmpint(send(t->socket, bytes, n, 0), ==, (ssize_t)n);
    free(bytes);
}

static void taker_open(struct taker *t, struct hall *hall)
{
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    struct timeval limit = {.tv_sec = 5};
    *t = (struct taker){.socket = a_bare_socket(&hall->stage), .fd = -1};
    g_assert_cmpint(setsockopt(t->socket, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit), ==, 0);
    t->payload = g_byte_array_new();
    hello.version = LS_FRAME_VERSION;
    say(t, LS_MESSAGE_HELLO, &hello.base);
    take_frame(t);
}

static void taker_close(struct taker *t)
{
    forget(t);
    g_byte_array_unref(t->payload);
    close(t->socket);
}

/* ---- what comes ---- */

static const struct way {
    const char *channel;
    Lightstage__Model model;
    Lightstage__Layout layout;
    Lightstage__Quantity quantity;
    Lightstage__Sample sample;
    size_t pixel;
} ways[] = {
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__MOSAIC, LIGHTSTAGE__QUANTITY__ESTIMATE,
     LIGHTSTAGE__SAMPLE__HALF, 2},
    {"W", LIGHTSTAGE__MODEL__MEASURED, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     LIGHTSTAGE__SAMPLE__HALF, 6},
    {"R", LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     LIGHTSTAGE__SAMPLE__HALF, 6},
    {"R", LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__LAYOUT__RGB, LIGHTSTAGE__QUANTITY__REFLECTANCE,
     LIGHTSTAGE__SAMPLE__FLOAT, 12},
};

static void ask_for(Lightstage__Fetch *fetch, const struct hall *hall, const struct way *way)
{
    a_fetch(fetch, hall);
    fetch->channel = (char *)way->channel;
    fetch->model = way->model;
    fetch->layout = way->layout;
    fetch->quantity = way->quantity;
    fetch->sample = way->sample;
    fetch->tiles = true;
    fetch->credit_bytes = UINT64_MAX;
}

/* The tiles of the frame at hand are the next ones of @expected, over the socket. */
static size_t assert_same(const struct taker *t, const uint8_t *expected, size_t tile)
{
    const Lightstage__FetchReply *r = t->reply;
    g_assert_true(r->memfd);
    g_assert_cmpuint(r->memfd_bytes, ==, TILES * tile);
    g_assert_cmpuint(t->payload->len, ==, 0);
    g_assert_cmpint(t->fd, >=, 0);
    const uint8_t *bytes = mmap(NULL, r->memfd_bytes, PROT_READ, MAP_SHARED, t->fd, 0);
    g_assert_true(bytes != MAP_FAILED);
    size_t at = 0;
    for (size_t i = 0; i < r->n_tile; i++) {
        const uint8_t *got = bytes + r->tile[i] * tile;
        if (r->tile_hash[i] == 0) /* left out */
            continue;
        g_assert_cmpmem(got, tile, expected + at, tile);
        g_assert_cmphex(r->tile_hash[i], ==, ls_tile_hash(got, tile));
        at += tile;
    }
    munmap((void *)bytes, r->memfd_bytes);
    return at;
}

/* Of the first tile that the socket brings. */
static double largest(struct hall *hall, const Lightstage__Fetch *fetch, size_t tile)
{
    uint32_t number;
    double most = 0;
    GByteArray *bytes = fetched(hall, fetch, &number);
    for (size_t at = 0; at < tile; at += fetch->sample == LIGHTSTAGE__SAMPLE__HALF ? 2 : 4) {
        uint16_t half;
        float v;
        memcpy(&half, bytes->data + at, sizeof half);
        memcpy(&v, bytes->data + at, sizeof v);
        v = fetch->sample == LIGHTSTAGE__SAMPLE__HALF ? ls_half_to_float(half) : v;
        most = fmax(most, fabs((double)v));
    }
    g_byte_array_unref(bytes);
    return most;
}

static void a_memfd_holds_what_the_socket_brings(struct hall *hall, gconstpointer data)
{
    Lightstage__Region cropped = LIGHTSTAGE__REGION__INIT;
    struct taker t;
    cropped.x = 70, cropped.y = 10, cropped.width = 60, cropped.height = 60;
    taker_open(&t, hall);
    for (size_t i = 0; i < 3 * G_N_ELEMENTS(ways); i++) {
        const struct way *way = &ways[i / 3];
        size_t tile = SIDE * SIDE * way->pixel;
        Lightstage__Fetch fetch;
        uint32_t number, pictures = 0;
        size_t at = 0;
        ask_for(&fetch, hall, way);
        fetch.region = i % 3 == 1 ? &cropped : NULL;
        fetch.max_error = i % 3 == 2 ? largest(hall, &fetch, tile) : 0;
        GByteArray *expected = fetched(hall, &fetch, &number);
        g_assert_cmpuint(number, ==, 0);
        g_assert_cmpuint(expected->len < TAKE_LIGHTS * TILES * tile, ==, i % 3 != 0);
        fetch.memfd = true;
        say(&t, LS_MESSAGE_FETCH, &fetch.base);
        do {
            g_assert_cmpuint(take_frame(&t), ==, 0);
            at += assert_same(&t, expected->data + at, tile);
            pictures++;
        } while (!(t.header.flags & LS_FRAME_LAST));
        g_assert_cmpuint(at, ==, expected->len);
        g_assert_cmpuint(pictures, ==, TAKE_LIGHTS);
        g_byte_array_unref(expected);
    }
    taker_close(&t);
}

static void nobody_can_change_a_memfd(struct hall *hall, gconstpointer data)
{
    for (size_t i = 0; i < G_N_ELEMENTS(ways); i++) {
        Lightstage__Fetch fetch;
        struct taker t;
        char byte = 1;
        taker_open(&t, hall);
        ask_for(&fetch, hall, &ways[i]);
        fetch.memfd = true;
        say(&t, LS_MESSAGE_FETCH, &fetch.base);
        g_assert_cmpuint(take_frame(&t), ==, 0);
        g_assert_cmpint(fcntl(t.fd, F_GET_SEALS), ==,
                        F_SEAL_SEAL | F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE);
        g_assert_cmpint(pwrite(t.fd, &byte, 1, 0), ==, -1);
        g_assert_cmpint(errno, ==, EPERM);
        g_assert_cmpint(ftruncate(t.fd, 0), ==, -1);
        g_assert_true(mmap(NULL, 1, PROT_READ | PROT_WRITE, MAP_SHARED, t.fd, 0) == MAP_FAILED);
        taker_close(&t);
    }
}

static ino_t memory_of_the_first(struct hall *hall, const struct way *way, uint32_t light)
{
    Lightstage__Fetch fetch;
    struct stat info;
    struct taker t;
    taker_open(&t, hall);
    ask_for(&fetch, hall, way);
    fetch.lights = &light;
    fetch.n_lights = 1;
    fetch.memfd = true;
    say(&t, LS_MESSAGE_FETCH, &fetch.base);
    g_assert_cmpuint(take_frame(&t), ==, 0);
    g_assert_cmpint(fstat(t.fd, &info), ==, 0);
    taker_close(&t);
    return info.st_ino;
}

static void stored_pictures_are_the_same_memory_for_all(struct hall *hall, gconstpointer data)
{
    ino_t first = memory_of_the_first(hall, &ways[0], 2);
    g_assert_cmpuint(memory_of_the_first(hall, &ways[0], 2), ==, first);
    g_assert_cmpuint(memory_of_the_first(hall, &ways[0], 3), !=, first);
    first = memory_of_the_first(hall, &ways[2], 2); /* what is made is not kept */
    g_assert_cmpuint(memory_of_the_first(hall, &ways[2], 2), !=, first);
}

/* Each picture is charged: of credit for one byte, one comes. */
static void memory_is_filled_within_credit_alone(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    Lightstage__Metrics metrics = LIGHTSTAGE__METRICS__INIT;
    struct taker t;
    taker_open(&t, hall);
    ask_for(&fetch, hall, &ways[2]);
    fetch.memfd = true;
    fetch.credit_bytes = 0;
    say(&t, LS_MESSAGE_FETCH, &fetch.base);
    g_assert_cmpuint(take_frame(&t), ==, LS_PROTO_BAD_ARGUMENT);
    fetch.credit_bytes = 1;
    say(&t, LS_MESSAGE_FETCH, &fetch.base);
    g_assert_cmpuint(take_frame(&t), ==, 0);
    say(&t, LS_MESSAGE_METRICS, &metrics.base);
    take_frame(&t);
    g_assert_cmpuint(t.header.type, ==, LS_MESSAGE_METRICS | LS_MESSAGE_REPLY);
    taker_close(&t);
}

static void elsewhere_a_memfd_is_refused(void)
{
    Lightstage__Fetch fetch = LIGHTSTAGE__FETCH__INIT;
    struct ls_tiles tiles;
    struct ls_diag diag = {{0}};
    fetch.tiles = fetch.memfd = true;
    fetch.credit_bytes = 1;
    g_assert_cmpint(ls_tiles_read(&fetch, NULL, 0, NULL, NULL, &tiles, &diag), ==,
                    LS_ERR_UNSUPPORTED);
    g_assert_nonnull(strstr(diag.text, "Unix socket"));
    ls_tiles_finish(&tiles);
}

/* ---- the ring ---- */

static void a_ring_is_handed_over_while_there_is_one(struct hall *hall, gconstpointer data)
{
    const struct ls_camera_info info = {.width = 10, .height = 7, .pixel_format = "BayerRG12"};
    struct ls_preview *preview = ls_engine_preview(hall->stage.engine);
    Lightstage__Ring ask = LIGHTSTAGE__RING__INIT;
    struct ls_ring *ring = NULL;
    struct stat memory;
    struct taker t;
    taker_open(&t, hall);
    say(&t, LS_MESSAGE_RING, &ask.base);
    g_assert_cmpuint(take_frame(&t), ==, LS_PROTO_WRONG_STATE);
    g_assert_cmpint(ls_ring_create(4, 140, &ring, NULL), ==, LS_OK);
    ls_preview_set_ring(preview, 0, ring, &info);
    say(&t, LS_MESSAGE_RING, &ask.base);
    g_assert_cmpuint(take_frame(&t), ==, 0);
    g_assert_cmpuint(t.header.type, ==, LS_MESSAGE_RING | LS_MESSAGE_REPLY);
    g_assert_cmpint(fstat(t.fd, &memory), ==, 0);
    g_assert_cmpuint(memory.st_size, ==, ls_ring_bytes(ring));
    ls_preview_set_ring(preview, 0, NULL, NULL);
    ls_ring_destroy(ring);
    say(&t, LS_MESSAGE_RING, &ask.base);
    g_assert_cmpuint(take_frame(&t), ==, LS_PROTO_WRONG_STATE);
    ask.camera = 1;
    say(&t, LS_MESSAGE_RING, &ask.base);
    g_assert_cmpuint(take_frame(&t), ==, LS_PROTO_BAD_ARGUMENT);
    taker_close(&t);
}

/* A seventh picture does not fit beside six. */
static void what_is_kept_is_bounded(struct hall *hall, gconstpointer data)
{
    enum { PICTURE = TILES * SIDE * SIDE * 2 };
    struct ls_memfds *memfds = ls_memfds_create(6 * PICTURE);
    struct stat first, again;
    int fd[8];
    for (int i = 0; i < 8; i++) {
        struct ls_picture_map map;
        char *file = g_strdup_printf("cam0/W-%04d.exr", i % 7);
        char *folder = g_build_filename(hall->stage.storage, hall->take->id, NULL);
        g_assert_cmpint(ls_picture_map_open(&map, folder, file, TAKE_W, TAKE_H, NULL), ==, LS_OK);
        g_assert_cmpint(ls_memfds_get(memfds, &map, &fd[i], NULL), ==, LS_OK);
        ls_picture_map_finish(&map);
        g_free(file);
        g_free(folder);
    }
    fstat(fd[0], &first);
    fstat(fd[7], &again);
    g_assert_cmpuint(first.st_ino, !=, again.st_ino);
    for (int i = 0; i < 8; i++)
        close(fd[i]);
    ls_memfds_destroy(memfds);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("a-memfd-holds-what-the-socket-brings", with_take, a_memfd_holds_what_the_socket_brings);
    ADD("nobody-can-change-a-memfd", with_take, nobody_can_change_a_memfd);
    ADD("stored-pictures-are-the-same-memory-for-all", with_take,
        stored_pictures_are_the_same_memory_for_all);
    ADD("memory-is-filled-within-credit-alone", with_take, memory_is_filled_within_credit_alone);
    ADD("what-is-kept-is-bounded", with_take, what_is_kept_is_bounded);
    ADD("a-ring-is-handed-over-while-there-is-one", with_take,
        a_ring_is_handed_over_while_there_is_one);
    g_test_add_func("/serving/elsewhere-a-memfd-is-refused", elsewhere_a_memfd_is_refused);
    return g_test_run();
}

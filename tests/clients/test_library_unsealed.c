/* liblightstage, and a daemon whose shared memory is not what the protocol promises. */
#include "clients/lightstage.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <fcntl.h>
#include <glib.h>
#include <stdbool.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

enum {
    SIDE = 64,
    TILE_BYTES = SIDE * SIDE * 4,
    PAGE = 4096,
    RING_BYTES = 2 * PAGE, /* a slot, then its index */
    LENGTHS = F_SEAL_SHRINK | F_SEAL_GROW,
};

/* What the daemon hands over, and whether that may be believed. */
struct memory {
    off_t bytes;
    int seals;
    const char *sentence; /* NULL: it may */
};

/* The daemon, for one client that asks once. */
struct daemon {
    const struct memory *memory;
    bool ring;
    char *folder, *path;
    int listener;
    GThread *thread;
};

static int memory_of(const struct memory *memory)
{
    int fd = memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    g_assert_cmpint(fd, >=, 0);
    g_assert_cmpint(ftruncate(fd, memory->bytes), ==, 0);
    g_assert_cmpint(pwrite(fd, "LSRING 1", 8, PAGE), ==, 8);
    g_assert_cmpint(ftruncate(fd, memory->bytes), ==, 0);
    g_assert_cmpint(fcntl(fd, F_ADD_SEALS, memory->seals), ==, 0);
    return fd;
}

/* A whole frame comes at once: a client sends it so, and waits for the answer. */
static uint32_t hear(int client)
{
    uint8_t bytes[8192];
    struct ls_frame_header header;
    g_assert_cmpint(recv(client, bytes, sizeof bytes, 0), >=, LS_FRAME_HEADER_BYTES);
    g_assert_cmpint(ls_frame_get(bytes, 0, &header, NULL), ==, LS_OK);
    return header.request;
}

static void say(int client, uint16_t type, uint32_t request, const ProtobufCMessage *body, int fd)
{
    uint8_t bytes[1024];
    const struct ls_frame_header header = {.version = LS_FRAME_VERSION,
                                           .type = type | LS_MESSAGE_REPLY,
                                           .flags = LS_FRAME_LAST,
                                           .request = request,
                                           .message_bytes =
                                               (uint32_t)protobuf_c_message_get_packed_size(body)};
    g_assert_cmpuint(header.message_bytes, <=, sizeof bytes - LS_FRAME_HEADER_BYTES);
    ls_frame_put(&header, bytes);
    protobuf_c_message_pack(body, bytes + LS_FRAME_HEADER_BYTES);
    struct iovec part = {bytes, LS_FRAME_HEADER_BYTES + header.message_bytes};
    _Alignas(struct cmsghdr) char control[CMSG_SPACE(sizeof fd)] = {0};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    if (fd >= 0) {
        message.msg_control = control;
        message.msg_controllen = sizeof control;
        struct cmsghdr *c = CMSG_FIRSTHDR(&message);
        *c = (struct cmsghdr){CMSG_LEN(sizeof fd), SOL_SOCKET, SCM_RIGHTS};
        memcpy(CMSG_DATA(c), &fd, sizeof fd);
    }
    g_assert_cmpint(sendmsg(client, &message, MSG_NOSIGNAL), ==, (ssize_t)part.iov_len);
}

static void say_memory(const struct daemon *daemon, int client, uint32_t request)
{
    Lightstage__RingReply ring = LIGHTSTAGE__RING_REPLY__INIT;
    Lightstage__FetchReply tile = LIGHTSTAGE__FETCH_REPLY__INIT;
    uint32_t number = 0;
    uint64_t hash = 1;
    int fd = memory_of(daemon->memory);
    ring.slots = 1;
    ring.stride = ring.payload_bytes = ring.index_at = PAGE;
    ring.bytes = RING_BYTES;
    tile.width = tile.height = SIDE;
    tile.components = 1;
    tile.n_tile = tile.n_tile_hash = 1;
    tile.tile = &number;
    tile.tile_hash = &hash;
    tile.memfd = true;
    tile.memfd_bytes = TILE_BYTES;
    say(client, daemon->ring ? LS_MESSAGE_RING : LS_MESSAGE_FETCH, request,
        daemon->ring ? &ring.base : &tile.base, fd);
    close(fd);
}

static void *serve(void *user)
{
    const struct daemon *daemon = user;
    Lightstage__HelloReply hello = LIGHTSTAGE__HELLO_REPLY__INIT;
    hello.version = 1;
    int client = accept(daemon->listener, NULL, NULL);
    g_assert_cmpint(client, >=, 0);
    say(client, LS_MESSAGE_HELLO, hear(client), &hello.base, -1);
    say_memory(daemon, client, hear(client));
    close(client);
    return NULL;
}

static struct lightstage *connected(struct daemon *daemon)
{
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    struct lightstage *client = NULL;
    struct lightstage_error error = {0};
    daemon->folder = g_dir_make_tmp("unsealed-XXXXXX", NULL);
    daemon->path = g_build_filename(daemon->folder, "socket", NULL);
    g_strlcpy(name.sun_path, daemon->path, sizeof name.sun_path);
    daemon->listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    g_assert_cmpint(bind(daemon->listener, (struct sockaddr *)&name, sizeof name), ==, 0);
    g_assert_cmpint(listen(daemon->listener, 1), ==, 0);
    daemon->thread = g_thread_new("daemon", serve, daemon);
    const struct lightstage_address address = {.size = sizeof address, .where = daemon->path};
    lightstage_connect(&address, &client, &error);
    g_assert_cmpstr(error.text, ==, "");
    return client;
}

static void end(struct daemon *daemon)
{
    g_thread_join(daemon->thread);
    close(daemon->listener);
    g_assert_cmpint(unlink(daemon->path), ==, 0);
    g_assert_cmpint(rmdir(daemon->folder), ==, 0);
    g_free(daemon->path);
    g_free(daemon->folder);
}

static void is_as(const struct memory *memory, uint32_t number,
                  const struct lightstage_error *error)
{
    g_test_message("%s", error->text);
    if (!memory->sentence)
        g_assert_cmpuint(number, ==, 0);
    else if (number != LIGHTSTAGE_STRANGE || !strstr(error->text, memory->sentence))
        g_error("%u %s, expected \"%s\"", number, error->text, memory->sentence);
}

static int count_tile(const struct lightstage_tile *tile, void *user)
{
    uint32_t *seen = user;
    *seen += *(const float *)tile->values == 0;
    return 0;
}

static void tiles_that_could_change_or_are_too_short_are_refused(void)
{
    static const struct memory memories[] = {
        {TILE_BYTES, LENGTHS | F_SEAL_WRITE, NULL},
        {TILE_BYTES, 0, "its seals are 0, expected 0xe"},
        {TILE_BYTES, LENGTHS, "its seals are 0x6, expected 0xe"},
        {TILE_BYTES, F_SEAL_GROW | F_SEAL_WRITE, "its seals are 0xc"},
        {TILE_BYTES, F_SEAL_SHRINK | F_SEAL_WRITE, "its seals are 0xa"},
        {TILE_BYTES - 1, LENGTHS | F_SEAL_WRITE, "shorter than the 16384 bytes"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(memories); i++) {
        struct daemon daemon = {.memory = &memories[i]};
        struct lightstage *client = connected(&daemon);
        struct lightstage_error error = {0};
        uint32_t seen = 0;
        const struct lightstage_fetch fetch = {
            .size = sizeof fetch, .take = "take", .channel = "W", .memfd = 1};
        uint32_t number = lightstage_fetch_tiles(client, &fetch, NULL, count_tile, &seen, &error);
        is_as(&memories[i], number, &error);
        g_assert_cmpuint(seen, ==, !memories[i].sentence);
        lightstage_close(client);
        end(&daemon);
    }
}

static void a_ring_that_others_could_change_or_that_is_too_short_is_refused(void)
{
    static const struct memory memories[] = {
        {RING_BYTES, LENGTHS | F_SEAL_FUTURE_WRITE, NULL},
        {RING_BYTES, 0, "its seals are 0, expected 0x16"},
        {RING_BYTES, LENGTHS, "its seals are 0x6"},
        {RING_BYTES, F_SEAL_GROW | F_SEAL_FUTURE_WRITE, "its seals are 0x14"},
        {RING_BYTES - 1, LENGTHS | F_SEAL_FUTURE_WRITE, "shorter than the 8192 bytes"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(memories); i++) {
        struct daemon daemon = {.memory = &memories[i], .ring = true};
        struct lightstage *client = connected(&daemon);
        struct lightstage_error error = {0};
        struct lightstage_ring *ring = NULL;
        is_as(&memories[i], lightstage_ring(client, 0, &ring, &error), &error);
        g_assert_true(!ring == !!memories[i].sentence);
        lightstage_ring_free(ring);
        lightstage_close(client);
        end(&daemon);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/liblightstage/tiles-that-could-change-or-are-too-short-are-refused",
                    tiles_that_could_change_or_are_too_short_are_refused);
    g_test_add_func(
        "/liblightstage/a-ring-that-others-could-change-or-that-is-too-short-is-refused",
        a_ring_that_others_could_change_or_that_is_too_short_is_refused);
    return g_test_run();
}

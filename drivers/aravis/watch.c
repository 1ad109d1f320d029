#include "drivers/aravis/watch.h"

#include "drivers/aravis/settings.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

enum {
    CONTROL_PORT = 3956,
    ASK_MS = 400,
    IN_VAIN = 5, /* questions in a row */
    CONTROL_REGISTER = 0x0a00,
    CONTROLLED = 3, /* its bits: exclusively, or not */
    READ_ACK = 0x0081,
    ACK_BYTES = 12,
};

struct ls_aravis_watch {
    ArvStream *stream;
    void (*gone)(void *user);
    void *user;
    int socket, quit, news; /* news: of an answer, or that none will come */
    uint16_t id;            /* of the newest question */
    unsigned in_vain;       /* questions since the last sign of life */
    uint64_t packets;       /* seen of the stream */
    atomic_bool known;      /* it has answered ever */
    atomic_bool open, lost; /* a question is open; the camera is gone */
    pthread_t thread;
};

/** Read one register; GigE Vision: key, flags, command, bytes, id, address, all big-endian. */
static void ask(struct ls_aravis_watch *w)
{
    w->id = (uint16_t)(w->id == UINT16_MAX ? 1 : w->id + 1);
    const uint8_t question[] = {0x42,
                                1,
                                0,
                                0x80,
                                0,
                                4,
                                (uint8_t)(w->id >> 8),
                                (uint8_t)w->id,
                                0,
                                0,
                                CONTROL_REGISTER >> 8,
                                CONTROL_REGISTER & 0xff};
    atomic_store(&w->open, true);
    send(w->socket, question, sizeof question, MSG_DONTWAIT); /* unsent is unanswered */
}

static void tell(struct ls_aravis_watch *w, bool lost)
{
    if (lost && !atomic_exchange(&w->lost, true))
        w->gone(w->user);
    atomic_store(&w->open, false);
    eventfd_write(w->news, 1);
}

/** Any answer to the newest question is a sign of life; one that is an acknowledgement tells who
 * controls the camera. */
static void hear(struct ls_aravis_watch *w)
{
    uint8_t answer[64];
    ssize_t n = recv(w->socket, answer, sizeof answer, MSG_DONTWAIT);
    if (n < 8 || answer[6] != w->id >> 8 || answer[7] != (w->id & 0xff))
        return;
    bool read = n >= ACK_BYTES && !answer[0] && !answer[1] && answer[2] == READ_ACK >> 8 &&
                answer[3] == (READ_ACK & 0xff);
    atomic_store(&w->known, true);
    w->in_vain = 0;
    tell(w, read && !(answer[ACK_BYTES - 1] & CONTROLLED));
}

static void count_packets(struct ls_aravis_watch *w)
{
    uint64_t packets = arv_stream_get_info_uint64_by_name(w->stream, "n_received_packets");
    if (packets != w->packets)
        w->in_vain = 0;
    w->packets = packets;
}

static void *run(void *data)
{
    struct ls_aravis_watch *w = data;
    struct pollfd on[] = {{w->quit, POLLIN, 0}, {w->socket, POLLIN, 0}};
    uint64_t next_ns = ls_aravis_host_ns();
    pthread_setname_np(pthread_self(), "ls-watch");
    while (!atomic_load(&w->lost)) {
        uint64_t now_ns = ls_aravis_host_ns();
        if (now_ns >= next_ns) {
            count_packets(w);
            if (atomic_load(&w->known) && w->in_vain == IN_VAIN) {
                tell(w, true);
                break;
            }
            ask(w);
            w->in_vain++;
            next_ns = now_ns + ASK_MS * 1000000ull;
        }
        if (poll(on, 2, (int)((next_ns - now_ns) / 1000000) + 1) > 0 && on[0].revents)
            break;
        if (on[1].revents)
            hear(w); /* or an ICMP error, which is no sign of life */
    }
    return NULL;
}

static enum ls_err open_all(struct ls_aravis_watch *w, const char *address)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(CONTROL_PORT)};
    w->socket = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    w->quit = eventfd(0, EFD_CLOEXEC);
    w->news = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bool good = w->socket >= 0 && w->quit >= 0 && w->news >= 0 &&
                inet_pton(AF_INET, address, &to.sin_addr) == 1 &&
                !connect(w->socket, (struct sockaddr *)&to, sizeof to);
    return good ? LS_OK : LS_ERR_OS;
}

static void free_all(struct ls_aravis_watch *w)
{
    const int fds[] = {w->socket, w->quit, w->news};
    for (size_t i = 0; i < sizeof fds / sizeof *fds; i++)
        if (fds[i] >= 0)
            close(fds[i]);
    free(w);
}

enum ls_err ls_aravis_watch_start(const char *address, ArvStream *stream, void (*gone)(void *user),
                                  void *user, struct ls_aravis_watch **out, struct ls_diag *diag)
{
    struct ls_aravis_watch *w = calloc(1, sizeof *w);
    if (!w)
        return LS_ERR_NOMEM;
    w->stream = stream;
    w->gone = gone;
    w->user = user;
    w->socket = w->quit = w->news = -1;
    enum ls_err err = open_all(w, address);
    if (!err && pthread_create(&w->thread, NULL, run, w))
        err = LS_ERR_OS;
    if (err) {
        ls_fail(diag, err, "camera %s: cannot watch it: %s", address, strerror(errno));
        free_all(w);
        return err;
    }
    *out = w;
    return LS_OK;
}

bool ls_aravis_watch_answers(struct ls_aravis_watch *w)
{
    struct pollfd news = {w->news, POLLIN, 0};
    eventfd_t ignored;
    while (atomic_load(&w->known) && atomic_load(&w->open) && !atomic_load(&w->lost))
        if (poll(&news, 1, ASK_MS) > 0)
            eventfd_read(w->news, &ignored);
    return !atomic_load(&w->lost);
}

void ls_aravis_watch_stop(struct ls_aravis_watch *w)
{
    if (!w)
        return;
    eventfd_write(w->quit, 1);
    pthread_join(w->thread, NULL);
    free_all(w);
}

/* Tiles to one client over a Unix socket: as they are stored, and promoted; held against a plain
 * loop of writev of as many bytes over such a socket, to a reader that does as little. In memfds,
 * mapped and read once: against reading as much memory. */
#include "tests/bench/bench.h"
#include "tests/bench/references.h"
#include "tests/bench/serving.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

enum { SPANS = 128, SEND_BYTES = 1 << 20 };

struct setting {
    struct serving serving;
    struct receiver client;
    struct iovec *spans;
    size_t n_spans, bytes; /* of all stored tiles */
    Lightstage__Fetch stored, promoted, handed;
    struct reference_bytes memory; /* as many, of this process */
};

/* ---- plainly ---- */

struct plain {
    struct setting *setting;
    size_t bytes;
    int fd[2];
    uint8_t *room;
};

/* Spans are written whole or in part: what is left of one begins the next call. */
static void *write_all(void *data)
{
    struct plain *p = data;
    const struct setting *s = p->setting;
    size_t at = 0, skip = 0;
    for (size_t left = p->bytes; left > 0;) {
        struct iovec spans[SPANS];
        int n = 0;
        for (size_t k = at, room = left + skip; n < SPANS && room > 0; k++, n++) {
            spans[n] = s->spans[k % s->n_spans];
            if (spans[n].iov_len > room)
                spans[n].iov_len = room;
            room -= spans[n].iov_len;
        }
        spans[0].iov_base = (char *)spans[0].iov_base + skip;
        spans[0].iov_len -= skip;
        ssize_t wrote = writev(p->fd[0], spans, n);
        if (wrote <= 0)
            abort();
        left -= (size_t)wrote;
        at += (skip + (size_t)wrote) / s->spans[0].iov_len;
        skip = (skip + (size_t)wrote) % s->spans[0].iov_len;
    }
    return NULL;
}

static void plain_run(void *data)
{
    struct plain *p = data;
    pthread_t writer;
    if (pthread_create(&writer, NULL, write_all, p))
        abort();
    for (size_t left = p->bytes; left > 0;) {
        size_t n = left < SEND_BYTES ? left : SEND_BYTES;
        receive_bytes(p->fd[1], p->room, n);
        left -= n;
    }
    pthread_join(writer, NULL);
}

static void plain_init(struct plain *p, struct setting *s, size_t bytes)
{
    int size = SEND_BYTES; /* as the server asks for */
    *p = (struct plain){.setting = s, .bytes = bytes, .room = bench_alloc(SEND_BYTES)};
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, p->fd) ||
        setsockopt(p->fd[0], SOL_SOCKET, SO_SNDBUF, &size, sizeof size))
        abort();
}

static void plain_finish(struct plain *p)
{
    close(p->fd[0]);
    close(p->fd[1]);
    free(p->room);
}

/* ---- served ---- */

static void serve_stored(void *data)
{
    struct setting *s = data;
    receive_all(&s->client, &s->stored);
}

static void serve_promoted(void *data)
{
    struct setting *s = data;
    receive_all(&s->client, &s->promoted);
}

static void serve_memfds(void *data)
{
    struct setting *s = data;
    s->memory.sum += read_memfds(&s->client, &s->handed, true);
}

static void serve_memfds_mapped(void *data)
{
    struct setting *s = data;
    s->memory.sum += read_memfds(&s->client, &s->handed, false);
}

static void print(const struct bench *bench, const char *name, const struct bench_task *task,
                  const struct bench_task *plain, const char *reference_name, size_t bytes,
                  double wanted)
{
    double rate = (double)bytes / task->best_s, reference = (double)bytes / plain->best_s;
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "GB/s",
                                         .value = 1e-9 * rate,
                                         .median = 1e-9 * (double)bytes / task->median_s,
                                         .error = NAN,
                                         .reference = reference_name,
                                         .reference_value = 1e-9 * reference,
                                         .ratio = rate / reference,
                                         .wanted = wanted});
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting s;
    struct plain plain, plain_rgb;
    bench_init(&bench, argc, argv);
    serving_open(&s.serving, (uint32_t)bench_size(&bench, 24, 4),
                 (uint32_t)bench_size(&bench, 2048, 192), 8);
    receiver_open(&s.client, &s.serving);
    s.spans = serving_spans(&s.serving, &s.n_spans);
    s.bytes = s.n_spans * s.spans[0].iov_len;
    stored_fetch(&s.stored, &s.serving);
    promoted_fetch(&s.promoted, &s.serving);
    s.handed = s.stored;
    s.handed.memfd = true;
    s.handed.credit_bytes = UINT64_MAX;
    s.memory =
        (struct reference_bytes){.from = bench_alloc(s.bytes), .bytes = s.bytes, .n_threads = 1};
    plain_init(&plain, &s, s.bytes);
    plain_init(&plain_rgb, &s, 3 * s.bytes);
    struct bench_task tasks[] = {
        {.name = "writev", .run = plain_run, .data = &plain},
        {.name = "stored tiles", .run = serve_stored, .data = &s},
        {.name = "writev, three times", .run = plain_run, .data = &plain_rgb},
        {.name = "promoted tiles", .run = serve_promoted, .data = &s},
        {.name = "read memory", .run = reference_read, .data = &s.memory},
        {.name = "read memfds", .run = serve_memfds, .data = &s},
        {.name = "map and read memfds", .run = serve_memfds_mapped, .data = &s}};
    bench_time(&bench, tasks, 7);
    print(&bench, "serve_stored", &tasks[1], &tasks[0], "writev over a Unix socket", s.bytes, 0.8);
    print(&bench, "serve_promoted", &tasks[3], &tasks[2], "writev over a Unix socket", 3 * s.bytes,
          0.6);
    print(&bench, "serve_memfd", &tasks[5], &tasks[4], "reading memory", s.bytes, 0.8);
    print(&bench, "serve_memfd_mapped", &tasks[6], &tasks[4], "reading memory", s.bytes, NAN);
    free((void *)s.memory.from);
    plain_finish(&plain);
    plain_finish(&plain_rgb);
    g_free(s.spans);
    receiver_close(&s.client);
    serving_close(&s.serving);
    return 0;
}

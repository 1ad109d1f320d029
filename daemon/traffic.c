#include "daemon/traffic.h"

#include <glib-unix.h>
#include <stddef.h>

enum {
    READ_BYTES = 64 * 1024,
    HIGH_BYTES = 1024 * 1024, /* above: no new frames are made, nothing more is read */
    SMALL_BYTES = 64 * 1024,  /* up to this ls-main writes itself */
};

size_t ls_traffic_waiting(const struct ls_traffic *traffic)
{
    return ls_outbox_waiting(&traffic->outbox);
}

bool ls_traffic_has_room(const struct ls_traffic *traffic)
{
    return ls_traffic_waiting(traffic) < HIGH_BYTES;
}

static void drop_source(guint *source)
{
    if (*source)
        g_source_remove(*source);
    *source = 0;
}

/* ---- out ---- */

static gboolean on_writable(gint fd, GIOCondition condition, gpointer data);

/* Any thread. */
static enum ls_err write_some(struct ls_traffic *traffic)
{
    size_t sent = 0;
    enum ls_err err = ls_outbox_write(&traffic->outbox, traffic->transport, &sent);
    if (sent > 0)
        __atomic_store_n(&traffic->wrote_us, g_get_monotonic_time(), __ATOMIC_RELAXED);
    return err;
}

static void watch_for_room(struct ls_traffic *traffic)
{
    if (traffic->open && !traffic->writing && !traffic->flushing && ls_traffic_waiting(traffic) > 0)
        traffic->writing = g_unix_fd_add(traffic->transport->fd, G_IO_OUT, on_writable, traffic);
}

static enum ls_err flush_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct ls_traffic *traffic =
        (struct ls_traffic *)((char *)job - offsetof(struct ls_traffic, flush));
    enum ls_err err = write_some(traffic);
    *last = true;
    return err == LS_ERR_BUSY ? LS_OK : err; /* who writes will settle */
}

static const struct ls_job_ops flush_ops = {"flush", flush_step, NULL};

static void on_flushed(void *user, struct ls_job *job, struct ls_job_result *result)
{
    struct ls_traffic *traffic = user;
    traffic->flushing = false;
    if (result->err && traffic->open)
        traffic->ops->gone(traffic->user);
    ls_traffic_settle(traffic);
    traffic->ops->release(traffic->user);
}

static void hand_over(struct ls_traffic *traffic)
{
    traffic->flushing = true;
    traffic->ops->hold(traffic->user);
    ls_job_pool_step(traffic->pool, &traffic->flush, NULL, on_flushed, traffic);
}

/* A thread that finds `wanted` when it stops writing reports at once. */
static void write_here(struct ls_traffic *traffic)
{
    g_atomic_int_set(&traffic->wanted, 1);
    enum ls_err err = write_some(traffic);
    if (err == LS_ERR_BUSY)
        return;
    g_atomic_int_set(&traffic->wanted, 0);
    if (err)
        traffic->ops->gone(traffic->user);
    else
        ls_traffic_settle(traffic);
}

static gboolean on_writable(gint fd, GIOCondition condition, gpointer data)
{
    struct ls_traffic *traffic = data;
    traffic->writing = 0;
    traffic->ops->hold(traffic->user);
    if (ls_traffic_waiting(traffic) > SMALL_BYTES)
        hand_over(traffic);
    else
        write_here(traffic);
    traffic->ops->release(traffic->user);
    return G_SOURCE_REMOVE;
}

static void queue(struct ls_traffic *traffic, struct ls_chunk *chunk)
{
    if (ls_traffic_waiting(traffic) == 0)
        __atomic_store_n(&traffic->wrote_us, g_get_monotonic_time(), __ATOMIC_RELAXED);
    ls_outbox_push(&traffic->outbox, chunk);
}

void ls_traffic_push(struct ls_traffic *traffic, struct ls_chunk *chunk)
{
    queue(traffic, chunk);
    watch_for_room(traffic);
}

bool ls_traffic_send(struct ls_traffic *traffic, struct ls_chunk *chunk)
{
    queue(traffic, chunk);
    return write_some(traffic) == LS_OK && ls_traffic_waiting(traffic) == 0 &&
           !g_atomic_int_get(&traffic->wanted);
}

void ls_traffic_settle(struct ls_traffic *traffic)
{
    g_atomic_int_set(&traffic->wanted, 0);
    if (traffic->open)
        traffic->ops->wrote(traffic->user);
    watch_for_room(traffic);
}

void ls_traffic_write_now(struct ls_traffic *traffic)
{
    if (write_some(traffic))
        g_debug("a client left before the daemon");
}

/* ---- in ---- */

static void decode(struct ls_traffic *traffic)
{
    while (traffic->in_used < traffic->in_fill && traffic->open && !traffic->deaf &&
           ls_traffic_has_room(traffic)) {
        size_t used = 0;
        int complete = 0;
        struct ls_diag diag = {0};
        if (!ls_frame_decoder_inside(&traffic->decoder))
            traffic->begun_us = g_get_monotonic_time();
        enum ls_err err =
            ls_frame_decoder_feed(&traffic->decoder, traffic->in + traffic->in_used,
                                  traffic->in_fill - traffic->in_used, &used, &complete, &diag);
        traffic->in_used += used;
        if (err) {
            traffic->ops->damaged(traffic->user, err, &diag);
            return;
        }
        if (complete) {
            traffic->ops->frame(traffic->user);
            ls_frame_decoder_next(&traffic->decoder);
        }
    }
}

static void take_more(struct ls_traffic *traffic)
{
    size_t n = 0;
    if (ls_transport_read(traffic->transport, traffic->in, READ_BYTES, &n)) {
        traffic->ops->gone(traffic->user);
        return;
    }
    if (n == 0)
        return;
    traffic->in_used = 0;
    traffic->in_fill = n;
    decode(traffic);
    if (!ls_traffic_has_room(traffic))
        drop_source(&traffic->reading);
}

/* One read per turn of the loop, so that every client has its turn. */
static gboolean on_readable(gint fd, GIOCondition condition, gpointer data)
{
    struct ls_traffic *traffic = data;
    traffic->ops->hold(traffic->user);
    take_more(traffic);
    bool on = traffic->reading != 0;
    traffic->ops->release(traffic->user);
    return on ? G_SOURCE_CONTINUE : G_SOURCE_REMOVE;
}

void ls_traffic_go_on(struct ls_traffic *traffic)
{
    decode(traffic);
    if (!traffic->open || traffic->reading || traffic->deaf || !ls_traffic_has_room(traffic))
        return;
    traffic->begun_us = g_get_monotonic_time();
    traffic->reading =
        g_unix_fd_add(traffic->transport->fd, G_IO_IN | G_IO_HUP | G_IO_ERR, on_readable, traffic);
}

bool ls_traffic_stalled(const struct ls_traffic *traffic, int64_t now_us, unsigned ms)
{
    int64_t wrote_us = __atomic_load_n(&traffic->wrote_us, __ATOMIC_RELAXED);
    if (ls_traffic_waiting(traffic) > 0 && (now_us - wrote_us) / 1000 >= ms)
        return true;
    return traffic->reading && ls_frame_decoder_inside(&traffic->decoder) &&
           (now_us - traffic->begun_us) / 1000 >= ms;
}

int64_t ls_traffic_quiet_us(const struct ls_traffic *traffic, int64_t now_us)
{
    int64_t wrote_us = __atomic_load_n(&traffic->wrote_us, __ATOMIC_RELAXED);
    return now_us - (wrote_us > traffic->begun_us ? wrote_us : traffic->begun_us);
}

/* ---- life ---- */

void ls_traffic_init(struct ls_traffic *traffic, struct ls_transport *transport,
                     struct ls_job_pool *pool, uint64_t max_payload,
                     const struct ls_traffic_ops *ops, void *user)
{
    *traffic = (struct ls_traffic){.ops = ops, .user = user, .pool = pool, .transport = transport};
    traffic->flush.ops = &flush_ops;
    traffic->open = true;
    traffic->begun_us = traffic->wrote_us = g_get_monotonic_time();
    traffic->in = g_malloc(READ_BYTES);
    ls_frame_decoder_init(&traffic->decoder, max_payload);
    ls_outbox_init(&traffic->outbox);
}

void ls_traffic_last_words(struct ls_traffic *traffic)
{
    traffic->deaf = true;
    drop_source(&traffic->reading);
    ls_outbox_close(&traffic->outbox);
}

void ls_traffic_close(struct ls_traffic *traffic)
{
    traffic->open = false;
    drop_source(&traffic->writing);
    ls_traffic_last_words(traffic);
    ls_transport_shut(traffic->transport);
}

void ls_traffic_finish(struct ls_traffic *traffic)
{
    ls_frame_decoder_finish(&traffic->decoder);
    ls_outbox_finish(&traffic->outbox);
    ls_transport_destroy(traffic->transport);
    g_free(traffic->in);
}

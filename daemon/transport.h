/*
 * transport: how the bytes of a connection travel: plainly, or encrypted (tls_transport.h).
 * Layer: daemon. Threads: one reads and one writes, at the same time if they like; shut from any.
 * Ownership: the maker's; owns its descriptor.
 */
#ifndef LS_DAEMON_TRANSPORT_H
#define LS_DAEMON_TRANSPORT_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <sys/uio.h>

struct ls_transport;

/** All required but the last. None of them blocks on the peer. */
struct ls_transport_ops {
    const char *name; /* "unix" */
    /** At most @size bytes of what has come. LS_OK with *n = 0: nothing more now; LS_ERR_GONE: the
     * peer has left, or cannot be trusted any more. */
    enum ls_err (*read)(struct ls_transport *transport, void *bytes, size_t size, size_t *n);
    /** As much of the spans as goes out now, *n bytes (0: nothing now). LS_ERR_GONE as above. What
     * is not written is offered again, from the same place in memory. */
    enum ls_err (*write)(struct ls_transport *transport, const struct iovec *spans, size_t n_spans,
                         size_t *n);
    /** Nothing goes either way any more, and the peer hears so at once. The descriptor stays. */
    void (*shut)(struct ls_transport *transport);
    void (*destroy)(struct ls_transport *transport);
    /** As write, and with the first byte the descriptor @fd. NULL: it carries none. */
    enum ls_err (*write_fd)(struct ls_transport *transport, const struct iovec *spans,
                            size_t n_spans, int fd, size_t *n);
};

/** First member of every kind of transport. */
struct ls_transport {
    const struct ls_transport_ops *ops;
    int fd; /* to poll */
};

/** The connected non-blocking socket @fd (transfer full), bytes as they are. (transfer full). */
struct ls_transport *ls_transport_plain(int fd);

/** Read and drop what a peer has sent, a mebibyte at most: unread bytes at close would reach it as
 * a reset, before it has read our last words. */
void ls_transport_drain(int fd);

LS_MUST_CHECK enum ls_err ls_transport_read(struct ls_transport *transport, void *bytes,
                                            size_t size, size_t *n);
LS_MUST_CHECK enum ls_err ls_transport_write(struct ls_transport *transport,
                                             const struct iovec *spans, size_t n_spans, size_t *n);
bool ls_transport_passes_fds(const struct ls_transport *transport);
LS_MUST_CHECK enum ls_err ls_transport_write_fd(struct ls_transport *transport,
                                                const struct iovec *spans, size_t n_spans, int fd,
                                                size_t *n);
void ls_transport_shut(struct ls_transport *transport);

/** Shuts first. NULL is allowed. */
void ls_transport_destroy(struct ls_transport *transport);

#endif

#include "daemon/transport.h"

#include <errno.h>
#include <glib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { DRAIN_BYTES = 1024 * 1024 };

void ls_transport_drain(int fd)
{
    char bytes[4096];
    ssize_t n;
    for (size_t total = 0; total < DRAIN_BYTES; total += (size_t)n)
        if ((n = recv(fd, bytes, sizeof bytes, MSG_DONTWAIT)) <= 0)
            return;
}

static bool later(void)
{
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
}

static enum ls_err plain_read(struct ls_transport *transport, void *bytes, size_t size, size_t *n)
{
    ssize_t got = recv(transport->fd, bytes, size, MSG_DONTWAIT);
    *n = got > 0 ? (size_t)got : 0;
    return got > 0 || (got < 0 && later()) ? LS_OK : LS_ERR_GONE;
}

static enum ls_err send_message(struct ls_transport *transport, const struct msghdr *message,
                                size_t *n)
{
    ssize_t wrote;
    do
        wrote = sendmsg(transport->fd, message, MSG_NOSIGNAL | MSG_DONTWAIT);
    while (wrote < 0 && errno == EINTR);
    *n = wrote > 0 ? (size_t)wrote : 0;
    return wrote >= 0 || later() ? LS_OK : LS_ERR_GONE;
}

static enum ls_err plain_write(struct ls_transport *transport, const struct iovec *spans,
                               size_t n_spans, size_t *n)
{
    struct msghdr message = {.msg_iov = (struct iovec *)spans, .msg_iovlen = n_spans};
    return send_message(transport, &message, n);
}

static enum ls_err plain_write_fd(struct ls_transport *transport, const struct iovec *spans,
                                  size_t n_spans, int fd, size_t *n)
{
    union {
        struct cmsghdr header;
        char room[CMSG_SPACE(sizeof(int))];
    } control = {.header = {.cmsg_level = SOL_SOCKET,
                            .cmsg_type = SCM_RIGHTS,
                            .cmsg_len = CMSG_LEN(sizeof fd)}};
    struct msghdr message = {.msg_iov = (struct iovec *)spans,
                             .msg_iovlen = n_spans,
                             .msg_control = &control,
                             .msg_controllen = sizeof control.room};
    memcpy(CMSG_DATA(&control.header), &fd, sizeof fd);
    return send_message(transport, &message, n);
}

static void plain_shut(struct ls_transport *transport)
{
    ls_transport_drain(transport->fd);
    shutdown(transport->fd, SHUT_RDWR);
}

static void plain_destroy(struct ls_transport *transport)
{
    close(transport->fd);
    g_free(transport);
}

static const struct ls_transport_ops plain_ops = {"unix",     plain_read,    plain_write,
                                                  plain_shut, plain_destroy, plain_write_fd};

struct ls_transport *ls_transport_plain(int fd)
{
    struct ls_transport *transport = g_new(struct ls_transport, 1);
    *transport = (struct ls_transport){&plain_ops, fd};
    return transport;
}

enum ls_err ls_transport_read(struct ls_transport *transport, void *bytes, size_t size, size_t *n)
{
    return transport->ops->read(transport, bytes, size, n);
}

enum ls_err ls_transport_write(struct ls_transport *transport, const struct iovec *spans,
                               size_t n_spans, size_t *n)
{
    return transport->ops->write(transport, spans, n_spans, n);
}

bool ls_transport_passes_fds(const struct ls_transport *transport)
{
    return transport->ops->write_fd != NULL;
}

enum ls_err ls_transport_write_fd(struct ls_transport *transport, const struct iovec *spans,
                                  size_t n_spans, int fd, size_t *n)
{
    return transport->ops->write_fd(transport, spans, n_spans, fd, n);
}

void ls_transport_shut(struct ls_transport *transport)
{
    transport->ops->shut(transport);
}

void ls_transport_destroy(struct ls_transport *transport)
{
    if (!transport)
        return;
    transport->ops->shut(transport);
    transport->ops->destroy(transport);
}

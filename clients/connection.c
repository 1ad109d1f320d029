#include "clients/connection.h"

#include "proto/errors.h"
#include "proto/frame.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

enum { READ_BYTES = 256 * 1024, MOST_FDS = 4 };
static const uint64_t max_payload = (uint64_t)1 << 30; /* of a reply; memory grows as it arrives */

struct ls_connection {
    int fd;
    struct ls_secure *secure; /* NULL: fd is a plain socket of ours, else it is secure's */
    uint32_t last_request;
    uint32_t error;
    struct ls_frame_decoder decoder;
    bool frame_taken; /* the decoder's frame has been handed out */
    uint8_t *in;
    size_t in_used, in_fill;
    int fds[MOST_FDS], n_fds; /* that have come, in the order of the frames that say so */
};

void ls_reply_finish(struct ls_reply *reply)
{
    ls_message_free(reply->message);
    if (reply->fd >= 0)
        close(reply->fd);
    *reply = (struct ls_reply){.fd = -1};
}

uint32_t ls_connection_error(const struct ls_connection *connection)
{
    return connection->error;
}

int ls_connection_descriptor(const struct ls_connection *connection)
{
    return connection->fd;
}

bool ls_connection_has_bytes(const struct ls_connection *connection)
{
    return connection->in_used < connection->in_fill ||
           (connection->secure && ls_secure_has_bytes(connection->secure));
}

void ls_connection_close(struct ls_connection *connection)
{
    if (!connection)
        return;
    if (!connection->secure)
        close(connection->fd);
    ls_secure_close(connection->secure);
    for (int i = 0; i < connection->n_fds; i++)
        close(connection->fds[i]);
    ls_frame_decoder_finish(&connection->decoder);
    free(connection->in);
    free(connection);
}

static enum ls_err lost(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_GONE, "the connection to the daemon is lost");
}

static enum ls_err send_all(struct ls_connection *connection, struct iovec *spans, size_t n,
                            struct ls_diag *diag)
{
    size_t at = 0;
    enum ls_err err = LS_OK;
    for (; connection->secure && at < n && !err; at++)
        err = ls_secure_write(connection->secure, spans[at].iov_base, spans[at].iov_len, diag);
    while (at < n && !err) {
        struct msghdr message = {.msg_iov = spans + at, .msg_iovlen = n - at};
        ssize_t sent = sendmsg(connection->fd, &message, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR)
            continue;
        if (sent < 0)
            return lost(diag);
        for (; at < n && (size_t)sent >= spans[at].iov_len; at++)
            sent -= (ssize_t)spans[at].iov_len;
        if (at < n) {
            spans[at].iov_base = (uint8_t *)spans[at].iov_base + sent;
            spans[at].iov_len -= (size_t)sent;
        }
    }
    return err;
}

enum ls_err ls_connection_send(struct ls_connection *connection, uint16_t type,
                               const ProtobufCMessage *body, const void *payload,
                               size_t payload_bytes, uint32_t *request, struct ls_diag *diag)
{
    uint8_t *head = NULL;
    size_t head_bytes = 0;
    uint32_t id = ++connection->last_request;
    enum ls_err err =
        ls_message_frame(type, id, LS_FRAME_LAST, body, payload_bytes, &head, &head_bytes, diag);
    if (err)
        return err;
    struct iovec spans[2] = {{head, head_bytes}, {(void *)payload, payload_bytes}};
    err = send_all(connection, spans, payload_bytes ? 2 : 1, diag);
    free(head);
    *request = id;
    /* A daemon that refuses says why before it closes: what it said is still to be read. */
    return err == LS_ERR_GONE ? LS_OK : err;
}

/* More than are waited for at once is nothing that a daemon does. */
static enum ls_err keep_fds(struct ls_connection *connection, struct msghdr *message,
                            struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c; c = CMSG_NXTHDR(message, c)) {
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_RIGHTS)
            continue;
        for (size_t at = CMSG_LEN(0); at + sizeof(int) <= c->cmsg_len; at += sizeof(int)) {
            int fd;
            memcpy(&fd, (const char *)c + at, sizeof fd);
            if (connection->n_fds < MOST_FDS)
                connection->fds[connection->n_fds++] = fd;
            else {
                close(fd);
                err = ls_fail(diag, LS_ERR_INVALID, "the daemon sent descriptors unasked for");
            }
        }
    }
    return err;
}

static enum ls_err read_plain(struct ls_connection *connection, size_t *n, struct ls_diag *diag)
{
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(MOST_FDS * sizeof(int))];
    } control;
    struct iovec span = {connection->in, READ_BYTES};
    struct msghdr message = {.msg_iov = &span,
                             .msg_iovlen = 1,
                             .msg_control = &control,
                             .msg_controllen = sizeof control};
    ssize_t got = recvmsg(connection->fd, &message, MSG_CMSG_CLOEXEC);
    if (got < 0 && errno == EINTR)
        return ls_fail(diag, LS_ERR_ABORTED, "interrupted");
    *n = got > 0 ? (size_t)got : 0;
    return got > 0 ? keep_fds(connection, &message, diag) : lost(diag);
}

static enum ls_err read_more(struct ls_connection *connection, struct ls_diag *diag)
{
    struct ls_secure *secure = connection->secure;
    size_t n = 0;
    enum ls_err err = secure ? ls_secure_read(secure, connection->in, READ_BYTES, &n, diag)
                             : read_plain(connection, &n, diag);
    if (err)
        return err;
    connection->in_used = 0;
    connection->in_fill = n;
    return LS_OK;
}

static enum ls_err next_frame(struct ls_connection *connection, struct ls_diag *diag)
{
    int complete = 0;
    if (connection->frame_taken)
        ls_frame_decoder_next(&connection->decoder);
    connection->frame_taken = false;
    while (!complete) {
        size_t used = 0;
        enum ls_err err = LS_OK;
        if (connection->in_used == connection->in_fill)
            err = read_more(connection, diag);
        if (!err)
            err = ls_frame_decoder_feed(&connection->decoder, connection->in + connection->in_used,
                                        connection->in_fill - connection->in_used, &used, &complete,
                                        diag);
        if (err)
            return err;
        connection->in_used += used;
    }
    connection->frame_taken = true;
    return LS_OK;
}

/* The descriptor that the frame says comes with it, if it does. */
static enum ls_err take_fd(struct ls_connection *connection, struct ls_reply *reply,
                           struct ls_diag *diag)
{
    bool with = reply->type == (LS_MESSAGE_RING | LS_MESSAGE_REPLY) ||
                (reply->type == (LS_MESSAGE_FETCH | LS_MESSAGE_REPLY) &&
                 ((const Lightstage__FetchReply *)reply->message)->memfd);
    if (!with)
        return LS_OK;
    if (!connection->n_fds)
        return ls_fail(diag, LS_ERR_INVALID,
                       "the daemon sent no descriptor of the memory it speaks of, or there are too "
                       "many open");
    reply->fd = connection->fds[0];
    memmove(connection->fds, connection->fds + 1, (size_t)--connection->n_fds * sizeof(int));
    return LS_OK;
}

static enum ls_err remote_error(struct ls_connection *connection, struct ls_reply *reply,
                                struct ls_diag *diag)
{
    const Lightstage__Error *error = (const Lightstage__Error *)reply->message;
    connection->error = error->number;
    ls_fail(diag, LS_ERR_REFUSED, "%s", error->text);
    uint32_t request = reply->request;
    ls_reply_finish(reply);
    reply->request = request;
    return LS_ERR_REFUSED;
}

enum ls_err ls_connection_receive(struct ls_connection *connection, uint32_t request,
                                  struct ls_reply *reply, struct ls_diag *diag)
{
    *reply = (struct ls_reply){.fd = -1};
    for (;;) {
        enum ls_err err = next_frame(connection, diag);
        const struct ls_frame_header *header = &connection->decoder.header;
        if (err)
            return err;
        if (request && header->request && header->request != request)
            continue;
        err = ls_message_decode(header->type, ls_frame_decoder_message(&connection->decoder),
                                header->message_bytes, &reply->message, diag);
        if (err)
            return err;
        reply->type = header->type;
        reply->request = header->request;
        reply->last = header->flags & LS_FRAME_LAST;
        reply->payload = ls_frame_decoder_payload(&connection->decoder);
        reply->payload_bytes = (size_t)header->payload_bytes;
        return header->type == LS_MESSAGE_ERROR ? remote_error(connection, reply, diag)
                                                : take_fd(connection, reply, diag);
    }
}

enum ls_err ls_connection_call(struct ls_connection *connection, uint16_t type,
                               const ProtobufCMessage *body, const void *payload,
                               size_t payload_bytes, struct ls_reply *reply, struct ls_diag *diag)
{
    uint32_t request = 0;
    enum ls_err err =
        ls_connection_send(connection, type, body, payload, payload_bytes, &request, diag);
    if (err)
        return err;
    do
        err = ls_connection_receive(connection, request, reply, diag);
    while (err == LS_ERR_ABORTED);
    if (!err && reply->type != (type | LS_MESSAGE_REPLY)) {
        ls_reply_finish(reply);
        return ls_fail(diag, LS_ERR_INVALID, "the daemon answered %s with another kind of message",
                       ls_message_name(type));
    }
    return err;
}

enum ls_err ls_connection_over(int fd, struct ls_secure *secure, struct ls_connection **out,
                               struct ls_diag *diag)
{
    struct ls_connection *connection = calloc(1, sizeof *connection);
    uint8_t *in = malloc(READ_BYTES);
    if (!connection || !in) {
        free(connection);
        free(in);
        if (!secure)
            close(fd);
        ls_secure_close(secure);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    }
    connection->fd = fd;
    connection->secure = secure;
    connection->in = in;
    ls_frame_decoder_init(&connection->decoder, max_payload);
    *out = connection;
    return LS_OK;
}

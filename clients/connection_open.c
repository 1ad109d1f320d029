/* To a daemon, and Hello. */
#include "clients/connection.h"

#include "proto/frame.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static enum ls_err connect_unix(const char *path, int *out, struct ls_diag *diag)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path)
        return ls_fail(diag, LS_ERR_INVALID, "socket path %s: at most %zu characters", path,
                       sizeof address.sun_path - 1);
    strcpy(address.sun_path, path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return ls_fail(diag, LS_ERR_OS, "socket: %s", strerror(errno));
    if (connect(fd, (const struct sockaddr *)&address, sizeof address)) {
        int reason = errno;
        close(fd);
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "no lightstaged answers at %s (%s): start it, or name its socket", path,
                       strerror(reason));
    }
    *out = fd;
    return LS_OK;
}

enum ls_err ls_connection_reach(const struct ls_remote *remote, struct ls_connection **out,
                                struct ls_diag *diag)
{
    struct ls_secure *secure = NULL;
    int fd = -1;
    enum ls_err err = ls_remote_is_url(remote->url) ? ls_secure_connect(remote, &secure, diag)
                                                    : connect_unix(remote->url, &fd, diag);
    if (err)
        return err;
    return ls_connection_over(secure ? ls_secure_fd(secure) : fd, secure, out, diag);
}

enum ls_err ls_connection_greet(struct ls_connection *connection, struct ls_reply *reply,
                                struct ls_diag *diag)
{
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    hello.version = LS_FRAME_VERSION;
    hello.client = program_invocation_short_name;
    return ls_connection_call(connection, LS_MESSAGE_HELLO, &hello.base, NULL, 0, reply, diag);
}

enum ls_err ls_connection_open_remote(const struct ls_remote *remote, struct ls_connection **out,
                                      struct ls_diag *diag)
{
    struct ls_connection *connection = NULL;
    struct ls_reply reply;
    enum ls_err err = ls_connection_reach(remote, &connection, diag);
    if (!err)
        err = ls_connection_greet(connection, &reply, diag);
    if (err) {
        ls_connection_close(connection);
        return err;
    }
    ls_reply_finish(&reply);
    *out = connection;
    return LS_OK;
}

enum ls_err ls_connection_open(const char *socket_path, struct ls_connection **out,
                               struct ls_diag *diag)
{
    const struct ls_remote remote = {.url = socket_path};
    return ls_connection_open_remote(&remote, out, diag);
}

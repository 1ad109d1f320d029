#include "daemon/listen.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

enum { BACKLOG = 32 };

static enum ls_err fill_address(const char *path, struct sockaddr_un *address, struct ls_diag *diag)
{
    memset(address, 0, sizeof *address);
    address->sun_family = AF_UNIX;
    if (!path || !path[0] || strlen(path) >= sizeof address->sun_path)
        return ls_fail(diag, LS_ERR_INVALID,
                       "socket path \"%.120s\": %zu characters, expected 1 to %zu",
                       path ? path : "", path ? strlen(path) : 0, sizeof address->sun_path - 1);
    strcpy(address->sun_path, path);
    return LS_OK;
}

/* Connecting tells a living daemon (accepted or backlog full) from the file of a dead one. */
static enum ls_err remove_stale(const struct sockaddr_un *address, struct ls_diag *diag)
{
    struct stat info;
    const char *path = address->sun_path;
    if (lstat(path, &info))
        return errno == ENOENT ? LS_OK
                               : ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %s", path, strerror(errno));
    if (!S_ISSOCK(info.st_mode))
        return ls_fail(diag, LS_ERR_EXISTS,
                       "%s exists and is no socket; move it away or set another socket path", path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return ls_fail(diag, LS_ERR_OS, "socket: %s", strerror(errno));
    int refused =
        connect(fd, (const struct sockaddr *)address, sizeof *address) && errno == ECONNREFUSED;
    close(fd);
    if (!refused)
        return ls_fail(diag, LS_ERR_BUSY,
                       "%s is in use by a running lightstaged; stop it or set another socket path",
                       path);
    if (unlink(path) && errno != ENOENT)
        return ls_fail(diag, LS_ERR_OS, "%s: cannot remove the stale socket: %s", path,
                       strerror(errno));
    return LS_OK;
}

static enum ls_err bind_and_listen(int fd, const struct sockaddr_un *address, struct ls_diag *diag)
{
    const char *path = address->sun_path;
    mode_t old = umask(0117);
    int failed = bind(fd, (const struct sockaddr *)address, sizeof *address);
    int reason = errno;
    umask(old);
    if (failed && reason == ENOENT)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: its folder does not exist", path);
    if (failed)
        return ls_fail(diag, reason == EADDRINUSE ? LS_ERR_BUSY : LS_ERR_OS, "%s: %s", path,
                       strerror(reason));
    if (listen(fd, BACKLOG))
        return ls_fail(diag, LS_ERR_OS, "%s: listen: %s", path, strerror(errno));
    return LS_OK;
}

/* Two daemons starting at once would both find the socket stale: the folder is the lock. */
static int lock_folder(const char *path)
{
    char folder[sizeof((struct sockaddr_un *)0)->sun_path + 4];
    const char *slash = strrchr(path, '/');
    snprintf(folder, sizeof folder, "%.*s", slash ? (int)(slash - path) + 1 : 1,
             slash ? path : ".");
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd >= 0)
        flock(fd, LOCK_EX);
    return fd;
}

enum ls_err ls_listen_check(const char *path, struct ls_diag *diag)
{
    struct sockaddr_un address;
    return fill_address(path, &address, diag);
}

enum ls_err ls_listen_unix(const char *path, int *out, struct ls_diag *diag)
{
    struct sockaddr_un address;
    enum ls_err err = fill_address(path, &address, diag);
    if (err)
        return err;
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return ls_fail(diag, LS_ERR_OS, "socket: %s", strerror(errno));
    int lock = lock_folder(path);
    err = remove_stale(&address, diag);
    if (!err)
        err = bind_and_listen(fd, &address, diag);
    if (lock >= 0)
        close(lock);
    if (err)
        close(fd);
    else
        *out = fd;
    return err;
}

/* ---- TCP ---- */

static enum ls_err resolve(const char *address, unsigned port, struct addrinfo **out,
                           struct ls_diag *diag)
{
    struct addrinfo hints = {.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV | AI_PASSIVE,
                             .ai_socktype = SOCK_STREAM};
    char service[16];
    snprintf(service, sizeof service, "%u", port);
    int failed = getaddrinfo(address, service, &hints, out);
    return failed ? ls_fail(diag, LS_ERR_INVALID,
                            "listen address \"%.60s\": %s; expected a numeric one of this host",
                            address, gai_strerror(failed))
                  : LS_OK;
}

static enum ls_err listen_at(int fd, const struct addrinfo *to, struct sockaddr_storage *bound)
{
    socklen_t size = sizeof *bound;
    int on = 1;
    if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) ||
        bind(fd, to->ai_addr, to->ai_addrlen) || listen(fd, BACKLOG) ||
        getsockname(fd, (struct sockaddr *)bound, &size))
        return errno == EADDRINUSE      ? LS_ERR_BUSY
               : errno == EADDRNOTAVAIL ? LS_ERR_INVALID
                                        : LS_ERR_OS;
    return LS_OK;
}

enum ls_err ls_listen_tcp(const char *address, unsigned port, int *out,
                          struct sockaddr_storage *bound, struct ls_diag *diag)
{
    struct addrinfo *to = NULL;
    enum ls_err err = resolve(address, port, &to, diag);
    if (err)
        return err;
    int fd = socket(to->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    err = fd < 0 ? LS_ERR_OS : listen_at(fd, to, bound);
    if (err)
        ls_fail(diag, err, "listen at %s port %u: %s", address, port, strerror(errno));
    freeaddrinfo(to);
    if (err && fd >= 0)
        close(fd);
    if (!err)
        *out = fd;
    return err;
}

void ls_listen_name(const struct sockaddr_storage *address, char *name, size_t size)
{
    char host[48], port[8];
    if (getnameinfo((const struct sockaddr *)address, sizeof *address, host, sizeof host, port,
                    sizeof port, NI_NUMERICHOST | NI_NUMERICSERV))
        snprintf(name, size, "?");
    else
        snprintf(name, size, address->ss_family == AF_INET6 ? "[%s]:%s" : "%s:%s", host, port);
}

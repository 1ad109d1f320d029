#include "daemon/listen.h"

#include <errno.h>
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
        return ls_fail(diag, LS_ERR_INVALID, "socket path \"%.120s\": %zu characters, expected 1 to %zu",
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

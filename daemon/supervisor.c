#include "daemon/supervisor.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

enum ls_err ls_supervisor_socket(const char *path, int *fd, struct ls_diag *diag)
{
    int n = sd_listen_fds(1);
    *fd = -1;
    if (n < 0)
        return ls_fail(diag, LS_ERR_OS, "sockets passed to this process: %s", strerror(-n));
    if (n == 0)
        return LS_OK;
    if (n > 1 || sd_is_socket_unix(SD_LISTEN_FDS_START, SOCK_STREAM, 1, path, 0) <= 0)
        return ls_fail(diag, LS_ERR_INVALID,
                       "%d sockets were passed to this process: expected one, listening at the "
                       "configured socket path %s (ListenStream= of the socket unit)",
                       n, path);
    if (fcntl(SD_LISTEN_FDS_START, F_SETFL, O_NONBLOCK))
        return ls_fail(diag, LS_ERR_OS, "socket passed: %s", strerror(errno));
    *fd = SD_LISTEN_FDS_START;
    return LS_OK;
}

void ls_supervisor_ready(const char *status)
{
    (void)sd_notifyf(0, "READY=1\nSTATUS=%s", status);
}

void ls_supervisor_stopping(void)
{
    (void)sd_notify(0, "STOPPING=1");
}

static gboolean beat(gpointer unused)
{
    (void)sd_notify(0, "WATCHDOG=1");
    return G_SOURCE_CONTINUE;
}

guint ls_supervisor_watchdog(void)
{
    uint64_t us;
    return sd_watchdog_enabled(0, &us) > 0 ? g_timeout_add((guint)(us / 2000), beat, NULL) : 0;
}

/*
 * supervisor: what the daemon tells systemd, or anything that speaks its protocol, and takes from
 * it: readiness, a watchdog, a listening socket. Without one every function does nothing.
 * Layer: daemon. Threads: ls-main. Source: sd_notify(3), sd_listen_fds(3), sd_watchdog_enabled(3).
 */
#ifndef LS_DAEMON_SUPERVISOR_H
#define LS_DAEMON_SUPERVISOR_H

#include "core/error.h"

#include <glib.h>

/** The listening socket passed to this process; *fd: (transfer full), -1 if none was. Errors:
 * LS_ERR_INVALID (not the Unix socket at @path, or several), LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_supervisor_socket(const char *path, int *fd, struct ls_diag *diag);

/** Clients may connect. @status is a sentence for whoever asks. */
void ls_supervisor_ready(const char *status);

/** The end has begun; it may take as long as a camera takes to close. */
void ls_supervisor_stopping(void);

/** If a watchdog wants it, say so from the default main loop, twice in its time. Returns a source
 * to remove, 0 if nobody watches. */
guint ls_supervisor_watchdog(void);

#endif

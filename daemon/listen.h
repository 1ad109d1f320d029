/*
 * listen: the daemon's sockets. The Unix one is taken over from a dead daemon, never from a living
 * one.
 * Layer: daemon. Threads: any. Ownership: the caller owns the descriptor.
 */
#ifndef LS_DAEMON_LISTEN_H
#define LS_DAEMON_LISTEN_H

#include "core/error.h"

#include <stddef.h>
#include <sys/socket.h>

/** Can @path be a socket's? LS_ERR_INVALID: empty, or longer than an address can hold. */
LS_MUST_CHECK enum ls_err ls_listen_check(const char *path, struct ls_diag *diag);

/** Bind and listen at @path, mode 0660, non-blocking. Errors: LS_ERR_BUSY (somebody answers there),
 * LS_ERR_EXISTS (not a socket), LS_ERR_INVALID (path too long), LS_ERR_NOT_FOUND (no such folder),
 * LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_listen_unix(const char *path, int *fd, struct ls_diag *diag);

/** Bind and listen at the numeric @address (IPv4 or IPv6) and @port (0: one that is free), told in
 * *bound, non-blocking. Errors: LS_ERR_INVALID (no such address here), LS_ERR_BUSY, LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_listen_tcp(const char *address, unsigned port, int *fd,
                                        struct sockaddr_storage *bound, struct ls_diag *diag);

/** "127.0.0.1:7472", "[::1]:7472". */
void ls_listen_name(const struct sockaddr_storage *address, char *name, size_t size);

#endif

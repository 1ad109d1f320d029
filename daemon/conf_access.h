/*
 * conf_access: the groups `access` and `listen` of the daemon file, and the limits of clients.
 * Layer: daemon. Threads: any. Ownership: what is read is the caller's.
 */
#ifndef LS_DAEMON_CONF_ACCESS_H
#define LS_DAEMON_CONF_ACCESS_H

#include "daemon/access.h"
#include "daemon/conf_read.h"

/** Where remote clients are listened for; no address = nowhere. Strings: (transfer full). */
struct ls_listen_config {
    char *address; /* of this host, numeric */
    unsigned port; /* 0 = any that is free */
    char *certificate, *key, *authority;
};

/** Errors stick to @daemon. Paths are relative to its file. */
void ls_conf_access(struct ls_conf *daemon, struct ls_access *access);
void ls_conf_listen(struct ls_conf *daemon, struct ls_listen_config *out, struct ls_access *access);

void ls_listen_config_finish(struct ls_listen_config *config);

#endif

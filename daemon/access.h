/*
 * access: who may do what: the roles, and who has which.
 * Layer: daemon. Threads: any, read-only. Ownership: the config's.
 *
 * An operator may do everything. A reader sees and fetches, and never fires a light, starts,
 * changes or ends anything but its own requests (requests.c has the table).
 */
#ifndef LS_DAEMON_ACCESS_H
#define LS_DAEMON_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

enum ls_role {
    LS_ROLE_NONE, /* is told so, and goes */
    LS_ROLE_READER,
    LS_ROLE_OPERATOR,
};

/** "operator", "reader", "nobody". */
const char *ls_role_name(enum ls_role role);

enum { LS_ACCESS_MAX = 64 }; /* entries of a list */

struct ls_access_ids {
    unsigned id[LS_ACCESS_MAX];
    unsigned n;
};

struct ls_access_names {
    char *name[LS_ACCESS_MAX]; /* (transfer full) */
    unsigned n;
};

struct ls_access {
    bool listed; /* else whoever may open the Unix socket is an operator */
    struct ls_access_ids operator_uids, operator_gids, reader_uids, reader_gids;
    struct ls_access_names operators, readers; /* common names of certificates */
};

/** Of a peer of the Unix socket; @groups: all it is in. The higher role wins. */
enum ls_role ls_access_unix(const struct ls_access *access, unsigned uid, const gid_t *groups,
                            size_t n_groups);

/** Of a peer with a certificate of this common name. */
enum ls_role ls_access_certificate(const struct ls_access *access, const char *common_name);

/** Free the names. */
void ls_access_finish(struct ls_access *access);

#endif

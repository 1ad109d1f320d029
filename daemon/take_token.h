/*
 * take_token: the take that a client's token has started, found on disk: a daemon that was started
 * again fires nothing twice either.
 * Layer: daemon. Threads: any. Ownership: nothing is kept.
 */
#ifndef LS_DAEMON_TAKE_TOKEN_H
#define LS_DAEMON_TAKE_TOKEN_H

#include "daemon/engine.h"

#include <stdbool.h>

enum { LS_TOKEN_TAKES = 16 };

/**
 * Is one of the newest LS_TOKEN_TAKES takes named @name in @storage the one of @token ("" is
 * nobody's)? Then *status is where it stands, as if it had ended just now; a take that the daemon
 * did not see to its end has failed. What cannot be read is passed over.
 */
bool ls_take_token_find(const char *storage, const char *name, const char *token,
                        struct ls_take_status *status);

#endif

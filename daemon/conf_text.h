/*
 * conf_text: libconfig text that came from a client, looked at before libconfig sees it.
 * Layer: daemon. Threads: any. Ownership: the caller's.
 *
 * libconfig 1.5 loses a string that it has read and cannot place: one that does not end, and one
 * where no value may stand. A client could make the daemon grow by the length of its text with
 * every request.
 */
#ifndef LS_DAEMON_CONF_TEXT_H
#define LS_DAEMON_CONF_TEXT_H

#include "core/error.h"

#include <libconfig.h>

/**
 * Parse @text into @tree, which config_init made and config_destroy ends. @what begins every
 * sentence. LS_ERR_INVALID with the line: libconfig's own errors, a string out of place, brackets
 * in more than 32 others, and @include, since a client has no business in the daemon's file system.
 */
LS_MUST_CHECK enum ls_err ls_conf_text(const char *what, const char *text, config_t *tree,
                                       struct ls_diag *diag);

#endif

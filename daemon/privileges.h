/*
 * privileges: what the daemon may do beyond an ordinary process, and what is lost without it.
 * Layer: daemon. Threads: any. Ownership: none.
 */
#ifndef LS_DAEMON_PRIVILEGES_H
#define LS_DAEMON_PRIVILEGES_H

#include <stddef.h>

/** Write the missing ones, with what each would help and how to grant it, separated by "; ", or "".
 * Changes nothing about the process. */
void ls_privileges_missing(char *text, size_t size);

#endif

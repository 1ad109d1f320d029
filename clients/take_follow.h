/*
 * take_follow: watch a take to its end: progress bar, Ctrl-C, lost connection.
 * Layer: clients. Threads: the main thread; installs a SIGINT handler. Ownership: none.
 *
 * First Ctrl-C: abort the take and wait for its end. Second: leave at once; the daemon finishes
 * aborting. A lost connection leaves the take running and says so.
 */
#ifndef LS_CLIENTS_TAKE_FOLLOW_H
#define LS_CLIENTS_TAKE_FOLLOW_H

#include "clients/command.h"

/** Follow the take of @token and print how it ended. Returns an exit code: OK if complete, NO if
 * incomplete or failed, INTERRUPTED after Ctrl-C. */
int ls_take_follow(struct ls_command_context *context, const char *token);

/** A token nobody else has. False: no random numbers to be had. */
bool ls_take_token(char token[64]);

/** From now on SIGINT is counted, not deadly. */
void ls_take_follow_signals(void);

#endif

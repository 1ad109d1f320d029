/*
 * lines: what strangers make the daemon write into its log, ten lines a second at most.
 * Layer: daemon. Threads: one at a time. Ownership: none; zero it to begin.
 */
#ifndef LS_DAEMON_LINES_H
#define LS_DAEMON_LINES_H

#include <stdint.h>

struct ls_lines {
    int64_t second_us; /* when it began */
    unsigned said;     /* since */
};

/** Log "@who is turned away: @why", or count it: the first line of a later second says how many
 * were left out. */
void ls_lines_turned_away(struct ls_lines *lines, const char *who, const char *why);

#endif

/*
 * map_guard: a file that was cut short, or cannot be read, under a mapping.
 * Layer: daemon. Threads: any; the guard's own SIGBUS handler runs on whichever thread touched the
 * page. Ownership: the caller's, embedded; a guarded range must not move in memory.
 *
 * Touching a mapped page that the file no longer has raises SIGBUS, which ends a process. Inside a
 * guarded range the handler puts zeros there instead, from that page to the range's end, and marks
 * the range lost; the reader goes on and asks afterwards. Elsewhere SIGBUS does what it did before.
 */
#ifndef LS_DAEMON_MAP_GUARD_H
#define LS_DAEMON_MAP_GUARD_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_map_guard {
    uintptr_t begin, end; /* [begin, end), end rounded up to a page */
    atomic_bool lost;
    struct ls_map_guard *previous, *next;
};

/** Guard @n mapped bytes at @base. The first call installs the handler. */
void ls_map_guard_add(struct ls_map_guard *guard, void *base, size_t n);

/** Did a read since ls_map_guard_add meet a page that could not be had? Then what was read is not
 * to be used. True before any thread can see the zeros. */
bool ls_map_guard_lost(const struct ls_map_guard *guard);

/** Before the range is unmapped. Zeroed is allowed. */
void ls_map_guard_remove(struct ls_map_guard *guard);

#endif

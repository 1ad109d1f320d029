/*
 * numbered_name: file names with a number in them, for several pictures.
 * Layer: clients. Threads: any. Ownership: see the function.
 */
#ifndef LS_CLIENTS_NUMBERED_NAME_H
#define LS_CLIENTS_NUMBERED_NAME_H

#include <stdbool.h>
#include <stdint.h>

/** Does it hold %d, %2d or %02d (one or two digits)? Only the first counts; every other % is
 * itself. */
bool ls_name_has_number(const char *name);

/** @name with @number in its place, or as it is. (transfer full), free(); NULL: out of memory. */
char *ls_name_numbered(const char *name, uint32_t number);

#endif

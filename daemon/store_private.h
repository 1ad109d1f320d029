/*
 * store_private: a take being written, for the files it is made of: store_open.c (begun, gone on
 * with, closed) and store.c (what goes in).
 * Layer: daemon. Threads, ownership: store.h.
 */
#ifndef LS_DAEMON_STORE_PRIVATE_H
#define LS_DAEMON_STORE_PRIVATE_H

#include "daemon/store.h"
#include "daemon/store_writer.h"
#include "daemon/take_head.h"

#include <glib.h>

struct ls_store {
    struct ls_store_writer writer;
    struct ls_take_head head;
    char *document;        /* the caller's JSON */
    GHashTable *published; /* "cam<k>/<condition>"; under the writer's lock */
};

#endif

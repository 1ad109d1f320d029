/*
 * service: what the sessions of a server share.
 * Layer: daemon. Threads: ls-main, except where said. Ownership: the server owns it.
 */
#ifndef LS_DAEMON_SERVICE_H
#define LS_DAEMON_SERVICE_H

#include "daemon/engine.h"
#include "daemon/field_cache.h"
#include "daemon/job.h"
#include "daemon/lines.h"
#include "daemon/memfds.h"
#include "daemon/server.h"
#include "daemon/stored_tiles.h"

#include <glib.h>

struct ls_service {
    struct ls_server_config config; /* defaults filled in; read-only, any thread */
    struct ls_engine *engine;
    struct ls_field_cache *fields;  /* any thread */
    struct ls_memfds *memfds;       /* any thread */
    struct ls_stored_tiles *stored; /* any thread */
    struct ls_job_pool *pool;
    struct ls_take_status take; /* last reported */
    GList *sessions;            /* struct ls_session */
    unsigned n_sessions;
    uint64_t stalled_closed, events_skipped, pictures_skipped, credit_waits;
    struct ls_lines strangers; /* who was turned away */
    guint looking;             /* live.h: source, 0 = nobody looks */
};

#endif

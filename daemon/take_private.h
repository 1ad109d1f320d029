/*
 * take_private: a take being made, for the files it is made of: take_open.c (preflight, begun, gone
 * on with) and take.c (run and closed).
 * Layer: daemon. Threads, ownership: take.h.
 */
#ifndef LS_DAEMON_TAKE_PRIVATE_H
#define LS_DAEMON_TAKE_PRIVATE_H

#include "daemon/checks.h"
#include "daemon/plan.h"
#include "daemon/resumed.h"
#include "daemon/rig.h"
#include "daemon/store.h"
#include "daemon/take.h"

#include <jansson.h>

struct ls_take {
    const struct ls_take_context *context; /* `own` */
    struct ls_take_context own;
    struct ls_config config; /* the configuration, how each camera exposes, and offsets an earlier
                                run measured; strings are its */
    struct ls_plan *plan;
    struct ls_rig rig;
    struct ls_store *store;
    struct ls_checks *checks;
    json_t *led_record; /* of the last sweep, NULL if there is none */
    struct ls_capture *capture;
    struct ls_resumed resumed;
};

#endif

/*
 * rig_requests: the requests that may have to wait for devices: asked of the engine, answered when
 * it has answered.
 * Layer: daemon. Threads: ls-main. Ownership: a call is (transfer none), valid during it.
 */
#ifndef LS_DAEMON_RIG_REQUESTS_H
#define LS_DAEMON_RIG_REQUESTS_H

#include "daemon/session.h"
#include "proto/message.h"

#include <stddef.h>
#include <stdint.h>

/** One request on its way to its answer. */
struct ls_call {
    struct ls_session *session;
    uint16_t type;
    uint32_t id;
    const ProtobufCMessage *message;
    const uint8_t *payload;
    size_t payload_bytes;
};

void ls_handle_status(const struct ls_call *call);
void ls_handle_preflight(const struct ls_call *call);
void ls_handle_take_start(const struct ls_call *call);
void ls_handle_take_resume(const struct ls_call *call);
void ls_handle_blank(const struct ls_call *call);

#endif

/*
 * requests: what each type of request means: checked, handed to the engine or made a job.
 * Layer: daemon. Threads: ls-main. Ownership: message and payload are (transfer none), valid
 * during the call.
 */
#ifndef LS_DAEMON_REQUESTS_H
#define LS_DAEMON_REQUESTS_H

#include "daemon/session.h"
#include "proto/message.h"

#include <stddef.h>
#include <stdint.h>

/** Answer, now or later. @type has a request schema and is not Hello. */
void ls_request_handle(struct ls_session *session, uint16_t type, uint32_t request,
                       const ProtobufCMessage *message, const uint8_t *payload,
                       size_t payload_bytes);

#endif

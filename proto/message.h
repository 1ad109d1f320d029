/*
 * message: which Protocol Buffers message a frame's type means, and its coding within a budget.
 * Layer: proto. Threads: any, one at a time per object. Ownership: as stated.
 *
 * A reply has its request's type | LS_MESSAGE_REPLY. Unknown fields of known messages are ignored;
 * an unknown type is refused. Decoding allocates at most LS_MESSAGE_BUDGET bytes, whatever the
 * bytes say: 64 KiB of hostile input could otherwise cost megabytes.
 */
#ifndef LS_PROTO_MESSAGE_H
#define LS_PROTO_MESSAGE_H

#include "core/error.h"
#include "proto/lightstage.pb-c.h"

#include <stddef.h>
#include <stdint.h>

enum ls_message_type {
    LS_MESSAGE_HELLO = 1,
    LS_MESSAGE_STATUS = 2,
    LS_MESSAGE_RIG = 3,
    LS_MESSAGE_PREFLIGHT = 4,
    LS_MESSAGE_TAKE_START = 5,
    LS_MESSAGE_TAKE_PROGRESS = 6,
    LS_MESSAGE_TAKE_ABORT = 7,
    LS_MESSAGE_TAKE_RESUME = 8,
    LS_MESSAGE_TAKE_LIST = 9,
    LS_MESSAGE_TAKE_SHOW = 10,
    LS_MESSAGE_TAKE_VERIFY = 11,
    LS_MESSAGE_FETCH = 12,
    LS_MESSAGE_RELIGHT = 13,
    LS_MESSAGE_BLANK = 14,
    LS_MESSAGE_CANCEL = 15,
    LS_MESSAGE_TAKE_SLATE = 16,
    LS_MESSAGE_METRICS = 17,
    LS_MESSAGE_PREVIEW = 18,
    LS_MESSAGE_EVENTS = 19,
    LS_MESSAGE_CREDIT = 20,
    LS_MESSAGE_RING = 21,
    LS_MESSAGE_REPLY = 0x8000,
    LS_MESSAGE_ERROR = 0xffff,
};

enum { LS_MESSAGE_BUDGET = 256 * 1024 };

/** "TakeStart", "TakeStartReply", "Error"; NULL for an unknown type. */
const char *ls_message_name(uint16_t type);

/** The schema of a type, or NULL. */
const ProtobufCMessageDescriptor *ls_message_descriptor(uint16_t type);

/**
 * Decode the @n bytes of a message of @type. *out is (transfer full): ls_message_free, and may be
 * cast to the type's struct. Errors: LS_ERR_UNSUPPORTED (unknown type), LS_ERR_INVALID (does not
 * decode), LS_ERR_LIMIT (longer than LS_FRAME_MAX_MESSAGE, or over the budget).
 */
LS_MUST_CHECK enum ls_err ls_message_decode(uint16_t type, const uint8_t *bytes, size_t n,
                                            ProtobufCMessage **out, struct ls_diag *diag);

/** NULL is allowed. */
void ls_message_free(ProtobufCMessage *message);

/**
 * Header and message as one span, ready to be followed by @payload_bytes of payload. *out:
 * (transfer full, free). @body must be of the descriptor of @type. Errors: LS_ERR_LIMIT (message
 * over LS_FRAME_MAX_MESSAGE), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_message_frame(uint16_t type, uint32_t request, uint32_t flags,
                                           const ProtobufCMessage *body, uint64_t payload_bytes,
                                           uint8_t **out, size_t *n, struct ls_diag *diag);

#endif

#include "proto/message.h"

#include "proto/frame.h"

#include <assert.h>
#include <stdlib.h>

struct pairing {
    uint16_t type;
    const ProtobufCMessageDescriptor *request, *reply;
};

static const struct pairing pairings[] = {
    {LS_MESSAGE_HELLO, &lightstage__hello__descriptor, &lightstage__hello_reply__descriptor},
    {LS_MESSAGE_STATUS, &lightstage__status__descriptor, &lightstage__status_reply__descriptor},
    {LS_MESSAGE_RIG, &lightstage__rig__descriptor, &lightstage__rig_reply__descriptor},
    {LS_MESSAGE_PREFLIGHT, &lightstage__preflight__descriptor,
     &lightstage__preflight_reply__descriptor},
    {LS_MESSAGE_TAKE_START, &lightstage__take_start__descriptor,
     &lightstage__take_start_reply__descriptor},
    {LS_MESSAGE_TAKE_PROGRESS, &lightstage__take_progress__descriptor,
     &lightstage__take_status__descriptor},
    {LS_MESSAGE_TAKE_ABORT, &lightstage__take_abort__descriptor,
     &lightstage__take_abort_reply__descriptor},
    {LS_MESSAGE_TAKE_RESUME, &lightstage__take_resume__descriptor,
     &lightstage__take_start_reply__descriptor},
    {LS_MESSAGE_TAKE_LIST, &lightstage__take_list__descriptor,
     &lightstage__take_list_reply__descriptor},
    {LS_MESSAGE_TAKE_SHOW, &lightstage__take_show__descriptor,
     &lightstage__take_show_reply__descriptor},
    {LS_MESSAGE_TAKE_VERIFY, &lightstage__take_verify__descriptor,
     &lightstage__take_verify_reply__descriptor},
    {LS_MESSAGE_FETCH, &lightstage__fetch__descriptor, &lightstage__fetch_reply__descriptor},
    {LS_MESSAGE_RELIGHT, &lightstage__relight__descriptor, &lightstage__relight_reply__descriptor},
    {LS_MESSAGE_BLANK, &lightstage__blank__descriptor, &lightstage__blank_reply__descriptor},
    {LS_MESSAGE_CANCEL, &lightstage__cancel__descriptor, &lightstage__cancel_reply__descriptor},
    {LS_MESSAGE_TAKE_SLATE, &lightstage__take_slate__descriptor,
     &lightstage__take_slate_reply__descriptor},
    {LS_MESSAGE_METRICS, &lightstage__metrics__descriptor, &lightstage__metrics_reply__descriptor},
    {LS_MESSAGE_PREVIEW, &lightstage__preview__descriptor, &lightstage__preview_reply__descriptor},
    {LS_MESSAGE_EVENTS, &lightstage__events__descriptor, &lightstage__events_reply__descriptor},
    {LS_MESSAGE_CREDIT, &lightstage__credit__descriptor, &lightstage__credit_reply__descriptor},
    {LS_MESSAGE_RING, &lightstage__ring__descriptor, &lightstage__ring_reply__descriptor},
};

const ProtobufCMessageDescriptor *ls_message_descriptor(uint16_t type)
{
    if (type == LS_MESSAGE_ERROR)
        return &lightstage__error__descriptor;
    for (size_t i = 0; i < sizeof pairings / sizeof *pairings; i++) {
        if (type == pairings[i].type)
            return pairings[i].request;
        if (type == (pairings[i].type | LS_MESSAGE_REPLY))
            return pairings[i].reply;
    }
    return NULL;
}

const char *ls_message_name(uint16_t type)
{
    const ProtobufCMessageDescriptor *descriptor = ls_message_descriptor(type);
    return descriptor ? descriptor->short_name : NULL;
}

struct budget {
    size_t left;
    int exceeded;
};

static void *budget_alloc(void *data, size_t n)
{
    struct budget *budget = data;
    if (n > budget->left) {
        budget->exceeded = 1;
        return NULL;
    }
    budget->left -= n;
    return malloc(n);
}

static void budget_free(void *data, void *pointer)
{
    free(pointer);
}

static const ProtobufCAllocator plain_free = {.free = budget_free};

enum ls_err ls_message_decode(uint16_t type, const uint8_t *bytes, size_t n, ProtobufCMessage **out,
                              struct ls_diag *diag)
{
    const ProtobufCMessageDescriptor *descriptor = ls_message_descriptor(type);
    struct budget budget = {.left = LS_MESSAGE_BUDGET};
    ProtobufCAllocator allocator = {budget_alloc, budget_free, &budget};

    *out = NULL;
    if (!descriptor)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "message type %#x is not known to this side",
                       type);
    if (n > LS_FRAME_MAX_MESSAGE)
        return ls_fail(diag, LS_ERR_LIMIT, "%s of %zu bytes, at most %d allowed",
                       descriptor->short_name, n, LS_FRAME_MAX_MESSAGE);
    *out = protobuf_c_message_unpack(descriptor, &allocator, n, bytes);
    if (*out)
        return LS_OK;
    if (budget.exceeded)
        return ls_fail(diag, LS_ERR_LIMIT, "%s needs more than %d bytes of memory to decode",
                       descriptor->short_name, LS_MESSAGE_BUDGET);
    return ls_fail(diag, LS_ERR_INVALID, "the %zu bytes are not a %s message", n,
                   descriptor->short_name);
}

void ls_message_free(ProtobufCMessage *message)
{
    ProtobufCAllocator allocator = plain_free;
    if (message)
        protobuf_c_message_free_unpacked(message, &allocator);
}

enum ls_err ls_message_frame(uint16_t type, uint32_t request, uint32_t flags,
                             const ProtobufCMessage *body, uint64_t payload_bytes, uint8_t **out,
                             size_t *n, struct ls_diag *diag)
{
    assert(body->descriptor == ls_message_descriptor(type));
    size_t message_bytes = protobuf_c_message_get_packed_size(body);
    if (message_bytes > LS_FRAME_MAX_MESSAGE)
        return ls_fail(diag, LS_ERR_LIMIT, "%s of %zu bytes, at most %d allowed",
                       body->descriptor->short_name, message_bytes, LS_FRAME_MAX_MESSAGE);
    uint8_t *bytes = malloc(LS_FRAME_HEADER_BYTES + message_bytes);
    if (!bytes)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a message of %zu bytes", message_bytes);
    struct ls_frame_header header = {.version = LS_FRAME_VERSION,
                                     .type = type,
                                     .flags = flags,
                                     .request = request,
                                     .message_bytes = (uint32_t)message_bytes,
                                     .payload_bytes = payload_bytes};
    ls_frame_put(&header, bytes);
    protobuf_c_message_pack(body, bytes + LS_FRAME_HEADER_BYTES);
    *out = bytes;
    *n = LS_FRAME_HEADER_BYTES + message_bytes;
    return LS_OK;
}

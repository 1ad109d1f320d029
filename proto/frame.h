/*
 * frame: the 32 bytes in front of every message, and the cutting of a byte stream into frames.
 * Layer: proto (no file descriptors). Threads: one at a time per decoder. Ownership: below.
 *
 * Everything is little-endian:
 *
 *   offset  size  field
 *        0     4  magic "LSTG"
 *        4     2  version, 1
 *        6     2  type (proto/message.h)
 *        8     4  flags
 *       12     4  request id, chosen by the client, not 0 in a request
 *       16     4  message length, [0, 65536]
 *       20     4  reserved, 0
 *       24     8  payload length
 *       32        message (Protocol Buffers), then payload (raw)
 */
#ifndef LS_PROTO_FRAME_H
#define LS_PROTO_FRAME_H

#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_FRAME_HEADER_BYTES = 32,
    LS_FRAME_MAX_MESSAGE = 64 * 1024,
    LS_FRAME_VERSION = 1,
};

enum ls_frame_flags {
    LS_FRAME_LAST = 1 << 0, /* nothing more follows for this request */
};

struct ls_frame_header {
    uint16_t version, type;
    uint32_t flags; /* enum ls_frame_flags */
    uint32_t request;
    uint32_t message_bytes;
    uint64_t payload_bytes;
};

/** Write the header. @header is ours: lengths over the limits are a bug. */
void ls_frame_put(const struct ls_frame_header *header, uint8_t out[LS_FRAME_HEADER_BYTES]);

/**
 * Read and check a header. Errors: LS_ERR_INVALID (magic, flags, reserved bytes: not our stream),
 * LS_ERR_UNSUPPORTED (version), LS_ERR_LIMIT (message over LS_FRAME_MAX_MESSAGE, payload over
 * @max_payload). *out is filled as far as it could be read on every error.
 */
LS_MUST_CHECK enum ls_err ls_frame_get(const uint8_t bytes[LS_FRAME_HEADER_BYTES],
                                       uint64_t max_payload, struct ls_frame_header *out,
                                       struct ls_diag *diag);

/**
 * Incremental decoder: takes bytes as they come, in pieces of any size, and holds at most one
 * frame, never more than header + 64 KiB + max_payload. Nothing is allocated before a header has
 * passed its checks, and then only as much as has arrived (rounded up to 64 KiB).
 */
struct ls_frame_decoder {
    uint64_t max_payload;
    struct ls_frame_header header;
    uint8_t head[LS_FRAME_HEADER_BYTES];
    size_t head_fill;
    uint8_t *body; /* message, then payload */
    size_t body_fill, body_size, body_capacity;
    enum ls_err failed;
};

void ls_frame_decoder_init(struct ls_frame_decoder *decoder, uint64_t max_payload);

/** Frees what it holds. */
void ls_frame_decoder_finish(struct ls_frame_decoder *decoder);

/**
 * Feed @n bytes; *used of them were taken (all, or up to the end of one frame). *complete is set
 * when a whole frame is there: read it with the accessors, then call ls_frame_decoder_next before
 * feeding again. Errors: those of ls_frame_get, and LS_ERR_NOMEM; after one the decoder stays
 * failed (a byte stream cannot be resynchronised) and returns it again.
 */
LS_MUST_CHECK enum ls_err ls_frame_decoder_feed(struct ls_frame_decoder *decoder,
                                                const uint8_t *bytes, size_t n, size_t *used,
                                                int *complete, struct ls_diag *diag);

/** Parts of the complete frame, (transfer none), valid until ls_frame_decoder_next. */
const uint8_t *ls_frame_decoder_message(const struct ls_frame_decoder *decoder);
const uint8_t *ls_frame_decoder_payload(const struct ls_frame_decoder *decoder);

/** Forget the complete frame. */
void ls_frame_decoder_next(struct ls_frame_decoder *decoder);

/** The decoder stands inside a frame: a stream that ends here was cut. */
int ls_frame_decoder_inside(const struct ls_frame_decoder *decoder);

#endif

/* frame: any bytes, in pieces of any size, are the same frames; memory follows what arrived. */
#include "core/crc32c.h"
#include "proto/frame.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

enum { MAX_PAYLOAD = 1 << 20 };

/* What a decoder made of a stream, and how it ended. */
struct outcome {
    uint32_t frames, crc;
    enum ls_err err;
    size_t used;
};

static void take_frame(struct ls_frame_decoder *decoder, struct outcome *out)
{
    const struct ls_frame_header *header = &decoder->header;
    uint8_t again[LS_FRAME_HEADER_BYTES];
    HOLDS(header->message_bytes <= LS_FRAME_MAX_MESSAGE && header->payload_bytes <= MAX_PAYLOAD);
    ls_frame_put(header, again);
    HOLDS(!memcmp(again, decoder->head, sizeof again));
    out->crc = ls_crc32c(out->crc, again, sizeof again);
    size_t body = header->message_bytes + (size_t)header->payload_bytes;
    HOLDS(decoder->body_fill == body);
    if (body)
        out->crc = ls_crc32c(out->crc, ls_frame_decoder_message(decoder), body);
    out->frames++;
    ls_frame_decoder_next(decoder);
    HOLDS(!ls_frame_decoder_inside(decoder));
}

/* In pieces of @piece bytes, each in memory of its own. */
static struct outcome decode(const uint8_t *data, size_t n, size_t piece)
{
    struct ls_frame_decoder decoder;
    struct outcome out = {0};
    ls_frame_decoder_init(&decoder, MAX_PAYLOAD);
    while (out.used < n && !out.err) {
        size_t some = n - out.used < piece ? n - out.used : piece, used;
        uint8_t *copy = malloc(some);
        int complete;
        struct ls_diag diag = {0};
        HOLDS(copy);
        memcpy(copy, data + out.used, some);
        out.err = ls_frame_decoder_feed(&decoder, copy, some, &used, &complete, &diag);
        free(copy);
        HOLDS_REFUSED(out.err, diag);
        HOLDS(used <= some && (used > 0 || out.err));
        HOLDS(!complete || !out.err);
        out.used += used;
        /* half as much again, and 64 KiB */
        HOLDS(decoder.body_capacity <= n + n / 2 + 65536);
        if (complete)
            take_frame(&decoder, &out);
    }
    if (out.err) {
        size_t used;
        int complete;
        HOLDS(ls_frame_decoder_feed(&decoder, data, n, &used, &complete, NULL) == out.err);
        HOLDS(!complete && used == 0);
    }
    ls_frame_decoder_finish(&decoder);
    return out;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    if (n < 1)
        return 0;
    struct outcome whole = decode(data + 1, n - 1, n);
    struct outcome pieces = decode(data + 1, n - 1, 1 + data[0]);
    HOLDS(whole.frames == pieces.frames && whole.crc == pieces.crc && whole.err == pieces.err);
    return 0;
}

#include "proto/frame.h"

#include <assert.h>
#include <endian.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

enum { GROWTH = 64 * 1024 };

static const uint8_t magic[4] = {'L', 'S', 'T', 'G'};

static uint16_t get16(const uint8_t *p)
{
    uint16_t v;
    memcpy(&v, p, sizeof v);
    return le16toh(v);
}

static uint32_t get32(const uint8_t *p)
{
    uint32_t v;
    memcpy(&v, p, sizeof v);
    return le32toh(v);
}

static uint64_t get64(const uint8_t *p)
{
    uint64_t v;
    memcpy(&v, p, sizeof v);
    return le64toh(v);
}

static void put(uint8_t *p, uint64_t v, size_t n)
{
    for (size_t i = 0; i < n; i++)
        p[i] = (uint8_t)(v >> (8 * i));
}

void ls_frame_put(const struct ls_frame_header *header, uint8_t out[LS_FRAME_HEADER_BYTES])
{
    assert(header->message_bytes <= LS_FRAME_MAX_MESSAGE);
    memcpy(out, magic, sizeof magic);
    put(out + 4, header->version, 2);
    put(out + 6, header->type, 2);
    put(out + 8, header->flags, 4);
    put(out + 12, header->request, 4);
    put(out + 16, header->message_bytes, 4);
    put(out + 20, 0, 4);
    put(out + 24, header->payload_bytes, 8);
}

enum ls_err ls_frame_get(const uint8_t bytes[LS_FRAME_HEADER_BYTES], uint64_t max_payload,
                         struct ls_frame_header *out, struct ls_diag *diag)
{
    memset(out, 0, sizeof *out);
    if (memcmp(bytes, magic, sizeof magic) != 0)
        return ls_fail(diag, LS_ERR_INVALID,
                       "frame starts with %02x %02x %02x %02x, expected \"LSTG\": the peer does "
                       "not speak this protocol, or the stream is damaged",
                       bytes[0], bytes[1], bytes[2], bytes[3]);
    out->version = get16(bytes + 4);
    out->type = get16(bytes + 6);
    out->flags = get32(bytes + 8);
    out->request = get32(bytes + 12);
    out->message_bytes = get32(bytes + 16);
    out->payload_bytes = get64(bytes + 24);
    if (out->version != LS_FRAME_VERSION)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "frame of protocol version %u, this side speaks %u", out->version,
                       LS_FRAME_VERSION);
    if (out->flags & ~(uint32_t)LS_FRAME_LAST)
        return ls_fail(diag, LS_ERR_INVALID, "frame flags %#" PRIx32 ": only bit 0 is defined",
                       out->flags);
    if (get32(bytes + 20) != 0)
        return ls_fail(diag, LS_ERR_INVALID, "reserved header bytes are %#" PRIx32 ", expected 0",
                       get32(bytes + 20));
    if (out->message_bytes > LS_FRAME_MAX_MESSAGE)
        return ls_fail(diag, LS_ERR_LIMIT, "message of %" PRIu32 " bytes, at most %d allowed",
                       out->message_bytes, LS_FRAME_MAX_MESSAGE);
    if (out->payload_bytes > max_payload)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "payload of %" PRIu64 " bytes, at most %" PRIu64 " allowed",
                       out->payload_bytes, max_payload);
    return LS_OK;
}

void ls_frame_decoder_init(struct ls_frame_decoder *decoder, uint64_t max_payload)
{
    memset(decoder, 0, sizeof *decoder);
    decoder->max_payload = max_payload;
}

void ls_frame_decoder_finish(struct ls_frame_decoder *decoder)
{
    free(decoder->body);
    memset(decoder, 0, sizeof *decoder);
}

static size_t smaller(size_t a, size_t b)
{
    return a < b ? a : b;
}

static enum ls_err feed_head(struct ls_frame_decoder *decoder, const uint8_t *bytes, size_t n,
                             size_t *used, struct ls_diag *diag)
{
    *used = smaller(n, LS_FRAME_HEADER_BYTES - decoder->head_fill);
    memcpy(decoder->head + decoder->head_fill, bytes, *used);
    decoder->head_fill += *used;
    if (decoder->head_fill < LS_FRAME_HEADER_BYTES)
        return LS_OK;
    enum ls_err err = ls_frame_get(decoder->head, decoder->max_payload, &decoder->header, diag);
    if (err)
        return err;
    if (decoder->header.payload_bytes > SIZE_MAX - LS_FRAME_MAX_MESSAGE)
        return ls_fail(diag, LS_ERR_LIMIT, "payload does not fit this machine's memory");
    decoder->body_size = decoder->header.message_bytes + (size_t)decoder->header.payload_bytes;
    return LS_OK;
}

static enum ls_err reserve(struct ls_frame_decoder *decoder, size_t need, struct ls_diag *diag)
{
    if (need <= decoder->body_capacity)
        return LS_OK;
    size_t want = decoder->body_capacity + decoder->body_capacity / 2;
    if (want < need)
        want = need;
    want = (want + GROWTH - 1) / GROWTH * GROWTH;
    uint8_t *grown = realloc(decoder->body, want);
    if (!grown)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a frame of %zu bytes",
                       decoder->body_size);
    decoder->body = grown;
    decoder->body_capacity = want;
    return LS_OK;
}

static enum ls_err feed_body(struct ls_frame_decoder *decoder, const uint8_t *bytes, size_t n,
                             size_t *used, struct ls_diag *diag)
{
    *used = smaller(n, decoder->body_size - decoder->body_fill);
    if (*used == 0)
        return LS_OK;
    enum ls_err err = reserve(decoder, decoder->body_fill + *used, diag);
    if (err)
        return err;
    memcpy(decoder->body + decoder->body_fill, bytes, *used);
    decoder->body_fill += *used;
    return LS_OK;
}

enum ls_err ls_frame_decoder_feed(struct ls_frame_decoder *decoder, const uint8_t *bytes, size_t n,
                                  size_t *used, int *complete, struct ls_diag *diag)
{
    size_t head = 0, body = 0;
    *used = 0;
    *complete = 0;
    if (decoder->failed)
        return ls_fail(diag, decoder->failed, "the stream was damaged before");
    if (decoder->head_fill < LS_FRAME_HEADER_BYTES)
        decoder->failed = feed_head(decoder, bytes, n, &head, diag);
    if (!decoder->failed && decoder->head_fill == LS_FRAME_HEADER_BYTES) {
        decoder->failed = feed_body(decoder, bytes + head, n - head, &body, diag);
        *complete = !decoder->failed && decoder->body_fill == decoder->body_size;
    }
    *used = head + body;
    return decoder->failed;
}

const uint8_t *ls_frame_decoder_message(const struct ls_frame_decoder *decoder)
{
    return decoder->body;
}

const uint8_t *ls_frame_decoder_payload(const struct ls_frame_decoder *decoder)
{
    return decoder->body ? decoder->body + decoder->header.message_bytes : NULL;
}

void ls_frame_decoder_next(struct ls_frame_decoder *decoder)
{
    decoder->head_fill = decoder->body_fill = decoder->body_size = 0;
}

int ls_frame_decoder_inside(const struct ls_frame_decoder *decoder)
{
    return decoder->head_fill > 0;
}

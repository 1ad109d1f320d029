/* message: two bytes of type and a message. What decodes stays within its budget of memory, and is
 * the same after it was encoded and decoded again. */
#include "proto/frame.h"
#include "proto/message.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

static ProtobufCMessage *decode(uint16_t type, const uint8_t *bytes, size_t n)
{
    ProtobufCMessage *message = NULL;
    struct ls_diag diag = {0};
    size_t before = fuzz_allocated();
    enum ls_err err = ls_message_decode(type, bytes, n, &message, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(!err == !!message);
    HOLDS(!err || fuzz_allocated() == before);
    HOLDS(fuzz_allocated() - before <= LS_MESSAGE_BUDGET);
    return message;
}

static uint8_t *encode(uint16_t type, const ProtobufCMessage *message, size_t *n)
{
    uint8_t *bytes = NULL;
    struct ls_diag diag = {0};
    enum ls_err err = ls_message_frame(type, 1, LS_FRAME_LAST, message, 0, &bytes, n, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(!err || err == LS_ERR_LIMIT);
    return bytes;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    if (n < 2)
        return 0;
    uint16_t type = (uint16_t)(data[0] | data[1] << 8);
    size_t n_first, n_second;
    ProtobufCMessage *first = decode(type, data + 2, n - 2);
    if (!first)
        return 0;
    uint8_t *bytes = encode(type, first, &n_first);
    ls_message_free(first);
    if (!bytes)
        return 0;
    ProtobufCMessage *second =
        decode(type, bytes + LS_FRAME_HEADER_BYTES, n_first - LS_FRAME_HEADER_BYTES);
    /* protobuf-c 1.4 takes a field of number 0, which does not exist, if it is written in two
     * bytes; it writes it in one, which it does not take */
    uint8_t *again = second ? encode(type, second, &n_second) : NULL;
    if (second)
        HOLDS(again && n_second == n_first && !memcmp(again, bytes, n_first));
    ls_message_free(second);
    free(bytes);
    free(again);
    return 0;
}

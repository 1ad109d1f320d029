/* frame: headers and the incremental decoder, on good and hostile streams. */
#include "proto/frame.h"

#include <glib.h>
#include <string.h>

enum { MAX_PAYLOAD = 4096, MESSAGE = 11, PAYLOAD = 70 };

struct frame {
    uint8_t bytes[LS_FRAME_HEADER_BYTES + MESSAGE + PAYLOAD];
};

static struct frame make_frame(void)
{
    struct frame frame;
    struct ls_frame_header header = {.version = LS_FRAME_VERSION,
                                     .type = 13,
                                     .flags = LS_FRAME_LAST,
                                     .request = 0x01020304,
                                     .message_bytes = MESSAGE,
                                     .payload_bytes = PAYLOAD};
    ls_frame_put(&header, frame.bytes);
    for (size_t i = LS_FRAME_HEADER_BYTES; i < sizeof frame.bytes; i++)
        frame.bytes[i] = (uint8_t)i;
    return frame;
}

static void header_survives_put_and_get(void)
{
    struct frame frame = make_frame();
    struct ls_frame_header header;
    static const uint8_t start[16] = {'L', 'S', 'T', 'G', 1, 0, 13, 0, 1, 0, 0, 0, 4, 3, 2, 1};
    g_assert_cmpmem(frame.bytes, 16, start, 16);
    g_assert_cmpint(ls_frame_get(frame.bytes, MAX_PAYLOAD, &header, NULL), ==, LS_OK);
    g_assert_cmpuint(header.type, ==, 13);
    g_assert_cmpuint(header.flags, ==, LS_FRAME_LAST);
    g_assert_cmpuint(header.request, ==, 0x01020304);
    g_assert_cmpuint(header.message_bytes, ==, MESSAGE);
    g_assert_cmpuint(header.payload_bytes, ==, PAYLOAD);
}

/* Feed all of @bytes; how many frames came out whole and right. */
static unsigned feed_all(struct ls_frame_decoder *decoder, const uint8_t *bytes, size_t n,
                         const struct frame *expected)
{
    unsigned frames = 0;
    while (n > 0) {
        size_t used;
        int complete;
        g_assert_cmpint(ls_frame_decoder_feed(decoder, bytes, n, &used, &complete, NULL), ==,
                        LS_OK);
        bytes += used;
        n -= used;
        if (!complete)
            continue;
        g_assert_cmpmem(ls_frame_decoder_message(decoder), MESSAGE,
                        expected->bytes + LS_FRAME_HEADER_BYTES, MESSAGE);
        g_assert_cmpmem(ls_frame_decoder_payload(decoder), PAYLOAD,
                        expected->bytes + LS_FRAME_HEADER_BYTES + MESSAGE, PAYLOAD);
        ls_frame_decoder_next(decoder);
        frames++;
    }
    return frames;
}

static void any_split_gives_the_same_frames(void)
{
    struct frame frame = make_frame();
    uint8_t stream[3 * sizeof frame.bytes];
    for (int i = 0; i < 3; i++)
        memcpy(stream + i * sizeof frame.bytes, frame.bytes, sizeof frame.bytes);
    for (size_t split = 0; split <= sizeof stream; split++) {
        struct ls_frame_decoder decoder;
        ls_frame_decoder_init(&decoder, MAX_PAYLOAD);
        unsigned frames = feed_all(&decoder, stream, split, &frame);
        g_assert_cmpint(ls_frame_decoder_inside(&decoder), ==, split % sizeof frame.bytes != 0);
        frames += feed_all(&decoder, stream + split, sizeof stream - split, &frame);
        g_assert_cmpuint(frames, ==, 3);
        g_assert_false(ls_frame_decoder_inside(&decoder));
        ls_frame_decoder_finish(&decoder);
    }
}

static void byte_by_byte_gives_the_same_frames(void)
{
    struct frame frame = make_frame();
    struct ls_frame_decoder decoder;
    unsigned frames = 0;
    ls_frame_decoder_init(&decoder, MAX_PAYLOAD);
    for (size_t i = 0; i < sizeof frame.bytes; i++)
        frames += feed_all(&decoder, frame.bytes + i, 1, &frame);
    g_assert_cmpuint(frames, ==, 1);
    ls_frame_decoder_finish(&decoder);
}

static void empty_message_and_payload_complete_with_the_header(void)
{
    uint8_t bytes[LS_FRAME_HEADER_BYTES];
    struct ls_frame_header header = {.version = LS_FRAME_VERSION, .type = 2, .request = 1};
    struct ls_frame_decoder decoder;
    size_t used;
    int complete;
    ls_frame_put(&header, bytes);
    ls_frame_decoder_init(&decoder, MAX_PAYLOAD);
    g_assert_cmpint(ls_frame_decoder_feed(&decoder, bytes, sizeof bytes, &used, &complete, NULL),
                    ==, LS_OK);
    g_assert_true(complete);
    g_assert_cmpuint(used, ==, sizeof bytes);
    ls_frame_decoder_finish(&decoder);
}

struct damage {
    const char *what;
    size_t offset;
    uint8_t value;
    enum ls_err err;
};

static const struct damage damages[] = {
    {"magic", 0, 'X', LS_ERR_INVALID},
    {"last letter of the magic", 3, 'g', LS_ERR_INVALID},
    {"version", 4, 2, LS_ERR_UNSUPPORTED},
    {"unknown flag", 11, 0x80, LS_ERR_INVALID},
    {"message length", 18, 2, LS_ERR_LIMIT}, /* 131072 + 11 */
    {"message length just over", 18, 1, LS_ERR_LIMIT}, /* 65536 + 11 */
    {"reserved", 20, 1, LS_ERR_INVALID},
    {"payload length", 25, 0x10, LS_ERR_LIMIT}, /* 4096 + 70 */
    {"payload of 2^63 bytes", 31, 0x80, LS_ERR_LIMIT},
};

static void damaged_headers_are_refused_and_stay_refused(void)
{
    for (size_t i = 0; i < G_N_ELEMENTS(damages); i++) {
        struct frame frame = make_frame();
        struct ls_frame_decoder decoder;
        struct ls_diag diag = {0};
        size_t used;
        int complete;
        frame.bytes[damages[i].offset] = damages[i].value;
        ls_frame_decoder_init(&decoder, MAX_PAYLOAD);
        g_test_message("%s", damages[i].what);
        g_assert_cmpint(ls_frame_decoder_feed(&decoder, frame.bytes, sizeof frame.bytes, &used,
                                              &complete, &diag),
                        ==, damages[i].err);
        g_assert_cmpstr(diag.text, !=, "");
        g_assert_false(complete);
        g_assert_null(decoder.body);
        frame = make_frame();
        g_assert_cmpint(ls_frame_decoder_feed(&decoder, frame.bytes, sizeof frame.bytes, &used,
                                              &complete, &diag),
                        ==, damages[i].err);
        ls_frame_decoder_finish(&decoder);
    }
}

static void lengths_at_the_limit_are_accepted(void)
{
    uint8_t bytes[LS_FRAME_HEADER_BYTES];
    struct ls_frame_header header = {.version = LS_FRAME_VERSION,
                                     .message_bytes = LS_FRAME_MAX_MESSAGE,
                                     .payload_bytes = MAX_PAYLOAD};
    ls_frame_put(&header, bytes);
    g_assert_cmpint(ls_frame_get(bytes, MAX_PAYLOAD, &header, NULL), ==, LS_OK);
    g_assert_cmpint(ls_frame_get(bytes, MAX_PAYLOAD - 1, &header, NULL), ==, LS_ERR_LIMIT);
}

/* A header that announces much must not make us reserve it. */
static void memory_follows_what_arrived_not_what_was_announced(void)
{
    uint8_t bytes[LS_FRAME_HEADER_BYTES + 1] = {0};
    struct ls_frame_header header = {.version = LS_FRAME_VERSION,
                                     .payload_bytes = (uint64_t)1 << 40};
    struct ls_frame_decoder decoder;
    size_t used;
    int complete;
    ls_frame_put(&header, bytes);
    ls_frame_decoder_init(&decoder, UINT64_MAX / 2);
    g_assert_cmpint(ls_frame_decoder_feed(&decoder, bytes, sizeof bytes, &used, &complete, NULL),
                    ==, LS_OK);
    g_assert_false(complete);
    g_assert_cmpuint(decoder.body_capacity, <=, 64 * 1024);
    ls_frame_decoder_finish(&decoder);
}

static void random_bytes_never_do_harm(void)
{
    for (int round = 0; round < 20000; round++) {
        uint8_t bytes[96];
        struct ls_frame_decoder decoder;
        struct frame good = make_frame();
        size_t used, at = 0;
        int complete;
        memcpy(bytes, good.bytes, sizeof bytes);
        for (int i = 0; i < 3; i++)
            bytes[g_test_rand_int_range(0, 40)] = (uint8_t)g_test_rand_int_range(0, 256);
        ls_frame_decoder_init(&decoder, MAX_PAYLOAD);
        while (at < sizeof bytes) {
            size_t n = (size_t)g_test_rand_int_range(1, (gint32)(sizeof bytes - at) + 1);
            if (ls_frame_decoder_feed(&decoder, bytes + at, n, &used, &complete, NULL))
                break;
            at += used;
            if (complete)
                ls_frame_decoder_next(&decoder);
        }
        g_assert_cmpuint(decoder.body_fill, <=, LS_FRAME_MAX_MESSAGE + MAX_PAYLOAD);
        ls_frame_decoder_finish(&decoder);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/frame/a-header-survives-put-and-get", header_survives_put_and_get);
    g_test_add_func("/frame/any-split-gives-the-same-frames", any_split_gives_the_same_frames);
    g_test_add_func("/frame/byte-by-byte-gives-the-same-frames",
                    byte_by_byte_gives_the_same_frames);
    g_test_add_func("/frame/an-empty-frame-is-complete-with-its-header",
                    empty_message_and_payload_complete_with_the_header);
    g_test_add_func("/frame/damaged-headers-are-refused-and-stay-refused",
                    damaged_headers_are_refused_and_stay_refused);
    g_test_add_func("/frame/lengths-at-the-limit-are-accepted", lengths_at_the_limit_are_accepted);
    g_test_add_func("/frame/memory-follows-what-arrived-not-what-was-announced",
                    memory_follows_what_arrived_not_what_was_announced);
    g_test_add_func("/frame/random-bytes-never-do-harm", random_bytes_never_do_harm);
    return g_test_run();
}

/* message: the schema's coding, and what hostile bytes can cost. */
#include "proto/errors.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <glib.h>
#include <malloc.h>
#include <stdlib.h>
#include <string.h>

static void a_message_survives_coding(void)
{
    Lightstage__TakeStart start = LIGHTSTAGE__TAKE_START__INIT;
    struct ls_frame_header header;
    ProtobufCMessage *back = NULL;
    uint8_t *bytes = NULL;
    size_t n = 0;
    start.name = (char *)"vase";
    start.token = (char *)"abc";
    g_assert_cmpint(ls_message_frame(LS_MESSAGE_TAKE_START, 7, LS_FRAME_LAST, &start.base, 99,
                                     &bytes, &n, NULL),
                    ==, LS_OK);
    g_assert_cmpint(ls_frame_get(bytes, 99, &header, NULL), ==, LS_OK);
    g_assert_cmpuint(header.message_bytes, ==, n - LS_FRAME_HEADER_BYTES);
    g_assert_cmpint(ls_message_decode(header.type, bytes + LS_FRAME_HEADER_BYTES,
                                      header.message_bytes, &back, NULL),
                    ==, LS_OK);
    g_assert_cmpstr(((Lightstage__TakeStart *)back)->name, ==, "vase");
    g_assert_cmpstr(((Lightstage__TakeStart *)back)->token, ==, "abc");
    ls_message_free(back);
    free(bytes);
}

static void unknown_fields_are_ignored(void)
{
    static const uint8_t bytes[] = {0x0a, 1,    'a', 0xf8, 0x07, 42, /* field 127, varint */
                                    0xfa, 0x07, 3,   1,    2,    3}; /* field 127, bytes */
    ProtobufCMessage *back = NULL;
    g_assert_cmpint(ls_message_decode(LS_MESSAGE_TAKE_START, bytes, sizeof bytes, &back, NULL), ==,
                    LS_OK);
    g_assert_cmpstr(((Lightstage__TakeStart *)back)->name, ==, "a");
    ls_message_free(back);
}

static void unknown_types_are_refused(void)
{
    static const uint16_t types[] = {0,      LS_MESSAGE_RING + 1,          0x7fff,
                                     0x8000, 0x8000 + LS_MESSAGE_RING + 1, 0xfffe};
    for (size_t i = 0; i < G_N_ELEMENTS(types); i++) {
        ProtobufCMessage *back = NULL;
        struct ls_diag diag = {0};
        g_assert_null(ls_message_name(types[i]));
        g_assert_cmpint(ls_message_decode(types[i], NULL, 0, &back, &diag), ==, LS_ERR_UNSUPPORTED);
        g_assert_null(back);
        g_assert_cmpstr(diag.text, !=, "");
    }
}

static void every_type_has_both_schemas(void)
{
    for (uint16_t type = LS_MESSAGE_HELLO; type <= LS_MESSAGE_PREVIEW; type++) {
        g_assert_nonnull(ls_message_name(type));
        g_assert_nonnull(ls_message_name(type | LS_MESSAGE_REPLY));
    }
    g_assert_cmpstr(ls_message_name(LS_MESSAGE_ERROR), ==, "Error");
}

static void malformed_bytes_are_refused(void)
{
    static const struct {
        uint8_t bytes[6];
        size_t n;
    } cases[] = {
        {{0x0a, 5, 'a'}, 3},                       /* string longer than what follows */
        {{0x0a}, 1},                               /* a tag and nothing */
        {{0x0b}, 1},                               /* a group */
        {{0x08, 0xff, 0xff, 0xff, 0xff, 0xff}, 6}, /* an endless varint, cut */
        {{0x07, 0}, 2},                            /* wire type 7 */
        {{0x0a, 0xff, 0xff, 0xff, 0xff, 0x0f}, 6}, /* a string of 4 GiB */
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        ProtobufCMessage *back = NULL;
        g_assert_cmpint(
            ls_message_decode(LS_MESSAGE_TAKE_START, cases[i].bytes, cases[i].n, &back, NULL), ==,
            LS_ERR_INVALID);
        g_assert_null(back);
    }
}

/* 32 Ki empty TakeSummary items in 64 KiB: each would cost over 100 bytes. */
static void hostile_messages_stay_within_the_budget(void)
{
    size_t n = LS_FRAME_MAX_MESSAGE;
    uint8_t *bytes = g_malloc(n);
    ProtobufCMessage *back = NULL;
    struct ls_diag diag = {0};
    for (size_t i = 0; i < n; i += 2) {
        bytes[i] = 0x0a;
        bytes[i + 1] = 0;
    }
    size_t before = mallinfo2().uordblks;
    g_assert_cmpint(
        ls_message_decode(LS_MESSAGE_TAKE_LIST | LS_MESSAGE_REPLY, bytes, n, &back, &diag), ==,
        LS_ERR_LIMIT);
    /* the allocator's own caches count as in use, so not exactly */
    g_assert_cmpuint(mallinfo2().uordblks, <=, before + 32 * 1024);
    g_assert_nonnull(strstr(diag.text, "memory"));
    /* unknown fields are kept by the decoder: they count as well */
    for (size_t i = 0; i + 2 < n; i += 3)
        memcpy(bytes + i, "\xf8\x07\x01", 3);
    g_assert_cmpint(ls_message_decode(LS_MESSAGE_STATUS, bytes, n / 3 * 3, &back, NULL), ==,
                    LS_ERR_LIMIT);
    g_free(bytes);
}

static void a_message_over_64_kib_is_refused_both_ways(void)
{
    size_t n = LS_FRAME_MAX_MESSAGE + 1, out = 0;
    char *text = g_strnfill(n, 'x');
    ProtobufCMessage *back = NULL;
    uint8_t *bytes = NULL;
    Lightstage__Error error = LIGHTSTAGE__ERROR__INIT;
    error.text = text;
    g_assert_cmpint(ls_message_decode(LS_MESSAGE_ERROR, (uint8_t *)text, n, &back, NULL), ==,
                    LS_ERR_LIMIT);
    g_assert_cmpint(ls_message_frame(LS_MESSAGE_ERROR, 1, 0, &error.base, 0, &bytes, &out, NULL),
                    ==, LS_ERR_LIMIT);
    g_assert_null(bytes);
    g_free(text);
}

static void random_bytes_never_do_harm(void)
{
    for (int round = 0; round < 20000; round++) {
        uint8_t bytes[48];
        ProtobufCMessage *back = NULL;
        size_t n = (size_t)g_test_rand_int_range(0, sizeof bytes + 1);
        uint16_t type = (uint16_t)g_test_rand_int_range(1, 16);
        for (size_t i = 0; i < n; i++)
            bytes[i] = (uint8_t)g_test_rand_int_range(0, g_test_rand_bit() ? 256 : 24);
        if (g_test_rand_bit())
            type |= LS_MESSAGE_REPLY;
        enum ls_err err = ls_message_decode(type, bytes, n, &back, NULL);
        g_assert_true(err == LS_OK || err == LS_ERR_INVALID || err == LS_ERR_LIMIT);
        ls_message_free(back);
    }
}

static void error_numbers_tell_their_class(void)
{
    for (enum ls_err err = LS_ERR_NOMEM; err <= LS_ERR_ABORTED; err++)
        for (int about = LS_PROTO_ABOUT_REQUEST; about <= LS_PROTO_ABOUT_STORAGE; about++) {
            enum ls_proto_error number = ls_proto_error_of(err, (enum ls_proto_context)about);
            g_assert_cmpint(number, >=, 100);
            g_assert_cmpint(number, <, 600);
            g_assert_cmpstr(ls_proto_error_name(number), !=, "error");
            if (err <= LS_ERR_BUG && !(err == LS_ERR_OS && about == LS_PROTO_ABOUT_STORAGE))
                g_assert_cmpint(number / 100, ==, 5);
        }
    g_assert_cmpint(ls_proto_error_of(LS_ERR_BUSY, LS_PROTO_ABOUT_REQUEST), ==, 201);
    g_assert_cmpint(ls_proto_error_of(LS_ERR_OS, LS_PROTO_ABOUT_STORAGE), ==, 400);
    g_assert_cmpint(ls_proto_error_of(LS_ERR_LIMIT, LS_PROTO_ABOUT_RIG), ==, 303);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/message/survives-coding", a_message_survives_coding);
    g_test_add_func("/message/unknown-fields-are-ignored", unknown_fields_are_ignored);
    g_test_add_func("/message/unknown-types-are-refused", unknown_types_are_refused);
    g_test_add_func("/message/every-type-has-a-request-and-a-reply", every_type_has_both_schemas);
    g_test_add_func("/message/malformed-bytes-are-refused", malformed_bytes_are_refused);
    g_test_add_func("/message/hostile-bytes-stay-within-the-budget",
                    hostile_messages_stay_within_the_budget);
    g_test_add_func("/message/over-64-kib-is-refused-both-ways",
                    a_message_over_64_kib_is_refused_both_ways);
    g_test_add_func("/message/random-bytes-never-do-harm", random_bytes_never_do_harm);
    g_test_add_func("/errors/numbers-tell-their-class", error_numbers_tell_their_class);
    return g_test_run();
}

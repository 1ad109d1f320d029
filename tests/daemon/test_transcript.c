/* transcript: the conversation written down in proto/PROTOCOL.md is the one that takes place.
 * With LS_TRANSCRIPT_PRINT=1 it prints what the daemon really says, to be pasted. */
#include "proto/frame.h"
#include "tests/daemon/server_fixture.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* One line group of the document: "> Name id", "< Name id [last]" or "! what the rig does". */
struct turn {
    char direction;
    char words[3][32];
    GByteArray *bytes;
};

static char *read_document(void)
{
    char *text = NULL,
         *path = g_build_filename(g_getenv("LS_SOURCE_ROOT"), "proto", "PROTOCOL.md", NULL);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_free(path);
    return text;
}

static void add_hex(GByteArray *bytes, const char *line)
{
    for (const char *p = line; *p; p++) {
        if (isspace((unsigned char)*p))
            continue;
        int high = g_ascii_xdigit_value(p[0]), low = high < 0 ? -1 : g_ascii_xdigit_value(p[1]);
        if (low < 0)
            g_error("not a line of hex: %s", line);
        uint8_t value = (uint8_t)(high * 16 + low);
        g_byte_array_append(bytes, &value, 1);
        p++;
    }
}

static void turn_free(gpointer data)
{
    struct turn *turn = data;
    g_byte_array_unref(turn->bytes);
    g_free(turn);
}

/* The indented lines after the heading "## Transcript". */
static GPtrArray *parse(const char *document)
{
    GPtrArray *turns = g_ptr_array_new_with_free_func(turn_free);
    char **parts = g_strsplit(document, "\n## Transcript", 2);
    g_assert_cmpuint(g_strv_length(parts), ==, 2);
    char **lines = g_strsplit(parts[1], "\n", -1);
    struct turn *turn = NULL;
    for (char **l = lines; *l; l++) {
        if (strncmp(*l, "    ", 4) != 0)
            continue;
        if (strchr("<>!", (*l)[4])) {
            turn = g_new0(struct turn, 1);
            turn->direction = (*l)[4];
            turn->bytes = g_byte_array_new();
            g_assert_cmpint(
                sscanf(*l + 5, "%31s %31s %31s", turn->words[0], turn->words[1], turn->words[2]),
                >=, 2);
            g_ptr_array_add(turns, turn);
        } else {
            g_assert_nonnull(turn);
            add_hex(turn->bytes, *l + 4);
        }
    }
    g_strfreev(lines);
    g_strfreev(parts);
    return turns;
}

static void rig_acts(struct stage *stage, const struct turn *turn)
{
    if (strcmp(turn->words[1], "binds") == 0)
        take_advances(stage, (uint32_t)atoi(turn->words[2]));
    else if (strcmp(turn->words[2], "complete") == 0)
        take_ends(stage, LS_TAKE_COMPLETE);
    else
        g_error("the rig cannot \"%s %s\"", turn->words[1], turn->words[2]);
}

static void heading_says_what_the_bytes_say(const struct turn *turn)
{
    struct ls_frame_header header;
    char id[16];
    g_assert_cmpuint(turn->bytes->len, >=, LS_FRAME_HEADER_BYTES);
    g_assert_cmpint(ls_frame_get(turn->bytes->data, 1 << 20, &header, NULL), ==, LS_OK);
    g_assert_cmpuint(turn->bytes->len, ==,
                     LS_FRAME_HEADER_BYTES + header.message_bytes + header.payload_bytes);
    snprintf(id, sizeof id, "%u", header.request);
    const char *name = ls_message_name(header.type);
    g_assert_cmpstr(turn->words[0], ==, name ? name : "unknown");
    g_assert_cmpstr(turn->words[1], ==, id);
    if (turn->direction == '<')
        g_assert_cmpint(strcmp(turn->words[2], "last") == 0, ==,
                        (header.flags & LS_FRAME_LAST) != 0);
}

static GByteArray *next_frame(int fd)
{
    GByteArray *out = g_byte_array_new();
    struct ls_frame_decoder decoder;
    ls_frame_decoder_init(&decoder, 1 << 20);
    for (int complete = 0; !complete;) {
        uint8_t byte;
        size_t used;
        g_assert_cmpint(recv(fd, &byte, 1, 0), ==, 1);
        g_byte_array_append(out, &byte, 1);
        g_assert_cmpint(ls_frame_decoder_feed(&decoder, &byte, 1, &used, &complete, NULL), ==,
                        LS_OK);
    }
    ls_frame_decoder_finish(&decoder);
    return out;
}

static void print_frame(const GByteArray *frame)
{
    struct ls_frame_header header;
    g_assert_cmpint(ls_frame_get(frame->data, 1 << 20, &header, NULL), ==, LS_OK);
    fprintf(stderr, "    < %s %u%s", ls_message_name(header.type), header.request,
            header.flags & LS_FRAME_LAST ? " last" : "");
    for (guint i = 0; i < frame->len; i++)
        fprintf(stderr, "%s%02x", i % 16 ? " " : "\n    ", frame->data[i]);
    fputs("\n\n", stderr);
}

static void the_written_conversation_takes_place(void)
{
    struct stage stage;
    char *document = read_document();
    GPtrArray *turns = parse(document);
    bool print = g_getenv("LS_TRANSCRIPT_PRINT") != NULL;
    stage_init(&stage);
    stage_open(&stage);
    int fd = a_bare_socket(&stage);
    unsigned said = 0;
    for (guint i = 0; i < turns->len; i++) {
        const struct turn *turn = turns->pdata[i];
        if (turn->direction == '!') {
            rig_acts(&stage, turn);
            continue;
        }
        if (turn->direction == '>') {
            heading_says_what_the_bytes_say(turn);
            g_assert_cmpint(send(fd, turn->bytes->data, turn->bytes->len, MSG_NOSIGNAL), ==,
                            turn->bytes->len);
            continue;
        }
        GByteArray *frame = next_frame(fd);
        if (print) {
            print_frame(frame);
        } else {
            heading_says_what_the_bytes_say(turn);
            g_assert_cmpmem(frame->data, frame->len, turn->bytes->data, turn->bytes->len);
        }
        g_byte_array_unref(frame);
        said++;
    }
    uint8_t byte;
    g_assert_cmpuint(said, >=, 8);
    g_assert_cmpint(recv(fd, &byte, 1, 0), ==, 0); /* the last refusal closes */
    close(fd);
    stage_close(&stage);
    g_ptr_array_unref(turns);
    g_free(document);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/transcript/the-written-conversation-takes-place",
                    the_written_conversation_takes_place);
    return g_test_run();
}

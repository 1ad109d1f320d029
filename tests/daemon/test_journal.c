#include "daemon/journal.h"

#include "core/crc32c.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

struct seen {
    struct ls_ticket ticket;
    unsigned tickets, published, alarms, states;
    uint32_t crc_sum;
    char text[64], state[32];
};

static enum ls_err see_ticket(void *user, const struct ls_ticket *ticket)
{
    struct seen *seen = user;
    seen->ticket = *ticket;
    seen->tickets++;
    return LS_OK;
}

static enum ls_err see_published(void *user, const struct ls_published *published)
{
    struct seen *seen = user;
    seen->published++;
    for (uint32_t k = 0; k < published->n_tiles; k++)
        seen->crc_sum += published->tile_crc[k] ^ published->tile_max[k] ^
                         (published->tile_invalid ? published->tile_invalid[k] : 0);
    seen->crc_sum += published->validity_crc;
    g_assert_cmpstr(published->condition, ==, "W-0137");
    g_assert_cmpstr(published->file, ==, "cam1/W-0137.exr");
    g_assert_cmpuint(published->width, ==, 100);
    g_assert_cmpuint(published->height, ==, 65);
    g_assert_cmpuint(published->bytes, ==, 12345678901);
    return LS_OK;
}

static enum ls_err see_alarm(void *user, const char *text)
{
    struct seen *seen = user;
    seen->alarms++;
    g_strlcpy(seen->text, text, sizeof seen->text);
    return LS_OK;
}

static enum ls_err see_state(void *user, const char *state)
{
    struct seen *seen = user;
    seen->states++;
    g_strlcpy(seen->state, state, sizeof seen->state);
    return LS_OK;
}

static enum ls_err replay(const char *text, size_t n, struct seen *seen, size_t *n_good,
                          struct ls_diag *diag)
{
    *seen = (struct seen){0};
    const struct ls_journal_reader reader = {seen, see_ticket, see_published, see_alarm, see_state};
    char *copy = g_memdup2(text, n ? n : 1); /* its own block: a checker sees overruns */
    enum ls_err err = ls_journal_replay(copy, n, &reader, n_good, diag);
    g_free(copy);
    return err;
}

static const struct ls_ticket a_ticket = {
    .shot = 4000000000u,
    .step = 2,
    .camera = 1,
    .attempt = 3,
    .condition = 4,
    .exposure = 5,
    .repeat = 6,
    .pulse_us = 1250.125,
    .controller_step = 7,
    .width_us = 1251,
    .controller_us = 1ull << 62,
    .frame_id = 70000,
    .camera_ns = 123456789012345678,
    .host_ns = 8,
    .status = LS_FRAME_OK,
    .trigger_counter = 9,
    .chunk_exposure_us = 1263.8,
    .exposure_used_us = 1263.825,
    .residual_us = -0.1,
    .raw_crc32c = 0xdeadbeef,
    .raw_bytes = 8388608,
};

static struct ls_published a_picture(uint32_t *crc, uint32_t *max, uint32_t *invalid, bool is_float)
{
    struct ls_published p = {.camera = 1,
                             .bytes = 12345678901,
                             .width = 100,
                             .height = 65,
                             .is_float = is_float,
                             .n_tiles = 4,
                             .tile_crc = crc,
                             .tile_max = max,
                             .tile_invalid = invalid,
                             .validity_crc = invalid ? 77 : 0};
    strcpy(p.condition, "W-0137");
    strcpy(p.file, "cam1/W-0137.exr");
    return p;
}

static void fill(struct ls_journal_batch *batch)
{
    uint32_t crc[4] = {1, 0xffffffff, 3, 0x80000000}, max[4] = {0, 0x7c00, 0x3c00, 1};
    uint32_t max_float[4] = {0, 0x7f800000, 0x3f800000, 1}, invalid[4] = {0, 5, 0, 2340};
    struct ls_published half = a_picture(crc, max, NULL, false);
    struct ls_published flagged = a_picture(crc, max_float, invalid, true);
    g_assert_cmpint(ls_journal_add_ticket(batch, &a_ticket), ==, LS_OK);
    g_assert_cmpint(ls_journal_add_published(batch, &half), ==, LS_OK);
    g_assert_cmpint(ls_journal_add_published(batch, &flagged), ==, LS_OK);
    g_assert_cmpint(ls_journal_add_alarm(batch, 5, "drift of \"0.3 %\"\nper minute"), ==, LS_OK);
    g_assert_cmpint(ls_journal_add_state(batch, 6, "complete"), ==, LS_OK);
}

static void test_round_trip(void)
{
    struct ls_journal_batch batch = {0};
    struct seen seen;
    size_t n_good;
    fill(&batch);
    g_assert_cmpint(replay(batch.text, batch.n, &seen, &n_good, NULL), ==, LS_OK);
    g_assert_cmpuint(n_good, ==, batch.n);
    g_assert_cmpuint(seen.tickets, ==, 1);
    g_assert_cmpuint(seen.published, ==, 2);
    g_assert_cmpstr(seen.text, ==, "drift of \"0.3 %\"\nper minute");
    g_assert_cmpstr(seen.state, ==, "complete");
    const struct ls_ticket *t = &seen.ticket;
    g_assert_cmpuint(t->shot, ==, a_ticket.shot);
    g_assert_cmpuint(t->controller_us, ==, a_ticket.controller_us);
    g_assert_cmpuint(t->camera_ns, ==, a_ticket.camera_ns);
    g_assert_cmpuint(t->raw_crc32c, ==, a_ticket.raw_crc32c);
    g_assert_cmpint(t->status, ==, a_ticket.status);
    g_assert_cmpfloat(t->chunk_exposure_us, ==, a_ticket.chunk_exposure_us);
    g_assert_cmpfloat(t->residual_us, ==, a_ticket.residual_us);
    uint32_t sum = 77 + (1 ^ 0) + (0xffffffff ^ 0x7c00) + (3 ^ 0x3c00) + (0x80000000 ^ 1) +
                   (1 ^ 0) + (0xffffffff ^ 0x7f800000 ^ 5) + (3 ^ 0x3f800000) +
                   (0x80000000 ^ 1 ^ 2340);
    g_assert_cmphex(seen.crc_sum, ==, sum);
    ls_journal_batch_finish(&batch);
}

static size_t last_record(const struct ls_journal_batch *batch)
{
    size_t at = batch->n - 1;
    while (batch->text[at - 1] != '\n')
        at--;
    return at;
}

static void test_torn_tail(void)
{
    struct ls_journal_batch batch = {0};
    struct seen seen;
    size_t n_good;
    fill(&batch);
    size_t last = last_record(&batch);
    for (size_t cut = last; cut < batch.n; cut++) {
        g_assert_cmpint(replay(batch.text, cut, &seen, &n_good, NULL), ==, LS_OK);
        g_assert_cmpuint(n_good, ==, last);
        g_assert_cmpuint(seen.alarms, ==, 1);
        g_assert_cmpuint(seen.states, ==, 0);
    }
    for (size_t at = last; at < batch.n; at++) {
        char *copy = g_memdup2(batch.text, batch.n);
        copy[at] ^= 1;
        g_assert_cmpint(replay(copy, batch.n, &seen, &n_good, NULL), ==, LS_OK);
        g_assert_cmpuint(n_good, ==, last);
        g_free(copy);
    }
    ls_journal_batch_finish(&batch);
}

/* Line 2 begins after the ticket. */
static void test_damage_in_the_middle(void)
{
    struct ls_journal_batch batch = {0};
    struct seen seen;
    size_t n_good, second;
    fill(&batch);
    second = (size_t)((char *)memchr(batch.text, '\n', batch.n) + 1 - batch.text);
    size_t third =
        (size_t)((char *)memchr(batch.text + second, '\n', batch.n - second) + 1 - batch.text);
    for (size_t at = second; at < third - 1; at++) {
        struct ls_diag diag = {0};
        char *copy = g_memdup2(batch.text, batch.n);
        copy[at] ^= 1;
        g_assert_cmpint(replay(copy, batch.n, &seen, &n_good, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, "line 2"));
        g_free(copy);
    }
    ls_journal_batch_finish(&batch);
}

static void add_raw_line(GString *text, const char *json)
{
    g_string_append_printf(text, "%08x %s\n", ls_crc32c(0, json, strlen(json)), json);
}

static void test_nonsense(void)
{
    static const char *const bad[] = {
        "{}",
        "[]",
        "3",
        "{\"k\":3}",
        "{\"k\":\"ticket\"}",
        "{\"k\":\"alarm\"}",
        "{\"k\":\"state\",\"state\":5}",
        "{\"k\":\"published\"}",
        "{\"k\":\"published\",\"condition\":\"a\",\"camera\":0,\"file\":\"../../etc/passwd\","
        "\"bytes\":1,\"width\":1,\"height\":1,\"type\":\"half\",\"crc\":\"00000000\",\"max\":"
        "\"0000\"}",
        "{\"k\":\"published\",\"condition\":\"a\",\"camera\":0,\"file\":\"a\",\"bytes\":1,"
        "\"width\":65,\"height\":1,\"type\":\"half\",\"crc\":\"00000000\",\"max\":\"0000\"}",
        "{\"k\":\"published\",\"condition\":\"a\",\"camera\":-1,\"file\":\"a\",\"bytes\":1,"
        "\"width\":1,\"height\":1,\"type\":\"half\",\"crc\":\"00000000\",\"max\":\"0000\"}",
    };
    struct seen seen;
    size_t n_good;
    for (size_t k = 0; k < G_N_ELEMENTS(bad); k++) {
        GString *text = g_string_new(NULL);
        struct ls_diag diag = {0};
        add_raw_line(text, bad[k]);
        g_assert_cmpint(replay(text->str, text->len, &seen, &n_good, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, "line 1"));
        g_string_free(text, TRUE);
    }
    GString *text = g_string_new(NULL);
    add_raw_line(text, "{\"k\":\"from the future\",\"x\":[1]}");
    g_assert_cmpint(replay(text->str, text->len, &seen, &n_good, NULL), ==, LS_OK);
    g_assert_cmpuint(n_good, ==, text->len);
    g_string_free(text, TRUE);
}

static void test_infinite_time_is_refused(void)
{
    struct ls_journal_batch batch = {0};
    struct ls_ticket ticket = a_ticket;
    ticket.residual_us = NAN;
    g_assert_cmpint(ls_journal_add_ticket(&batch, &ticket), ==, LS_ERR_INVALID);
    g_assert_cmpuint(batch.n, ==, 0);
    ls_journal_batch_finish(&batch);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/journal/records-come-back", test_round_trip);
    g_test_add_func("/journal/torn-tail-is-cut-at-every-offset", test_torn_tail);
    g_test_add_func("/journal/damage-in-the-middle-names-its-line", test_damage_in_the_middle);
    g_test_add_func("/journal/whole-records-of-nonsense-are-refused", test_nonsense);
    g_test_add_func("/journal/a-time-that-is-not-finite-is-refused", test_infinite_time_is_refused);
    return g_test_run();
}

/*
 * journal: first byte 'r': the bytes as they stand. Else the lines are the records, and get their
 * checksums here, which no mutation would find; the last two bytes say where the file is cut.
 * Replay finds whole records only, all of them before the first damage, and the same ones after
 * they were written again.
 */
#include "core/crc32c.h"
#include "daemon/journal.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

/* What a replay told, written down again. */
struct told {
    struct ls_journal_batch batch;
    uint32_t records;
    int unwritable; /* a number without JSON */
};

static enum ls_err written(struct told *told, enum ls_err err)
{
    HOLDS(!err || err == LS_ERR_INVALID);
    told->unwritable |= err != LS_OK;
    told->records++;
    return LS_OK;
}

static enum ls_err on_ticket(void *user, const struct ls_ticket *ticket)
{
    struct told *told = user;
    return written(told, ls_journal_add_ticket(&told->batch, ticket));
}

static enum ls_err on_published(void *user, const struct ls_published *published)
{
    struct told *told = user;
    HOLDS(published->n_tiles && published->width && published->height);
    HOLDS(*published->file && !strstr(published->file, "..") && *published->file != '/');
    return written(told, ls_journal_add_published(&told->batch, published));
}

static enum ls_err on_alarm(void *user, const char *text)
{
    struct told *told = user;
    return written(told, ls_journal_add_alarm(&told->batch, 0, text));
}

static enum ls_err on_state(void *user, const char *state)
{
    struct told *told = user;
    return written(told, ls_journal_add_state(&told->batch, 0, state));
}

static enum ls_err replay(const char *text, size_t n, struct told *told, size_t *n_good)
{
    struct ls_journal_reader reader = {told, on_ticket, on_published, on_alarm, on_state};
    struct ls_diag diag = {0};
    *told = (struct told){0};
    *n_good = 0;
    enum ls_err err = ls_journal_replay(text, n, &reader, n_good, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(*n_good <= n && (!*n_good || text[*n_good - 1] == '\n'));
    return err;
}

/* The good part alone is good, and holds the same records; so does what was written of them. */
static void check(const char *text, size_t n)
{
    struct told first, again, rewritten;
    size_t n_good, n_again, n_rewritten;
    enum ls_err err = replay(text, n, &first, &n_good);
    if (!err) {
        HOLDS(!replay(text, n_good, &again, &n_again));
        HOLDS(n_again == n_good && again.records == first.records);
        const char *batch = first.batch.text ? first.batch.text : "";
        HOLDS(!replay(batch, first.batch.n, &rewritten, &n_rewritten));
        HOLDS(n_rewritten == first.batch.n);
        HOLDS(first.unwritable || rewritten.records == first.records);
        HOLDS(rewritten.batch.n == first.batch.n &&
              (!first.batch.n || !memcmp(rewritten.batch.text, first.batch.text, first.batch.n)));
        ls_journal_batch_finish(&again.batch);
        ls_journal_batch_finish(&rewritten.batch);
    }
    ls_journal_batch_finish(&first.batch);
}

/* The lines with their checksums. (transfer full) */
static char *sealed(const uint8_t *data, size_t n, size_t *length)
{
    size_t lines = 1;
    for (size_t k = 0; k < n; k++)
        lines += data[k] == '\n';
    char *text = malloc(n + 10 * lines + 1);
    HOLDS(text);
    *length = 0;
    for (size_t at = 0; at < n;) {
        const uint8_t *end = memchr(data + at, '\n', n - at);
        size_t some = end ? (size_t)(end - data) - at : n - at;
        sprintf(text + *length, "%08x ", ls_crc32c(0, data + at, some));
        memcpy(text + *length + 9, data + at, some);
        *length += some + 10;
        text[*length - 1] = '\n';
        at += some + 1;
    }
    return text;
}

/* A file cut anywhere opens to its whole lines, if they are good. */
static void check_cut(const char *text, size_t n, size_t cut)
{
    struct told all, some;
    size_t n_all, n_some, whole = cut;
    while (whole && text[whole - 1] != '\n')
        whole--;
    enum ls_err err = replay(text, n, &all, &n_all);
    if (!err && n_all == n) {
        char *copy = fuzz_text((const uint8_t *)text, cut);
        HOLDS(!replay(copy, cut, &some, &n_some));
        HOLDS(n_some == whole && some.records <= all.records);
        ls_journal_batch_finish(&some.batch);
        free(copy);
    }
    ls_journal_batch_finish(&all.batch);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    if (n < 4)
        return 0;
    if (data[0] == 'r') {
        check((const char *)data + 1, n - 1);
        return 0;
    }
    size_t length, at = data[n - 2] | (size_t)data[n - 1] << 8;
    char *text = sealed(data + 1, n - 3, &length);
    check(text, length);
    check_cut(text, length, at % (length + 1));
    free(text);
    return 0;
}

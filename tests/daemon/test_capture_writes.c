/*
 * capture: the disk fails at every operation of a short take, in every way it can; what was
 * published is there afterwards, and what is missing is shot by a resume. (How a take's folder
 * comes to be is test_store_faults.c's.)
 */
#include "tests/daemon/capture_fixture.h"
#include "tests/daemon/store_fixture.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

enum { LIGHTS = 3, CONDITIONS = N_EXPOSURES + LIGHTS, MAX_RENAMED = 64 };

enum failure {
    SHORT,  /* one write takes half of what it was given */
    FULL,   /* no space from now on */
    BROKEN, /* input/output error from now on */
    CRASH,  /* the process ends; if at a write, half of that is done */
    POWER,  /* the same, and what was not synced is gone: the journal's tail, renamed files */
    N_FAILURES
};

static const char *const names[N_FAILURES] = {"short write", "disk full", "broken disk", "crash",
                                              "power cut"};

/* What a writer told the world it had made durable, in memory both processes see. */
struct promise {
    uint64_t published;
    char folder[512];
};

struct fault {
    struct stage *stage;
    struct promise *promise;
    enum failure failure;
    unsigned count, at;
    bool running;        /* the take's folder is made */
    bool synced_journal; /* the operation before this one synced it */
    bool synced_names;   /* ... synced a folder's names */
    off_t size, durable; /* of the journal */
    unsigned n_renamed;
    char renamed[MAX_RENAMED][64];
};

static char *path_in(const struct fault *f, const char *name)
{
    return g_build_filename(ls_store_folder(f->stage->store), name, NULL);
}

static off_t journal_size(const struct fault *f)
{
    GStatBuf status;
    char *path = path_in(f, "journal");
    g_assert_cmpint(g_stat(path, &status), ==, 0);
    g_free(path);
    return status.st_size;
}

/* A sync has happened when the next operation is asked for. */
static void note(struct fault *f, enum ls_disk_op op, const char *name)
{
    struct ls_store_stats stats;
    ls_store_stats(f->stage->store, &stats);
    f->promise->published = stats.published;
    if (f->synced_journal)
        f->durable = f->size;
    if (f->synced_names)
        f->n_renamed = 0;
    f->synced_journal = op == LS_DISK_SYNC && g_str_equal(name, "journal");
    f->synced_names = op == LS_DISK_SYNC_DIR;
    if (f->synced_journal)
        f->size = journal_size(f);
    if (op == LS_DISK_RENAME && g_str_has_prefix(name, "cam") && f->n_renamed < MAX_RENAMED)
        g_strlcpy(f->renamed[f->n_renamed++], name, sizeof f->renamed[0]);
}

static void cut_power(struct fault *f)
{
    char *journal = path_in(f, "journal");
    g_assert_cmpint(truncate(journal, f->durable), ==, 0);
    for (unsigned i = 0; i < f->n_renamed; i++) {
        char *path = path_in(f, f->renamed[i]);
        unlink(path);
        g_free(path);
    }
    g_free(journal);
}

static int crash(struct fault *f, enum ls_disk_op op, size_t *n_bytes)
{
    if (op == LS_DISK_WRITE && *n_bytes > 1) {
        *n_bytes /= 2;
        f->at++; /* the other half is asked for next */
        return 0;
    }
    if (f->failure == POWER)
        cut_power(f);
    _exit(9);
}

static bool takes_space(enum ls_disk_op op)
{
    return op == LS_DISK_CREATE || op == LS_DISK_ALLOCATE || op == LS_DISK_WRITE;
}

static int strike(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    struct fault *f = user;
    if (!f->running)
        return 0;
    note(f, op, name);
    unsigned count = ++f->count;
    switch (f->failure) {
    case SHORT:
        if (count == f->at && op == LS_DISK_WRITE && *n_bytes > 1)
            *n_bytes /= 2;
        return 0;
    case FULL:
        return count >= f->at && takes_space(op) ? ENOSPC : 0;
    case BROKEN:
        return count >= f->at ? EIO : 0;
    default:
        return count == f->at ? crash(f, op, n_bytes) : 0;
    }
}

static struct stage *short_take(void)
{
    struct stage *s = new_stage();
    s->n_lights = LIGHTS;
    s->plan.keep_raw = false;
    return s;
}

/* A whole take, from the made folder to its state. */
static enum ls_err shoot_struck(struct stage *s, struct fault *f)
{
    const struct ls_store_end end = {.state = LS_STORE_COMPLETE};
    s->shim = (struct ls_disk_shim){strike, f};
    f->stage = s;
    set_up(s);
    g_strlcpy(f->promise->folder, s->folder, sizeof f->promise->folder);
    f->size = f->durable = journal_size(f);
    f->running = true;
    enum ls_err err = ls_capture_run(s->capture, &s->report, &s->diag);
    g_assert_true(fake_rig_is_dark(s->rig));
    return err ? err : ls_store_set_state(s->store, &end, &s->diag);
}

/* Exactly what was published is there, whole; then the rest, and all shows what it should. */
static void check_and_resume(struct stage *s, const struct promise *promise)
{
    struct ls_takedir *take = open_take(s->folder);
    struct ls_take_report report;
    bool complete = take->state == LS_STORE_COMPLETE;
    g_assert_cmpuint(take->n_published, >=, promise->published);
    assert_published_intact(take);
    ls_takedir_close(take);
    if (!complete)
        resume(s);
    take = open_take(s->folder);
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    g_assert_cmpuint(report.pictures_good, ==, CONDITIONS);
    for (uint32_t i = 0; i < CONDITIONS; i++)
        check_picture(s, take, i, 0);
    ls_take_report_finish(&report);
    ls_takedir_close(take);
}

static struct promise *new_promise(void)
{
    void *p = mmap(NULL, sizeof(struct promise), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS,
                   -1, 0);
    g_assert_true(p != MAP_FAILED);
    return p;
}

/* In this process: the disk says what is wrong, and so must the take. False: not struck. */
static bool told_at(struct fault *f)
{
    static const enum ls_err expected[] = {[FULL] = LS_ERR_FULL, [BROKEN] = LS_ERR_OS};
    struct stage *s = short_take();
    enum ls_err err = shoot_struck(s, f);
    bool struck = f->count >= f->at;
    if (f->failure == SHORT || !struck) {
        g_assert_cmpint(err, ==, LS_OK);
    } else if (err) { /* else all that needed space was done */
        g_assert_cmpint(err, ==, expected[f->failure]);
        g_assert_nonnull(strstr(s->diag.text, f->failure == FULL ? "space" : "error"));
    }
    g_assert_true(err || f->failure == FULL || f->failure == SHORT || !struck);
    (void)ls_store_close(s->store, NULL);
    s->store = NULL;
    check_and_resume(s, f->promise);
    clear(s);
    return struck;
}

/* In another process, which ends. */
static bool crashed_at(struct fault *f)
{
    struct stage *s = short_take();
    int status;
    pid_t child = fork();
    if (!child)
        _exit(shoot_struck(s, f) ? 1 : 0);
    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    g_assert_true(WIFEXITED(status));
    g_assert_true(WEXITSTATUS(status) == 9 || WEXITSTATUS(status) == 0);
    describe(s);
    s->folder = g_strdup(f->promise->folder);
    check_and_resume(s, f->promise);
    clear(s);
    return WEXITSTATUS(status) == 9;
}

static void test_failure(gconstpointer data)
{
    enum failure failure = (enum failure)GPOINTER_TO_INT(data);
    unsigned at = 1, step = g_getenv("LS_TEST_FULL") ? 1 : 17;
    bool struck = true;
    for (; struck; at += step) {
        struct promise *promise = new_promise();
        struct fault fault = {.promise = promise, .failure = failure, .at = at};
        struck = failure < CRASH ? told_at(&fault) : crashed_at(&fault);
        munmap(promise, sizeof *promise);
    }
    g_test_message("%s: at up to %u operations", names[failure], at);
    g_assert_cmpuint(at, >, 5 * CONDITIONS); /* create, allocate, write, sync, rename of each */
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_data_func("/writes/a-short-write-is-continued", GINT_TO_POINTER(SHORT),
                         test_failure);
    g_test_add_data_func("/writes/a-full-disk-is-told-and-costs-no-published-picture",
                         GINT_TO_POINTER(FULL), test_failure);
    g_test_add_data_func("/writes/a-broken-disk-is-told-and-costs-no-published-picture",
                         GINT_TO_POINTER(BROKEN), test_failure);
    g_test_add_data_func("/writes/a-crash-costs-no-published-picture", GINT_TO_POINTER(CRASH),
                         test_failure);
    g_test_add_data_func("/writes/a-power-cut-costs-no-published-picture", GINT_TO_POINTER(POWER),
                         test_failure);
    return g_test_run();
}

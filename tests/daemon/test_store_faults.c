#include "tests/daemon/store_fixture.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

/* What the disk does to us: at operation number `at` (counted from 1), once or from then on. */
struct fault {
    unsigned count, at;
    int error;    /* errno, or 0 */
    bool crash;   /* end the process without a word */
    bool shorten; /* every write is cut to at most 1000 bytes */
    bool sticky;
};

static int strike(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    struct fault *fault = user;
    unsigned count = ++fault->count;
    if (fault->shorten && op == LS_DISK_WRITE && *n_bytes > 1000)
        *n_bytes = 1000;
    if (!fault->at || (fault->sticky ? count < fault->at : count != fault->at))
        return 0;
    if (fault->crash) {
        /* half a write may have reached the disk */
        if (op == LS_DISK_WRITE && *n_bytes > 1) {
            *n_bytes /= 2;
            fault->at++;
            return 0;
        }
        _exit(9);
    }
    return fault->error;
}

/* What a writer told the world it had made durable, in memory both processes see. */
struct promises {
    _Atomic uint32_t flushed; /* conditions [0, flushed) are durable */
    _Atomic bool created;     /* folder is set */
    char folder[512];
};

static struct promises *new_promises(void)
{
    void *p = mmap(NULL, sizeof(struct promises), PROT_READ | PROT_WRITE,
                   MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    g_assert_true(p != MAP_FAILED);
    return p;
}

/* Shoot a whole take, flushing after every second condition. */
static enum ls_err shoot(const char *root, const struct ls_disk_shim *shim,
                         struct promises *promises, struct ls_diag *diag)
{
    struct ls_store_config config = a_take(root);
    struct ls_store *store;
    config.shim = shim;
    enum ls_err err = ls_store_create(&config, &store, diag);
    if (err)
        return err;
    g_strlcpy(promises->folder, ls_store_folder(store), sizeof promises->folder);
    promises->created = true;
    for (uint32_t k = 0; k < N_CONDITIONS && !err; k++) {
        err = ticket(store, k, diag);
        if (!err)
            err = publish(store, k, 0, diag);
        if (!err && k % 2) {
            err = ls_store_flush(store, diag);
            promises->flushed = err ? promises->flushed : k + 1;
        }
    }
    struct ls_store_end end = {.state = LS_STORE_ABORTED};
    if (!err)
        err = ls_store_set_state(store, &end, diag);
    enum ls_err closed = ls_store_close(store, err ? NULL : diag);
    return err ? err : closed;
}

/* Reopen what is left: every promise kept, every published file intact; then finish the take. */
static void assert_survived(const struct promises *promises)
{
    struct ls_takedir *take = open_take(promises->folder);
    assert_published_intact(take);
    for (uint32_t k = 0; k < promises->flushed; k++) {
        g_assert_nonnull(ls_takedir_find(take, condition_ids[k], 0));
        g_assert_nonnull(ls_takedir_ticket(take, k));
    }
    for (size_t k = 0; k < take->n_published; k++) { /* a picture never comes without its tickets */
        uint32_t shot = 0;
        while (strcmp(condition_ids[shot], take->published[k].condition))
            shot++;
        g_assert_nonnull(ls_takedir_ticket(take, shot));
    }
    ls_takedir_close(take);
    finish_take(promises->folder);
    char *camera = g_build_filename(promises->folder, "cam0", NULL);
    g_assert_cmpuint(count_files(camera), ==, N_CONDITIONS); /* no temporary file left */
    g_assert_cmpuint(count_files(promises->folder), ==, 3);
    g_free(camera);
}

static bool run_crashing(const char *root, unsigned at, struct promises *promises)
{
    pid_t child = fork();
    if (!child) {
        struct fault fault = {.at = at, .crash = true};
        struct ls_disk_shim shim = {strike, &fault};
        _exit(shoot(root, &shim, promises, NULL) ? 1 : 0);
    }
    int status;
    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    g_assert_true(WIFEXITED(status));
    g_assert_true(WEXITSTATUS(status) == 9 || WEXITSTATUS(status) == 0);
    return WEXITSTATUS(status) == 9;
}

static void test_crash_at_every_operation(void)
{
    unsigned at = 1, step = g_getenv("LS_TEST_FULL") ? 1 : 6;
    bool crashed = true;
    for (; crashed; at += step) {
        char *root = new_root();
        struct promises *promises = new_promises();
        crashed = run_crashing(root, at, promises);
        if (promises->created)
            assert_survived(promises);
        g_assert_true(crashed || promises->flushed == N_CONDITIONS);
        munmap(promises, sizeof *promises);
        remove_tree(root);
        g_free(root);
    }
    g_test_message("crashed at up to %u operations", at);
    g_assert_cmpuint(at, >, 60);
}

static void test_kill(void)
{
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    int rounds = g_getenv("LS_TEST_FULL") ? 300 : 12, partial = 0;
    g_test_message("seed %u", seed);
    for (int k = 0; k < rounds; k++) {
        char *root = new_root();
        struct promises *promises = new_promises();
        pid_t child = fork();
        if (!child)
            _exit(shoot(root, NULL, promises, NULL) ? 1 : 0);
        while (!promises->created)
            g_thread_yield();
        g_usleep((gulong)g_rand_int_range(rand, 0, 20000)); /* the moment is what varies */
        kill(child, SIGKILL);
        int status;
        g_assert_cmpint(waitpid(child, &status, 0), ==, child);
        partial += promises->flushed < N_CONDITIONS;
        assert_survived(promises);
        munmap(promises, sizeof *promises);
        remove_tree(root);
        g_free(root);
    }
    g_test_message("%d of %d killed before the end", partial, rounds);
    g_rand_free(rand);
}

static void fail_at(unsigned at, int error, enum ls_err expected)
{
    char *root = new_root();
    struct promises *promises = new_promises();
    struct fault fault = {.at = at, .error = error, .sticky = true};
    struct ls_disk_shim shim = {strike, &fault};
    struct ls_diag diag = {0};
    enum ls_err err = shoot(root, &shim, promises, &diag);
    if (fault.count >= at) { /* the fault struck: it must have been told, with its sentence */
        g_assert_cmpint(err, ==, expected);
        g_assert_cmpstr(diag.text, !=, "");
    }
    if (promises->created)
        assert_survived(promises);
    else if (err)
        g_assert_cmpuint(count_files(root), ==, 0);
    munmap(promises, sizeof *promises);
    remove_tree(root);
    g_free(root);
}

static void test_errors_are_told(void)
{
    unsigned step = g_getenv("LS_TEST_FULL") ? 1 : 11;
    for (unsigned at = 1; at < 80; at += step) {
        fail_at(at, ENOSPC, LS_ERR_FULL);
        fail_at(at, EIO, LS_ERR_OS);
    }
}

/* What a power failure would take away, since the disk was not yet told to keep it. */
struct unsynced {
    unsigned renames, journal_writes;
    bool file, journal, pictures, document; /* the bytes of a file; the names of files */
    bool said_after;                        /* records that came after the newest take.json */
};

static int watch_order(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    struct unsynced *u = user;
    bool journal = !strcmp(name, "journal"), picture = g_str_has_prefix(name, "cam");
    if (op == LS_DISK_WRITE && journal) {
        g_assert_false(u->pictures); /* a record vouches for files that are there */
        u->journal_writes++;
        u->said_after = true;
    }
    if (op == LS_DISK_WRITE || op == LS_DISK_SYNC)
        *(journal ? &u->journal : &u->file) = op == LS_DISK_WRITE;
    if (op == LS_DISK_RENAME) {
        g_assert_false(u->file); /* under its own name a file is whole */
        g_assert_true(picture || !u->journal);
        *(picture ? &u->pictures : &u->document) = true;
        u->said_after &= picture;
        u->renames++;
    }
    if (op == LS_DISK_SYNC_DIR)
        *(strcmp(name, "of a camera") ? &u->document : &u->pictures) = false;
    return 0;
}

static void test_order(void)
{
    char *root = new_root();
    struct promises *promises = new_promises();
    struct unsynced unsynced = {0};
    struct ls_disk_shim shim = {watch_order, &unsynced};
    g_assert_cmpint(shoot(root, &shim, promises, NULL), ==, LS_OK);
    g_assert_cmpuint(unsynced.renames, >, N_CONDITIONS);
    g_assert_cmpuint(unsynced.journal_writes, >=, N_CONDITIONS / 2);
    g_assert_false(unsynced.file || unsynced.journal || unsynced.pictures || unsynced.document);
    g_assert_false(unsynced.said_after); /* what take.json calls ended is whole in the journal */
    munmap(promises, sizeof *promises);
    remove_tree(root);
    g_free(root);
}

static void test_short_writes(void)
{
    char *root = new_root();
    struct promises *promises = new_promises();
    struct fault fault = {.shorten = true};
    struct ls_disk_shim shim = {strike, &fault};
    g_assert_cmpint(shoot(root, &shim, promises, NULL), ==, LS_OK);
    g_assert_cmpuint(fault.count, >, N_CONDITIONS * 14); /* 15 KB files in pieces of 1000 bytes */
    assert_survived(promises);
    munmap(promises, sizeof *promises);
    remove_tree(root);
    g_free(root);
}

static void test_torn_journal(void)
{
    char *root = new_root();
    struct promises *promises = new_promises();
    g_assert_cmpint(shoot(root, NULL, promises, NULL), ==, LS_OK);
    char *path = g_build_filename(promises->folder, "journal", NULL), *text;
    gsize n;
    g_assert_true(g_file_get_contents(path, &text, &n, NULL));
    size_t last = n - 1;
    while (text[last - 1] != '\n')
        last--;
    size_t step = g_getenv("LS_TEST_FULL") ? 1 : 7;
    for (size_t cut = last; cut < n; cut += step) {
        struct ls_store *store;
        g_assert_true(g_file_set_contents(path, text, (gssize)cut, NULL));
        g_assert_cmpint(ls_store_reopen(promises->folder, 0, 0, NULL, &store, NULL), ==, LS_OK);
        g_assert_cmpint(ls_store_alarm(store, "after the cut", NULL), ==, LS_OK);
        g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
        struct ls_takedir *take = open_take(promises->folder);
        g_assert_cmpuint(take->torn_bytes, ==, 0);
        g_assert_cmpuint(take->n_published, ==, N_CONDITIONS);
        g_assert_cmpuint(take->n_alarms, ==, 1);
        ls_takedir_close(take);
    }
    /* damage before the last record is no torn tail: resume refuses */
    text[last / 2] ^= 1;
    struct ls_store *store;
    struct ls_diag diag = {0};
    g_assert_true(g_file_set_contents(path, text, (gssize)n, NULL));
    g_assert_cmpint(ls_store_reopen(promises->folder, 0, 0, NULL, &store, &diag), ==,
                    LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "line "));
    munmap(promises, sizeof *promises);
    remove_tree(root);
    g_free(path);
    g_free(text);
    g_free(root);
}

/* What a killed writer leaves of conditions that are never shot again goes away as well. */
static void test_leftovers_are_removed(void)
{
    static const char *const left[] = {"cam0/gone.exr.tmp", "take.json.tmp", ".reserve"};
    char *root = new_root();
    struct promises *promises = new_promises();
    g_assert_cmpint(shoot(root, NULL, promises, NULL), ==, LS_OK);
    for (size_t k = 0; k < G_N_ELEMENTS(left); k++) {
        char *path = g_build_filename(promises->folder, left[k], NULL);
        g_assert_true(g_file_set_contents(path, "x", 1, NULL));
        g_free(path);
    }
    struct ls_store *store;
    g_assert_cmpint(ls_store_reopen(promises->folder, 0, 0, NULL, &store, NULL), ==, LS_OK);
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    for (size_t k = 0; k < G_N_ELEMENTS(left); k++) {
        char *path = g_build_filename(promises->folder, left[k], NULL);
        g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
        g_free(path);
    }
    munmap(promises, sizeof *promises);
    remove_tree(root);
    g_free(root);
}

/* ---- disk full ---- */

static void assert_refused_as_full(const char *root, uint64_t need, uint64_t spare)
{
    struct ls_store_config config = a_take(root);
    struct ls_store *store;
    struct ls_diag diag = {0};
    config.need_bytes = need;
    config.spare_bytes = spare;
    g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_ERR_FULL);
    g_test_message("%s", diag.text);
    g_assert_nonnull(strstr(diag.text, "MB free"));
    g_assert_nonnull(strstr(diag.text, "needs"));
    g_assert_cmpuint(count_files(root), ==, 0);
}

static void test_full_before_the_first_flash(void)
{
    char *root = new_root();
    assert_refused_as_full(root, (uint64_t)1 << 60, 0);
    assert_refused_as_full(root, 0, (uint64_t)1 << 60);
    remove_tree(root);
    g_free(root);
}

/* In a file system of 4 MB of its own: a second take finds the first one's reservation in place,
 * and other people's files cannot take what has been reserved. */
static int on_a_small_disk(const char *root)
{
    struct ls_store_config config = a_take(root);
    struct ls_store *store, *second;
    struct ls_diag diag = {0};
    config.need_bytes = 1 << 20;
    g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_OK);
    config.need_bytes = 2 << 20;
    g_assert_cmpint(ls_store_create(&config, &second, &diag), ==, LS_ERR_FULL);
    char *other = g_build_filename(root, "other", NULL), *junk = g_malloc0(8 << 20);
    g_assert_false(
        g_file_set_contents_full(other, junk, 8 << 20, G_FILE_SET_CONTENTS_NONE, 0600, NULL));
    FILE *file = fopen(other, "w");
    while (fwrite(junk, 1, 4096, file) == 4096 && !fflush(file))
        ;
    fclose(file);
    for (uint32_t k = 0; k < N_CONDITIONS; k++) {
        g_assert_cmpint(ticket(store, k, NULL), ==, LS_OK);
        g_assert_cmpint(publish(store, k, 0, NULL), ==, LS_OK);
    }
    g_assert_cmpint(ls_store_close(store, &diag), ==, LS_OK);
    return 0;
}

static void test_reservation_holds(void)
{
    char *root = new_root();
    int status;
    pid_t child = fork();
    if (!child) {
        if (unshare(CLONE_NEWNS) || mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) ||
            mount("tmpfs", root, "tmpfs", 0, "size=4m"))
            _exit(77);
        _exit(on_a_small_disk(root));
    }
    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 77)
        g_test_skip("may not mount a small file system");
    else
        g_assert_cmpint(status, ==, 0);
    remove_tree(root);
    g_free(root);
}

/* A limit on the size of files stands in for a full disk where nothing may be mounted. */
static void test_file_size_limit(void)
{
    char *root = new_root();
    int status;
    pid_t child = fork();
    if (!child) {
        struct rlimit limit = {100000, 100000};
        signal(SIGXFSZ, SIG_IGN);
        setrlimit(RLIMIT_FSIZE, &limit);
        assert_refused_as_full(root, 1 << 20, 0);
        _exit(0);
    }
    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    g_assert_cmpint(status, ==, 0);
    remove_tree(root);
    g_free(root);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/store/crash-at-any-operation-keeps-what-was-promised",
                    test_crash_at_every_operation);
    g_test_add_func("/store/kill-at-any-moment-keeps-what-was-promised", test_kill);
    g_test_add_func("/store/disk-errors-are-told-never-lost", test_errors_are_told);
    g_test_add_func("/store/nothing-is-vouched-for-that-power-could-take-away", test_order);
    g_test_add_func("/store/short-writes-are-continued", test_short_writes);
    g_test_add_func("/store/torn-journal-is-repaired-at-every-offset", test_torn_journal);
    g_test_add_func("/store/leftovers-of-a-killed-writer-are-removed", test_leftovers_are_removed);
    g_test_add_func("/store/full-disk-refuses-before-the-first-flash",
                    test_full_before_the_first_flash);
    g_test_add_func("/store/reservation-holds-against-others", test_reservation_holds);
    g_test_add_func("/store/file-size-limit-refuses-before-the-first-flash", test_file_size_limit);
    return g_test_run();
}

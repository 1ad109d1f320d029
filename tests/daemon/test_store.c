#include "tests/daemon/store_fixture.h"

#include <jansson.h>

static struct ls_store *create(const struct ls_store_config *config)
{
    struct ls_store *store;
    struct ls_diag diag = {0};
    enum ls_err err = ls_store_create(config, &store, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return store;
}

static void test_whole_take(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    config.n_cameras = 2;
    config.n_shots = 2 * N_CONDITIONS;
    struct ls_store *store = create(&config);
    g_assert_true(g_str_has_prefix(ls_store_id(store), "20240517T120000Z-still_life-1-"));
    g_assert_true(ls_takedir_id_ok(ls_store_id(store)));
    for (uint32_t k = 0; k < N_CONDITIONS; k++)
        for (uint32_t camera = 0; camera < 2; camera++) {
            g_assert_cmpint(ticket_of(store, 2, 2 * k + camera, NULL), ==, LS_OK);
            g_assert_cmpint(publish(store, k, camera, NULL), ==, LS_OK);
        }
    g_assert_cmpint(publish(store, 3, 1, NULL), ==, LS_ERR_EXISTS);
    g_assert_cmpint(ls_store_alarm(store, "dark drift 0.2 DN", NULL), ==, LS_OK);
    g_assert_cmpint(ls_store_flush(store, NULL), ==, LS_OK);
    struct ls_store_stats stats;
    ls_store_stats(store, &stats);
    g_assert_cmpuint(stats.tickets, ==, 2 * N_CONDITIONS);
    g_assert_cmpuint(stats.published, ==, 2 * N_CONDITIONS);
    g_assert_cmpuint(stats.queued, ==, 0);
    const char *missing[] = {"cam0/W-9999"};
    struct ls_store_end end = {.state = LS_STORE_INCOMPLETE,
                               .missing = missing,
                               .n_missing = 1,
                               .take_json = "{\"plan\": {\"x\": 2}, \"state\": \"mine\"}"};
    g_assert_cmpint(ls_store_set_state(store, &end, NULL), ==, LS_OK);
    char *folder = g_strdup(ls_store_folder(store));
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);

    struct ls_takedir *take = open_take(folder);
    g_assert_cmpint(take->state, ==, LS_STORE_INCOMPLETE);
    g_assert_cmpstr(take->name, ==, "still_life-1");
    g_assert_cmpuint(take->n_published, ==, 2 * N_CONDITIONS);
    g_assert_cmpuint(take->n_tickets, ==, 2 * N_CONDITIONS);
    g_assert_cmpstr(take->alarms[0], ==, "dark drift 0.2 DN");
    g_assert_cmpfloat(ls_takedir_ticket(take, 5)->exposure_used_us, ==, 1013.7);
    g_assert_null(ls_takedir_ticket(take, 2 * N_CONDITIONS));
    struct ls_take_report report;
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    g_assert_cmpuint(report.pictures_good, ==, report.pictures_planned);
    ls_take_report_finish(&report);

    json_t *json = json_loads(take->take_json, 0, NULL);
    int format, x;
    const char *state, *utc, *gone;
    g_assert_cmpint(json_unpack(json, "{s:i, s:s, s:s, s:{s:i}, s:[s]}", "format", &format, "state",
                                &state, "utc", &utc, "plan", "x", &x, "missing", &gone),
                    ==, 0);
    g_assert_cmpint(format, ==, LS_TAKE_FORMAT);
    g_assert_cmpstr(state, ==, "incomplete");
    g_assert_cmpstr(utc, ==, "2024-05-17T12:00:00Z");
    g_assert_cmpint(x, ==, 2);
    g_assert_cmpstr(gone, ==, "cam0/W-9999");
    json_decref(json);
    /* nothing but the contract's files: cam0, cam1, journal, take.json */
    g_assert_cmpuint(count_files(folder), ==, 4);
    ls_takedir_close(take);
    remove_tree(root);
    g_free(folder);
    g_free(root);
}

static void test_bad_names(void)
{
    static const char *const names[] = {"",
                                        "a b",
                                        "../x",
                                        "a/b",
                                        ".",
                                        "\xc3\xa4",
                                        "a.exr",
                                        ("01234567890123456789012345678901234567890123456789"
                                         "012345678901234")};
    static const char *const ids[] = {"",
                                      "..",
                                      "20240517T120000Z-a-00beeg",
                                      "20240517T120000Z-a",
                                      "20240517T120000Z--00beef",
                                      "2024051xT120000Z-a-00beef",
                                      "20240517T120000Z-a/-00beef",
                                      "20240517T120000Z-a-00BEEF"};
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    struct ls_store *store;
    for (size_t k = 0; k < G_N_ELEMENTS(names); k++) {
        struct ls_diag diag = {0};
        config.name = names[k];
        g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, "letters"));
    }
    for (size_t k = 0; k < G_N_ELEMENTS(ids); k++)
        g_assert_false(ls_takedir_id_ok(ids[k]));
    g_assert_true(ls_takedir_id_ok("20240517T120000Z-a-00beef"));
    config = a_take(root);
    config.take_json = "{\n\"a\": }";
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "line 2"));
    config = a_take("/nonexistent/folder");
    g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_ERR_NOT_FOUND);
    g_assert_cmpuint(count_files(root), ==, 0);
    remove_tree(root);
    g_free(root);
}

static void test_bad_pictures(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    struct ls_store *store = create(&config);
    uint16_t half[4] = {0};
    struct ls_store_picture ok = {"W-0001", 0, {2, 2, half, NULL, NULL, NULL}, {0}}, bad;
    g_assert_cmpint(ls_store_raw(store, 0, 0, 0, "raw", 3, NULL), ==, LS_ERR_STATE);
    bad = ok;
    bad.condition = "../W";
    g_assert_cmpint(ls_store_publish(store, &bad, NULL), ==, LS_ERR_INVALID);
    bad = ok;
    bad.camera = 1;
    g_assert_cmpint(ls_store_publish(store, &bad, NULL), ==, LS_ERR_INVALID);
    bad = ok;
    bad.mosaic.half = NULL;
    g_assert_cmpint(ls_store_publish(store, &bad, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_store_publish(store, &ok, NULL), ==, LS_OK);
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    remove_tree(root);
    g_free(root);
}

static void test_raw_is_kept(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    config.keep_raw = true;
    struct ls_store *store = create(&config);
    for (uint32_t k = 0; k < N_CONDITIONS; k++) {
        g_assert_cmpint(ls_store_raw(store, 0, k, 0, "raw", 3, NULL), ==, LS_OK);
        g_assert_cmpint(ticket(store, k, NULL), ==, LS_OK);
        g_assert_cmpint(publish(store, k, 0, NULL), ==, LS_OK);
    }
    char *folder = g_strdup(ls_store_folder(store));
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    struct ls_takedir *take = open_take(folder);
    struct ls_take_report report;
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    ls_take_report_finish(&report);
    char *raw = g_build_filename(folder, "cam0", "raw", "7-0.raw", NULL);
    g_assert_true(g_file_set_contents(raw, "rxw", 3, NULL));
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_nonnull(strstr(report.text, "raw frame of shot 7"));
    ls_take_report_finish(&report);
    ls_takedir_close(take);
    remove_tree(root);
    g_free(raw);
    g_free(folder);
    g_free(root);
}

static void flip_byte(const char *folder, const char *file, size_t from_end)
{
    char *path = g_build_filename(folder, file, NULL), *contents;
    gsize n;
    g_assert_true(g_file_get_contents(path, &contents, &n, NULL));
    contents[n - 1 - from_end] ^= 1;
    g_assert_true(g_file_set_contents(path, contents, (gssize)n, NULL));
    g_free(contents);
    g_free(path);
}

static void test_verify_finds_damage(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    struct ls_store *store = create(&config);
    for (uint32_t k = 0; k < N_CONDITIONS - 1; k++) {
        if (k != 4)
            g_assert_cmpint(ticket(store, k, NULL), ==, LS_OK);
        g_assert_cmpint(publish(store, k, 0, NULL), ==, LS_OK);
    }
    char *folder = g_strdup(ls_store_folder(store));
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    flip_byte(folder, "cam0/W-0000.exr", 10);
    flip_byte(folder, "cam0/W-0002.exr", 10); /* has a validity part, which lies at its end */
    flip_byte(folder, "cam0/dark-0.exr", 10);
    char *path = g_build_filename(folder, "cam0/W-0003.exr", NULL);
    g_assert_cmpint(g_unlink(path), ==, 0);
    struct ls_takedir *take = open_take(folder);
    struct ls_take_report report;
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_test_message("%s", report.text);
    g_assert_cmpuint(report.pictures_damaged, ==, 4);
    g_assert_cmpuint(report.pictures_missing, ==, 1);
    g_assert_cmpuint(report.pictures_good, ==, N_CONDITIONS - 5);
    g_assert_cmpuint(report.shots_ticketed, ==, N_CONDITIONS - 2);
    g_assert_nonnull(strstr(report.text, "2 of 12 shots have no ticket: 4, 11\n"));
    g_assert_nonnull(strstr(report.text, "cam0/sphere-B is missing"));
    g_assert_nonnull(strstr(report.text, "cam0/W-0000 is damaged"));
    ls_take_report_finish(&report);
    ls_takedir_close(take);
    remove_tree(root);
    g_free(path);
    g_free(folder);
    g_free(root);
}

static void test_repacking_keeps_checksums(void)
{
    char *tool = g_find_program_in_path("oiiotool");
    if (!tool)
        return g_test_skip("oiiotool is not installed");
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    struct ls_store *store = create(&config);
    g_assert_cmpint(publish(store, 1, 0, NULL), ==, LS_OK); /* without a validity part */
    char *file = g_build_filename(ls_store_folder(store), "cam0", "W-0000.exr", NULL);
    g_assert_cmpint(ls_store_flush(store, NULL), ==, LS_OK);
    char *command = g_strdup_printf("oiiotool %s --tile 0 0 --compression piz -o %s", file, file);
    int status;
    g_assert_true(g_spawn_command_line_sync(command, NULL, NULL, &status, NULL));
    g_assert_true(g_spawn_check_wait_status(status, NULL));
    struct ls_takedir *take = open_take(ls_store_folder(store));
    uint8_t *bytes;
    size_t n;
    g_assert_cmpint(ls_takedir_read(take, &take->published[0], &bytes, &n, NULL), ==, LS_OK);
    g_assert_cmpuint(n, !=, take->published[0].bytes);
    g_assert_cmpint(ls_published_check(&take->published[0], bytes, n, NULL), ==, LS_OK);
    free(bytes);
    ls_takedir_close(take);
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    remove_tree(root);
    g_free(command);
    g_free(file);
    g_free(root);
    g_free(tool);
}

static void test_lock(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    struct ls_store *store = create(&config), *second;
    struct ls_diag diag = {0};
    char *folder = g_strdup(ls_store_folder(store));
    g_assert_cmpint(ls_store_reopen(folder, 0, 0, NULL, &second, &diag), ==, LS_ERR_BUSY);
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    finish_take(folder);
    g_assert_cmpint(ls_store_reopen(folder, 0, 0, NULL, &second, &diag), ==, LS_ERR_STATE);
    g_assert_cmpint(ls_store_reopen("/nonexistent", 0, 0, NULL, &second, &diag), ==,
                    LS_ERR_NOT_FOUND);
    remove_tree(root);
    g_free(folder);
    g_free(root);
}

static void test_list(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    struct ls_take_summary *takes;
    size_t n;
    g_assert_cmpint(ls_takedir_list(root, &takes, &n, NULL), ==, LS_OK);
    g_assert_cmpuint(n, ==, 0);
    for (int k = 0; k < 3; k++) {
        config.utc_s += k == 2 ? -100 : 100;
        config.name = k == 1 ? "second" : "other";
        g_assert_cmpint(ls_store_close(create(&config), NULL), ==, LS_OK);
    }
    char *stray = g_build_filename(root, "20240517T120000Z-no-00beef", NULL);
    g_assert_cmpint(g_mkdir(stray, 0755), ==, 0);
    char *other = g_build_filename(root, "lost+found", NULL);
    g_assert_cmpint(g_mkdir(other, 0755), ==, 0);
    g_assert_cmpint(ls_takedir_list(root, &takes, &n, NULL), ==, LS_OK);
    g_assert_cmpuint(n, ==, 4);
    g_assert_cmpstr(takes[0].damage, !=, ""); /* no take.json */
    g_assert_cmpstr(takes[3].name, ==, "second");
    g_assert_cmpstr(takes[3].damage, ==, "");
    g_assert_cmpint(takes[3].state, ==, LS_STORE_OPEN);
    g_assert_cmpuint(takes[3].conditions_planned, ==, N_CONDITIONS);
    free(takes);
    remove_tree(root);
    g_free(stray);
    g_free(other);
    g_free(root);
}

/* ---- many threads, little room ---- */

struct worker {
    struct ls_store *store;
    uint32_t camera;
};

static gpointer work(gpointer user)
{
    struct worker *worker = user;
    for (uint32_t k = 0; k < N_CONDITIONS; k++) {
        g_assert_cmpint(ticket_of(worker->store, 4, 4 * k + worker->camera, NULL), ==, LS_OK);
        g_assert_cmpint(publish(worker->store, k, worker->camera, NULL), ==, LS_OK);
    }
    return NULL;
}

static void test_back_pressure(void)
{
    char *root = new_root();
    struct ls_store_config config = a_take(root);
    config.n_cameras = 4;
    config.n_shots = 4 * N_CONDITIONS;
    struct ls_store *store = create(&config);
    ls_store_limit_queue(store, 20000); /* one picture */
    struct worker workers[4];
    GThread *threads[4];
    gint64 begun = g_get_monotonic_time();
    for (uint32_t k = 0; k < 4; k++) {
        workers[k] = (struct worker){store, k};
        threads[k] = g_thread_new("worker", work, &workers[k]);
    }
    for (int k = 0; k < 4; k++)
        g_thread_join(threads[k]);
    g_assert_cmpint(ls_store_flush(store, NULL), ==, LS_OK);
    struct ls_store_stats stats;
    ls_store_stats(store, &stats);
    g_assert_cmpuint(stats.published, ==, 4 * N_CONDITIONS);
    /* one sync per 16 pictures or 50 ms, one more for each of start, flush and rounding */
    uint32_t most =
        4 * N_CONDITIONS / 16 + (uint32_t)((g_get_monotonic_time() - begun) / 50000) + 3;
    g_test_message("%u commits, at most %u", stats.commits, most);
    g_assert_cmpuint(stats.commits, <=, most);
    char *folder = g_strdup(ls_store_folder(store));
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    struct ls_takedir *take = open_take(folder);
    struct ls_take_report report;
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    ls_take_report_finish(&report);
    ls_takedir_close(take);
    remove_tree(root);
    g_free(folder);
    g_free(root);
}

/* When the journal is brought to the disk. */
struct journal_watch {
    GMutex lock;
    GCond sync;
    bool synced;
};

static int watch_journal(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    struct journal_watch *watch = user;
    if (op != LS_DISK_SYNC || strcmp(name, "journal"))
        return 0;
    g_mutex_lock(&watch->lock);
    watch->synced = true;
    g_cond_signal(&watch->sync);
    g_mutex_unlock(&watch->lock);
    return 0;
}

static void forget_syncs(struct journal_watch *watch)
{
    g_mutex_lock(&watch->lock);
    watch->synced = false;
    g_mutex_unlock(&watch->lock);
}

static void wait_for_sync(struct journal_watch *watch)
{
    gint64 until = g_get_monotonic_time() + 30 * G_TIME_SPAN_SECOND;
    g_mutex_lock(&watch->lock);
    while (!watch->synced)
        g_assert_true(g_cond_wait_until(&watch->sync, &watch->lock, until));
    g_mutex_unlock(&watch->lock);
}

/* Without a flush the records still come to the disk, by the 50 ms. */
static void test_records_do_not_wait_for_ever(void)
{
    char *root = new_root();
    struct journal_watch watch = {.synced = false};
    const struct ls_disk_shim shim = {.before = watch_journal, .user = &watch};
    struct ls_store_config config = a_take(root);
    config.shim = &shim;
    struct ls_store *store = create(&config);
    struct ls_store_stats stats = {0};
    forget_syncs(&watch); /* of the beginning */
    g_assert_cmpint(ticket(store, 0, NULL), ==, LS_OK);
    wait_for_sync(&watch);
    g_assert_cmpint(ls_store_flush(store, NULL), ==, LS_OK); /* ends when that sync has */
    ls_store_stats(store, &stats);
    g_assert_cmpuint(stats.tickets, ==, 1);
    g_assert_cmpuint(stats.commits, ==, 1); /* the flush found nothing to do */
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    remove_tree(root);
    g_free(root);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/store/whole-take-comes-back", test_whole_take);
    g_test_add_func("/store/names-with-paths-in-them-are-refused", test_bad_names);
    g_test_add_func("/store/bad-pictures-are-refused", test_bad_pictures);
    g_test_add_func("/store/raw-frames-are-kept-byte-for-byte", test_raw_is_kept);
    g_test_add_func("/store/verify-finds-damage-and-gaps", test_verify_finds_damage);
    g_test_add_func("/store/repacking-keeps-the-checksums", test_repacking_keeps_checksums);
    g_test_add_func("/store/one-writer-at-a-time", test_lock);
    g_test_add_func("/store/takes-are-listed-oldest-first", test_list);
    g_test_add_func("/store/four-threads-and-a-full-queue-lose-nothing", test_back_pressure);
    g_test_add_func("/store/records-become-durable-without-a-flush",
                    test_records_do_not_wait_for_ever);
    return g_test_run();
}

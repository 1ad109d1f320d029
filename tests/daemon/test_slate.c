/* slate: what is written down comes back, whole or not at all; nothing else gets in. */
#include "daemon/slate.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <string.h>

static char *new_folder(void)
{
    char *folder = g_dir_make_tmp("ls-slate-XXXXXX", NULL);
    g_assert_nonnull(folder);
    return folder;
}

static void remove_folder(char *folder)
{
    g_autofree char *file = g_build_filename(folder, "slate.json", NULL);
    g_unlink(file);
    g_assert_no_errno(g_rmdir(folder)); /* nothing else was left behind */
    g_free(folder);
}

static const struct ls_slate full = {.slate = "12A",
                                     .scene = "kitchen, \xc3\xa0 la nuit",
                                     .take = 3,
                                     .circled = true,
                                     .timecode = "10:11:12;13",
                                     .notes = "blinked\nlovely \"light\""};

/* All of it. */
static enum ls_err write_whole(const char *folder, const struct ls_slate *slate,
                               struct ls_diag *diag)
{
    struct ls_slate now = *slate;
    bool damaged = true;
    enum ls_err err = ls_slate_change(folder, LS_SLATE_ALL, &now, &damaged, diag);
    g_assert_false(damaged);
    return err;
}

static void test_round_trip(void)
{
    char *folder = new_folder();
    struct ls_slate back = full;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_slate_read(folder, &back, &diag), ==, LS_OK);
    g_assert_cmpstr(back.notes, ==, "");
    g_assert_cmpuint(back.take, ==, 0);
    for (int i = 0; i < 2; i++) { /* the second replaces */
        g_assert_cmpint(write_whole(folder, &full, &diag), ==, LS_OK);
        g_assert_cmpint(ls_slate_read(folder, &back, &diag), ==, LS_OK);
        g_assert_cmpstr(back.slate, ==, full.slate);
        g_assert_cmpstr(back.scene, ==, full.scene);
        g_assert_cmpuint(back.take, ==, full.take);
        g_assert_true(back.circled);
        g_assert_cmpstr(back.timecode, ==, full.timecode);
        g_assert_cmpstr(back.notes, ==, full.notes);
    }
    remove_folder(folder);
}

static void test_longest(void)
{
    char *folder = new_folder();
    struct ls_slate longest = full, back;
    memset(longest.notes, '"', sizeof longest.notes - 1); /* two bytes each in JSON */
    g_assert_cmpint(write_whole(folder, &longest, NULL), ==, LS_OK);
    g_assert_cmpint(ls_slate_read(folder, &back, NULL), ==, LS_OK);
    g_assert_cmpstr(back.notes, ==, longest.notes);
    remove_folder(folder);
}

static void test_refused(void)
{
    static const char *const timecodes[] = {"1:2:3:4",      "24:00:00:00", "10:60:00:00",
                                            "10:00:61:00",  "10:00:00.00", "10:00:00:0",
                                            "+1:00:00:000", "noon"};
    char *folder = new_folder();
    struct ls_slate bad = full;
    struct ls_diag diag = {0};
    for (size_t i = 0; i < G_N_ELEMENTS(timecodes); i++) {
        g_strlcpy(bad.timecode, timecodes[i], sizeof bad.timecode);
        g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, "HH:MM:SS:FF"));
    }
    bad = full;
    bad.take = LS_SLATE_MAX_TAKE + 1;
    g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_ERR_INVALID);
    bad = full;
    strcpy(bad.scene, "two\nlines");
    g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_ERR_INVALID);
    strcpy(bad.scene, "\xff");
    g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_ERR_INVALID);
    strcpy(bad.scene, "\x1b[2J");
    g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_ERR_INVALID);
    for (gunichar c = 0x7f; c < 0xa0; c++) { /* DEL and C1: U+009B is an escape of one character */
        bad = full;
        bad.notes[g_unichar_to_utf8(c, bad.notes)] = '\0';
        g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_ERR_INVALID);
    }
    bad = full;
    strcpy(bad.notes, "\xc2\xa0\xe2\x80\xa6"); /* U+00A0, the first that is none, and U+2026 */
    g_assert_cmpint(write_whole(folder, &bad, &diag), ==, LS_OK);
    g_assert_cmpint(write_whole("/nonexistent", &full, &diag), ==, LS_ERR_NOT_FOUND);
    remove_folder(folder);
}

static void test_damaged(void)
{
    static const char *const texts[] = {
        "",
        "{",
        "[]",
        "{\"format\": 1}",
        "{\"format\": 2, \"slate\": \"\", \"scene\": \"\", \"take\": 0, \"circled\": false, "
        "\"timecode\": \"\", \"notes\": \"\"}",
        "{\"format\": 1, \"slate\": \"\", \"scene\": \"\", \"take\": -1, \"circled\": false, "
        "\"timecode\": \"\", \"notes\": \"\"}",
        "{\"format\": 1, \"slate\": 7, \"scene\": \"\", \"take\": 0, \"circled\": false, "
        "\"timecode\": \"\", \"notes\": \"\"}"};
    char *folder = new_folder();
    g_autofree char *file = g_build_filename(folder, "slate.json", NULL);
    g_autofree char *aside = g_build_filename(folder, "slate.damaged.json", NULL);
    struct ls_slate back;
    struct ls_diag diag = {0};
    for (size_t i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_assert_true(g_file_set_contents(file, texts[i], -1, NULL));
        back = full;
        g_assert_cmpint(ls_slate_read(folder, &back, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, "written down next"));
        g_assert_cmpstr(back.slate, ==, "");
        back = full; /* and so is it mended */
        bool damaged = false;
        g_assert_cmpint(ls_slate_change(folder, LS_SLATE_NOTES, &back, &damaged, &diag), ==, LS_OK);
        g_assert_true(damaged);
        g_assert_cmpstr(back.notes, ==, full.notes);
        g_assert_cmpstr(back.slate, ==, "");
        g_autofree char *old = NULL;
        g_assert_true(g_file_get_contents(aside, &old, NULL, NULL));
        g_assert_cmpstr(old, ==, texts[i]);
        back = full;
        g_assert_cmpint(ls_slate_read(folder, &back, &diag), ==, LS_OK);
        g_assert_cmpstr(back.notes, ==, full.notes);
        g_assert_cmpuint(back.take, ==, 0);
    }
    g_assert_no_errno(g_unlink(aside));
    remove_folder(folder);
}

/* Each of the six changes one field of its own, and finds it after every change of the others. */
struct writer {
    const char *folder;
    unsigned field;
};

static void *write_often(void *data)
{
    const struct writer *w = data;
    for (uint32_t i = 1; i <= 20; i++) {
        struct ls_slate mine = full, back;
        bool damaged;
        mine.take = i;
        g_snprintf(mine.notes, sizeof mine.notes, "%u", i);
        g_assert_cmpint(ls_slate_change(w->folder, w->field, &mine, &damaged, NULL), ==, LS_OK);
        g_assert_false(damaged);
        g_assert_cmpint(ls_slate_read(w->folder, &back, NULL), ==, LS_OK);
        if (w->field == LS_SLATE_TAKE)
            g_assert_cmpuint(back.take, ==, i);
        if (w->field == LS_SLATE_NOTES)
            g_assert_cmpstr(back.notes, ==, mine.notes);
    }
    return NULL;
}

static void test_writers_of_other_fields(void)
{
    char *folder = new_folder();
    struct writer writers[6];
    GThread *threads[6];
    struct ls_slate back;
    for (unsigned i = 0; i < 6; i++) {
        writers[i] = (struct writer){folder, 1u << i};
        threads[i] = g_thread_new("writer", write_often, &writers[i]);
    }
    for (int i = 0; i < 6; i++)
        g_thread_join(threads[i]);
    g_assert_cmpint(ls_slate_read(folder, &back, NULL), ==, LS_OK);
    g_assert_cmpstr(back.slate, ==, full.slate);
    g_assert_cmpstr(back.scene, ==, full.scene);
    g_assert_cmpuint(back.take, ==, 20);
    g_assert_true(back.circled);
    g_assert_cmpstr(back.timecode, ==, full.timecode);
    g_assert_cmpstr(back.notes, ==, "20");
    remove_folder(folder);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/slate/what-is-written-comes-back", test_round_trip);
    g_test_add_func("/slate/the-longest-notes-fit", test_longest);
    g_test_add_func("/slate/what-no-slate-says-is-refused", test_refused);
    g_test_add_func("/slate/a-damaged-one-is-named-and-set-aside", test_damaged);
    g_test_add_func("/slate/writers-of-other-fields-lose-nothing", test_writers_of_other_fields);
    return g_test_run();
}

/* conf_text: what a client's libconfig text may hold, and that a refused one leaves nothing behind.
 */
#include "daemon/conf_text.h"

#include <glib.h>
#include <malloc.h>
#include <string.h>

static enum ls_err parse(const char *text, struct ls_diag *diag)
{
    config_t tree;
    config_init(&tree);
    enum ls_err err = ls_conf_text("plan", text, &tree, diag);
    config_destroy(&tree);
    return err;
}

static void strings_and_comments_of_every_form_are_read(void)
{
    static const char *const texts[] = {
        "",
        "a = \"b\";",
        "a : \"b\" \"c\"\n  \"d\";",
        "a = [\"b\", \"c\"]; d = ( \"e\", { f = \"g\"; } );",
        "a = \"b\", c = [\"d\"], e = ( ( 1, { f = 2, g = \"h\" } ), \"i\" )",
        "a = \"quoted \\\" and \\\\\"; b = \"\\\\\";",
        "# \"no end\na = /* \"neither */ \"b\"; // \"\n",
    };
    for (size_t i = 0; i < G_N_ELEMENTS(texts); i++) {
        struct ls_diag diag = {0};
        g_test_message("%s", texts[i]);
        g_assert_cmpint(parse(texts[i], &diag), ==, LS_OK);
        g_assert_cmpstr(diag.text, ==, "");
    }
}

static void strings_out_of_place_are_refused_with_their_line(void)
{
    static const struct {
        const char *text, *sentence;
    } cases[] = {
        {"a = \"b", "plan:1: the string has no end"},
        {"a = 1;\nb = \"c\\\";", "plan:2: the string has no end"},
        {"\"a\" = 1;", "plan:1: a string where no value is expected"},
        {"a = 1;\n\nb \"c\";", "plan:3: a string where no value is expected"},
        {"a = 1; \"b\";", "a string where no value is expected"},
        {"a = { \"b\" };", "a string where no value is expected"},
        {"a = \"b\" c \"d\";", "a string where no value is expected"},
        {"a = \"b\", \"c\";", "plan:1: a string where no value is expected"},
        {"a = ( { b = [1, 2], \"c\"; } );", "a string where no value is expected"},
        {"a = ;", "plan:1: syntax error"},
        {"@include \"x\"", "@include: expected the whole plan in one text"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct ls_diag diag = {0};
        g_test_message("%s", cases[i].text);
        g_assert_cmpint(parse(cases[i].text, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, cases[i].sentence));
    }
}

static void brackets_are_in_32_others_at_most(void)
{
    struct ls_diag diag = {0};
    char text[100] = "a = ";
    memset(text + 4, '(', 32);
    memset(text + 36, ')', 32);
    g_assert_cmpint(parse(text, &diag), ==, LS_OK);
    memset(text + 4, '(', 33);
    memset(text + 37, ')', 33);
    g_assert_cmpint(parse(text, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "plan:1: brackets in more than 32 others"));
}

/* Each text's string is 100 kB long: a hundred that are lost would be 10 MB. */
static void a_refused_text_leaves_nothing_behind(void)
{
    static const char *const forms[] = {"a = \"%s",         "a = 1; \"%s\";", "a = { \"%s\" };",
                                        "a = [1, \"%s\"];", "a = \"%s\" b",   "a = 1, \"%s\";"};
    g_autofree char *content = g_strnfill(100000, 'x');
    for (size_t i = 0; i < G_N_ELEMENTS(forms); i++) {
        g_auto(GStrv) halves = g_strsplit(forms[i], "%s", 2);
        g_autofree char *text = g_strconcat(halves[0], content, halves[1], NULL);
        g_assert_cmpint(parse(text, NULL), ==, LS_ERR_INVALID);
        struct mallinfo2 before = mallinfo2();
        for (int k = 0; k < 100; k++)
            g_assert_cmpint(parse(text, NULL), ==, LS_ERR_INVALID);
        struct mallinfo2 after = mallinfo2();
        g_test_message("%s: %zu bytes, then %zu", forms[i], before.uordblks + before.hblkhd,
                       after.uordblks + after.hblkhd);
        g_assert_cmpuint(after.uordblks + after.hblkhd, <,
                         before.uordblks + before.hblkhd + 100000);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/conf-text/strings-and-comments-of-every-form-are-read",
                    strings_and_comments_of_every_form_are_read);
    g_test_add_func("/conf-text/strings-out-of-place-are-refused-with-their-line",
                    strings_out_of_place_are_refused_with_their_line);
    g_test_add_func("/conf-text/brackets-are-in-32-others-at-most",
                    brackets_are_in_32_others_at_most);
    g_test_add_func("/conf-text/a-refused-text-leaves-nothing-behind",
                    a_refused_text_leaves_nothing_behind);
    return g_test_run();
}

/* crew: pieces of work by any number of threads, or as many as there are to be had. */
#include "daemon/crew.h"

#include <glib.h>
#include <pthread.h>

struct pieces {
    struct ls_job asker;
    int done; /* atomic */
};

static enum ls_err cancel_at_the_third(void *user, uint32_t item, unsigned thread,
                                       struct ls_diag *diag)
{
    struct pieces *pieces = user;
    g_atomic_int_inc(&pieces->done);
    if (item == 2)
        ls_job_cancel(&pieces->asker);
    return LS_OK;
}

static void a_cancelled_asker_ends_the_work_between_two_pieces(void)
{
    for (unsigned n = 1; n <= 4; n++) {
        struct pieces pieces = {0};
        const struct ls_crew crew = {n, &pieces.asker};
        g_assert_cmpint(ls_crew_run(&crew, 100000, cancel_at_the_third, &pieces, NULL), ==,
                        LS_ERR_ABORTED);
        g_assert_cmpint(pieces.done, <, 100000);
        if (n == 1)
            g_assert_cmpint(pieces.done, ==, 3);
    }
}

static enum ls_err fail_from_the_fifth(void *user, uint32_t item, unsigned thread,
                                       struct ls_diag *diag)
{
    return item < 5 ? LS_OK : ls_fail(diag, LS_ERR_FULL, "piece %u", item);
}

static void the_first_piece_that_fails_is_the_one_told_of(void)
{
    for (unsigned n = 1; n <= 4; n++) {
        const struct ls_crew crew = {n, NULL};
        struct ls_diag diag = {0};
        g_assert_cmpint(ls_crew_run(&crew, 1000, fail_from_the_fifth, NULL, &diag), ==,
                        LS_ERR_FULL);
        g_assert_cmpstr(diag.text, ==, "piece 5");
    }
}

static enum ls_err count(void *user, uint32_t item, unsigned thread, struct ls_diag *diag)
{
    struct pieces *pieces = user;
    g_assert_cmpuint(thread, ==, 0);
    g_atomic_int_inc(&pieces->done);
    return LS_OK;
}

/* No thread can have a stack larger than the addresses there are. */
static void without_threads_the_caller_does_all_the_work(void)
{
    const struct ls_crew crew = {4, NULL};
    struct pieces pieces = {0};
    pthread_attr_t usual, giant;
    g_assert_cmpint(pthread_getattr_default_np(&usual), ==, 0);
    g_assert_cmpint(pthread_attr_init(&giant), ==, 0);
    g_assert_cmpint(pthread_attr_setstacksize(&giant, (size_t)1 << 50), ==, 0);
    g_assert_cmpint(pthread_setattr_default_np(&giant), ==, 0);
    enum ls_err err = ls_crew_run(&crew, 1000, count, &pieces, NULL);
    g_assert_cmpint(pthread_setattr_default_np(&usual), ==, 0);
    pthread_attr_destroy(&giant);
    pthread_attr_destroy(&usual);
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpint(pieces.done, ==, 1000);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/crew/a-cancelled-asker-ends-the-work-between-two-pieces",
                    a_cancelled_asker_ends_the_work_between_two_pieces);
    g_test_add_func("/crew/the-first-piece-that-fails-is-the-one-told-of",
                    the_first_piece_that_fails_is_the_one_told_of);
    g_test_add_func("/crew/without-threads-the-caller-does-all-the-work",
                    without_threads_the_caller_does_all_the_work);
    return g_test_run();
}

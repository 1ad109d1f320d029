/* liblightstage: requests in flight, how they end, and what a caller passes. */
#include "tests/clients/library_fixture.h"

#include <poll.h>
#include <signal.h>
#include <string.h>

struct counted {
    uint32_t calls, rows, stop_at;
};

static int count_band(const struct lightstage_band *band, void *user)
{
    struct counted *counted = user;
    counted->rows += band->n_rows;
    g_assert_true(!band->report == (band->first_row > 0));
    if (band->report)
        g_assert_cmpstr(band->report->channel, ==, "W");
    return ++counted->calls == counted->stop_at;
}

static int count_relit(const struct lightstage_relit *rows, void *user)
{
    struct counted *counted = user;
    counted->rows += rows->n_rows;
    counted->calls += rows->n_rows == 0 && rows->lights_used == TAKE_LIGHTS &&
                      rows->n_spectra == 1 && !strcmp(rows->spectra[0]->channel, "W") &&
                      rows->spectra[0]->model == LIGHTSTAGE_MEASURED;
    return 0;
}

static void many_requests_are_in_flight_from_one_thread(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_fetch fetch = stored(take);
    struct counted counted[4] = {0}, relit = {0};
    uint32_t request[5];
    float weights[2 * TAKE_LIGHTS];
    static const char *const channels[] = {"W"};
    struct lightstage_relight relight = {.size = sizeof relight,
                                         .take = take->id,
                                         .channels = channels,
                                         .n_channels = 1,
                                         .n_lights = TAKE_LIGHTS,
                                         .weights = weights,
                                         .n_pictures = 2};
    for (size_t i = 0; i < G_N_ELEMENTS(weights); i++)
        weights[i] = 1;
    for (size_t i = 0; i < 4; i++)
        g_assert_cmpuint(
            lightstage_fetch_begin(client, &fetch, count_band, &counted[i], &request[i], NULL), ==,
            0);
    g_assert_cmpuint(
        lightstage_relight_begin(client, &relight, count_relit, &relit, &request[4], NULL), ==, 0);
    g_assert_cmpuint(lightstage_in_flight(client), ==, 5);
    while (relit.calls == 0 || counted[3].rows < TAKE_LIGHTS * TAKE_H) {
        struct pollfd wait = {.fd = lightstage_descriptor(client), .events = POLLIN};
        g_assert_cmpint(poll(&wait, 1, 5000), ==, 1); /* ms; they take some 10 */
        g_assert_cmpuint(lightstage_dispatch(client, NULL), ==, 0);
    }
    for (size_t i = 0; i < 5; i++)
        g_assert_cmpuint(lightstage_wait(client, request[i], NULL), ==, 0);
    for (size_t i = 0; i < 4; i++)
        g_assert_cmpuint(counted[i].rows, ==, TAKE_LIGHTS * TAKE_H);
    g_assert_cmpuint(relit.rows, ==, 2 * TAKE_H);
    g_assert_cmpuint(lightstage_in_flight(client), ==, 0);
    lightstage_close(client);
    made_take_free(take);
}

/* What was read with the end of one request is of another: polling would not tell. */
static void waiting_for_one_leaves_nothing_unread_of_others(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    const uint32_t light = 0;
    struct lightstage_fetch fetch = stored(take);
    fetch.lights = &light;
    fetch.n_lights = 1;
    fetch.region = (struct lightstage_region){0, 0, 2, 2};
    for (int i = 0; i < 200; i++) { /* both arrive at once often enough */
        struct counted counted = {0};
        uint32_t one = 0, other = 0;
        lightstage_fetch_begin(client, &fetch, count_band, &counted, &one, NULL);
        lightstage_fetch_begin(client, &fetch, count_band, &counted, &other, NULL);
        g_assert_cmpuint(lightstage_wait(client, one, NULL), ==, 0);
        while (!lightstage_has_ended(client, other)) {
            struct pollfd wait = {.fd = lightstage_descriptor(client), .events = POLLIN};
            g_assert_cmpint(poll(&wait, 1, 5000), ==, 1);
            g_assert_cmpuint(lightstage_dispatch(client, NULL), ==, 0);
        }
        g_assert_cmpuint(lightstage_wait(client, other, NULL), ==, 0);
        g_assert_cmpuint(counted.rows, ==, 4);
        g_assert_true(lightstage_has_ended(client, other));
    }
    lightstage_close(client);
    made_take_free(take);
}

static void a_callback_and_a_call_cancel(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_fetch fetch = stored(take);
    struct lightstage_error error = {0};
    struct counted counted = {.stop_at = 1}, other = {0};
    uint32_t request = 0;
    g_assert_cmpuint(lightstage_fetch(client, &fetch, count_band, &counted, &error), ==,
                     LIGHTSTAGE_CANCELLED);
    g_assert_cmpuint(counted.calls, ==, 1);
    g_assert_cmpuint(lightstage_fetch_begin(client, &fetch, count_band, &other, &request, NULL), ==,
                     0);
    g_assert_cmpuint(lightstage_cancel(client, request, &error), ==, 0);
    g_assert_cmpuint(lightstage_wait(client, request, &error), ==, LIGHTSTAGE_CANCELLED);
    g_assert_cmpuint(other.calls, ==, 0);
    g_assert_cmpuint(lightstage_cancel(client, request, &error), ==, LIGHTSTAGE_BAD_ARGUMENT);
    g_assert_cmpuint(lightstage_blank(client, &error), ==, 0);
    lightstage_close(client);
    made_take_free(take);
}

/* One picture's worth of credit at a time. */
static void who_has_no_credit_waits(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_fetch fetch = stored(take);
    struct lightstage_status *status = NULL;
    struct counted counted = {0};
    uint32_t request = 0;
    fetch.credit_bytes = 1; /* the first band goes beyond it */
    g_assert_cmpuint(lightstage_fetch(client, &fetch, count_band, &counted, NULL), ==,
                     LIGHTSTAGE_BAD_ARGUMENT);
    g_assert_cmpuint(lightstage_fetch_begin(client, &fetch, count_band, &counted, &request, NULL),
                     ==, 0);
    while (!counted.calls)
        g_assert_cmpuint(lightstage_dispatch(client, NULL), ==, 0);
    for (int i = 0; i < 3; i++) { /* whatever was on its way has come */
        g_assert_cmpuint(lightstage_status(client, &status, NULL), ==, 0);
        lightstage_status_free(status);
    }
    g_assert_cmpuint(counted.calls, ==, 1);
    g_assert_cmpuint(lightstage_credit(client, request, 1 << 30, NULL), ==, 0);
    g_assert_cmpuint(lightstage_wait(client, request, NULL), ==, 0);
    g_assert_cmpuint(counted.rows, ==, TAKE_LIGHTS * TAKE_H);
    lightstage_close(client);
    made_take_free(take);
}

static void errors_are_the_daemons_number_and_sentence(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage), *none = NULL;
    struct lightstage_error error = {0};
    struct lightstage_address nowhere = {.size = sizeof nowhere, .where = "/nowhere/socket"};
    char *text = NULL;
    g_assert_cmpuint(lightstage_take_show(client, "20260101T000000Z-none-000000", &text, &error),
                     ==, 202);
    g_assert_cmpuint(error.number, ==, 202);
    g_assert_cmpstr(error.text, !=, "");
    g_assert_cmpuint(lightstage_connect(&nowhere, &none, &error), ==, LIGHTSTAGE_UNREACHABLE);
    nowhere.size = 0;
    g_assert_cmpuint(lightstage_connect(&nowhere, &none, &error), ==, LIGHTSTAGE_BAD_ARGUMENT);
    g_assert_null(none);
    lightstage_close(client);
}

/* What the caller's header knows may be more or less than what the library does. */
static void structs_of_older_and_newer_headers_are_taken(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_error error = {0};
    struct counted counted = {0};
    struct {
        struct lightstage_fetch fetch;
        uint64_t newer;
    } grown = {.fetch = stored(take)};
    grown.fetch.size = sizeof grown;
    g_assert_cmpuint(lightstage_fetch(client, &grown.fetch, count_band, &counted, &error), ==, 0);
    grown.newer = 1;
    g_assert_cmpuint(lightstage_fetch(client, &grown.fetch, count_band, &counted, &error), ==,
                     LIGHTSTAGE_UNSUPPORTED);
    grown.fetch.size = offsetof(struct lightstage_fetch, level);
    grown.fetch.level = 7; /* behind the size: not read */
    g_assert_cmpuint(lightstage_fetch(client, &grown.fetch, count_band, &counted, &error), ==, 0);
    g_assert_cmpuint(counted.rows, ==, 2 * TAKE_LIGHTS * TAKE_H);
    lightstage_close(client);
    made_take_free(take);
}

static void a_lost_connection_ends_all_that_is_in_flight(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage);
    struct lightstage_fetch fetch = {.size = sizeof fetch, .take = "none", .channel = "W"};
    struct lightstage_error error = {0};
    struct counted counted = {0};
    uint32_t request = 0;
    end_stage(stage, data);
    g_assert_cmpuint(lightstage_fetch_begin(client, &fetch, count_band, &counted, &request, NULL),
                     ==, 0);
    uint32_t number = lightstage_wait(client, request, &error);
    g_assert_true(number == LIGHTSTAGE_LOST || number == 207); /* it may say that it closes */
    g_assert_cmpuint(lightstage_dispatch(client, &error), ==, LIGHTSTAGE_LOST);
    g_assert_cmpuint(lightstage_blank(client, &error), ==, LIGHTSTAGE_LOST);
    lightstage_close(client);
}

static volatile sig_atomic_t interrupts;

static void count_interrupt(int signal_number)
{
    interrupts++;
}

static void a_signal_that_is_blocked_stays_so(struct stage *stage, gconstpointer data)
{
    struct sigaction action = {.sa_handler = count_interrupt}, before;
    struct lightstage_status *status = NULL;
    sigset_t block, mask, pending;
    g_assert_no_errno(sigaction(SIGINT, &action, &before));
    sigemptyset(&block);
    sigaddset(&block, SIGINT);
    pthread_sigmask(SIG_BLOCK, &block, &mask);
    g_assert_cmpint(raise(SIGINT), ==, 0);
    struct lightstage *client = connected(stage);
    g_assert_cmpuint(lightstage_status(client, &status, NULL), ==, 0);
    g_assert_cmpint(interrupts, ==, 0);
    sigpending(&pending);
    g_assert_true(sigismember(&pending, SIGINT));
    pthread_sigmask(SIG_SETMASK, &mask, NULL);
    g_assert_cmpint(interrupts, ==, 1);
    g_assert_no_errno(sigaction(SIGINT, &before, NULL));
    lightstage_status_free(status);
    lightstage_close(client);
}

static void numbers_have_words(void)
{
    enum lightstage_model model = LIGHTSTAGE_MEASURED;
    enum lightstage_reference reference = LIGHTSTAGE_STRENGTHS;
    g_assert_true(lightstage_model_by_name("linear", &model));
    g_assert_cmpint(model, ==, LIGHTSTAGE_LINEAR);
    g_assert_false(lightstage_model_by_name("magic", &model));
    g_assert_true(lightstage_reference_by_name("paper", &reference));
    g_assert_cmpint(reference, ==, LIGHTSTAGE_PAPER);
    g_assert_cmpstr(lightstage_model_name(LIGHTSTAGE_SEPARATED), ==, "separated");
    g_assert_null(lightstage_model_name((enum lightstage_model)99));
    g_assert_cmpstr(lightstage_reference_name(LIGHTSTAGE_STRENGTHS), ==, "strengths");
    g_assert_cmpstr(lightstage_error_name(201), ==, "busy");
    g_assert_cmpstr(lightstage_error_name(LIGHTSTAGE_LOST), ==, "connection lost");
    g_assert_cmpstr(lightstage_error_name(0), ==, "error");
}

static void nothing(struct stage *stage, gconstpointer data)
{
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("many-requests-are-in-flight-from-one-thread",
                many_requests_are_in_flight_from_one_thread);
    ADD_LIBRARY("waiting-for-one-leaves-nothing-unread-of-others",
                waiting_for_one_leaves_nothing_unread_of_others);
    ADD_LIBRARY("a-callback-and-a-call-cancel", a_callback_and_a_call_cancel);
    ADD_LIBRARY("who-has-no-credit-waits", who_has_no_credit_waits);
    ADD_LIBRARY("errors-are-the-daemons-number-and-sentence",
                errors_are_the_daemons_number_and_sentence);
    ADD_LIBRARY("structs-of-older-and-newer-headers-are-taken",
                structs_of_older_and_newer_headers_are_taken);
    g_test_add("/liblightstage/a-lost-connection-ends-all-that-is-in-flight", struct stage, NULL,
               with_stage, a_lost_connection_ends_all_that_is_in_flight, nothing);
    ADD_LIBRARY("a-signal-that-is-blocked-stays-so", a_signal_that_is_blocked_stays_so);
    g_test_add_func("/liblightstage/numbers-have-words", numbers_have_words);
    return g_test_run();
}

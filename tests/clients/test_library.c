/* liblightstage, the shared one, and a daemon with made takes. */
#include "clients/lightstage.h"
#include "tests/clients/ctl_fixture.h"
#include "tests/daemon/take_fixture.h"

#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct lightstage *connected(const struct stage *stage)
{
    struct lightstage_address address = {.size = sizeof address, .where = stage->socket_path};
    struct lightstage *client = NULL;
    struct lightstage_error error = {0};
    lightstage_connect(&address, &client, &error);
    g_assert_cmpstr(error.text, ==, "");
    g_assert_nonnull(client);
    return client;
}

static struct lightstage_fetch stored(const struct made_take *take)
{
    return (struct lightstage_fetch){.size = sizeof(struct lightstage_fetch),
                                     .take = take->id,
                                     .channel = "W",
                                     .quantity = LIGHTSTAGE_ESTIMATE};
}

static void pictures_come_into_a_buffer_as_they_are_stored(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_fetch fetch = stored(take);
    struct lightstage_shape shape = {0};
    struct lightstage_error error = {0};
    float *pixels = g_new(float, TAKE_LIGHTS *TAKE_PIXELS);
    size_t bytes = sizeof(float) * TAKE_LIGHTS * TAKE_PIXELS;
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, pixels, bytes, &shape, &error), ==, 0);
    g_assert_cmpuint(shape.pictures, ==, TAKE_LIGHTS);
    g_assert_cmpuint(shape.height, ==, TAKE_H);
    g_assert_cmpuint(shape.width, ==, TAKE_W);
    g_assert_cmpuint(shape.components, ==, 1);
    for (size_t i = 0; i < TAKE_LIGHTS; i++)
        g_assert_cmpmem(pixels + i * TAKE_PIXELS, bytes / TAKE_LIGHTS, take->light[i],
                        bytes / TAKE_LIGHTS);
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, pixels, bytes - 1, &shape, &error), ==,
                     LIGHTSTAGE_OVER_LIMIT);
    g_assert_nonnull(strstr(error.text, "150 x 140"));
    /* the connection is as good as before */
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, pixels, bytes, &shape, &error), ==, 0);
    g_assert_cmpuint(lightstage_in_flight(client), ==, 0);
    lightstage_close(client);
    g_free(pixels);
    made_take_free(take);
}

struct counted {
    uint32_t calls, rows, stop_at;
};

static int count_band(const struct lightstage_band *band, void *user)
{
    struct counted *counted = user;
    counted->rows += band->n_rows;
    return ++counted->calls == counted->stop_at;
}

static int count_relit(const struct lightstage_relit *rows, void *user)
{
    struct counted *counted = user;
    counted->rows += rows->n_rows;
    counted->calls += rows->n_rows == 0 && rows->lights_used == TAKE_LIGHTS;
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

static int keep_state(const struct lightstage_take_status *status, void *user)
{
    *(enum lightstage_take_state *)user = status->state;
    return 0;
}

static int stop_at_once(const struct lightstage_take_status *status, void *user)
{
    return 1;
}

static void a_take_is_started_followed_and_told(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage);
    struct lightstage_error error = {0};
    struct lightstage_status *status = NULL;
    enum lightstage_take_state state = LIGHTSTAGE_TAKE_NONE;
    g_assert_cmpuint(
        lightstage_take_start(client, "face", "token-1", "subject = \"still\";", &error), ==, 0);
    g_assert_cmpuint(lightstage_status(client, &status, &error), ==, 0);
    g_assert_nonnull(status->take);
    g_assert_cmpint(status->take->state, ==, LIGHTSTAGE_TAKE_PREPARING);
    g_assert_cmpstr(status->take->token, ==, "token-1");
    lightstage_status_free(status);
    g_assert_cmpuint(lightstage_take_progress(client, "token-1", stop_at_once, NULL, &error), ==,
                     LIGHTSTAGE_CANCELLED);
    take_ends(stage, LS_TAKE_COMPLETE);
    g_assert_cmpuint(lightstage_take_progress(client, "token-1", keep_state, &state, &error), ==,
                     0);
    g_assert_cmpint(state, ==, LIGHTSTAGE_TAKE_COMPLETE);
    lightstage_close(client);
}

static void the_rig_and_a_plans_cost_are_told(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage);
    struct lightstage_rig *rig = NULL;
    struct lightstage_preflight *cost = NULL;
    g_assert_cmpuint(lightstage_rig(client, &rig, NULL), ==, 0);
    g_assert_cmpstr(rig->name, ==, "test rig");
    g_assert_cmpuint(rig->n_lights, ==, 2);
    g_assert_cmpfloat(rig->positions_m[1], ==, 1);
    g_assert_cmpfloat(rig->positions_m[5], ==, 1.5f);
    g_assert_cmpuint(rig->n_channels, ==, 2);
    g_assert_cmpstr(rig->channels[1]->name, ==, "R");
    g_assert_cmpuint(rig->n_cameras, ==, 1);
    g_assert_cmpstr(rig->cameras[0]->name, ==, "front");
    g_assert_cmpfloat(rig->cameras[0]->focal_length_mm, ==, 50);
    g_assert_cmpuint(lightstage_preflight(client, "subject", &cost, NULL), ==, 0);
    g_assert_cmpuint(cost->shots, ==, strlen("subject")); /* the fixture's */
    g_assert_cmpfloat(cost->seconds, ==, 12.5);
    lightstage_close(client);
    g_assert_cmpstr(rig->channels[0]->name, ==, "W"); /* it outlives the client */
    g_assert_cmpstr(cost->warnings, ==, "");
    lightstage_rig_free(rig);
    lightstage_preflight_free(cost);
}

struct listed {
    uint32_t n;
    char id[64];
};

static int keep_id(const struct lightstage_take_summary *take, void *user)
{
    struct listed *listed = user;
    g_assert_cmpstr(take->problem, ==, "");
    g_assert_cmpuint(take->conditions_planned, >=, TAKE_LIGHTS);
    g_strlcpy(listed->id, take->id, sizeof listed->id);
    return ++listed->n == 2;
}

static void takes_on_disk_are_listed_and_verified(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, 3);
    struct lightstage *client = connected(stage);
    struct listed listed = {0};
    struct lightstage_verified *verified = NULL;
    struct lightstage_error error;
    g_assert_cmpuint(lightstage_take_list(client, keep_id, &listed, NULL), ==, 0);
    g_assert_cmpuint(listed.n, ==, 1);
    g_assert_cmpstr(listed.id, ==, take->id);
    listed.n = 1; /* the callback stops at 2 */
    g_assert_cmpuint(lightstage_take_list(client, keep_id, &listed, NULL), ==,
                     LIGHTSTAGE_CANCELLED);
    g_assert_cmpuint(lightstage_take_verify(client, take->id, &verified, NULL), ==, 0);
    g_assert_cmpuint(verified->conditions_missing, ==, 1);
    g_assert_cmpuint(verified->n_findings, >, 0);
    g_assert_cmpstr(verified->findings[0], !=, "");
    lightstage_verified_free(verified);
    g_assert_cmpuint(lightstage_take_verify(client, "none", &verified, &error), !=, 0);
    g_assert_cmpstr(error.text, !=, "");
    lightstage_close(client);
    made_take_free(take);
}

static void a_slate_is_written_field_by_field(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_slate write = {.size = sizeof write, .slate = "12A", .scene = "other"}, *is;
    g_assert_cmpuint(lightstage_take_slate(client, take->id, &is, NULL), ==, 0);
    g_assert_cmpstr(is->slate, ==, "");
    lightstage_slate_free(is);
    write.take = 4;
    write.circled = 1;
    write.timecode = "10:00:00:12";
    g_assert_cmpuint(lightstage_take_slate_write(client, take->id, &write,
                                                 LIGHTSTAGE_SLATE | LIGHTSTAGE_SLATE_TAKE |
                                                     LIGHTSTAGE_SLATE_CIRCLED,
                                                 &is, NULL),
                     ==, 0);
    lightstage_slate_free(is);
    write.slate = NULL;
    write.take = 0;
    write.notes = "soft";
    g_assert_cmpuint(lightstage_take_slate_write(client, take->id, &write,
                                                 LIGHTSTAGE_SLATE_TIMECODE | LIGHTSTAGE_SLATE_NOTES,
                                                 &is, NULL),
                     ==, 0);
    lightstage_slate_free(is);
    g_assert_cmpuint(lightstage_take_slate_write(client, take->id, &write, 0, &is, NULL), ==,
                     LIGHTSTAGE_BAD_ARGUMENT);
    g_assert_cmpuint(lightstage_take_slate(client, take->id, &is, NULL), ==, 0);
    g_assert_cmpstr(is->slate, ==, "12A");
    g_assert_cmpstr(is->scene, ==, "");
    g_assert_cmpuint(is->take, ==, 4);
    g_assert_cmpint(is->circled, ==, 1);
    g_assert_cmpstr(is->timecode, ==, "10:00:00:12");
    g_assert_cmpstr(is->notes, ==, "soft");
    g_assert_cmpint(is->damaged, ==, 0);
    lightstage_slate_free(is);
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

static void the_example_prints_a_pictures_mean(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    char *words[] = {(char *)g_getenv("LIGHTSTAGE_EXAMPLE"), stage->socket_path, take->id,
                     (char *)"W", NULL};
    char *out = NULL;
    int status = -1;
    g_assert_true(
        g_spawn_sync(NULL, words, NULL, G_SPAWN_DEFAULT, NULL, NULL, &out, NULL, &status, NULL));
    g_assert_cmpint(status, ==, 0);
    double mean = 0;
    g_assert_cmpint(sscanf(out, "150 x 140 x 3, mean %lf", &mean), ==, 1);
    g_assert_cmpfloat(mean, >, 0);
    g_free(out);
    made_take_free(take);
}

static void nothing(struct stage *stage, gconstpointer data)
{
}

#define ADD_LIBRARY(name, function) \
    g_test_add("/liblightstage/" name, struct stage, NULL, with_stage, function, end_stage)

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("pictures-come-into-a-buffer-as-they-are-stored",
                pictures_come_into_a_buffer_as_they_are_stored);
    ADD_LIBRARY("many-requests-are-in-flight-from-one-thread",
                many_requests_are_in_flight_from_one_thread);
    ADD_LIBRARY("a-callback-and-a-call-cancel", a_callback_and_a_call_cancel);
    ADD_LIBRARY("errors-are-the-daemons-number-and-sentence",
                errors_are_the_daemons_number_and_sentence);
    ADD_LIBRARY("structs-of-older-and-newer-headers-are-taken",
                structs_of_older_and_newer_headers_are_taken);
    ADD_LIBRARY("a-take-is-started-followed-and-told", a_take_is_started_followed_and_told);
    ADD_LIBRARY("the-rig-and-a-plans-cost-are-told", the_rig_and_a_plans_cost_are_told);
    ADD_LIBRARY("takes-on-disk-are-listed-and-verified", takes_on_disk_are_listed_and_verified);
    ADD_LIBRARY("a-slate-is-written-field-by-field", a_slate_is_written_field_by_field);
    ADD_LIBRARY("a-signal-that-is-blocked-stays-so", a_signal_that_is_blocked_stays_so);
    ADD_LIBRARY("the-example-prints-a-pictures-mean", the_example_prints_a_pictures_mean);
    g_test_add("/liblightstage/a-lost-connection-ends-all-that-is-in-flight", struct stage, NULL,
               with_stage, a_lost_connection_ends_all_that_is_in_flight, nothing);
    return g_test_run();
}

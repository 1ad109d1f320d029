/* liblightstage, the shared one, and a daemon with made takes. */
#include "clients/lightstage.h"
#include "core/pixel.h"
#include "daemon/preview.h"
#include "tests/clients/ctl_fixture.h"
#include "tests/daemon/take_fixture.h"

#include <math.h>
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
    g_assert_true(!status->repaired == (status->state < LIGHTSTAGE_TAKE_COMPLETE));
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
    struct lightstage_started *started[2] = {NULL};
    for (int i = 0; i < 2; i++)
        g_assert_cmpuint(lightstage_take_start(client, "face", "token-1", "subject = \"still\";",
                                               &started[i], &error),
                         ==, 0);
    g_assert_false(started[0]->already);
    g_assert_true(started[1]->already);
    g_assert_cmpstr(started[1]->take->token, ==, "token-1");
    lightstage_started_free(started[0]);
    lightstage_started_free(started[1]);
    g_assert_cmpuint(lightstage_status(client, &status, &error), ==, 0);
    g_assert_nonnull(status->take);
    g_assert_cmpint(status->take->state, ==, LIGHTSTAGE_TAKE_PREPARING);
    g_assert_cmpstr(status->take->token, ==, "token-1");
    g_assert_null(status->take->repaired);
    g_assert_cmpuint(status->connections, ==, 1);
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

static void a_daemon_says_what_it_does_and_who_one_is(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage);
    g_assert_cmpint(lightstage_role(client), ==, LIGHTSTAGE_OPERATOR);
    g_assert_true(lightstage_can(client, "tiles"));
    g_assert_true(lightstage_can(client, "events"));
    g_assert_false(lightstage_can(client, "tile"));
    g_assert_false(lightstage_can(client, ""));
    lightstage_close(client);
}

static void what_was_counted_is_told(struct stage *stage, gconstpointer data)
{
    struct ls_camera_metrics *camera = &fake_engine_metrics(stage->engine)->cameras[0];
    struct lightstage *client = connected(stage);
    struct lightstage_metrics *metrics = NULL;
    camera->frames_bound = 99;
    camera->frames_discarded[LS_BIND_STALE] = 3;
    for (int i = 0; i < 7; i++)
        ls_histogram_add(&camera->latencies[LS_LATENCY_FRAME], 1 << 20);
    g_assert_cmpuint(lightstage_metrics(client, &metrics, NULL), ==, 0);
    lightstage_close(client);
    g_assert_cmpuint(metrics->n_cameras, ==, 1);
    g_assert_cmpuint(metrics->connections, ==, 1);
    const struct lightstage_camera_metrics *told = metrics->cameras[0];
    g_assert_cmpstr(told->name, ==, "front");
    g_assert_cmpuint(told->frames_bound, ==, 99);
    uint64_t late = 0, others = 0;
    for (size_t i = 0; i < told->n_frames_discarded; i++)
        *(strcmp(told->frames_discarded[i]->reason, "late") ? &others : &late) +=
            told->frames_discarded[i]->count;
    g_assert_cmpuint(late, ==, 3);
    g_assert_cmpuint(others, ==, 0);
    g_assert_cmpstr(told->latencies[0]->part, ==, "frame");
    g_assert_cmpuint(told->latencies[0]->count, ==, 7);
    g_assert_cmpuint(told->latencies[0]->below[2], ==, 0); /* 2^20 ns is not shorter than itself */
    g_assert_cmpuint(told->latencies[0]->below[3], ==, 7);
    g_assert_cmpuint(told->latencies[1]->count, ==, 0);
    lightstage_metrics_free(metrics);
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
    struct lightstage_take_summary *summary = NULL;
    g_assert_cmpuint(lightstage_take_summary(client, take->id, &summary, NULL), ==, 0);
    g_assert_cmpstr(summary->id, ==, take->id);
    g_assert_cmpuint(summary->width, ==, TAKE_W);
    g_assert_cmpuint(summary->height, ==, TAKE_H);
    g_assert_cmpuint(summary->n_lights, ==, TAKE_LIGHTS);
    g_assert_cmpuint(summary->conditions_published, ==, summary->conditions_planned - 1);
    lightstage_take_summary_free(summary);
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

struct quality {
    uint32_t rows, strange;
    uint32_t valid[4];
    size_t bytes;
    float *pixels;
};

static int take_quality(const struct lightstage_band *band, void *user)
{
    struct quality *q = user;
    size_t n = (size_t)band->n_rows * band->width;
    for (size_t i = 0; i < n; i++) {
        float variance;
        memcpy(&variance, (const char *)band->variance + i * sizeof variance, sizeof variance);
        q->strange += !(variance > 0) || band->validity[i] > 3;
        q->valid[band->validity[i] & 3]++;
        q->strange += band->validity[i] !=
                      made_validity(TAKE_FLAGGED, (int)(band->first_row * band->width + i));
    }
    memcpy(q->pixels + (size_t)band->first_row * band->width, band->values, band->values_bytes);
    q->rows += band->n_rows;
    return 0;
}

static void pictures_come_by_name_with_what_is_known_of_their_pixels(struct stage *stage,
                                                                     gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    static const char *const names[] = {"W-0002"};
    struct lightstage_fetch fetch = {.size = sizeof fetch,
                                     .take = take->id,
                                     .quantity = LIGHTSTAGE_ESTIMATE,
                                     .conditions = names,
                                     .n_conditions = 1,
                                     .variance = 1,
                                     .validity = 1};
    struct quality q = {.pixels = g_new(float, TAKE_PIXELS)};
    g_assert_cmpuint(lightstage_fetch(client, &fetch, take_quality, &q, NULL), ==, 0);
    g_assert_cmpuint(q.rows, ==, TAKE_H);
    g_assert_cmpuint(q.strange, ==, 0);
    for (int i = 0; i < 4; i++)
        g_assert_cmpuint(q.valid[i], >, 0);
    g_assert_cmpmem(q.pixels, sizeof(float) * TAKE_PIXELS, take->light[TAKE_FLAGGED],
                    sizeof(float) * TAKE_PIXELS);
    g_free(q.pixels);
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

enum { RGB_VALUES = 3 * TAKE_PIXELS };

struct factored {
    uint16_t ratio[RGB_VALUES], white[RGB_VALUES], whole[RGB_VALUES];
    float gain;
    uint32_t ratios;
};

static int take_factor(const struct lightstage_band *band, void *user)
{
    struct factored *f = user;
    uint16_t *to = band->factor == LIGHTSTAGE_RATIO   ? f->ratio
                   : band->factor == LIGHTSTAGE_WHITE ? f->white
                                                      : f->whole;
    if (band->factor == LIGHTSTAGE_RATIO && band->spectrum)
        f->ratios += !strcmp(band->spectrum, "R");
    if (band->factor == LIGHTSTAGE_WHITE)
        f->gain = band->gain;
    memcpy(to + (size_t)band->first_row * band->width * 3, band->values, band->values_bytes);
    return 0;
}

static void a_factored_fetch_expands_to_what_the_daemon_sends(struct stage *stage,
                                                              gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct factored *f = g_new0(struct factored, 1);
    uint16_t *expanded = g_new0(uint16_t, RGB_VALUES);
    struct lightstage_shape shape;
    static const char *const spectra[] = {"R"};
    static const uint32_t light[] = {4};
    struct lightstage_promotion sphere = {.size = sizeof sphere, .model = LIGHTSTAGE_SPHERE};
    struct lightstage_fetch fetch = {.size = sizeof fetch,
                                     .take = take->id,
                                     .lights = light,
                                     .n_lights = 1,
                                     .promotion = &sphere,
                                     .layout = LIGHTSTAGE_RGB,
                                     .sample = LIGHTSTAGE_HALF,
                                     .factored = 1,
                                     .spectra = spectra,
                                     .n_spectra = 1};
    g_assert_cmpuint(lightstage_fetch(client, &fetch, take_factor, f, NULL), ==, 0);
    g_assert_cmpuint(f->ratios, ==, 1);
    g_assert_cmpuint(lightstage_fetch_into(client, &fetch, expanded, sizeof f->white, &shape, NULL),
                     ==, LIGHTSTAGE_BAD_ARGUMENT);
    fetch.factored = 0;
    fetch.n_spectra = 0;
    fetch.channel = "R";
    g_assert_cmpuint(lightstage_fetch(client, &fetch, take_factor, f, NULL), ==, 0);
    g_assert_cmpuint(lightstage_expand(f->white, f->gain, f->ratio, RGB_VALUES, expanded), ==, 0);
    g_assert_cmpmem(expanded, sizeof f->whole, f->whole, sizeof f->whole);
    g_assert_true(memcmp(f->white, f->whole, sizeof f->whole));
    g_free(expanded);
    g_free(f);
    lightstage_close(client);
    made_take_free(take);
}

enum { SIDE = 64, ACROSS = 3, TILES = ACROSS * 3 };

struct tiles {
    float *picture; /* put together */
    uint64_t hash[TILES];
    uint32_t sent, kept, first, stop_at;
};

static int take_tile(const struct lightstage_tile *tile, void *user)
{
    struct tiles *t = user;
    uint32_t x = tile->number % ACROSS * SIDE, y = tile->number / ACROSS * SIDE;
    g_assert_cmpuint(tile->picture->width, ==, TAKE_W);
    g_assert_cmpuint(tile->index, ==, tile->number); /* of one picture */
    t->hash[tile->number] = tile->hash;
    if (t->sent + t->kept == 0)
        t->first = tile->index;
    t->sent += tile->values != NULL;
    t->kept += !tile->values;
    for (uint32_t r = 0; tile->values && r < SIDE && y + r < TAKE_H; r++)
        memcpy(t->picture + (size_t)(y + r) * TAKE_W + x,
               (const float *)tile->values + (size_t)r * SIDE,
               sizeof(float) * MIN(SIDE, TAKE_W - x));
    return t->sent + t->kept == t->stop_at;
}

static void tiles_come_once_and_go_on_where_they_were_left(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    static const uint32_t light[] = {5};
    struct lightstage_fetch fetch = stored(take);
    struct lightstage_have have = {.size = sizeof have};
    struct tiles t = {.picture = g_new0(float, TAKE_PIXELS), .stop_at = 4};
    const size_t bytes = sizeof(float) * TAKE_PIXELS;
    uint64_t hashes[TILES];
    fetch.lights = light;
    fetch.n_lights = 1;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_tile, &t, NULL), ==,
                     LIGHTSTAGE_CANCELLED);
    have.first_tile = 4;
    t.sent = t.stop_at = 0;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, &have, take_tile, &t, NULL), ==, 0);
    g_assert_cmpuint(t.first, ==, 4);
    g_assert_cmpuint(t.sent, ==, TILES - 4);
    g_assert_cmpmem(t.picture, bytes, take->light[5], bytes);
    memcpy(hashes, t.hash, sizeof hashes);
    hashes[2] ^= 1;
    have = (struct lightstage_have){.size = sizeof have, .hashes = hashes, .n_hashes = TILES - 1};
    t.sent = 0;
    memset(t.picture, 0, bytes);
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, &have, take_tile, &t, NULL), ==, 0);
    g_assert_cmpuint(t.sent, ==, 2); /* the one that differs and the one not named */
    g_assert_cmpuint(t.kept, ==, TILES - 2);
    for (uint32_t y = 0; y < SIDE; y++)
        g_assert_cmpmem(t.picture + y * TAKE_W + 2 * SIDE, 4 * (TAKE_W - 2 * SIDE),
                        take->light[5] + y * TAKE_W + 2 * SIDE, 4 * (TAKE_W - 2 * SIDE));
    g_assert_cmpfloat(t.picture[0], ==, 0);
    have.first_tile = TILES;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, &have, take_tile, &t, NULL), ==,
                     LIGHTSTAGE_OVER_LIMIT);
    g_free(t.picture);
    lightstage_close(client);
    made_take_free(take);
}

/* Of a tile that comes whole. */
static double brightest(const struct lightstage_tile *tile)
{
    double most = 0;
    for (size_t k = 0; k < tile->values_bytes / sizeof(float); k++)
        most = fmax(most, fabs((double)((const float *)tile->values)[k]));
    return most;
}

struct bounded {
    double brightest[TILES], error_bound;
    uint32_t n, n_out;
    double max_error;
};

static int take_bounded(const struct lightstage_tile *tile, void *user)
{
    struct bounded *b = user;
    bool out = tile->hash == 0;
    if (b->max_error == 0)
        b->brightest[tile->number] = brightest(tile);
    g_assert_cmpint(out, ==, b->brightest[tile->number] <= b->max_error);
    g_assert_cmpint(out, ==, tile->values == NULL);
    b->error_bound = tile->picture->error_bound;
    b->n_out += out;
    b->n++;
    return 0;
}

static void what_is_under_max_error_does_not_come(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    static const uint32_t light[] = {5};
    struct lightstage_fetch fetch = stored(take);
    struct bounded b = {.n = 0};
    fetch.lights = light;
    fetch.n_lights = 1;
    g_assert_true(lightstage_can(client, "max_error"));
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_bounded, &b, NULL), ==, 0);
    g_assert_cmpuint(b.n, ==, TILES);
    g_assert_cmpfloat(b.error_bound, ==, 0);
    fetch.max_error = b.max_error = b.brightest[4];
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_bounded, &b, NULL), ==, 0);
    g_assert_cmpuint(b.n, ==, 2 * TILES);
    g_assert_cmpuint(b.n_out, >, 0);
    g_assert_cmpfloat(b.error_bound, ==, b.brightest[4]);
    fetch.max_error = -1;
    g_assert_cmpuint(lightstage_fetch_tiles(client, &fetch, NULL, take_bounded, &b, NULL), ==,
                     LIGHTSTAGE_BAD_ARGUMENT);
    lightstage_close(client);
    made_take_free(take);
}

struct heard {
    uint32_t progress, pictures, alarms;
    enum lightstage_take_state state;
    char text[64];
};

static int hear_progress(const struct lightstage_take_status *status, void *user)
{
    struct heard *heard = user;
    heard->progress++;
    heard->state = status->state;
    return 0;
}

static int hear_published(const struct lightstage_published *published, void *user)
{
    struct heard *heard = user;
    g_assert_cmpstr(published->take, ==, "one");
    g_assert_cmpstr(published->condition, ==, "W-00006");
    g_assert_cmpstr(published->channel, ==, "W");
    g_assert_true(published->single_light);
    g_assert_cmpuint(published->light, ==, 6);
    heard->pictures++;
    return 0;
}

/* Ends the listening. */
static int hear_alarm(const struct lightstage_alarm *alarm, void *user)
{
    struct heard *heard = user;
    g_assert_cmpint(alarm->kind, ==, LIGHTSTAGE_ALARM_DRIFT);
    g_assert_true(alarm->active);
    g_strlcpy(heard->text, alarm->text, sizeof heard->text);
    heard->alarms++;
    return 1;
}

static void what_happens_is_told(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage);
    struct heard heard = {0};
    struct lightstage_listener listener = {.size = sizeof listener,
                                           .progress = hear_progress,
                                           .published = hear_published,
                                           .alarm = hear_alarm};
    const struct lightstage_listener deaf = {.size = sizeof deaf};
    struct ls_event_picture picture = {.channel = "W", .light = 6, .condition = "W-00006"};
    struct ls_events *events = ls_engine_events(stage->engine);
    uint32_t request = 0;
    g_assert_cmpuint(lightstage_events(client, &deaf, NULL, NULL), ==, LIGHTSTAGE_BAD_ARGUMENT);
    g_assert_cmpuint(lightstage_events_begin(client, &listener, &heard, &request, NULL), ==, 0);
    while (!heard.progress) /* what is so now */
        g_assert_cmpuint(lightstage_dispatch(client, NULL), ==, 0);
    g_assert_cmpint(heard.state, ==, LIGHTSTAGE_TAKE_NONE);
    ls_events_begin(events, "one");
    ls_events_published(events, &picture);
    while (!heard.pictures)
        g_assert_cmpuint(lightstage_dispatch(client, NULL), ==, 0);
    ls_events_alarm(events, LS_ALARM_DRIFT, true, "one", "it drifts");
    g_assert_cmpuint(lightstage_wait(client, request, NULL), ==, LIGHTSTAGE_CANCELLED);
    g_assert_cmpuint(heard.pictures, ==, 1);
    g_assert_cmpuint(heard.alarms, ==, 1);
    g_assert_cmpstr(heard.text, ==, "it drifts");
    listener.progress = NULL;
    listener.published = NULL; /* alarms alone: the one that is on is told to who comes late */
    g_assert_cmpuint(lightstage_events(client, &listener, &heard, NULL), ==, LIGHTSTAGE_CANCELLED);
    g_assert_cmpuint(heard.alarms, ==, 2);
    lightstage_close(client);
}

static int look_once(const struct lightstage_view *view, void *user)
{
    *(uint64_t *)user = view->frame_id;
    g_assert_cmpuint(view->width * view->bin, ==, SIDE);
    g_assert_cmpuint(view->height * view->bin, ==, SIDE);
    g_assert_cmpfloat(view->exposure_us, ==, 100);
    g_assert_cmpuint(view->n_clip, ==, 1);
    g_assert_cmpuint(view->rgb[0], >, 0);
    return 1;
}

static void a_camera_is_looked_through(struct stage *stage, gconstpointer data)
{
    static uint8_t raw[SIDE * SIDE];
    struct lightstage *client = connected(stage);
    struct lightstage_preview preview = {.size = sizeof preview};
    uint64_t frame = 0, offered = 0;
    uint32_t request = 0;
    memset(raw, 100, sizeof raw);
    stage->config.cameras[0].full_scale_dn = 255;
    stage->config.cameras[0].electrons_per_dn = 1;
    stage->config.cameras[0].read_noise_dn = 1;
    g_assert_cmpuint(lightstage_preview_begin(client, &preview, look_once, &frame, &request, NULL),
                     ==, 0);
    for (int i = 0; i < 250 && !frame; i++) { /* as a camera does, whoever looks; 5 s at most */
        struct pollfd wait = {.fd = lightstage_descriptor(client), .events = POLLIN};
        ls_preview_offer(ls_engine_preview(stage->engine), 0, ls_pixel_by_name("Mono8"), SIDE, SIDE,
                         raw, ++offered, 100);
        if (poll(&wait, 1, 20) == 1)
            g_assert_cmpuint(lightstage_dispatch(client, NULL), ==, 0);
    }
    g_assert_cmpuint(frame, >, 0);
    g_assert_cmpuint(lightstage_wait(client, request, NULL), ==, LIGHTSTAGE_CANCELLED);
    lightstage_close(client);
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
    ADD_LIBRARY("waiting-for-one-leaves-nothing-unread-of-others",
                waiting_for_one_leaves_nothing_unread_of_others);
    ADD_LIBRARY("a-callback-and-a-call-cancel", a_callback_and_a_call_cancel);
    ADD_LIBRARY("errors-are-the-daemons-number-and-sentence",
                errors_are_the_daemons_number_and_sentence);
    ADD_LIBRARY("structs-of-older-and-newer-headers-are-taken",
                structs_of_older_and_newer_headers_are_taken);
    ADD_LIBRARY("a-take-is-started-followed-and-told", a_take_is_started_followed_and_told);
    ADD_LIBRARY("the-rig-and-a-plans-cost-are-told", the_rig_and_a_plans_cost_are_told);
    ADD_LIBRARY("a-daemon-says-what-it-does-and-who-one-is",
                a_daemon_says_what_it_does_and_who_one_is);
    ADD_LIBRARY("what-was-counted-is-told", what_was_counted_is_told);
    g_test_add_func("/liblightstage/numbers-have-words", numbers_have_words);
    ADD_LIBRARY("takes-on-disk-are-listed-and-verified", takes_on_disk_are_listed_and_verified);
    ADD_LIBRARY("a-slate-is-written-field-by-field", a_slate_is_written_field_by_field);
    ADD_LIBRARY("pictures-come-by-name-with-what-is-known-of-their-pixels",
                pictures_come_by_name_with_what_is_known_of_their_pixels);
    ADD_LIBRARY("who-has-no-credit-waits", who_has_no_credit_waits);
    ADD_LIBRARY("a-factored-fetch-expands-to-what-the-daemon-sends",
                a_factored_fetch_expands_to_what_the_daemon_sends);
    ADD_LIBRARY("tiles-come-once-and-go-on-where-they-were-left",
                tiles_come_once_and_go_on_where_they_were_left);
    ADD_LIBRARY("what-is-under-max-error-does-not-come", what_is_under_max_error_does_not_come);
    ADD_LIBRARY("what-happens-is-told", what_happens_is_told);
    ADD_LIBRARY("a-camera-is-looked-through", a_camera_is_looked_through);
    ADD_LIBRARY("a-signal-that-is-blocked-stays-so", a_signal_that_is_blocked_stays_so);
    ADD_LIBRARY("the-example-prints-a-pictures-mean", the_example_prints_a_pictures_mean);
    g_test_add("/liblightstage/a-lost-connection-ends-all-that-is-in-flight", struct stage, NULL,
               with_stage, a_lost_connection_ends_all_that_is_in_flight, nothing);
    return g_test_run();
}

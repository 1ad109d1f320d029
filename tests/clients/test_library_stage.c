/* liblightstage: what a daemon says of itself, its rig, and what happens there. */
#include "core/pixel.h"
#include "daemon/preview.h"
#include "tests/clients/library_fixture.h"

#include <poll.h>
#include <string.h>

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

enum { SIDE = 64 }; /* of a frame, in pixels */

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

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("the-rig-and-a-plans-cost-are-told", the_rig_and_a_plans_cost_are_told);
    ADD_LIBRARY("a-daemon-says-what-it-does-and-who-one-is",
                a_daemon_says_what_it_does_and_who_one_is);
    ADD_LIBRARY("what-was-counted-is-told", what_was_counted_is_told);
    ADD_LIBRARY("what-happens-is-told", what_happens_is_told);
    ADD_LIBRARY("a-camera-is-looked-through", a_camera_is_looked_through);
    return g_test_run();
}

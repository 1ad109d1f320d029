/* server_events: who wants to know is told, and who is slow misses progress alone. */
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/server_verbs.h"

#include <glib/gstdio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static struct ls_events *events_of(struct stage *stage)
{
    return ls_engine_events(stage->engine);
}

static void begins(struct stage *stage, const char *take)
{
    ls_events_begin(events_of(stage), take);
}

/* Pictures first to end - 1, of lights of these numbers. */
static void published(struct stage *stage, int first, int end)
{
    for (int i = first; i < end; i++) {
        struct ls_event_picture picture = {.channel = "W", .light = i, .camera = 1};
        snprintf(picture.condition, sizeof picture.condition, "W-%05d", i);
        ls_events_published(events_of(stage), &picture);
    }
}

static uint32_t listens(struct ls_connection *client, const Lightstage__Events *wish)
{
    Lightstage__Events all = LIGHTSTAGE__EVENTS__INIT;
    uint32_t request = 0;
    g_assert_cmpint(ls_connection_send(client, LS_MESSAGE_EVENTS, wish ? &wish->base : &all.base,
                                       NULL, 0, &request, NULL),
                    ==, LS_OK);
    return request;
}

static void take_starts(struct stage *stage)
{
    struct ls_connection *client = a_client(stage);
    bool already;
    g_assert_cmpuint(start_take(client, "t", &already), ==, 0);
    ls_connection_close(client);
}

/* What somebody has been told so far. */
struct told {
    uint32_t request;
    unsigned frames, progress, pictures, alarms, missed;
    char take[128];
    Lightstage__Alarm alarm; /* the last one; its text below */
    char text[384];
    Lightstage__TakeState state;
};

static void hear(struct ls_connection *client, struct told *told)
{
    struct ls_reply reply;
    g_assert_cmpint(ls_connection_receive(client, told->request, &reply, NULL), ==, LS_OK);
    const Lightstage__EventsReply *body = (const Lightstage__EventsReply *)reply.message;
    g_assert_false(reply.last);
    told->frames++;
    if (body->progress) {
        told->progress++;
        told->state = body->progress->state;
    }
    if (body->missed)
        told->pictures = 0;
    told->missed += body->missed;
    for (size_t i = 0; i < body->n_published; i++) {
        const Lightstage__Published *p = body->published[i];
        g_assert_cmpuint(p->light, ==, told->pictures++);
        g_assert_true(p->single_light);
        g_assert_cmpuint(p->camera, ==, 1);
        g_assert_cmpstr(p->channel, ==, "W");
        g_assert_cmpint(atoi(p->condition + 2), ==, (int)p->light);
        g_strlcpy(told->take, body->take, sizeof told->take);
    }
    for (size_t i = 0; i < body->n_alarms; i++) {
        told->alarms++;
        told->alarm = *body->alarms[i];
        g_strlcpy(told->text, body->alarms[i]->text, sizeof told->text);
    }
    ls_reply_finish(&reply);
}

static void what_happens_is_told(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    struct told told = {.request = listens(client, NULL)};
    hear(client, &told); /* what is so now: nothing */
    g_assert_cmpuint(told.progress, ==, 1);
    g_assert_cmpint(told.state, ==, LIGHTSTAGE__TAKE_STATE__NONE);
    begins(stage, "one");
    published(stage, 0, 3);
    while (told.pictures < 3)
        hear(client, &told);
    g_assert_cmpstr(told.take, ==, "one");
    g_assert_cmpuint(told.missed, ==, 0);
    ls_events_alarm(events_of(stage), LS_ALARM_DRIFT, true, "one", "it drifts");
    while (told.alarms < 1)
        hear(client, &told);
    g_assert_cmpint(told.alarm.kind, ==, LIGHTSTAGE__ALARM_KIND__ALARM_DRIFT);
    g_assert_true(told.alarm.active);
    g_assert_cmpstr(told.text, ==, "it drifts");
    begins(stage, "two"); /* it is over with its take */
    while (told.alarms < 2)
        hear(client, &told);
    g_assert_false(told.alarm.active);
    g_assert_cmpstr(told.text, ==, "it drifts");
    take_starts(stage);
    take_advances(stage, 4);
    while (told.state != LIGHTSTAGE__TAKE_STATE__RUNNING)
        hear(client, &told);
    take_ends(stage, LS_TAKE_COMPLETE);
    while (told.state != LIGHTSTAGE__TAKE_STATE__COMPLETE)
        hear(client, &told);
    ls_connection_close(client);
}

static void who_comes_late_is_told_what_is_so(struct stage *stage, gconstpointer data)
{
    begins(stage, "one");
    published(stage, 0, 300);
    ls_events_alarm(events_of(stage), LS_ALARM_HOT, true, "one", "hot");
    ls_events_alarm(events_of(stage), LS_ALARM_DISK, true, "one", "full");
    ls_events_alarm(events_of(stage), LS_ALARM_DISK, false, "one", "full");
    struct ls_connection *client = a_client(stage);
    struct told told = {.request = listens(client, NULL)};
    while (told.pictures < 300)
        hear(client, &told);
    g_assert_cmpuint(told.alarms, ==, 1);
    g_assert_cmpstr(told.text, ==, "hot");
    ls_connection_close(client);
}

/* Far more than the sockets hold, while nobody reads. */
static void who_is_slow_misses_progress_alone(struct stage *stage, gconstpointer data)
{
    enum { PICTURES = 240000, ADVANCES = 500 };
    struct ls_connection *client = a_client(stage);
    struct told told = {.request = listens(client, NULL)};
    take_starts(stage);
    begins(stage, "one");
    for (int k = 0; k < ADVANCES; k++) {
        char text[32];
        published(stage, k * (PICTURES / ADVANCES), (k + 1) * (PICTURES / ADVANCES));
        snprintf(text, sizeof text, "drifts %d", k);
        ls_events_alarm(events_of(stage), LS_ALARM_DRIFT, true, "one", text);
        take_advances(stage, (uint32_t)k + 1);
    }
    take_ends(stage, LS_TAKE_COMPLETE);
    while (told.pictures < PICTURES || told.state != LIGHTSTAGE__TAKE_STATE__COMPLETE)
        hear(client, &told);
    g_test_message("%u frames, %u with progress, %u with alarms", told.frames, told.progress,
                   told.alarms);
    g_assert_cmpuint(told.missed, ==, 0);
    g_assert_cmpuint(told.progress, <, ADVANCES);
    g_assert_cmpstr(told.text, ==, "drifts 499");
    ls_connection_close(client);
}

static void who_is_a_take_behind_is_told_so(struct stage *stage, gconstpointer data)
{
    enum { PICTURES = 240000 };
    struct ls_connection *client = a_client(stage);
    struct told told = {.request = listens(client, NULL)};
    begins(stage, "one");
    published(stage, 0, PICTURES);
    begins(stage, "two");
    published(stage, 0, 5);
    while (strcmp(told.take, "two") != 0)
        hear(client, &told);
    g_assert_cmpuint(told.missed, ==, 1);
    g_assert_cmpuint(told.pictures, ==, 5);
    ls_connection_close(client);
}

static void only_what_is_named_is_told(struct stage *stage, gconstpointer data)
{
    Lightstage__Events wish = LIGHTSTAGE__EVENTS__INIT;
    struct ls_connection *client = a_client(stage);
    wish.alarms = true;
    struct told told = {.request = listens(client, &wish)};
    begins(stage, "one");
    published(stage, 0, 10);
    ls_events_alarm(events_of(stage), LS_ALARM_FAULT, true, "one", "broken");
    hear(client, &told);
    g_assert_cmpstr(told.text, ==, "broken");
    g_assert_cmpuint(told.pictures + told.progress, ==, 0);
    ls_connection_close(client);
}

static void events_are_asked_for_once_and_can_be_cancelled(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    Lightstage__Events all = LIGHTSTAGE__EVENTS__INIT;
    struct told told = {.request = listens(client, NULL)};
    hear(client, &told);
    g_assert_cmpuint(ask(client, LS_MESSAGE_EVENTS, &all.base, NULL, NULL), ==, LS_PROTO_TOO_MANY);
    Lightstage__Cancel cancel = LIGHTSTAGE__CANCEL__INIT;
    uint32_t request;
    cancel.request = told.request;
    g_assert_cmpint(
        ls_connection_send(client, LS_MESSAGE_CANCEL, &cancel.base, NULL, 0, &request, NULL), ==,
        LS_OK);
    struct ls_reply reply;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_connection_receive(client, told.request, &reply, &diag), ==, LS_ERR_REFUSED);
    g_assert_cmpuint(ls_connection_error(client), ==, LS_PROTO_CANCELLED);
    told.request = listens(client, NULL);
    hear(client, &told);
    ls_connection_close(client);
}

/* ---- what clients do not know ---- */

static void read_all(int fd, uint8_t *to, size_t n)
{
    for (ssize_t got; n > 0; to += got, n -= (size_t)got)
        g_assert_cmpint((got = recv(fd, to, n, 0)), >, 0);
}

/* A daemon of a later day: it says what nobody has heard of. */
static gpointer later_daemon(gpointer data)
{
    static const uint8_t later[] = {
        0x08, 1,                                                 /* version 1 */
        0x12, 5,    'l',  'a',  't',  'e',  'r',                 /* server */
        0x1a, 6,    'e',  'v',  'e',  'n',  't',  's',           /* a capability */
        0x1a, 5,    's',  'm',  'e',  'l',  'l',                 /* another */
        0x20, 0x80, 0x80, 0x04, 0x28, 0x80, 0x80, 0x40, 0x30, 8, /* limits */
        0xfa, 0x7f, 3,    1,    2,    3,                         /* field 2047 */
    };
    int fd = accept(GPOINTER_TO_INT(data), NULL, NULL);
    uint8_t head[LS_FRAME_HEADER_BYTES], message[256];
    struct ls_frame_header header;
    read_all(fd, head, sizeof head);
    g_assert_cmpint(ls_frame_get(head, 1 << 20, &header, NULL), ==, LS_OK);
    g_assert_cmpuint(header.message_bytes, <=, sizeof message);
    read_all(fd, message, header.message_bytes);
    header.type |= LS_MESSAGE_REPLY;
    header.flags = LS_FRAME_LAST;
    header.message_bytes = sizeof later;
    ls_frame_put(&header, head);
    g_assert_cmpint(send(fd, head, sizeof head, MSG_NOSIGNAL), ==, sizeof head);
    g_assert_cmpint(send(fd, later, sizeof later, MSG_NOSIGNAL), ==, sizeof later);
    close(fd);
    return NULL;
}

static void unknown_capabilities_are_ignored(void)
{
    g_autofree char *folder = g_dir_make_tmp("lightstage-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "socket", NULL);
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    struct ls_connection *client = NULL;
    struct ls_diag diag = {{0}};
    g_strlcpy(address.sun_path, path, sizeof address.sun_path);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    g_assert_cmpint(bind(fd, (struct sockaddr *)&address, sizeof address), ==, 0);
    g_assert_cmpint(listen(fd, 1), ==, 0);
    GThread *thread = g_thread_new("later", later_daemon, GINT_TO_POINTER(fd));
    g_assert_cmpint(ls_connection_open(path, &client, &diag), ==, LS_OK);
    g_assert_cmpstr(diag.text, ==, "");
    g_thread_join(thread);
    ls_connection_close(client);
    close(fd);
    g_remove(path);
    g_rmdir(folder);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("what-happens-is-told", what_happens_is_told);
    ADD("who-comes-late-is-told-what-is-so", who_comes_late_is_told_what_is_so);
    ADD("who-is-slow-misses-progress-alone", who_is_slow_misses_progress_alone);
    ADD("who-is-a-take-behind-is-told-so", who_is_a_take_behind_is_told_so);
    ADD("only-what-is-named-is-told", only_what_is_named_is_told);
    ADD("events-are-asked-for-once-and-can-be-cancelled",
        events_are_asked_for_once_and_can_be_cancelled);
    g_test_add_func("/server/unknown-capabilities-are-ignored", unknown_capabilities_are_ignored);
    return g_test_run();
}

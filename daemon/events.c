#include "daemon/events.h"

#include <glib.h>
#include <string.h>

struct ls_events {
    GMutex lock;
    GMainContext *main;
    GSource *wake; /* on its way to ls-main, or NULL */
    void (*changed)(void *user);
    void *user;
    char take[128];
    GArray *pictures; /* struct ls_event_picture, of `take` */
    uint32_t list;    /* number of that list, from 1 */
    size_t n_before;  /* length of the one before */
    struct ls_alarm alarms[LS_ALARM_KINDS];
    uint32_t version[LS_ALARM_KINDS]; /* of the alarm's state; 0: it never was */
};

struct ls_events *ls_events_create(void)
{
    struct ls_events *events = g_new0(struct ls_events, 1);
    g_mutex_init(&events->lock);
    events->main = g_main_context_ref_thread_default();
    events->pictures = g_array_new(FALSE, FALSE, sizeof(struct ls_event_picture));
    events->list = 1;
    return events;
}

void ls_events_destroy(struct ls_events *events)
{
    if (!events)
        return;
    if (events->wake) {
        g_source_destroy(events->wake);
        g_source_unref(events->wake);
    }
    g_main_context_unref(events->main);
    g_array_unref(events->pictures);
    g_mutex_clear(&events->lock);
    g_free(events);
}

/* ---- what happens ---- */

static gboolean on_wake(gpointer data)
{
    struct ls_events *events = data;
    g_mutex_lock(&events->lock);
    g_clear_pointer(&events->wake, g_source_unref);
    g_mutex_unlock(&events->lock);
    if (events->changed)
        events->changed(events->user);
    return G_SOURCE_REMOVE;
}

/* The lock is held. */
static void wake(struct ls_events *events)
{
    if (events->wake)
        return;
    events->wake = g_idle_source_new();
    g_source_set_priority(events->wake, G_PRIORITY_DEFAULT);
    g_source_set_callback(events->wake, on_wake, events, NULL);
    g_source_attach(events->wake, events->main);
}

/* The lock is held. */
static void set_alarm(struct ls_events *events, enum ls_alarm_kind kind, bool active,
                      const char *take, const char *text)
{
    struct ls_alarm *alarm = &events->alarms[kind], old = *alarm;
    alarm->kind = kind;
    alarm->active = active;
    if (active) { /* what is over keeps saying what it was */
        g_strlcpy(alarm->take, take, sizeof alarm->take);
        g_strlcpy(alarm->text, text, sizeof alarm->text);
    }
    if (old.active == active && !strcmp(old.take, alarm->take) && !strcmp(old.text, alarm->text))
        return;
    events->version[kind]++;
    wake(events);
}

void ls_events_begin(struct ls_events *events, const char *id)
{
    static const enum ls_alarm_kind of_a_take[] = {LS_ALARM_DRIFT, LS_ALARM_FAULT, LS_ALARM_DISK};
    g_mutex_lock(&events->lock);
    g_strlcpy(events->take, id, sizeof events->take);
    events->n_before = events->pictures->len;
    g_array_set_size(events->pictures, 0);
    events->list++;
    for (size_t i = 0; i < G_N_ELEMENTS(of_a_take); i++)
        set_alarm(events, of_a_take[i], false, "", "");
    wake(events);
    g_mutex_unlock(&events->lock);
}

void ls_events_published(struct ls_events *events, const struct ls_event_picture *picture)
{
    g_mutex_lock(&events->lock);
    g_array_append_val(events->pictures, *picture);
    wake(events);
    g_mutex_unlock(&events->lock);
}

void ls_events_alarm(struct ls_events *events, enum ls_alarm_kind kind, bool active,
                     const char *take, const char *text)
{
    g_mutex_lock(&events->lock);
    set_alarm(events, kind, active, take, text);
    g_mutex_unlock(&events->lock);
}

/* ---- who reads ---- */

void ls_events_watch(struct ls_events *events, void (*changed)(void *user), void *user)
{
    events->changed = changed;
    events->user = user;
}

size_t ls_events_read(struct ls_events *events, struct ls_events_cursor *cursor, char take[128],
                      struct ls_event_picture *out, size_t most, bool *missed)
{
    g_mutex_lock(&events->lock);
    *missed = cursor->list && cursor->list != events->list &&
              (cursor->list + 1 != events->list || cursor->at < events->n_before);
    if (cursor->list != events->list)
        cursor->at = 0;
    cursor->list = events->list;
    size_t left = events->pictures->len - cursor->at, n = left < most ? left : most;
    if (n > 0)
        memcpy(out, &g_array_index(events->pictures, struct ls_event_picture, cursor->at),
               n * sizeof *out);
    cursor->at += n;
    g_strlcpy(take, events->take, sizeof events->take);
    g_mutex_unlock(&events->lock);
    return n;
}

bool ls_events_read_alarm(struct ls_events *events, struct ls_events_cursor *cursor,
                          struct ls_alarm *out)
{
    bool any = false;
    g_mutex_lock(&events->lock);
    for (int k = 0; k < LS_ALARM_KINDS && !any; k++) {
        bool told = cursor->alarms[k] != 0, changed = cursor->alarms[k] != events->version[k];
        cursor->alarms[k] = events->version[k];
        *out = events->alarms[k];
        any = changed && (told || out->active);
    }
    g_mutex_unlock(&events->lock);
    return any;
}

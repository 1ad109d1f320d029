#include "daemon/probe.h"

#include <glib.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const int64_t first_wait_us = 3000000;

struct ls_probe {
    struct ls_errand errand;
    const struct ls_config *config;
    struct ls_errands *errands;
    int64_t remember_us, wait_us;
    GList *looks;       /* struct ls_look, who wait */
    bool asking, known; /* known: all devices were asked since it was forgotten */
    int64_t found_us;
    GMutex lock; /* of found */
    struct ls_devices found;
};

static void ask_lights(const struct ls_config *config, struct ls_devices *out)
{
    struct ls_lights *lights;
    struct ls_step_event event;
    size_t n_events;
    out->lights_connected = false;
    out->lights_serial[0] = 0;
    out->lights = (struct ls_lights_status){0};
    if (ls_lights_open(&config->lights_driver, &lights, NULL))
        return;
    snprintf(out->lights_serial, sizeof out->lights_serial, "%s", ls_lights_info(lights)->serial);
    out->lights_connected = !ls_lights_poll(lights, &out->lights, &event, 1, &n_events, NULL);
    ls_lights_close(lights);
}

static void ask_camera(const struct ls_config *config, uint32_t i, struct ls_devices *out)
{
    struct ls_camera *camera;
    memset(&out->cameras[i], 0, sizeof out->cameras[i]);
    if (ls_camera_open(&config->cameras[i].driver, &camera, NULL))
        return;
    const struct ls_camera_info *info = ls_camera_info(camera);
    out->cameras[i].connected = true;
    snprintf(out->cameras[i].model, sizeof out->cameras[i].model, "%s", info->model);
    snprintf(out->cameras[i].serial, sizeof out->cameras[i].serial, "%s", info->serial);
    snprintf(out->cameras[i].unverified, sizeof out->cameras[i].unverified, "%s", info->unverified);
    out->cameras[i].packet_socket = info->packet_socket;
    ls_camera_close(camera);
}

static void tell(struct ls_probe *p, const struct ls_devices *devices)
{
    g_mutex_lock(&p->lock);
    p->found = *devices;
    g_mutex_unlock(&p->lock);
}

static void hear(struct ls_probe *p, struct ls_devices *devices)
{
    g_mutex_lock(&p->lock);
    *devices = p->found;
    g_mutex_unlock(&p->lock);
}

/* ls-rig: what each device says is told at once, so that a look that waits no longer has it. */
static void ask_all(struct ls_errand *errand)
{
    struct ls_probe *p = (struct ls_probe *)errand;
    struct ls_devices devices;
    hear(p, &devices);
    ask_lights(p->config, &devices);
    tell(p, &devices);
    for (uint32_t i = 0; i < p->config->n_cameras && !atomic_load(&errand->stop); i++) {
        ask_camera(p->config, i, &devices);
        tell(p, &devices);
    }
}

/* ---- who looks ---- */

void ls_probe_turn_away(struct ls_look *look)
{
    if (!look->probe)
        return;
    look->probe->looks = g_list_remove(look->probe->looks, look);
    g_clear_handle_id(&look->timer, g_source_remove);
    look->probe = NULL;
}

static void answer(struct ls_probe *p, struct ls_look *look)
{
    struct ls_devices devices;
    hear(p, &devices);
    ls_probe_turn_away(look);
    look->done(look, &devices);
}

static gboolean on_late(gpointer data)
{
    struct ls_look *look = data;
    look->timer = 0;
    answer(look->probe, look);
    return G_SOURCE_REMOVE;
}

static void asked(struct ls_errand *errand)
{
    struct ls_probe *p = (struct ls_probe *)errand;
    p->asking = false;
    p->known = !atomic_load(&errand->stop);
    p->found_us = g_get_monotonic_time();
    while (p->looks)
        answer(p, p->looks->data);
}

static void ask(struct ls_probe *p)
{
    static const struct ls_devices nothing;
    if (!p->known)
        tell(p, &nothing);
    p->asking = true;
    atomic_store(&p->errand.stop, false);
    ls_errands_put(p->errands, &p->errand);
}

void ls_probe_look(struct ls_probe *p, struct ls_look *look)
{
    bool fresh = p->known && g_get_monotonic_time() - p->found_us < p->remember_us;
    int64_t patience_us = p->known ? p->wait_us : first_wait_us;
    if (!p->asking && (fresh || ls_errands_busy(p->errands))) {
        answer(p, look);
        return;
    }
    look->probe = p;
    look->timer = g_timeout_add((guint)(patience_us / 1000), on_late, look);
    p->looks = g_list_append(p->looks, look);
    if (!p->asking)
        ask(p);
}

void ls_probe_forget(struct ls_probe *p)
{
    p->known = false;
}

struct ls_probe *ls_probe_create(const struct ls_config *config, struct ls_errands *errands,
                                 int64_t remember_us, int64_t wait_us)
{
    struct ls_probe *p = calloc(1, sizeof *p);
    if (!p)
        return NULL;
    p->errand = (struct ls_errand){.work = ask_all, .done = asked, .yields = true};
    p->config = config;
    p->errands = errands;
    p->remember_us = remember_us;
    p->wait_us = wait_us;
    g_mutex_init(&p->lock);
    return p;
}

void ls_probe_destroy(struct ls_probe *p)
{
    if (!p)
        return;
    g_mutex_clear(&p->lock);
    free(p);
}

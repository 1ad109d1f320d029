#include "daemon/probe.h"

#include <glib.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const int64_t first_wait_us = 3000000;

struct ls_probe {
    const struct ls_config *config;
    int64_t remember_us, wait_us;
    GThread *thread; /* NULL: none to join */
    GMutex lock;     /* of what follows */
    GCond ended;
    bool running, stop, known;
    int64_t found_us;
    struct ls_devices found;
};

struct ls_probe *ls_probe_create(const struct ls_config *config, int64_t remember_us,
                                 int64_t wait_us)
{
    struct ls_probe *p = calloc(1, sizeof *p);
    if (!p)
        return NULL;
    p->config = config;
    p->remember_us = remember_us;
    p->wait_us = wait_us;
    g_mutex_init(&p->lock);
    g_cond_init(&p->ended);
    return p;
}

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

/* Tell what was found so far; false: leave the other devices alone. */
static bool tell(struct ls_probe *p, const struct ls_devices *devices)
{
    g_mutex_lock(&p->lock);
    p->found = *devices;
    bool go_on = !p->stop;
    g_mutex_unlock(&p->lock);
    return go_on;
}

static gpointer probe_main(gpointer data)
{
    struct ls_probe *p = data;
    struct ls_devices devices = p->found; /* only this thread writes it now */
    ask_lights(p->config, &devices);
    for (uint32_t i = 0; tell(p, &devices) && i < p->config->n_cameras; i++)
        ask_camera(p->config, i, &devices);
    g_mutex_lock(&p->lock);
    p->found_us = g_get_monotonic_time();
    p->known = true;
    p->running = false;
    g_cond_broadcast(&p->ended);
    g_mutex_unlock(&p->lock);
    return NULL;
}

static void join(struct ls_probe *p)
{
    if (p->thread)
        g_thread_join(p->thread);
    p->thread = NULL;
}

void ls_probe_look(struct ls_probe *p, struct ls_devices *out)
{
    int64_t now = g_get_monotonic_time();
    g_mutex_lock(&p->lock);
    if (!p->running && (!p->known || now - p->found_us >= p->remember_us)) {
        join(p);
        p->running = true;
        p->thread = g_thread_new("ls-probe", probe_main, p);
    }
    int64_t until = now + (p->known ? p->wait_us : first_wait_us);
    while (p->running && g_cond_wait_until(&p->ended, &p->lock, until))
        ;
    *out = p->found;
    g_mutex_unlock(&p->lock);
}

void ls_probe_release(struct ls_probe *p)
{
    g_mutex_lock(&p->lock);
    p->stop = true;
    g_mutex_unlock(&p->lock);
    join(p);
    p->stop = p->known = false;
    p->found = (struct ls_devices){0};
}

void ls_probe_destroy(struct ls_probe *p)
{
    if (!p)
        return;
    ls_probe_release(p);
    g_mutex_clear(&p->lock);
    g_cond_clear(&p->ended);
    free(p);
}

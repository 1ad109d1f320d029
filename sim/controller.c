#include "sim/controller_private.h"

#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/random.h>
#include <time.h>
#include <unistd.h>

static const struct sim_wire *const wires[] = {
    [SIM_WIRE_MODBUS] = &sim_wire_tcp,
    [SIM_WIRE_MODBUS_RTU] = &sim_wire_serial,
    [SIM_WIRE_USB] = &sim_wire_usb,
};

void sim_controller_defaults(struct sim_controller_config *config)
{
    *config = (struct sim_controller_config){
        .address = "127.0.0.1",
        .unit = 1,
        .baud = 115200,
        .serial = "LS-DOME-SIM-0001",
        .firmware = 100,
        .n_lights = 346,
        .n_channels = 8,
        .pwm_period_us = 50,
        .pwm_levels = 1000,
        .min_pulse_us = 50,
        .max_pulse_us = 500000,
        .min_period_us = 13888, /* 72 per second */
        .max_duty_permille = 500,
        .max_current_ma = 300000,
        .led_current_ma = 700,
        .max_power_mw = 800000,
        .led_power_mw = 2500,
        .max_conditions = 8192,
        .max_steps = 65536,
        .max_program_bytes = 1u << 22,
        .max_hold_us = 1000000,
        .heartbeat_ms = 1000,
        .event_queue = 4096,
        .temperature_c = 31,
        .hot_c = 70,
        .max_c = 85,
        .clock = {.hz = 1e6},
    };
}

static enum ls_err check(const struct sim_controller_config *config, struct ls_diag *diag)
{
    if (!config->n_lights || config->n_lights > 65535 || !config->n_channels ||
        config->n_channels > 64 || !config->pwm_period_us || config->pwm_levels < 2 ||
        !config->min_period_us || !config->event_queue || !config->heartbeat_ms ||
        !config->max_duty_permille || config->clock.hz <= 0 || config->port > 65535 ||
        config->baud < 1 || config->wire > SIM_WIRE_USB || config->max_program_bytes > 1u << 28 ||
        config->n_faults > SIM_CONTROLLER_MAX_FAULTS)
        return ls_fail(diag, LS_ERR_INVALID, "controller: a configured limit is out of range");
    return LS_OK;
}

static enum ls_err allocate(struct sim_controller *c, struct ls_diag *diag)
{
    c->memory = calloc(c->config.max_program_bytes / 2 + LS_WIRE_WINDOW_DATA, sizeof *c->memory);
    c->events = calloc(c->config.event_queue, sizeof *c->events);
    c->kick_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (!sim_books_init(&c->books, &c->config) || !c->memory || !c->events || c->kick_fd < 0)
        return ls_fail(diag, LS_ERR_NOMEM, "controller: out of memory");
    return LS_OK;
}

static void *serve(void *controller)
{
    struct sim_controller *c = controller;
    c->wire->serve(c);
    return NULL;
}

static enum ls_err start(struct sim_controller *c, struct ls_diag *diag)
{
    void *(*const body[])(void *) = {sim_controller_engine, serve, sim_controller_preparation};
    pthread_t *const thread[] = {&c->engine, &c->server, &c->preparation};
    for (c->n_threads = 0; c->n_threads < 3; c->n_threads++)
        if (pthread_create(thread[c->n_threads], NULL, body[c->n_threads], c))
            return ls_fail(diag, LS_ERR_OS, "controller: cannot start a thread");
    return LS_OK;
}

static void init_sync(struct sim_controller *c)
{
    pthread_condattr_t attr;
    pthread_condattr_init(&attr);
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_cond_init(&c->wake, &attr);
    pthread_condattr_destroy(&attr);
    pthread_mutex_init(&c->lock, NULL);
}

enum ls_err sim_controller_create(const struct sim_controller_config *config,
                                  const struct sim_controller_hooks *hooks,
                                  struct sim_controller **out, struct ls_diag *diag)
{
    *out = NULL;
    enum ls_err err = check(config, diag);
    if (err)
        return err;
    struct sim_controller *c = calloc(1, sizeof *c);
    if (!c)
        return ls_fail(diag, LS_ERR_NOMEM, "controller: out of memory");
    c->config = *config;
    c->hooks = *hooks;
    c->wire = wires[config->wire];
    c->kick_fd = -1;
    if (!c->config.clock.start_ns)
        c->config.clock.start_ns = sim_now_ns();
    for (uint32_t i = 0; i < c->config.n_faults; i++)
        if (!c->config.faults[i].count)
            c->config.faults[i].count = 1;
    while (!c->boot && getrandom(&c->boot, sizeof c->boot, 0) == sizeof c->boot)
        ;
    init_sync(c);
    err = allocate(c, diag);
    if (!err)
        err = c->wire->open(c, diag);
    if (!err)
        err = start(c, diag);
    if (err) {
        sim_controller_destroy(c);
        return err;
    }
    *out = c;
    return LS_OK;
}

unsigned sim_controller_port(const struct sim_controller *controller)
{
    return controller->port;
}

const char *sim_controller_path(const struct sim_controller *controller)
{
    return controller->path;
}

bool sim_controller_quitting(struct sim_controller *c)
{
    pthread_mutex_lock(&c->lock);
    bool quit = c->quit;
    pthread_mutex_unlock(&c->lock);
    return quit;
}

uint64_t sim_controller_us(const struct sim_controller *c)
{
    return sim_clock_at(&c->config.clock, sim_now_ns());
}

void sim_controller_wait(struct sim_controller *c, uint64_t true_ns)
{
    if (true_ns == UINT64_MAX)
        pthread_cond_wait(&c->wake, &c->lock);
    else
        sim_wait_until(&c->wake, &c->lock, true_ns);
}

static void stop(struct sim_controller *c)
{
    pthread_t *const thread[] = {&c->engine, &c->server, &c->preparation};
    pthread_mutex_lock(&c->lock);
    c->quit = true;
    pthread_cond_broadcast(&c->wake);
    pthread_mutex_unlock(&c->lock);
    if (c->kick_fd >= 0)
        eventfd_write(c->kick_fd, 1);
    for (unsigned i = 0; i < c->n_threads; i++)
        pthread_join(*thread[i], NULL);
}

void sim_controller_destroy(struct sim_controller *c)
{
    if (!c)
        return;
    stop(c);
    c->wire->close(c);
    if (c->kick_fd >= 0)
        close(c->kick_fd);
    sim_program_finish(&c->program);
    sim_books_finish(&c->books);
    free(c->memory);
    free(c->events);
    pthread_cond_destroy(&c->wake);
    pthread_mutex_destroy(&c->lock);
    free(c);
}

#include "tests/daemon/fake_rig.h"

#include "daemon/realtime.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { MAX_STEPS = 2048, MAX_EVENTS = 2048, MAX_READY = 1024, MAX_CAMERAS = 4 };

struct ready {
    uint64_t at_ns;
    struct ls_camera_frame frame;
};

struct ls_camera {
    struct fake_rig *rig;
    uint32_t index;
    struct ls_camera_info info;
    struct ls_camera_slots slots;
    bool started, awake, gone;
    uint32_t queued[1024], n_queued;
    struct ready ready[MAX_READY];
    uint32_t n_ready;
    uint64_t frame_id;
    uint32_t counter;
    double exposure_us;
    uint64_t busy_until_ns;
    uint64_t gave_ns; /* its newest frame, or will */
};

struct ls_lights {
    struct fake_rig *rig;
    struct ls_lights_info info;
};

struct fake_rig {
    struct fake_options options;
    GMutex lock;
    GCond changed;
    GThread *engine;
    bool quit;
    uint64_t start_ns;
    struct ls_lights lights;
    struct ls_camera cameras[MAX_CAMERAS];
    struct ls_camera *pointers[MAX_CAMERAS];
    /* controller */
    enum ls_lights_state state;
    uint16_t work_level, work_light; /* as named; as shown */
    uint64_t hot_until_ns;
    uint32_t faults, n_steps, granted, fired, period_us, n_events, armed;
    struct ls_step steps[MAX_STEPS];
    int step_light[MAX_STEPS];
    struct ls_step_event events[MAX_EVENTS];
    bool holding, lit;
    struct ls_step_event held;
    uint64_t held_ns, next_ns, last_lit_ns;
    int light_now;
    uint32_t pulses, underruns;
};

/* The controller's clock: another epoch, 80 ppm fast; the cameras': 60 ppm slow. */
static uint64_t controller_us(const struct fake_rig *rig, uint64_t host_ns)
{
    return 77000000 + (uint64_t)((double)(host_ns - rig->start_ns) * (1 + 80e-6) / 1e3);
}

static uint64_t camera_clock(const struct fake_rig *rig, uint64_t host_ns)
{
    return 5000000000000ull + (uint64_t)((double)(host_ns - rig->start_ns) * (1 - 60e-6));
}

static bool is_software(const struct ls_camera *camera)
{
    return camera->rig->options.software && !(camera->rig->options.mixed && camera->index == 1);
}

static bool has_time(const struct ls_camera *camera)
{
    return !camera->rig->options.no_time || (camera->rig->options.mixed && camera->index == 1);
}

void fake_rig_draw(void *raw, uint32_t pulse, int light, uint32_t width_us, double black,
                   double exposure_us)
{
    uint16_t *px = raw;
    double dn = black + (light < 0 ? 0 : FAKE_RATE * (1 + light) * exposure_us);
    for (uint32_t i = 0; i < FAKE_WIDTH * FAKE_HEIGHT; i++)
        px[i] = (uint16_t)fmin(65535, round(dn));
    px[0] = (uint16_t)(light + 2);
    px[1] = (uint16_t)pulse;
    px[2] = (uint16_t)(width_us / 10 + 1);
}

static void expose(struct ls_camera *camera, uint64_t at_ns, uint32_t pulse, int light,
                   uint32_t width_us, enum fake_fault fault)
{
    struct fake_rig *rig = camera->rig;
    double exposure_us = rig->options.timed ? camera->exposure_us : width_us + FAKE_OFFSET_US;
    if (!camera->started || camera->gone || fault == FAKE_DROPPED)
        return;
    camera->counter++;
    camera->frame_id++;
    bool vanishes = fault == FAKE_VANISHED ||
                    (camera->index == 0 && light >= 0 && light == rig->options.lose_light);
    if (vanishes)
        return;
    if (camera->n_queued == 0 || camera->n_ready == MAX_READY) {
        rig->underruns++;
        return;
    }
    uint32_t slot = camera->queued[0];
    memmove(camera->queued, camera->queued + 1, --camera->n_queued * sizeof slot);
    bool drifted = rig->options.drift_at && rig->armed > 1 && pulse >= rig->options.drift_at;
    fake_rig_draw((char *)camera->slots.base + camera->slots.stride * slot, pulse, light, width_us,
                  FAKE_BLACK + drifted, exposure_us);
    struct ready *ready = &camera->ready[camera->n_ready++];
    ready->at_ns = at_ns + (uint64_t)(exposure_us + rig->options.frame_delay_us) * 1000;
    if (fault == FAKE_SLOW || fault == FAKE_SLOWER)
        ready->at_ns += fault == FAKE_SLOW ? 250000000 : 400000000;
    uint64_t turn_ns = camera->gave_ns + rig->options.crowded_us * 1000ull;
    if (camera->index == 0 && light >= 0 && ready->at_ns < turn_ns)
        ready->at_ns = turn_ns;
    camera->gave_ns = ready->at_ns;
    ready->frame =
        (struct ls_camera_frame){.slot = slot,
                                 .status = fault == FAKE_LOST ? LS_FRAME_LOST : LS_FRAME_OK,
                                 .payload_bytes = FAKE_WIDTH * FAKE_HEIGHT * 2,
                                 .frame_id = camera->frame_id,
                                 .camera_ns = has_time(camera) ? camera_clock(rig, at_ns) : 0,
                                 .trigger_counter = camera->counter,
                                 .chunk_exposure_us = exposure_us};
}

static void add_event(struct fake_rig *rig, const struct ls_step_event *event)
{
    g_assert_cmpuint(rig->n_events, <, MAX_EVENTS);
    rig->events[rig->n_events++] = *event;
}

static void release(struct fake_rig *rig, uint64_t now_ns)
{
    if (!rig->holding)
        return;
    rig->holding = rig->lit = false;
    rig->light_now = -1;
    rig->held.width_us = (uint32_t)((now_ns - rig->held_ns) / 1000);
    add_event(rig, &rig->held);
    g_cond_broadcast(&rig->changed);
}

static void blank(struct fake_rig *rig)
{
    rig->holding = rig->lit = false;
    rig->light_now = -1;
    if (rig->state == LS_LIGHTS_ARMED || rig->state == LS_LIGHTS_DONE)
        rig->state = LS_LIGHTS_LOADED;
}

static enum fake_fault fault_of(const struct fake_rig *rig, uint32_t pulse)
{
    if (pulse >= FAKE_MAX_PULSES)
        return FAKE_FINE;
    return (enum fake_fault)(rig->armed > 1 ? rig->options.faults
                                            : rig->options.warm_up_faults)[pulse];
}

/* Fire the next step, whose time has come. */
static void fire(struct fake_rig *rig)
{
    uint64_t at_ns = rig->next_ns;
    const struct ls_step *step = &rig->steps[rig->fired];
    int light = rig->step_light[rig->fired];
    uint32_t pulse = rig->pulses;
    enum fake_fault fault = fault_of(rig, pulse);
    bool warm = rig->armed > 1;
    if (warm && rig->options.interlock_at && pulse == rig->options.interlock_at) {
        blank(rig);
        rig->state = LS_LIGHTS_FAULT;
        rig->faults = LS_FAULT_INTERLOCK;
        return;
    }
    if (warm && rig->options.gone_at && pulse == rig->options.gone_at)
        rig->cameras[0].gone = true;
    if (light >= 0)
        rig->last_lit_ns = at_ns;
    for (uint32_t i = 0; i < rig->options.n_cameras; i++)
        if (!is_software(&rig->cameras[i]))
            expose(&rig->cameras[i], at_ns, pulse, light, step->pulse_us,
                   i == 0 ? fault : FAKE_FINE);
    if (fault == FAKE_DOUBLED)
        expose(&rig->cameras[0], at_ns + rig->period_us * 500ull, pulse, -1, step->pulse_us,
               FAKE_FINE);
    rig->pulses++;
    struct ls_step_event event = {
        .step = rig->fired++, .width_us = step->pulse_us, .us = controller_us(rig, at_ns)};
    if (step->flags & LS_STEP_HOLD) {
        rig->holding = rig->lit = true;
        rig->light_now = light;
        rig->held = event;
        rig->held_ns = at_ns;
        if (fault == FAKE_UNLIT)
            release(rig, at_ns + 1000);
    } else {
        add_event(rig, &event);
    }
    if (rig->fired == rig->n_steps)
        rig->state = LS_LIGHTS_DONE;
    rig->next_ns = at_ns + rig->period_us * 1000ull;
    if (warm && rig->options.stall_at && rig->pulses == rig->options.stall_at)
        rig->next_ns += 300000000;
    if (warm && rig->options.stuck_at && rig->pulses == rig->options.stuck_at)
        rig->next_ns += 3600000000000;
    if (warm && rig->options.hot_at && rig->pulses == rig->options.hot_at)
        rig->hot_until_ns = at_ns + rig->options.hot_ms * 1000000ull;
    if (warm && rig->options.stall_every && rig->pulses % rig->options.stall_every == 0)
        rig->next_ns += 40000000;
}

static bool may_fire(const struct fake_rig *rig)
{
    return rig->state == LS_LIGHTS_ARMED && rig->fired < rig->granted &&
           rig->fired < rig->n_steps && !rig->holding;
}

static gpointer engine(gpointer data)
{
    struct fake_rig *rig = data;
    g_mutex_lock(&rig->lock);
    while (!rig->quit) {
        uint64_t now = ls_host_ns();
        if (!may_fire(rig)) {
            g_cond_wait(&rig->changed, &rig->lock);
            continue;
        }
        if (rig->next_ns > now) {
            gint64 until = g_get_monotonic_time() + (gint64)(rig->next_ns - now) / 1000 + 1;
            g_cond_wait_until(&rig->changed, &rig->lock, until);
            continue;
        }
        fire(rig);
        g_cond_broadcast(&rig->changed);
    }
    g_mutex_unlock(&rig->lock);
    return NULL;
}

/* ---- drivers/lights.h ---- */

const struct ls_lights_info *ls_lights_info(const struct ls_lights *lights)
{
    return &lights->info;
}

enum ls_err ls_lights_load(struct ls_lights *lights, const struct ls_program *program,
                           const _Atomic bool *stop, struct ls_diag *diag)
{
    struct fake_rig *rig = lights->rig;
    g_mutex_lock(&rig->lock);
    g_assert_cmpint(rig->state, !=, LS_LIGHTS_ARMED);
    g_assert_cmpuint(program->n_steps, <=, lights->info.max_steps);
    g_assert_cmpuint(program->n_conditions, <=, lights->info.max_conditions);
    for (uint32_t i = 0; i < program->n_steps; i++) {
        const struct ls_condition *c = &program->conditions[program->steps[i].condition];
        rig->steps[i] = program->steps[i];
        rig->step_light[i] = c->kind == LS_CONDITION_DARK ? -1 : c->leds[0].light;
    }
    rig->n_steps = program->n_steps;
    rig->period_us = program->period_us;
    rig->state = LS_LIGHTS_LOADED;
    g_mutex_unlock(&rig->lock);
    return LS_OK;
}

enum ls_err ls_lights_arm(struct ls_lights *lights, struct ls_diag *diag)
{
    struct fake_rig *rig = lights->rig;
    g_mutex_lock(&rig->lock);
    rig->granted = rig->fired = rig->n_events = 0;
    rig->holding = false;
    rig->state = LS_LIGHTS_ARMED;
    rig->work_light = 0;
    rig->next_ns = 0;
    if (++rig->armed == 2)
        rig->pulses = 0;
    g_mutex_unlock(&rig->lock);
    if (rig->options.armed)
        rig->options.armed(true);
    return LS_OK;
}

enum ls_err ls_lights_grant(struct ls_lights *lights, uint32_t n_steps, struct ls_diag *diag)
{
    struct fake_rig *rig = lights->rig;
    g_mutex_lock(&rig->lock);
    g_assert_cmpuint(n_steps, >=, rig->granted);
    g_assert_cmpuint(n_steps, <=, rig->n_steps);
    /* late by credit is late; late by the host's scheduling is still exact by the controller's
     * clock */
    uint64_t now = ls_host_ns();
    if (rig->fired == rig->granted && rig->next_ns < now)
        rig->next_ns = now;
    release(rig, now);
    rig->granted = n_steps;
    g_cond_broadcast(&rig->changed);
    g_mutex_unlock(&rig->lock);
    return LS_OK;
}

enum ls_err ls_lights_poll(struct ls_lights *lights, struct ls_lights_status *status,
                           struct ls_step_event *events, size_t max_events, size_t *n_events,
                           struct ls_diag *diag)
{
    struct fake_rig *rig = lights->rig;
    g_mutex_lock(&rig->lock);
    uint64_t before = ls_host_ns();
    size_t n = rig->n_events < max_events ? rig->n_events : max_events;
    memcpy(events, rig->events, n * sizeof *events);
    memmove(rig->events, rig->events + n, (rig->n_events - n) * sizeof *events);
    rig->n_events -= (uint32_t)n;
    *n_events = n;
    *status = (struct ls_lights_status){.state = rig->state,
                                        .faults = rig->faults,
                                        .holding = rig->holding,
                                        .hot = before < rig->hot_until_ns,
                                        .temperature_c = before < rig->hot_until_ns ? 71 : 30,
                                        .fired = rig->fired,
                                        .granted = rig->granted,
                                        .now_us = controller_us(rig, before),
                                        .host_before_ns = before - 1000,
                                        .host_after_ns = before + 1000};
    g_mutex_unlock(&rig->lock);
    return LS_OK;
}

enum ls_err ls_lights_blank(struct ls_lights *lights, struct ls_diag *diag)
{
    if (lights->rig->options.armed)
        lights->rig->options.armed(false);
    g_mutex_lock(&lights->rig->lock);
    bool fails = lights->rig->options.blank_fails && lights->rig->armed > 1;
    fails |= lights->rig->options.warm_up_blank_fails;
    blank(lights->rig);
    lights->rig->work_light = 0;
    g_mutex_unlock(&lights->rig->lock);
    return fails ? ls_fail(diag, LS_ERR_GONE, "controller unplugged") : LS_OK;
}

enum ls_err ls_lights_test_work(const struct ls_lights_info *info, uint16_t channel, uint16_t level,
                                struct ls_diag *diag)
{
    return LS_OK;
}

enum ls_err ls_lights_set_work(struct ls_lights *lights, uint16_t channel, uint16_t level,
                               struct ls_diag *diag)
{
    lights->rig->work_level = level;
    return LS_OK;
}

enum ls_err ls_lights_work(struct ls_lights *lights, struct ls_diag *diag)
{
    struct fake_rig *rig = lights->rig;
    g_mutex_lock(&rig->lock);
    bool refused = rig->faults != 0;
    rig->work_light = refused ? 0 : rig->work_level;
    g_mutex_unlock(&rig->lock);
    return refused ? ls_fail(diag, LS_ERR_REFUSED, "interlock open") : LS_OK;
}

unsigned fake_rig_work_light(struct fake_rig *rig)
{
    return rig->work_light;
}

/* ---- drivers/camera.h ---- */

const struct ls_camera_info *ls_camera_info(const struct ls_camera *camera)
{
    return &camera->info;
}

enum ls_err ls_camera_start(struct ls_camera *camera, const struct ls_camera_slots *slots,
                            struct ls_diag *diag)
{
    g_mutex_lock(&camera->rig->lock);
    camera->slots = *slots;
    camera->n_queued = camera->n_ready = 0;
    for (uint32_t i = 0; i < slots->n; i++)
        camera->queued[camera->n_queued++] = i;
    camera->started = true;
    camera->awake = false;
    camera->info.packet_socket = false;
    g_mutex_unlock(&camera->rig->lock);
    return LS_OK;
}

static bool pop_ready(struct ls_camera *camera, struct ls_camera_frame *frame)
{
    if (camera->n_ready == 0 || camera->ready[0].at_ns > ls_host_ns())
        return false;
    *frame = camera->ready[0].frame;
    frame->host_ns = ls_host_ns();
    memmove(camera->ready, camera->ready + 1, --camera->n_ready * sizeof *camera->ready);
    return true;
}

enum ls_err ls_camera_next(struct ls_camera *camera, uint64_t timeout_us,
                           struct ls_camera_frame *frame)
{
    struct fake_rig *rig = camera->rig;
    uint64_t until = ls_host_ns() + timeout_us * 1000;
    enum ls_err err = LS_ERR_TIMEOUT;
    g_mutex_lock(&rig->lock);
    for (;;) {
        uint64_t now = ls_host_ns();
        if (camera->awake)
            err = LS_ERR_ABORTED;
        else if (pop_ready(camera, frame))
            err = LS_OK;
        else if (camera->gone)
            err = LS_ERR_GONE;
        else if (now < until) {
            uint64_t wake =
                camera->n_ready && camera->ready[0].at_ns < until ? camera->ready[0].at_ns : until;
            gint64 wait_us = wake > now ? (gint64)((wake - now) / 1000) + 1 : 1;
            g_cond_wait_until(&rig->changed, &rig->lock, g_get_monotonic_time() + wait_us);
            continue;
        }
        break;
    }
    g_mutex_unlock(&rig->lock);
    return err;
}

void ls_camera_release(struct ls_camera *camera, uint32_t slot)
{
    g_mutex_lock(&camera->rig->lock);
    camera->queued[camera->n_queued++] = slot;
    g_cond_broadcast(&camera->rig->changed);
    g_mutex_unlock(&camera->rig->lock);
}

void ls_camera_wake(struct ls_camera *camera)
{
    g_mutex_lock(&camera->rig->lock);
    camera->awake = true;
    g_cond_broadcast(&camera->rig->changed);
    g_mutex_unlock(&camera->rig->lock);
}

enum ls_err ls_camera_trigger(struct ls_camera *camera, struct ls_diag *diag)
{
    struct fake_rig *rig = camera->rig;
    g_mutex_lock(&rig->lock);
    uint32_t pulse = rig->pulses ? rig->pulses - 1 : 0;
    enum fake_fault fault = camera->index == 0 ? fault_of(rig, pulse) : FAKE_FINE;
    if (fault == FAKE_CUT)
        release(rig, ls_host_ns());
    expose(camera, ls_host_ns(), pulse, rig->lit ? rig->light_now : -1, 0, fault);
    g_mutex_unlock(&rig->lock);
    return LS_OK;
}

enum ls_err ls_camera_set_exposure(struct ls_camera *camera, double *exposure_us,
                                   struct ls_diag *diag)
{
    camera->exposure_us = round(*exposure_us / 2) * 2; /* a register of 2 us */
    *exposure_us = camera->exposure_us;
    return LS_OK;
}

enum ls_err ls_camera_latch(struct ls_camera *camera, uint64_t *camera_ns, uint64_t *host_before_ns,
                            uint64_t *host_after_ns, struct ls_diag *diag)
{
    *host_before_ns = ls_host_ns();
    *camera_ns = camera_clock(camera->rig, ls_host_ns());
    *host_after_ns = ls_host_ns();
    return LS_OK;
}

void ls_camera_stop(struct ls_camera *camera, struct ls_camera_stats *stats)
{
    g_mutex_lock(&camera->rig->lock);
    camera->started = false;
    g_mutex_unlock(&camera->rig->lock);
}

/* ---- the rig ---- */

static void init_camera(struct fake_rig *rig, uint32_t index)
{
    struct ls_camera *camera = &rig->cameras[index];
    rig->pointers[index] = camera;
    camera->rig = rig;
    camera->index = index;
    camera->frame_id = 65530;
    camera->info = (struct ls_camera_info){.vendor = "Fake",
                                           .model = "Camera",
                                           .width = FAKE_WIDTH,
                                           .height = FAKE_HEIGHT,
                                           .pixel_format = "Mono16",
                                           .payload_bytes = FAKE_WIDTH * FAKE_HEIGHT * 2 + 100,
                                           .tick_hz = has_time(camera) ? 1000000000 : 0,
                                           .has_trigger_counter = has_time(camera),
                                           .has_chunk_exposure = true,
                                           .has_latch = has_time(camera),
                                           .has_trigger_width = !rig->options.timed,
                                           .packet_socket = rig->options.noisy_link && !index};
}

struct fake_rig *fake_rig_new(const struct fake_options *options)
{
    struct fake_rig *rig = g_new0(struct fake_rig, 1);
    rig->options = *options;
    if (!rig->options.frame_delay_us)
        rig->options.frame_delay_us = 2000;
    rig->start_ns = ls_host_ns();
    rig->light_now = -1;
    g_mutex_init(&rig->lock);
    g_cond_init(&rig->changed);
    rig->lights.rig = rig;
    rig->lights.info = (struct ls_lights_info){.n_lights = 64,
                                               .n_channels = 1,
                                               .max_conditions = 50,
                                               .max_steps = 40,
                                               .max_hold_us = 1000000,
                                               .heartbeat_ms = 1000};
    for (uint32_t i = 0; i < options->n_cameras; i++)
        init_camera(rig, i);
    rig->engine = g_thread_new("engine", engine, rig);
    return rig;
}

struct ls_lights *fake_rig_lights(struct fake_rig *rig)
{
    return &rig->lights;
}

struct ls_camera *const *fake_rig_cameras(struct fake_rig *rig)
{
    return rig->pointers;
}

uint32_t fake_rig_pulses(struct fake_rig *rig)
{
    g_mutex_lock(&rig->lock);
    uint32_t n = rig->pulses;
    g_mutex_unlock(&rig->lock);
    return n;
}

void fake_rig_wait_released(struct fake_rig *rig, uint32_t n)
{
    g_mutex_lock(&rig->lock);
    while (rig->cameras[0].n_queued < n)
        g_cond_wait(&rig->changed, &rig->lock);
    g_mutex_unlock(&rig->lock);
}

uint32_t fake_rig_underruns(struct fake_rig *rig)
{
    return rig->underruns;
}

GMutex *fake_rig_lock(struct fake_rig *rig)
{
    return &rig->lock;
}

bool fake_rig_is_dark(struct fake_rig *rig)
{
    g_mutex_lock(&rig->lock);
    bool dark = !rig->lit && !may_fire(rig);
    g_mutex_unlock(&rig->lock);
    return dark;
}

uint64_t fake_rig_last_lit_ns(struct fake_rig *rig)
{
    return rig->last_lit_ns;
}

void fake_rig_free(struct fake_rig *rig)
{
    g_mutex_lock(&rig->lock);
    rig->quit = true;
    g_cond_broadcast(&rig->changed);
    g_mutex_unlock(&rig->lock);
    g_thread_join(rig->engine);
    g_mutex_clear(&rig->lock);
    g_cond_clear(&rig->changed);
    g_free(rig);
}

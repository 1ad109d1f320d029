#include "daemon/exposure_fit.h"

#include "core/pixel.h"
#include "daemon/realtime.h"
#include "daemon/ring.h"
#include "daemon/sequencer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    FULL = 65535,
    SLOTS = 16,
    DISCARDED = 3, /* a camera's first frames are often bad */
    LEVELS = 5,    /* full, a quarter of it, ... */
    LONGER = 12,   /* widths tried at the full level */
    GRID = DISCARDED + LEVELS + LONGER,
    WIDTHS = 3,
    REPEATS = 16,
    SERIES = DISCARDED + 2 * WIDTHS * REPEATS,
    LONGEST_US = 20000, /* beyond that a pulse says too little of a few microseconds */
    LEAST_PIXELS = 100,
    EVENT_US = 5000000,
    FRAME_US = 1000000,
    POLL_US = 1000,
};

static const double low = 0.3, high = 0.8, enough_us = 0.5, enough_share = 1e-3;

/* A camera being measured. */
struct eye {
    bool wanted;
    struct ls_ring *ring;
    bool started;
    const struct ls_pixel_format *format;
    size_t n; /* pixels */
    uint16_t *dn;
    uint32_t *chosen; /* pixels in range at the best light */
    size_t n_chosen;
    uint32_t best_step; /* of the grid */
    double worth;       /* pixels / us^2: the error of the offset goes with its root, inverse */
    double mean[SERIES];
    bool seen[SERIES];
};

struct fit {
    const struct ls_exposure_fit *with;
    const struct ls_plan *plan;
    struct ls_lights *lights;
    struct ls_diag *diag;
    uint32_t n_cameras;
    struct eye eyes[LS_MAX_CAMERAS];
    uint32_t measured; /* camera of the series */
    struct ls_led leds[LEVELS];
    struct ls_condition conditions[LEVELS + 1]; /* dark first */
    struct ls_step steps[SERIES > GRID ? SERIES : GRID];
    struct ls_program program;
};

bool ls_exposure_fit_wanted(const struct ls_config *config, uint32_t camera)
{
    const struct ls_config_camera *c = &config->cameras[camera];
    return c->measure_offset && c->exposure_offset_sigma_us <= 0 &&
           c->driver.exposure == LS_EXPOSURE_WIDTH;
}

bool ls_exposure_fit_needed(const struct ls_config *config)
{
    bool needed = false;
    for (uint32_t k = 0; k < config->n_cameras; k++)
        needed |= ls_exposure_fit_wanted(config, k);
    return needed;
}

/* ---- one pulse ---- */

/* Also the host's sign of life, and where it hears that it should stop. */
static enum ls_err poll_lights(struct fit *f, bool *fired)
{
    struct ls_lights_status status;
    struct ls_step_event event;
    size_t n = 0;
    if (atomic_load(f->with->abort))
        return LS_ERR_ABORTED;
    enum ls_err err = ls_lights_poll(f->lights, &status, &event, 1, &n, f->diag);
    if (!err && status.state == LS_LIGHTS_FAULT) {
        char names[160];
        ls_sequencer_fault_names(status.faults, names, sizeof names);
        return ls_fail(f->diag, LS_ERR_REFUSED,
                       "the light controller latched a fault (%s) while exposure offsets were "
                       "measured: clear its cause and start again",
                       names);
    }
    *fired |= n > 0;
    return err;
}

static enum ls_err fire(struct fit *f, uint32_t step)
{
    bool fired = false;
    uint64_t until = ls_host_ns() + EVENT_US * 1000ull;
    enum ls_err err = ls_lights_grant(f->lights, step + 1, f->diag);
    while (!err && !fired) {
        err = poll_lights(f, &fired);
        if (!err && !fired && ls_host_ns() > until)
            err = ls_fail(f->diag, LS_ERR_TIMEOUT,
                          "the light controller does not fire while exposure offsets are measured");
        if (!err && !fired)
            ls_host_rest(POLL_US);
    }
    return err;
}

/* A frame, its pixels in eye->dn, its slot given back. LS_ERR_TIMEOUT: none yet. */
static enum ls_err take_frame(struct fit *f, uint32_t k, bool *good)
{
    struct eye *eye = &f->eyes[k];
    struct ls_camera_frame frame;
    enum ls_err err = ls_camera_next(f->with->cameras[k], 5 * POLL_US, &frame);
    if (!err)
        err = ls_ring_take(eye->ring, frame.slot);
    if (err)
        return err;
    *good = frame.status == LS_FRAME_OK;
    if (*good)
        ls_pixel_unpack(eye->format, ls_ring_payload(eye->ring, frame.slot), 0, eye->n, eye->dn);
    err = ls_ring_give_back(eye->ring, frame.slot);
    if (!err)
        ls_camera_release(f->with->cameras[k], frame.slot);
    return err;
}

/* The frame of the pulse just fired; none within a second: *got false. */
static enum ls_err see(struct fit *f, uint32_t k, bool *got)
{
    uint64_t until = ls_host_ns() + FRAME_US * 1000ull;
    bool fired = false;
    enum ls_err err = LS_OK;
    while (!*got && !err && ls_host_ns() < until) {
        err = take_frame(f, k, got);
        if (err && err != LS_ERR_TIMEOUT)
            return ls_fail(f->diag, err, "camera %s is %s while its exposure offset is measured",
                           f->with->config->cameras[k].name, ls_err_name(err));
        err = *got ? LS_OK : poll_lights(f, &fired);
    }
    return err;
}

typedef void judge(struct fit *f, uint32_t camera, uint32_t step);

static enum ls_err run(struct fit *f, judge *each)
{
    enum ls_err err = ls_lights_load(f->lights, &f->program, f->with->abort, f->diag);
    if (!err)
        err = ls_lights_arm(f->lights, f->diag);
    for (uint32_t i = 0; i < f->program.n_steps && !err; i++) {
        err = fire(f, i);
        for (uint32_t k = 0; k < f->n_cameras && !err; k++) {
            bool got = false;
            if (f->eyes[k].wanted)
                err = see(f, k, &got);
            if (!err && got && i >= DISCARDED)
                each(f, k, i);
        }
    }
    struct ls_diag dark;
    enum ls_err blanked = ls_lights_blank(f->lights, err ? &dark : f->diag);
    return err ? err : blanked;
}

/* ---- which light ---- */

static uint32_t base_us(const struct ls_lights_info *info)
{
    uint32_t periods = (info->min_pulse_us + info->pwm_period_us - 1) / info->pwm_period_us;
    return (periods ? periods : 1) * info->pwm_period_us;
}

static void add_step(struct fit *f, uint32_t condition, uint32_t pulse_us)
{
    f->steps[f->program.n_steps++] = (struct ls_step){
        .condition = condition, .pulse_us = pulse_us, .settle_us = f->plan->settle_us};
    if (f->program.period_us < 4 * pulse_us) /* far from any limit of duty */
        f->program.period_us = 4 * pulse_us;
}

static void begin_program(struct fit *f, uint32_t pulse_us)
{
    f->program = (struct ls_program){.conditions = f->conditions,
                                     .n_conditions = LEVELS + 1,
                                     .steps = f->steps,
                                     .period_us = f->plan->period_us};
    for (uint32_t i = 0; i < DISCARDED; i++)
        add_step(f, 0, pulse_us);
}

static void make_lights(struct fit *f, uint16_t channel)
{
    const struct ls_lights_info *info = ls_lights_info(f->lights);
    double ma = (double)info->led_current_ma * info->n_lights;
    double full = ma > info->max_current_ma ? FULL * info->max_current_ma / ma : FULL;
    for (uint32_t i = 0; i < LEVELS; i++, full /= 4) {
        f->leds[i] = (struct ls_led){.channel = channel, .level = full < 1 ? 1 : (uint16_t)full};
        f->conditions[i + 1] = (struct ls_condition){LS_CONDITION_SPHERE, 1, &f->leds[i]};
    }
}

/* Dimmest first; then longer at the brightest. */
static void make_grid(struct fit *f)
{
    const struct ls_lights_info *info = ls_lights_info(f->lights);
    uint32_t us = 4 * base_us(info);
    begin_program(f, us);
    for (uint32_t i = 0; i < LEVELS; i++)
        add_step(f, LEVELS - i, us);
    for (uint32_t i = 0; i < LONGER && 2 * us <= LONGEST_US && 2 * us <= info->max_pulse_us; i++)
        add_step(f, 1, us *= 2);
}

static bool in_range(const struct fit *f, uint32_t k, uint16_t dn)
{
    double full = f->with->config->cameras[k].full_scale_dn;
    return dn >= low * full && dn <= high * full;
}

static void choose(struct fit *f, uint32_t k, uint32_t step)
{
    struct eye *eye = &f->eyes[k];
    size_t n = 0;
    for (size_t i = 0; i < eye->n; i++)
        n += in_range(f, k, eye->dn[i]);
    double us = f->steps[step].pulse_us, worth = (double)n / (us * us);
    if (n < LEAST_PIXELS || worth <= eye->worth)
        return;
    eye->worth = worth;
    eye->best_step = step;
    eye->n_chosen = 0;
    for (size_t i = 0; i < eye->n; i++)
        if (in_range(f, k, eye->dn[i]))
            eye->chosen[eye->n_chosen++] = (uint32_t)i;
}

/* ---- the series ---- */

static void sum(struct fit *f, uint32_t k, uint32_t step)
{
    struct eye *eye = &f->eyes[k];
    double total = 0;
    if (k != f->measured)
        return;
    for (size_t i = 0; i < eye->n_chosen; i++)
        total += eye->dn[eye->chosen[i]];
    eye->mean[step] = total / (double)eye->n_chosen;
    eye->seen[step] = true;
}

/* Lit less dark at width @w, over the repeats of which both were seen. */
static struct ls_width_signal signal_of(const struct fit *f, const struct eye *eye, uint32_t w)
{
    double s = 0, squares = 0, n = 0;
    uint32_t first = DISCARDED + 2 * w;
    for (uint32_t i = first; i < SERIES; i += 2 * WIDTHS) {
        double d = eye->mean[i + 1] - eye->mean[i];
        if (!eye->seen[i] || !eye->seen[i + 1])
            continue;
        s += d;
        squares += d * d;
        n++;
    }
    double variance = (squares - s * s / n) / (n - 1) / n; /* of too few: not finite, refused */
    return (struct ls_width_signal){f->steps[first].pulse_us, s / n, fmax(variance, 1e-12)};
}

static enum ls_err measure(struct fit *f, uint32_t k, struct ls_exposure_offset *out)
{
    struct eye *eye = &f->eyes[k];
    const char *name = f->with->config->cameras[k].name;
    const struct ls_step best = f->steps[eye->best_step];
    struct ls_width_signal signals[WIDTHS];
    if (eye->n_chosen < LEAST_PIXELS)
        return ls_fail(f->diag, LS_ERR_LIMIT,
                       "camera %s: its exposure offset cannot be measured: under no light of the "
                       "dome do %d pixels read 0.3 to 0.8 of full scale; set exposure_offset_us in "
                       "the rig file, or show it something brighter",
                       name, LEAST_PIXELS);
    f->measured = k;
    begin_program(f, best.pulse_us);
    for (uint32_t i = 0; i < REPEATS * WIDTHS; i++) {
        uint32_t us = best.pulse_us >> (WIDTHS - 1 - i % WIDTHS);
        add_step(f, 0, us);
        add_step(f, best.condition, us);
    }
    enum ls_err err = run(f, sum);
    for (uint32_t w = 0; w < WIDTHS && !err; w++)
        signals[w] = signal_of(f, eye, w);
    if (!err)
        err = ls_exposure_offset_fit(signals, WIDTHS, out, f->diag);
    if (err)
        return err;
    double shortest = f->plan->pulse_us[0];
    if (out->sigma_us > fmax(enough_us, enough_share * shortest))
        return ls_fail(f->diag, LS_ERR_LIMIT,
                       "camera %s: its exposure offset reads %.2f us, but only within %.2f us: set "
                       "exposure_offset_us in the rig file, or show it something brighter",
                       name, out->us, out->sigma_us);
    out->us = round(out->us * 1e3) / 1e3;
    return LS_OK;
}

/* ---- life ---- */

static enum ls_err open_eye(struct fit *f, uint32_t k)
{
    struct eye *eye = &f->eyes[k];
    const struct ls_camera_info *info = ls_camera_info(f->with->cameras[k]);
    eye->format = ls_pixel_by_name(info->pixel_format);
    eye->n = (size_t)info->width * info->height;
    eye->dn = malloc(eye->n * sizeof *eye->dn);
    eye->chosen = malloc(eye->n * sizeof *eye->chosen);
    if (!eye->dn || !eye->chosen)
        return ls_fail(f->diag, LS_ERR_NOMEM, "out of memory");
    if (!eye->format)
        return ls_fail(f->diag, LS_ERR_UNSUPPORTED, "pixel format %s", info->pixel_format);
    enum ls_err err = ls_ring_create(SLOTS, info->payload_bytes, &eye->ring, f->diag);
    if (err)
        return err;
    const struct ls_camera_slots slots = ls_ring_slots(eye->ring);
    ls_ring_queue(eye->ring);
    err = ls_camera_start(f->with->cameras[k], &slots, f->diag);
    eye->started = !err;
    return err;
}

static void close_eye(struct fit *f, uint32_t k)
{
    struct eye *eye = &f->eyes[k];
    if (eye->started)
        ls_camera_stop(f->with->cameras[k], NULL);
    ls_ring_destroy(eye->ring);
    free(eye->dn);
    free(eye->chosen);
}

static uint16_t first_channel(const struct ls_plan *plan)
{
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        if (plan->conditions[i].lights.n_leds)
            return plan->conditions[i].lights.leds->channel;
    return 0;
}

enum ls_err ls_exposure_fit_run(const struct ls_exposure_fit *with, struct ls_exposure_offset *out,
                                struct ls_diag *diag)
{
    struct fit *f = calloc(1, sizeof *f);
    if (!f)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    *f = (struct fit){.with = with,
                      .plan = with->plan,
                      .lights = with->lights,
                      .diag = diag,
                      .n_cameras = with->config->n_cameras};
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < f->n_cameras && !err; k++) {
        f->eyes[k].wanted = ls_exposure_fit_wanted(with->config, k);
        if (f->eyes[k].wanted)
            err = open_eye(f, k);
    }
    make_lights(f, first_channel(with->plan));
    make_grid(f);
    if (!err)
        err = run(f, choose);
    /* the series overwrites the steps of the grid */
    struct ls_step grid[GRID];
    memcpy(grid, f->steps, sizeof grid);
    for (uint32_t k = 0; k < f->n_cameras && !err; k++) {
        memcpy(f->steps, grid, sizeof grid);
        if (f->eyes[k].wanted)
            err = measure(f, k, &out[k]);
    }
    for (uint32_t k = 0; k < f->n_cameras; k++)
        close_eye(f, k);
    free(f);
    return err;
}

#include "daemon/warm_up.h"

#include "daemon/realtime.h"

#include <math.h>
#include <string.h>

enum {
    PULSES_MAX = 24,
    GOOD_PULSES = 5, /* frames of one camera, one after the other, that agree */
    LATCHES = 8,
    POLL_US = 1000,
    EVENT_TIMEOUT_US = 5000000,
    INTERVAL_US = 7000, /* longer by this from pulse to pulse */
    CLOCK_FLOOR_NS = 2000,
    AGREE_NS = 2000000, /* two timestamps of one pulse, clocks not yet fitted */
    JITTER_NS = 20000,  /* off the fitted line: a sensor that starts with its next line, of 10 us */
};

#define AGREE_SHARE 500e-6 /* drift that two healthy clocks can have against each other */

/* A camera's latest run of consistent frames. */
struct track {
    uint32_t good;
    uint64_t camera_ns, pulse_ns;
};

struct warming {
    struct ls_warm_up *warm_up;
    struct ls_diag *diag;
    struct ls_lights_status status;
    struct ls_step_event event;
    struct track tracks[LS_MAX_CAMERAS];
};

static enum ls_err poll_lights(struct warming *w, bool *fired)
{
    struct ls_warm_up *warm_up = w->warm_up;
    struct ls_step_event events[4];
    size_t n = 0;
    if (atomic_load(warm_up->abort))
        return LS_ERR_ABORTED;
    enum ls_err err = ls_lights_poll(warm_up->lights, &w->status, events, 4, &n, w->diag);
    if (err)
        return err;
    if (w->status.state == LS_LIGHTS_FAULT) {
        char names[160];
        ls_sequencer_fault_names(w->status.faults, names, sizeof names);
        return ls_fail(w->diag, LS_ERR_REFUSED,
                       "the light controller latched a fault (%s): clear its cause and start again",
                       names);
    }
    if (n > 0) {
        w->event = events[n - 1];
        *fired = true;
    }
    return ls_clock_add(&warm_up->controller, w->status.now_us, w->status.host_before_ns,
                        w->status.host_after_ns);
}

static enum ls_err rest(struct warming *w, uint64_t us)
{
    uint64_t until = ls_host_ns() + us * 1000;
    enum ls_err err = LS_OK;
    bool fired;
    do {
        err = poll_lights(w, &fired);
        ls_host_rest(POLL_US);
    } while (!err && ls_host_ns() < until);
    return err;
}

static enum ls_err fire(struct warming *w, uint32_t pulse)
{
    bool fired = false;
    enum ls_err err = ls_lights_grant(w->warm_up->lights, pulse + 1, w->diag);
    uint64_t timeout_us = (uint64_t)EVENT_TIMEOUT_US + w->warm_up->period_us +
                          w->warm_up->pulse_us + w->warm_up->settle_us;
    uint64_t until = ls_host_ns() + timeout_us * 1000;
    while (!err && !fired) {
        err = poll_lights(w, &fired);
        if (!err && !fired && ls_host_ns() > until)
            return ls_fail(w->diag, LS_ERR_TIMEOUT,
                           "the light controller does not fire: granted %u dark pulses, no step "
                           "event for %.0f s",
                           pulse + 1, (double)timeout_us * 1e-6);
        if (!err && !fired)
            ls_host_rest(POLL_US);
    }
    return err;
}

static enum ls_err trigger(struct warming *w)
{
    for (uint32_t i = 0; i < w->warm_up->n_cameras; i++) {
        struct ls_warm_up_camera *camera = &w->warm_up->cameras[i];
        enum ls_err err = camera->software ? ls_camera_trigger(camera->camera, w->diag) : LS_OK;
        if (err)
            return err;
    }
    return LS_OK;
}

/* Take one frame out of a camera and give its slot back; LS_ERR_TIMEOUT: none. */
static enum ls_err take_frame(struct ls_warm_up_camera *camera, uint64_t timeout_us,
                              struct ls_camera_frame *frame)
{
    enum ls_err err = ls_camera_next(camera->camera, timeout_us, frame);
    if (err)
        return err;
    if (ls_ring_take(camera->ring, frame->slot) || ls_ring_give_back(camera->ring, frame->slot))
        return LS_ERR_BUG;
    ls_camera_release(camera->camera, frame->slot);
    return LS_OK;
}

/* The frame of the pulse just fired: the last good one that comes within the patience. */
static enum ls_err await_frame(struct warming *w, uint32_t index, uint64_t until_ns, bool *got,
                               struct ls_camera_frame *frame)
{
    struct ls_warm_up_camera *camera = &w->warm_up->cameras[index];
    bool fired;
    *got = false;
    while (!*got && ls_host_ns() < until_ns) {
        enum ls_err err = take_frame(camera, 5 * POLL_US, frame);
        if (err == LS_OK && frame->status == LS_FRAME_OK)
            *got = true;
        else if (err && err != LS_ERR_TIMEOUT)
            return ls_fail(w->diag, err, "camera %s is %s while waiting for its first frames",
                           camera->name, ls_err_name(err));
        err = poll_lights(w, &fired);
        if (err)
            return err;
    }
    return LS_OK;
}

static double difference(uint64_t a, uint64_t b)
{
    return a >= b ? (double)(a - b) : -(double)(b - a);
}

/* Did as much time pass on the camera's clock as on the controller's since the last frame? */
static bool consistent(const struct ls_warm_up_camera *camera, const struct track *track,
                       const struct ls_camera_frame *frame, uint64_t pulse_ns)
{
    if (!camera->by_time)
        return frame->frame_id == camera->anchor.frame_id + 1;
    double ticks = difference(frame->camera_ns, track->camera_ns);
    double pulses = difference(pulse_ns, track->pulse_ns);
    return fabs(ticks - pulses) < AGREE_NS + AGREE_SHARE * pulses &&
           frame->frame_id == camera->anchor.frame_id + 1;
}

static enum ls_err follow(struct warming *w, uint32_t index, const struct ls_camera_frame *frame)
{
    struct ls_warm_up_camera *camera = &w->warm_up->cameras[index];
    struct track *track = &w->tracks[index];
    uint64_t pulse_ns = w->event.us * 1000;
    if (track->good > 0 && !consistent(camera, track, frame, pulse_ns))
        track->good = 0;
    if (track->good == 0)
        ls_clock_init(&camera->clock, 1e9, CLOCK_FLOOR_NS);
    track->good++;
    track->camera_ns = frame->camera_ns;
    track->pulse_ns = pulse_ns;
    camera->anchor = *frame;
    if (!camera->by_time)
        return LS_OK;
    enum ls_err err = ls_clock_add(&camera->clock, frame->camera_ns, pulse_ns, pulse_ns);
    if (camera->clock.residual_max > JITTER_NS) /* one of them was not at its pulse's time */
        track->good = 0;
    return err;
}

/* Whatever came of earlier pulses after their patience. */
static enum ls_err drain(struct warming *w)
{
    for (uint32_t i = 0; i < w->warm_up->n_cameras; i++) {
        struct ls_camera_frame frame;
        enum ls_err err;
        while ((err = take_frame(&w->warm_up->cameras[i], 0, &frame)) == LS_OK)
            w->tracks[i].good = 0;
        if (err != LS_ERR_TIMEOUT)
            return ls_fail(w->diag, err, "camera %s is %s while its clock is being set",
                           w->warm_up->cameras[i].name, ls_err_name(err));
    }
    return LS_OK;
}

static enum ls_err one_pulse(struct warming *w, uint32_t pulse)
{
    enum ls_err err = drain(w);
    if (!err)
        err = fire(w, pulse);
    if (!err)
        err = trigger(w);
    uint64_t until_ns = ls_host_ns() + w->warm_up->patience_us * 1000;
    for (uint32_t i = 0; i < w->warm_up->n_cameras && !err; i++) {
        struct ls_camera_frame frame;
        bool got;
        err = await_frame(w, i, until_ns, &got, &frame);
        if (!err && got)
            err = follow(w, i, &frame);
        else if (!err)
            w->tracks[i].good = 0;
    }
    return err;
}

static bool all_warm(const struct warming *w)
{
    for (uint32_t i = 0; i < w->warm_up->n_cameras; i++)
        if (w->tracks[i].good < GOOD_PULSES)
            return false;
    return true;
}

static enum ls_err cold(struct warming *w)
{
    for (uint32_t i = 0; i < w->warm_up->n_cameras; i++)
        if (w->tracks[i].good < GOOD_PULSES)
            return ls_fail(w->diag, LS_ERR_TIMEOUT,
                           "camera %s does not answer the trigger: of %d dark pulses the last %u "
                           "gave usable frames, expected %d in a row; check the trigger cable, "
                           "trigger source and network",
                           w->warm_up->cameras[i].name, PULSES_MAX, w->tracks[i].good, GOOD_PULSES);
    return LS_OK;
}

static enum ls_err latch(struct warming *w, struct ls_warm_up_camera *camera)
{
    uint64_t ticks, before, after;
    ls_clock_init(&camera->host_clock, 1e9, CLOCK_FLOOR_NS);
    if (!camera->by_time || !ls_camera_info(camera->camera)->has_latch)
        return LS_OK;
    for (int i = 0; i < LATCHES; i++) {
        enum ls_err err = ls_camera_latch(camera->camera, &ticks, &before, &after, w->diag);
        if (!err)
            err = ls_clock_add(&camera->host_clock, ticks, before, after);
        if (!err)
            err = rest(w, POLL_US);
        if (err)
            return err;
    }
    return LS_OK;
}

/* Where the latches and status reads put the last pulse, against where its frame puts it. */
static enum ls_err compare(struct warming *w, struct ls_warm_up_camera *camera)
{
    if (camera->host_clock.n == 0)
        return LS_OK;
    double host_ns = ls_clock_map(&camera->host_clock, camera->anchor.camera_ns);
    double by_latch_ns = ls_clock_inverse(&w->warm_up->controller, host_ns) * 1e3;
    double by_frame_ns = ls_clock_map(&camera->clock, camera->anchor.camera_ns);
    double allowed_ns = fmax(w->warm_up->period_us * 1e3 / 2, AGREE_NS);
    if (fabs(by_latch_ns - by_frame_ns) <= allowed_ns)
        return LS_OK;
    return ls_fail(w->diag, LS_ERR_MISMATCH,
                   "camera %s: its clock latch and its frames disagree by %.3f ms about when a "
                   "pulse was; expected at most %.3f ms: is its timestamp the start of exposure?",
                   camera->name, (by_latch_ns - by_frame_ns) * 1e-6, allowed_ns * 1e-6);
}

static enum ls_err load(struct ls_warm_up *warm_up, struct ls_diag *diag)
{
    const struct ls_condition dark = {.kind = LS_CONDITION_DARK};
    struct ls_step steps[PULSES_MAX];
    for (uint32_t i = 0; i < PULSES_MAX; i++)
        steps[i] = (struct ls_step){.pulse_us = warm_up->pulse_us, .settle_us = warm_up->settle_us};
    const struct ls_program program = {.conditions = &dark,
                                       .n_conditions = 1,
                                       .steps = steps,
                                       .n_steps = PULSES_MAX,
                                       .period_us = warm_up->period_us};
    enum ls_err err = ls_lights_load(warm_up->lights, &program, warm_up->abort, diag);
    return err ? err : ls_lights_arm(warm_up->lights, diag);
}

static enum ls_err warm(struct warming *w)
{
    enum ls_err err = load(w->warm_up, w->diag);
    for (uint32_t i = 0; i < PULSES_MAX && !err && !all_warm(w); i++) {
        err = one_pulse(w, i);
        if (!err)
            err = rest(w, w->warm_up->period_us + (uint64_t)(i % 8 + 1) * INTERVAL_US);
    }
    if (!err)
        err = cold(w);
    for (uint32_t i = 0; i < w->warm_up->n_cameras && !err; i++) {
        err = latch(w, &w->warm_up->cameras[i]);
        if (!err)
            err = compare(w, &w->warm_up->cameras[i]);
    }
    return err;
}

enum ls_err ls_warm_up_run(struct ls_warm_up *warm_up, struct ls_diag *diag)
{
    struct ls_diag dark = {0};
    struct warming w = {.warm_up = warm_up, .diag = diag};
    ls_clock_init(&warm_up->controller, 1e6, CLOCK_FLOOR_NS);
    enum ls_err err = warm(&w);
    enum ls_err blanked = ls_lights_blank(warm_up->lights, &dark);
    if (!blanked)
        return err;
    const struct ls_diag before = err && diag ? *diag : (struct ls_diag){0};
    return ls_fail(diag, err ? err : blanked,
                   "%.250s%s%.150s: LEDs may be lit until the heartbeat blanks them", before.text,
                   err ? "; and blanking failed: " : "", dark.text);
}

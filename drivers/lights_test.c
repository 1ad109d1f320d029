#include "drivers/lights.h"

#include "drivers/lights_image.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

enum { FULL = 65535, MAX_TIME_US = 1u << 30, SECOND_US = 1000000 };

/** On-time of every LED over the last second, in us x level. */
struct window {
    uint64_t limit;
    uint64_t total;   /* of all LEDs together */
    uint64_t *led;    /* [n_lights x n_channels] */
    uint64_t *sphere; /* [n_channels]: what full spheres add to each LED */
    uint32_t *seen;   /* [n_lights x n_channels]: last condition + 1 that names it */
};

static void window_finish(struct window *window)
{
    free(window->led);
    free(window->sphere);
    free(window->seen);
}

static enum ls_err window_init(struct window *window, const struct ls_lights_info *info,
                               struct ls_diag *diag)
{
    size_t n = (size_t)info->n_lights * info->n_channels;
    window->limit = (uint64_t)info->max_duty_permille * (SECOND_US / 1000) * FULL;
    window->led = calloc(n, sizeof *window->led);
    window->sphere = calloc(info->n_channels, sizeof *window->sphere);
    window->seen = calloc(n, sizeof *window->seen);
    if (!window->led || !window->sphere || !window->seen)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    return LS_OK;
}

static enum ls_err test_count(const struct ls_lights_info *info, const struct ls_condition *c,
                              uint32_t i, struct ls_diag *diag)
{
    uint32_t most = info->n_lights * info->n_channels;
    uint32_t least = c->kind == LS_CONDITION_DARK ? 0 : 1;
    if (most > UINT16_MAX)
        most = UINT16_MAX;
    if (c->kind == LS_CONDITION_DARK || c->kind == LS_CONDITION_ONE ||
        c->kind == LS_CONDITION_SPHERE)
        most = least;
    else if (c->kind != LS_CONDITION_SEGMENT && c->kind != LS_CONDITION_LIST)
        return ls_fail(diag, LS_ERR_INVALID, "condition %u: unknown kind %d", i, (int)c->kind);
    if (c->n_leds < least || c->n_leds > most || (c->n_leds && !c->leds))
        return ls_fail(diag, LS_ERR_INVALID, "condition %u: %u LEDs: expected %u..%u", i, c->n_leds,
                       least, most);
    return LS_OK;
}

static enum ls_err test_led(const struct ls_lights_info *info, const struct ls_condition *c,
                            uint32_t i, uint32_t k, uint32_t *seen, struct ls_diag *diag)
{
    const struct ls_led *led = &c->leds[k];
    uint32_t light = c->kind == LS_CONDITION_SPHERE ? 0 : led->light;
    if (light >= info->n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "condition %u: light address %u: expected 0..%u", i,
                       light, info->n_lights - 1);
    if (led->channel >= info->n_channels)
        return ls_fail(diag, LS_ERR_INVALID, "condition %u: channel %u: expected 0..%u", i,
                       led->channel, info->n_channels - 1);
    if (c->kind == LS_CONDITION_SEGMENT &&
        (led->channel != c->leds->channel || led->level != c->leds->level))
        return ls_fail(diag, LS_ERR_INVALID,
                       "condition %u: a segment has one channel and one level: expected %u at %u, "
                       "found %u at %u",
                       i, c->leds->channel, c->leds->level, led->channel, led->level);
    uint32_t *stamp = &seen[light * info->n_channels + led->channel];
    if (*stamp == i + 1)
        return ls_fail(diag, LS_ERR_INVALID,
                       "condition %u: light address %u channel %u is named twice", i, light,
                       led->channel);
    *stamp = i + 1;
    return LS_OK;
}

/** Sum over all LEDs that are lit. */
static uint64_t levels_of(const struct ls_lights_info *info, const struct ls_condition *c)
{
    uint64_t levels = 0;
    for (uint32_t k = 0; k < c->n_leds; k++)
        levels += c->leds[k].level;
    return c->kind == LS_CONDITION_SPHERE ? levels * info->n_lights : levels;
}

static enum ls_err test_current(const struct ls_lights_info *info, const char *what,
                                uint64_t levels, struct ls_diag *diag)
{
    uint64_t ma = (levels * info->led_current_ma + FULL - 1) / FULL;
    if (ma > info->max_current_ma)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "%s: current %" PRIu64 " mA: %" PRIu64
                       " mA over the controller's %u mA: dim it or light fewer LEDs",
                       what, ma, ma - info->max_current_ma, info->max_current_ma);
    return LS_OK;
}

static enum ls_err test_condition(const struct ls_lights_info *info, const struct ls_condition *c,
                                  uint32_t i, uint32_t *seen, struct ls_diag *diag)
{
    char what[24];
    snprintf(what, sizeof what, "condition %u", i);
    enum ls_err err = test_count(info, c, i, diag);
    for (uint32_t k = 0; !err && k < c->n_leds; k++)
        err = test_led(info, c, i, k, seen, diag);
    return err ? err : test_current(info, what, levels_of(info, c), diag);
}

static bool is_dimmed(const struct ls_condition *c)
{
    for (uint32_t k = 0; k < c->n_leds; k++)
        if (c->leds[k].level < FULL)
            return true;
    return false;
}

static enum ls_err test_pulse(const struct ls_lights_info *info, const struct ls_program *program,
                              uint32_t i, struct ls_diag *diag)
{
    const struct ls_step *step = &program->steps[i];
    if (step->pulse_us < info->min_pulse_us)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "step %u: pulse %u us: %u us shorter than the controller's %u us", i,
                       step->pulse_us, info->min_pulse_us - step->pulse_us, info->min_pulse_us);
    if (step->pulse_us > info->max_pulse_us)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "step %u: pulse %u us: %u us longer than the controller's %u us", i,
                       step->pulse_us, step->pulse_us - info->max_pulse_us, info->max_pulse_us);
    uint32_t over = step->pulse_us % info->pwm_period_us;
    if (over && is_dimmed(&program->conditions[step->condition]))
        return ls_fail(diag, LS_ERR_LIMIT,
                       "step %u: dimmed pulse of %u us is %u us over a whole number of the "
                       "controller's PWM periods of %u us: use %u us",
                       i, step->pulse_us, over, info->pwm_period_us,
                       step->pulse_us - over ? step->pulse_us - over : info->pwm_period_us);
    return LS_OK;
}

static enum ls_err test_step(const struct ls_lights_info *info, const struct ls_program *program,
                             uint32_t i, struct ls_diag *diag)
{
    const struct ls_step *step = &program->steps[i];
    if (step->condition >= program->n_conditions)
        return ls_fail(diag, LS_ERR_INVALID, "step %u: condition %u: expected 0..%u", i,
                       step->condition, program->n_conditions - 1);
    if (step->flags & ~(uint32_t)LS_STEP_HOLD)
        return ls_fail(diag, LS_ERR_INVALID, "step %u: unknown flags %#x", i, step->flags);
    if (step->settle_us > MAX_TIME_US)
        return ls_fail(diag, LS_ERR_INVALID, "step %u: settle time %u us: expected 0..%u", i,
                       step->settle_us, MAX_TIME_US);
    return test_pulse(info, program, i, diag);
}

static enum ls_err over_duty(const struct window *window, uint64_t on, uint32_t step,
                             uint32_t light, uint32_t channel, struct ls_diag *diag)
{
    return ls_fail(
        diag, LS_ERR_LIMIT,
        "step %u: light address %u channel %u would be on for %.3f ms of a second, %.3f ms over "
        "the controller's %.3f ms: lengthen the period or shorten the pulses",
        step, light, channel, (double)on / FULL / 1e3, (double)(on - window->limit) / FULL / 1e3,
        (double)window->limit / FULL / 1e3);
}

static void window_add(struct window *window, const struct ls_lights_info *info,
                       const struct ls_condition *c, int64_t us)
{
    window->total += (uint64_t)us * levels_of(info, c);
    for (uint32_t k = 0; k < c->n_leds; k++) {
        const struct ls_led *led = &c->leds[k];
        uint64_t on = (uint64_t)(us * led->level);
        if (c->kind == LS_CONDITION_SPHERE)
            window->sphere[led->channel] += on;
        else
            window->led[led->light * info->n_channels + led->channel] += on;
    }
}

/** @what of @on, us x level over a second, of all LEDs together. */
static enum ls_err test_power(const struct ls_lights_info *info, const char *what, uint64_t on,
                              struct ls_diag *diag)
{
    double w = (double)on / FULL / SECOND_US * info->led_power_mw / 1e3;
    double limit_w = info->max_power_mw / 1e3;
    if (w > limit_w)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "%s: the dome would draw %.2f W, mean over a second, %.2f W over the "
                       "controller's %.2f W: dim it, lengthen the period or shorten the pulses",
                       what, w, w - limit_w, limit_w);
    return LS_OK;
}

static enum ls_err window_test(const struct window *window, const struct ls_lights_info *info,
                               const struct ls_condition *c, uint32_t step, struct ls_diag *diag)
{
    bool sphere = c->kind == LS_CONDITION_SPHERE;
    for (uint32_t k = 0; k < (sphere ? info->n_lights : c->n_leds); k++) {
        const struct ls_led *led = &c->leds[sphere ? 0 : k];
        uint32_t light = sphere ? k : led->light;
        uint64_t on =
            window->led[light * info->n_channels + led->channel] + window->sphere[led->channel];
        if (on > window->limit)
            return over_duty(window, on, step, light, led->channel, diag);
    }
    char what[24];
    snprintf(what, sizeof what, "step %u", step);
    return test_power(info, what, window->total, diag);
}

static uint64_t next_start(const struct ls_program *program, uint32_t i, uint64_t start)
{
    uint64_t dark = (uint64_t)program->steps[i - 1].pulse_us + program->steps[i].settle_us;
    return start + (dark > program->period_us ? dark : program->period_us);
}

static enum ls_err test_limits_over_time(const struct ls_lights_info *info,
                                         const struct ls_program *program, struct window *window,
                                         struct ls_diag *diag)
{
    uint64_t start = SECOND_US, tail_start = SECOND_US;
    uint32_t tail = 0;
    for (uint32_t i = 0; i < program->n_steps; i++) {
        const struct ls_step *step = &program->steps[i];
        start = i ? next_start(program, i, start) : start;
        for (; tail_start + SECOND_US <= start;
             tail_start = next_start(program, tail, tail_start)) {
            const struct ls_step *old = &program->steps[tail++];
            window_add(window, info, &program->conditions[old->condition], -(int64_t)old->pulse_us);
        }
        const struct ls_condition *condition = &program->conditions[step->condition];
        window_add(window, info, condition, step->pulse_us);
        enum ls_err err = window_test(window, info, condition, i, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

static enum ls_err test_capacity(const struct ls_lights_info *info,
                                 const struct ls_program *program, struct ls_diag *diag)
{
    if (!program->n_conditions || !program->n_steps)
        return ls_fail(diag, LS_ERR_INVALID,
                       "program of %u conditions and %u steps: expected at least one of each",
                       program->n_conditions, program->n_steps);
    uint32_t conditions = info->max_conditions < UINT16_MAX ? info->max_conditions : UINT16_MAX;
    if (program->n_conditions > conditions)
        return ls_fail(diag, LS_ERR_LIMIT, "%u conditions: %u more than the controller's %u",
                       program->n_conditions, program->n_conditions - conditions, conditions);
    if (program->n_steps > info->max_steps)
        return ls_fail(diag, LS_ERR_LIMIT, "%u steps: %u more than the controller's %u",
                       program->n_steps, program->n_steps - info->max_steps, info->max_steps);
    if (program->period_us < info->min_period_us)
        return ls_fail(
            diag, LS_ERR_LIMIT, "period %u us: %u us shorter than the controller's %u us",
            program->period_us, info->min_period_us - program->period_us, info->min_period_us);
    if (program->period_us > MAX_TIME_US)
        return ls_fail(diag, LS_ERR_INVALID, "period %u us: expected at most %u",
                       program->period_us, MAX_TIME_US);
    return LS_OK;
}

static enum ls_err test_memory(const struct ls_lights_info *info, const struct ls_program *program,
                               struct ls_diag *diag)
{
    size_t bytes = 2 * ls_image_registers(program);
    if (bytes > info->max_program_bytes)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "program of %zu bytes: %zu more than the controller's memory of %u", bytes,
                       bytes - info->max_program_bytes, info->max_program_bytes);
    return LS_OK;
}

static enum ls_err test_all(const struct ls_lights_info *info, const struct ls_program *program,
                            struct window *window, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; !err && i < program->n_conditions; i++)
        err = test_condition(info, &program->conditions[i], i, window->seen, diag);
    if (!err)
        err = test_memory(info, program, diag);
    for (uint32_t i = 0; !err && i < program->n_steps; i++)
        err = test_step(info, program, i, diag);
    return err ? err : test_limits_over_time(info, program, window, diag);
}

enum ls_err ls_lights_test(const struct ls_lights_info *info, const struct ls_program *program,
                           struct ls_diag *diag)
{
    enum ls_err err = test_capacity(info, program, diag);
    if (err)
        return err;
    struct window window = {0};
    err = window_init(&window, info, diag);
    if (!err)
        err = test_all(info, program, &window, diag);
    window_finish(&window);
    return err;
}

enum ls_err ls_lights_test_work(const struct ls_lights_info *info, uint16_t channel, uint16_t level,
                                struct ls_diag *diag)
{
    uint64_t levels = (uint64_t)level * info->n_lights;
    uint64_t most = (uint64_t)info->max_duty_permille * FULL / 1000;
    if (channel >= info->n_channels)
        return ls_fail(diag, LS_ERR_INVALID, "work light: channel %u: expected 0..%u", channel,
                       info->n_channels - 1);
    if (level > most)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "work light: level %u: %" PRIu64 " over %" PRIu64
                       ", the controller's duty of %u permille",
                       level, level - most, most, info->max_duty_permille);
    enum ls_err err = test_current(info, "work light", levels, diag);
    return err ? err : test_power(info, "work light", levels * SECOND_US, diag);
}

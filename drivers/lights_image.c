#include "drivers/lights_image.h"

#include <stdio.h>
#include <string.h>

size_t ls_image_condition_registers(const struct ls_condition *condition)
{
    switch (condition->kind) {
    case LS_CONDITION_DARK:
        return 1;
    case LS_CONDITION_ONE:
        return 4;
    case LS_CONDITION_SPHERE:
        return 3;
    case LS_CONDITION_SEGMENT:
        return 4 + (size_t)condition->n_leds;
    case LS_CONDITION_LIST:
        return 2 + 3 * (size_t)condition->n_leds;
    }
    return 0;
}

size_t ls_image_registers(const struct ls_program *program)
{
    size_t n = LS_WIRE_IM_SIZE + (size_t)LS_WIRE_STEP_SIZE * program->n_steps;
    for (uint32_t i = 0; i < program->n_conditions; i++)
        n += ls_image_condition_registers(&program->conditions[i]);
    return n;
}

static uint16_t *put_led(uint16_t *at, const struct ls_led *led)
{
    *at++ = led->light;
    *at++ = led->channel;
    *at++ = led->level;
    return at;
}

static uint16_t *put_condition(uint16_t *at, const struct ls_condition *condition)
{
    const struct ls_led *leds = condition->leds;
    *at++ = (uint16_t)condition->kind;
    switch (condition->kind) {
    case LS_CONDITION_DARK:
        break;
    case LS_CONDITION_ONE:
        at = put_led(at, leds);
        break;
    case LS_CONDITION_SPHERE:
        *at++ = leds->channel;
        *at++ = leds->level;
        break;
    case LS_CONDITION_SEGMENT:
        *at++ = (uint16_t)condition->n_leds;
        *at++ = leds->channel;
        *at++ = leds->level;
        for (uint32_t i = 0; i < condition->n_leds; i++)
            *at++ = leds[i].light;
        break;
    case LS_CONDITION_LIST:
        *at++ = (uint16_t)condition->n_leds;
        for (uint32_t i = 0; i < condition->n_leds; i++)
            at = put_led(at, &leds[i]);
        break;
    }
    return at;
}

static uint16_t *put_step(uint16_t *at, const struct ls_step *step)
{
    at[LS_WIRE_STEP_CONDITION] = (uint16_t)step->condition;
    at[LS_WIRE_STEP_FLAGS] = step->flags & LS_STEP_HOLD ? LS_WIRE_STEP_HOLD : 0;
    ls_wire_put32(at + LS_WIRE_STEP_PULSE_US, step->pulse_us);
    ls_wire_put32(at + LS_WIRE_STEP_SETTLE_US, step->settle_us);
    return at + LS_WIRE_STEP_SIZE;
}

size_t ls_image_encode(const struct ls_program *program, uint16_t *image)
{
    image[LS_WIRE_IM_MAGIC] = LS_WIRE_IMAGE_MAGIC;
    image[LS_WIRE_IM_CONTRACT] = LS_WIRE_CONTRACT;
    ls_wire_put32(image + LS_WIRE_IM_CONDITIONS, program->n_conditions);
    ls_wire_put32(image + LS_WIRE_IM_STEPS, program->n_steps);
    ls_wire_put32(image + LS_WIRE_IM_PERIOD_US, program->period_us);
    uint16_t *at = image + LS_WIRE_IM_SIZE;
    for (uint32_t i = 0; i < program->n_conditions; i++)
        at = put_condition(at, &program->conditions[i]);
    for (uint32_t i = 0; i < program->n_steps; i++)
        at = put_step(at, &program->steps[i]);
    return (size_t)(at - image);
}

static void decode_serial(const uint16_t *regs, char serial[32])
{
    for (int i = 0; i < 16; i++) {
        serial[2 * i] = (char)(regs[i] >> 8);
        serial[2 * i + 1] = (char)(regs[i] & 0xff);
    }
    serial[31] = '\0';
    for (char *c = serial; *c; c++)
        if (*c < ' ' || *c > '~')
            *c = '?';
}

static void decode_limits(const uint16_t *regs, struct ls_lights_info *info)
{
    info->n_lights = ls_wire_get32(regs + LS_WIRE_LIM_LIGHTS);
    info->n_channels = ls_wire_get32(regs + LS_WIRE_LIM_CHANNELS);
    info->pwm_period_us = ls_wire_get32(regs + LS_WIRE_LIM_PWM_PERIOD_US);
    info->pwm_levels = ls_wire_get32(regs + LS_WIRE_LIM_PWM_LEVELS);
    info->min_pulse_us = ls_wire_get32(regs + LS_WIRE_LIM_MIN_PULSE_US);
    info->max_pulse_us = ls_wire_get32(regs + LS_WIRE_LIM_MAX_PULSE_US);
    info->min_period_us = ls_wire_get32(regs + LS_WIRE_LIM_MIN_PERIOD_US);
    info->max_duty_permille = ls_wire_get32(regs + LS_WIRE_LIM_DUTY_PERMILLE);
    info->max_current_ma = ls_wire_get32(regs + LS_WIRE_LIM_CURRENT_MA);
    info->led_current_ma = ls_wire_get32(regs + LS_WIRE_LIM_LED_CURRENT_MA);
    info->max_conditions = ls_wire_get32(regs + LS_WIRE_LIM_CONDITIONS);
    info->max_steps = ls_wire_get32(regs + LS_WIRE_LIM_STEPS);
    info->max_program_bytes = ls_wire_get32(regs + LS_WIRE_LIM_PROGRAM_BYTES);
    info->max_hold_us = ls_wire_get32(regs + LS_WIRE_LIM_HOLD_US);
    info->heartbeat_ms = ls_wire_get32(regs + LS_WIRE_LIM_HEARTBEAT_MS);
    info->max_power_mw = ls_wire_get32(regs + LS_WIRE_LIM_POWER_MW);
    info->led_power_mw = ls_wire_get32(regs + LS_WIRE_LIM_LED_POWER_MW);
    info->hot_c = ls_wire_get32(regs + LS_WIRE_LIM_HOT_C);
    info->max_c = ls_wire_get32(regs + LS_WIRE_LIM_MAX_C);
}

enum ls_err ls_wire_decode_info(const uint16_t identity[LS_WIRE_IDENTITY_SIZE],
                                const uint16_t limits[LS_WIRE_LIMITS_SIZE],
                                struct ls_lights_info *info, struct ls_diag *diag)
{
    if (identity[0] != LS_WIRE_MAGIC_0 || identity[1] != LS_WIRE_MAGIC_1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "registers 0 and 1 read %04x %04x: expected 4c53 4443 of a dome controller; "
                       "some other device answers at this address",
                       identity[0], identity[1]);
    if (identity[LS_WIRE_ID_CONTRACT] != LS_WIRE_CONTRACT)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the controller speaks contract version %u: expected %u",
                       identity[LS_WIRE_ID_CONTRACT], LS_WIRE_CONTRACT);
    memset(info, 0, sizeof *info);
    info->contract = identity[LS_WIRE_ID_CONTRACT];
    info->firmware = ls_wire_get32(identity + LS_WIRE_ID_FIRMWARE);
    decode_serial(identity + LS_WIRE_ID_SERIAL, info->serial);
    decode_limits(limits, info);
    if (info->n_lights < 1 || info->n_lights > 65535 || info->n_channels < 1 ||
        info->n_channels > 64 || info->pwm_period_us < 1 || info->pwm_levels < 2)
        return ls_fail(diag, LS_ERR_INVALID,
                       "controller %s reports %u lights of %u channels, a PWM period of %u us and "
                       "%u levels: expected 1..65535, 1..64, 1.., 2..",
                       info->serial, info->n_lights, info->n_channels, info->pwm_period_us,
                       info->pwm_levels);
    return LS_OK;
}

static enum ls_lights_state decode_state(uint16_t state)
{
    switch (state) {
    case LS_WIRE_IDLE:
    case LS_WIRE_PREPARING:
        return LS_LIGHTS_IDLE;
    case LS_WIRE_LOADED:
        return LS_LIGHTS_LOADED;
    case LS_WIRE_ARMED:
        return LS_LIGHTS_ARMED;
    case LS_WIRE_DONE:
        return LS_LIGHTS_DONE;
    default:
        return LS_LIGHTS_FAULT;
    }
}

void ls_wire_decode_status(const uint16_t regs[LS_WIRE_STATUS_SIZE],
                           struct ls_lights_status *status)
{
    status->state = decode_state(regs[LS_WIRE_ST_STATE]);
    status->faults = regs[LS_WIRE_ST_FAULTS];
    status->holding = regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_HOLDING;
    status->work_light = regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_WORK;
    status->interlock_open = regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_INTERLOCK_OPEN;
    status->estop_pressed = regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_ESTOP_PRESSED;
    status->hot = regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_HOT;
    status->fired = ls_wire_get32(regs + LS_WIRE_ST_FIRED);
    status->granted = ls_wire_get32(regs + LS_WIRE_ST_GRANTED);
    status->missed_triggers = ls_wire_get32(regs + LS_WIRE_ST_MISSED);
    status->events_lost = ls_wire_get32(regs + LS_WIRE_ST_EVENTS_LOST);
    status->temperature_c = (int16_t)regs[LS_WIRE_ST_TEMPERATURE];
    status->now_us = ls_wire_get64(regs + LS_WIRE_ST_NOW_US);
}

void ls_wire_decode_event(const uint16_t *regs, struct ls_step_event *event)
{
    event->step = ls_wire_get32(regs + LS_WIRE_EV_STEP);
    event->us = ls_wire_get64(regs + LS_WIRE_EV_US);
    event->width_us = ls_wire_get32(regs + LS_WIRE_EV_WIDTH_US);
    event->flags = regs[LS_WIRE_EV_FLAGS];
}

static const char *state_name(uint32_t state)
{
    static const char *const names[] = {"idle", "loaded",  "armed",
                                        "done", "faulted", "preparing a program"};
    return state < sizeof names / sizeof *names ? names[state] : "in an unknown state";
}

static void fault_names(uint32_t faults, char *text, size_t size)
{
    static const char *const names[] = {"interlock open", "E-stop pressed", "too hot",
                                        "over current",   "over duty",      "host was silent",
                                        "bad program",    "over power"};
    size_t at = 0;
    text[0] = '\0';
    for (unsigned i = 0; i < sizeof names / sizeof *names && at < size; i++)
        if (faults & 1u << i)
            at += (size_t)snprintf(text + at, size - at, "%s%s", at ? ", " : "", names[i]);
}

enum ls_err ls_wire_refused(const uint16_t status[LS_WIRE_STATUS_SIZE], const char *doing,
                            struct ls_diag *diag)
{
    static const char *const reasons[] = {
        [LS_WIRE_REFUSED_NOT] = "no reason given",
        [LS_WIRE_REFUSED_VALUE] = "value out of range",
        [LS_WIRE_REFUSED_CRC] = "the program's CRC does not match",
        [LS_WIRE_REFUSED_COUNTS] = "the program's counts disagree or exceed its memory",
        [LS_WIRE_REFUSED_FORMAT] = "malformed program at register",
        [LS_WIRE_REFUSED_LIGHT] = "no such light in condition",
        [LS_WIRE_REFUSED_CHANNEL] = "no such channel in condition",
        [LS_WIRE_REFUSED_CURRENT] = "over current in condition",
        [LS_WIRE_REFUSED_CONDITION] = "no such condition in step",
        [LS_WIRE_REFUSED_PULSE] = "pulse too short or too long in step",
        [LS_WIRE_REFUSED_PWM] = "dimmed pulse is not a whole number of PWM periods in step",
        [LS_WIRE_REFUSED_PERIOD] = "period too short",
        [LS_WIRE_REFUSED_DUTY] = "an LED is on for too long within a second at step",
        [LS_WIRE_REFUSED_UNPREPARED] = "it could not get ready for the program",
        [LS_WIRE_REFUSED_POWER] = "the dome draws too much power within a second at step",
    };
    unsigned reason = status[LS_WIRE_ST_REFUSAL];
    uint32_t detail = ls_wire_get32(status + LS_WIRE_ST_DETAIL);
    char faults[160];
    fault_names(status[LS_WIRE_ST_FAULTS], faults, sizeof faults);
    if (reason == LS_WIRE_REFUSED_STATE)
        return ls_fail(diag, LS_ERR_REFUSED, "%s: refused by the controller: it is %s%s%s", doing,
                       state_name(detail), faults[0] ? "; latched: " : "", faults);
    if (reason == LS_WIRE_REFUSED_FAULT)
        return ls_fail(
            diag, LS_ERR_REFUSED,
            "%s: refused by the controller: latched: %s; remove the cause and load again", doing,
            faults);
    bool known = reason < sizeof reasons / sizeof *reasons && reasons[reason];
    return ls_fail(diag, LS_ERR_REFUSED, "%s: refused by the controller: %s (reason %u, detail %u)",
                   doing, known ? reasons[reason] : "unknown reason", reason, detail);
}

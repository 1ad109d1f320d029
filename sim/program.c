#include "sim/program.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct reader {
    const struct sim_controller_config *config;
    const uint16_t *image;
    size_t n, at;
    struct sim_refusal *refusal;
};

static int refuse(struct reader *r, uint16_t reason, size_t detail, uint16_t faults)
{
    *r->refusal = (struct sim_refusal){reason, (uint32_t)detail, faults};
    return -1;
}

static int malformed(struct reader *r)
{
    return refuse(r, LS_WIRE_REFUSED_FORMAT, r->at, LS_WIRE_FAULT_PROGRAM);
}

static float quantise(const struct sim_controller_config *config, uint16_t level)
{
    double steps = config->pwm_levels - 1;
    return (float)(round(level / 65535.0 * steps) / steps);
}

static int read_header(struct reader *r, struct sim_program *p)
{
    if (r->n < LS_WIRE_IM_SIZE || r->image[LS_WIRE_IM_MAGIC] != LS_WIRE_IMAGE_MAGIC ||
        r->image[LS_WIRE_IM_CONTRACT] != LS_WIRE_CONTRACT)
        return malformed(r);
    p->n_conditions = ls_wire_get32(r->image + LS_WIRE_IM_CONDITIONS);
    p->n_steps = ls_wire_get32(r->image + LS_WIRE_IM_STEPS);
    p->period_us = ls_wire_get32(r->image + LS_WIRE_IM_PERIOD_US);
    r->at = LS_WIRE_IM_SIZE;
    if (!p->n_conditions || !p->n_steps || p->n_conditions > r->config->max_conditions ||
        p->n_steps > r->config->max_steps)
        return refuse(r, LS_WIRE_REFUSED_COUNTS, 0, LS_WIRE_FAULT_PROGRAM);
    if (p->period_us < r->config->min_period_us || p->period_us > 1u << 30)
        return refuse(r, LS_WIRE_REFUSED_PERIOD, p->period_us, LS_WIRE_FAULT_PROGRAM);
    return 0;
}

/** Shape of the record at r->at: LEDs it lights and registers it takes. */
static int measure(struct reader *r, uint32_t *n_leds, size_t *n_regs)
{
    static const uint8_t head[] = {1, 4, 3, 4, 2};
    size_t left = r->n - r->at;
    uint16_t kind = left ? r->image[r->at] : UINT16_MAX;
    if (kind > LS_WIRE_CONDITION_LIST || left < head[kind])
        return malformed(r);
    uint32_t count = kind >= LS_WIRE_CONDITION_SEGMENT ? r->image[r->at + 1] : 0;
    bool counted = kind >= LS_WIRE_CONDITION_SEGMENT;
    *n_regs = head[kind] + (size_t)count * (kind == LS_WIRE_CONDITION_LIST ? 3 : 1);
    *n_leds = counted                            ? count
              : kind == LS_WIRE_CONDITION_SPHERE ? r->config->n_lights
                                                 : kind == LS_WIRE_CONDITION_ONE;
    if (*n_regs > left || (counted && !count) ||
        count > r->config->n_lights * r->config->n_channels)
        return malformed(r);
    return 0;
}

static struct sim_led led_of(struct reader *r, const uint16_t *record, uint32_t k, uint16_t *level)
{
    const uint16_t *led = record + 2 + 3 * (size_t)k;
    switch (record[0]) {
    case LS_WIRE_CONDITION_ONE:
        *level = record[3];
        return (struct sim_led){record[1], record[2], quantise(r->config, record[3])};
    case LS_WIRE_CONDITION_SPHERE:
        *level = record[2];
        return (struct sim_led){(uint16_t)k, record[1], quantise(r->config, record[2])};
    case LS_WIRE_CONDITION_SEGMENT:
        *level = record[3];
        return (struct sim_led){record[4 + k], record[2], quantise(r->config, record[3])};
    default:
        *level = led[2];
        return (struct sim_led){led[0], led[1], quantise(r->config, led[2])};
    }
}

static int read_leds(struct reader *r, uint32_t i, struct sim_program *p, uint32_t *seen)
{
    const uint16_t *record = r->image + r->at;
    const struct sim_condition *c = &p->conditions[i];
    uint64_t levels = 0;
    for (uint32_t k = 0; k < c->n_leds; k++) {
        uint16_t level;
        struct sim_led led = led_of(r, record, k, &level);
        if (led.light >= r->config->n_lights)
            return refuse(r, LS_WIRE_REFUSED_LIGHT, i, LS_WIRE_FAULT_PROGRAM);
        if (led.channel >= r->config->n_channels)
            return refuse(r, LS_WIRE_REFUSED_CHANNEL, i, LS_WIRE_FAULT_PROGRAM);
        uint32_t *stamp = &seen[led.light * r->config->n_channels + led.channel];
        if (*stamp == i + 1)
            return malformed(r);
        *stamp = i + 1;
        levels += level;
        p->max_duty[i] = fmaxf(p->max_duty[i], led.duty);
        p->levels[i][k] = level;
        c->leds[k] = led;
    }
    p->total[i] = levels;
    if (levels * r->config->led_current_ma > (uint64_t)r->config->max_current_ma * 65535)
        return refuse(r, LS_WIRE_REFUSED_CURRENT, i, LS_WIRE_FAULT_OVERCURRENT);
    return 0;
}

static int no_memory(struct reader *r)
{
    return refuse(r, LS_WIRE_REFUSED_COUNTS, 0, LS_WIRE_FAULT_PROGRAM);
}

static int read_conditions(struct reader *r, struct sim_program *p)
{
    LS_CLEANUP_FREE uint32_t *seen =
        calloc((size_t)r->config->n_lights * r->config->n_channels, sizeof *seen);
    p->conditions = calloc(p->n_conditions, sizeof *p->conditions);
    p->max_duty = calloc(p->n_conditions, sizeof *p->max_duty);
    p->levels = calloc(p->n_conditions, sizeof *p->levels);
    p->total = calloc(p->n_conditions, sizeof *p->total);
    if (!seen || !p->conditions || !p->max_duty || !p->levels || !p->total)
        return no_memory(r);
    for (uint32_t i = 0; i < p->n_conditions; i++) {
        struct sim_condition *c = &p->conditions[i];
        size_t n_regs;
        if (measure(r, &c->n_leds, &n_regs))
            return -1;
        c->kind = r->image[r->at];
        c->leds = calloc(c->n_leds ? c->n_leds : 1, sizeof *c->leds);
        p->levels[i] = calloc(c->n_leds ? c->n_leds : 1, sizeof *p->levels[i]);
        if (!c->leds || !p->levels[i])
            return no_memory(r);
        if (read_leds(r, i, p, seen))
            return -1;
        r->at += n_regs;
    }
    return 0;
}

static bool is_dimmed(const struct sim_condition *c)
{
    for (uint32_t k = 0; k < c->n_leds; k++)
        if (c->leds[k].duty < 1.0f)
            return true;
    return false;
}

static int check_step(struct reader *r, const struct sim_program *p, uint32_t i)
{
    const struct sim_step *s = &p->steps[i];
    if (s->condition >= p->n_conditions)
        return refuse(r, LS_WIRE_REFUSED_CONDITION, i, LS_WIRE_FAULT_PROGRAM);
    if (s->flags & ~(uint32_t)LS_WIRE_STEP_HOLD || s->settle_us > 1u << 30)
        return malformed(r);
    if (s->pulse_us < r->config->min_pulse_us || s->pulse_us > r->config->max_pulse_us)
        return refuse(r, LS_WIRE_REFUSED_PULSE, i, LS_WIRE_FAULT_PROGRAM);
    if (s->pulse_us % r->config->pwm_period_us && is_dimmed(&p->conditions[s->condition]))
        return refuse(r, LS_WIRE_REFUSED_PWM, i, LS_WIRE_FAULT_PROGRAM);
    return 0;
}

static int read_steps(struct reader *r, struct sim_program *p)
{
    if (r->n - r->at != (size_t)p->n_steps * LS_WIRE_STEP_SIZE)
        return malformed(r);
    p->steps = calloc(p->n_steps, sizeof *p->steps);
    if (!p->steps)
        return no_memory(r);
    for (uint32_t i = 0; i < p->n_steps; i++, r->at += LS_WIRE_STEP_SIZE) {
        const uint16_t *record = r->image + r->at;
        p->steps[i] = (struct sim_step){
            record[LS_WIRE_STEP_CONDITION], ls_wire_get32(record + LS_WIRE_STEP_PULSE_US),
            ls_wire_get32(record + LS_WIRE_STEP_SETTLE_US), record[LS_WIRE_STEP_FLAGS]};
        if (check_step(r, p, i))
            return -1;
    }
    return 0;
}

static uint64_t *start_times(const struct sim_program *p)
{
    uint64_t *start = calloc(p->n_steps, sizeof *start);
    for (uint32_t i = 1; start && i < p->n_steps; i++) {
        uint64_t gap = (uint64_t)p->steps[i - 1].pulse_us + p->steps[i].settle_us;
        start[i] = start[i - 1] + (gap > p->period_us ? gap : p->period_us);
    }
    return start;
}

/** Add step @i to (or take it from) the us x level of every LED; returns the most touched. */
static uint64_t heat(const struct reader *r, const struct sim_program *p, uint32_t i, bool add,
                     uint64_t *on)
{
    uint32_t index = p->steps[i].condition;
    const struct sim_condition *c = &p->conditions[index];
    uint64_t hottest = 0;
    for (uint32_t k = 0; k < c->n_leds; k++) {
        uint64_t *led = &on[c->leds[k].light * r->config->n_channels + c->leds[k].channel];
        uint64_t amount = (uint64_t)p->steps[i].pulse_us * p->levels[index][k];
        *led = add ? *led + amount : *led - amount;
        hottest = *led > hottest ? *led : hottest;
    }
    return hottest;
}

/** Does what all LEDs took within a second, @total us x level, exceed the power limit? */
static bool is_over_power(const struct reader *r, uint64_t total)
{
    return (double)total / 65535 / 1e6 * r->config->led_power_mw > r->config->max_power_mw;
}

static int check_duty_and_power(struct reader *r, const struct sim_program *p)
{
    uint64_t total = 0;
    uint64_t limit = r->config->max_duty_permille * 1000ull * 65535;
    LS_CLEANUP_FREE uint64_t *start = start_times(p);
    LS_CLEANUP_FREE uint64_t *on =
        calloc((size_t)r->config->n_lights * r->config->n_channels, sizeof *on);
    if (!start || !on)
        return no_memory(r);
    for (uint32_t i = 0, tail = 0; i < p->n_steps; i++) {
        for (; start[i] - start[tail] >= 1000000; tail++) {
            heat(r, p, tail, false, on);
            total -= p->steps[tail].pulse_us * p->total[p->steps[tail].condition];
        }
        total += p->steps[i].pulse_us * p->total[p->steps[i].condition];
        if (heat(r, p, i, true, on) > limit)
            return refuse(r, LS_WIRE_REFUSED_DUTY, i, LS_WIRE_FAULT_OVERDUTY);
        if (is_over_power(r, total))
            return refuse(r, LS_WIRE_REFUSED_POWER, i, LS_WIRE_FAULT_OVERPOWER);
    }
    return 0;
}

int sim_program_decode(const struct sim_controller_config *config, const uint16_t *image, size_t n,
                       struct sim_program *out, struct sim_refusal *refusal)
{
    struct reader r = {config, image, n, 0, refusal};
    memset(out, 0, sizeof *out);
    if (read_header(&r, out) || read_conditions(&r, out) || read_steps(&r, out) ||
        check_duty_and_power(&r, out)) {
        sim_program_finish(out);
        return -1;
    }
    out->crc = ls_wire_crc32c(image, n);
    return 0;
}

void sim_program_finish(struct sim_program *program)
{
    for (uint32_t i = 0; program->conditions && i < program->n_conditions; i++)
        free(program->conditions[i].leds);
    for (uint32_t i = 0; program->levels && i < program->n_conditions; i++)
        free(program->levels[i]);
    free(program->levels);
    free(program->total);
    free(program->conditions);
    free(program->max_duty);
    free(program->steps);
    memset(program, 0, sizeof *program);
}

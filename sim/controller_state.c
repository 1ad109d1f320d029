#include "sim/controller_private.h"

#include <string.h>

static bool is_open(uint64_t until_ns)
{
    return until_ns && (until_ns == UINT64_MAX || sim_now_ns() < until_ns);
}

bool sim_controller_is_dead(const struct sim_controller *c)
{
    return is_open(c->dead_until_ns);
}

static int refuse(struct sim_controller *c, uint16_t reason, uint32_t detail)
{
    c->refusal = (struct sim_refusal){reason, detail, 0};
    return SIM_ANSWER_REFUSED;
}

static int refuse_state(struct sim_controller *c)
{
    if (c->state == LS_WIRE_FAULT)
        return refuse(c, LS_WIRE_REFUSED_FAULT, c->faults);
    return refuse(c, LS_WIRE_REFUSED_STATE, c->state);
}

void sim_controller_show_work(struct sim_controller *c, bool on)
{
    if (c->working)
        sim_books_note_work(&c->books, &c->config, c->shown_channel, c->shown_level, c->arm,
                            sim_controller_us(c), sim_controller_us(c) - c->working_us);
    c->working = on && c->work_level;
    c->working_us = sim_controller_us(c);
    c->shown_channel = c->work_channel;
    c->shown_level = c->work_level;
    c->watched &= c->working;
    if (c->hooks.work)
        c->hooks.work(c->hooks.user, sim_now_ns(), c->work_channel,
                      c->working ? c->work_level / 65535.0 : 0);
}

static int32_t temperature_c(const struct sim_controller *c)
{
    return is_open(c->overheat_until_ns) ? c->config.max_c
           : is_open(c->heat_until_ns)   ? c->config.hot_c
                                         : c->config.temperature_c;
}

/** Causes of faults that persist. */
static uint16_t causes(const struct sim_controller *c)
{
    return (uint16_t)((is_open(c->interlock_until_ns) ? LS_WIRE_FAULT_INTERLOCK : 0) |
                      (is_open(c->estop_until_ns) ? LS_WIRE_FAULT_ESTOP : 0) |
                      (temperature_c(c) >= c->config.hot_c ? LS_WIRE_FAULT_OVERTEMP : 0));
}

void sim_controller_latch(struct sim_controller *c, uint16_t faults)
{
    c->faults |= faults;
    c->state = LS_WIRE_FAULT;
    sim_controller_show_work(c, c->faults == LS_WIRE_FAULT_HEARTBEAT);
    pthread_cond_broadcast(&c->wake);
}

static struct sim_controller_fault *
due(struct sim_controller *c, enum sim_controller_fault_kind kind, uint32_t first, uint32_t last)
{
    for (uint32_t i = 0; i < c->config.n_faults; i++) {
        struct sim_controller_fault *fault = &c->config.faults[i];
        if (fault->kind == kind && fault->at >= first && fault->at <= last && fault->count) {
            fault->count--;
            return fault;
        }
    }
    return NULL;
}

struct sim_controller_fault *sim_controller_due(struct sim_controller *c,
                                                enum sim_controller_fault_kind kind, uint32_t step)
{
    return due(c, kind, step, step);
}

struct sim_controller_fault *sim_controller_due_from(struct sim_controller *c,
                                                     enum sim_controller_fault_kind kind,
                                                     uint32_t step)
{
    return due(c, kind, 0, step);
}

static void drop_program(struct sim_controller *c)
{
    sim_program_finish(&c->program);
    if (c->state == LS_WIRE_LOADED || c->state == LS_WIRE_DONE)
        c->state = LS_WIRE_IDLE;
}

static bool is_stopped(const struct sim_controller *c)
{
    return c->state != LS_WIRE_ARMED && c->state != LS_WIRE_PREPARING && !c->lit;
}

static uint32_t control32(const struct sim_controller *c, unsigned at)
{
    return ls_wire_get32(c->control + at);
}

static int commit(struct sim_controller *c)
{
    struct sim_program program;
    uint32_t bytes = control32(c, LS_WIRE_CT_BYTES);
    if (c->state == LS_WIRE_FAULT || !is_stopped(c))
        return refuse_state(c);
    drop_program(c);
    if (bytes % 2 || bytes > c->config.max_program_bytes)
        return refuse(c, LS_WIRE_REFUSED_COUNTS, bytes);
    uint32_t crc = ls_wire_crc32c(c->memory, bytes / 2);
    if (crc != control32(c, LS_WIRE_CT_CRC))
        return refuse(c, LS_WIRE_REFUSED_CRC, crc);
    if (sim_program_decode(&c->config, c->memory, bytes / 2, &program, &c->refusal)) {
        sim_controller_latch(c, c->refusal.faults);
        return SIM_ANSWER_REFUSED;
    }
    if (program.n_conditions != control32(c, LS_WIRE_CT_CONDITIONS) ||
        program.n_steps != control32(c, LS_WIRE_CT_STEPS)) {
        sim_program_finish(&program);
        return refuse(c, LS_WIRE_REFUSED_COUNTS, 0);
    }
    c->program = program;
    c->progress = 0;
    c->state = LS_WIRE_PREPARING;
    return 0;
}

static int arm(struct sim_controller *c)
{
    if (c->state != LS_WIRE_LOADED && c->state != LS_WIRE_DONE)
        return refuse_state(c);
    if (c->lit)
        return refuse(c, LS_WIRE_REFUSED_STATE, c->state);
    if (temperature_c(c) >= c->config.max_c) {
        sim_controller_latch(c, LS_WIRE_FAULT_OVERTEMP);
        return refuse_state(c);
    }
    sim_controller_show_work(c, false);
    c->fired = c->granted = c->releases = 0;
    c->event_first = c->event_next = c->events_lost = 0;
    memset(c->control + LS_WIRE_CT_GRANT, 0, 4 * sizeof *c->control);
    c->arm++;
    c->state = LS_WIRE_ARMED;
    return 0;
}

/** A stopped run is over when the engine has put the lights out. */
static void settle(struct sim_controller *c)
{
    uint64_t limit = sim_now_ns() + 200000000u;
    while (c->state != LS_WIRE_ARMED && c->lit && sim_now_ns() < limit)
        sim_controller_wait(c, limit);
}

static int blank(struct sim_controller *c)
{
    if (c->state == LS_WIRE_ARMED || c->state == LS_WIRE_DONE)
        c->state = LS_WIRE_LOADED;
    sim_controller_show_work(c, false);
    pthread_cond_broadcast(&c->wake);
    settle(c);
    return 0;
}

static int clear_faults(struct sim_controller *c)
{
    uint16_t persist = causes(c) & c->faults;
    if (persist)
        return refuse(c, LS_WIRE_REFUSED_FAULT, persist);
    if (c->state != LS_WIRE_FAULT)
        return 0;
    c->faults = 0;
    c->state = c->program.n_steps ? LS_WIRE_LOADED : LS_WIRE_IDLE;
    return 0;
}

static int release(struct sim_controller *c)
{
    if (c->state != LS_WIRE_ARMED && c->state != LS_WIRE_DONE)
        return refuse_state(c);
    c->releases++;
    return 0;
}

static int work(struct sim_controller *c)
{
    uint16_t dangers = LS_WIRE_FAULT_INTERLOCK | LS_WIRE_FAULT_ESTOP | LS_WIRE_FAULT_OVERTEMP;
    dangers &= causes(c) | c->faults;
    if (dangers)
        return refuse(c, LS_WIRE_REFUSED_FAULT, dangers);
    if (c->state == LS_WIRE_ARMED || c->lit)
        return refuse_state(c);
    c->watched = false;
    sim_controller_show_work(c, true);
    return 0;
}

/** The engine keeps an eye on the host. */
static int steady(struct sim_controller *c)
{
    int rc = work(c);
    c->watched = !rc && c->working;
    pthread_cond_broadcast(&c->wake);
    return rc;
}

static int set_work(struct sim_controller *c, uint16_t channel, uint16_t level)
{
    double on = (double)level * c->config.n_lights / 65535;
    if (channel >= c->config.n_channels)
        return refuse(c, LS_WIRE_REFUSED_CHANNEL, channel);
    if (level > c->config.max_duty_permille * 65535u / 1000)
        return refuse(c, LS_WIRE_REFUSED_DUTY, level);
    if (on * c->config.led_current_ma > c->config.max_current_ma)
        return refuse(c, LS_WIRE_REFUSED_CURRENT, level);
    if (on * c->config.led_power_mw > c->config.max_power_mw)
        return refuse(c, LS_WIRE_REFUSED_POWER, level);
    c->work_channel = channel;
    c->work_level = level;
    if (c->working)
        sim_controller_show_work(c, true);
    return 0;
}

static int command(struct sim_controller *c, uint16_t value)
{
    switch (value) {
    case LS_WIRE_COMMIT:
        return commit(c);
    case LS_WIRE_ARM:
        return arm(c);
    case LS_WIRE_BLANK:
        return blank(c);
    case LS_WIRE_CLEAR_FAULTS:
        return clear_faults(c);
    case LS_WIRE_RELEASE:
        return release(c);
    case LS_WIRE_ALIVE:
        return 0;
    case LS_WIRE_WORK:
        return work(c);
    case LS_WIRE_STEADY:
        return steady(c);
    default:
        return refuse(c, LS_WIRE_REFUSED_VALUE, value);
    }
}

static int grant(struct sim_controller *c, uint32_t n_steps)
{
    if (c->state != LS_WIRE_ARMED && c->state != LS_WIRE_DONE)
        return refuse_state(c);
    if (n_steps > c->program.n_steps)
        return refuse(c, LS_WIRE_REFUSED_VALUE, n_steps);
    if (n_steps > c->granted && c->granted == c->fired)
        c->credit_us = sim_controller_us(c);
    if (n_steps > c->granted) { /* the same again is a repeated request, and harmless */
        c->granted = n_steps;
        c->releases++;
    }
    return 0;
}

static int acknowledge(struct sim_controller *c, uint32_t sequence)
{
    if (sequence > c->event_next)
        return refuse(c, LS_WIRE_REFUSED_VALUE, sequence);
    if (sequence > c->event_first)
        c->event_first = sequence;
    return 0;
}

/** Numbers wider than a register are written whole: half a grant is no grant. */
static int write_control(struct sim_controller *c, unsigned at, const uint16_t *regs, unsigned n)
{
    if (at % 2 || (at == LS_WIRE_CT_COMMAND ? n != 1 : n % 2))
        return SIM_ANSWER_ADDRESS;
    int rc = at == LS_WIRE_CT_COMMAND ? command(c, regs[0]) : 0;
    for (; !rc && n > 1; at += 2, regs += 2, n -= 2) {
        uint32_t value = ls_wire_get32(regs);
        if (at == LS_WIRE_CT_GRANT)
            rc = grant(c, value);
        else if (at == LS_WIRE_CT_ACK)
            rc = acknowledge(c, value);
        else if (at == LS_WIRE_CT_WORK)
            rc = set_work(c, regs[0], regs[1]);
        if (!rc)
            memcpy(c->control + at, regs, 2 * sizeof *regs);
    }
    if (!rc) {
        c->alive_ns = sim_now_ns();
        pthread_cond_broadcast(&c->wake);
    }
    return rc;
}

static int write_window(struct sim_controller *c, const uint16_t *regs, unsigned n)
{
    uint32_t address = n >= LS_WIRE_WN_DATA ? ls_wire_get32(regs) : 0;
    if (n < LS_WIRE_WN_DATA || regs[LS_WIRE_WN_LENGTH] != n - LS_WIRE_WN_DATA ||
        (uint64_t)address + regs[LS_WIRE_WN_LENGTH] > c->config.max_program_bytes / 2)
        return refuse(c, LS_WIRE_REFUSED_VALUE, address);
    c->window_address = address;
    c->window_length = n - LS_WIRE_WN_DATA;
    if (!c->window_length)
        return 0;
    if (!is_stopped(c))
        return refuse_state(c);
    drop_program(c);
    memcpy(c->memory + address, regs + LS_WIRE_WN_DATA, c->window_length * sizeof *regs);
    if (sim_controller_due(c, SIM_CONTROLLER_CORRUPT, 0))
        c->memory[address] ^= 1;
    return 0;
}

int sim_controller_write(struct sim_controller *c, unsigned address, const uint16_t *regs,
                         unsigned n)
{
    settle(c);
    if (address >= LS_WIRE_CONTROL && address + n <= LS_WIRE_CONTROL + LS_WIRE_CONTROL_SIZE)
        return write_control(c, address - LS_WIRE_CONTROL, regs, n);
    if (address == LS_WIRE_WINDOW && n <= LS_WIRE_WINDOW_SIZE)
        return write_window(c, regs, n);
    return SIM_ANSWER_ADDRESS;
}

static void fill_identity(const struct sim_controller *c, uint16_t *regs)
{
    char serial[32] = {0};
    memcpy(serial, c->config.serial, strnlen(c->config.serial, sizeof serial - 1));
    regs[0] = LS_WIRE_MAGIC_0;
    regs[1] = LS_WIRE_MAGIC_1;
    regs[LS_WIRE_ID_CONTRACT] = LS_WIRE_CONTRACT;
    ls_wire_put32(regs + LS_WIRE_ID_FIRMWARE, c->config.firmware);
    ls_wire_put32(regs + LS_WIRE_ID_BOOT, c->boot);
    for (int i = 0; i < 16; i++)
        regs[LS_WIRE_ID_SERIAL + i] =
            (uint16_t)((uint8_t)serial[2 * i] << 8 | (uint8_t)serial[2 * i + 1]);
}

static void fill_limits(const struct sim_controller *c, uint16_t *regs)
{
    const struct sim_controller_config *g = &c->config;
    const uint32_t limits[LS_WIRE_LIMITS_SIZE / 2] = {
        g->n_lights,          g->n_channels,      g->pwm_period_us,  g->pwm_levels,
        g->min_pulse_us,      g->max_pulse_us,    g->min_period_us,  g->max_duty_permille,
        g->max_current_ma,    g->led_current_ma,  g->max_conditions, g->max_steps,
        g->max_program_bytes, g->max_hold_us,     g->heartbeat_ms,   g->max_power_mw,
        g->led_power_mw,      (uint32_t)g->hot_c, (uint32_t)g->max_c};
    for (unsigned i = 0; i < LS_WIRE_LIMITS_SIZE / 2; i++)
        ls_wire_put32(regs + 2 * i, limits[i]);
}

void sim_controller_event(const struct sim_controller *c, uint32_t sequence,
                          uint16_t regs[LS_WIRE_EVENT_SIZE])
{
    const struct sim_event *event = &c->events[sequence % c->config.event_queue];
    ls_wire_put32(regs + LS_WIRE_EV_STEP, event->step);
    ls_wire_put64(regs + LS_WIRE_EV_US, event->us);
    ls_wire_put32(regs + LS_WIRE_EV_WIDTH_US, event->width_us);
    regs[LS_WIRE_EV_FLAGS] = event->flags;
    regs[LS_WIRE_EV_SEQUENCE] = (uint16_t)sequence;
}

static void fill_events(const struct sim_controller *c, uint16_t *regs)
{
    uint32_t pending = c->event_next - c->event_first;
    uint32_t n = pending < LS_WIRE_EVENTS_PER_READ ? pending : LS_WIRE_EVENTS_PER_READ;
    ls_wire_put32(regs + LS_WIRE_ST_EVENT_FIRST, c->event_first);
    regs[LS_WIRE_ST_EVENT_COUNT] = (uint16_t)n;
    regs[LS_WIRE_ST_EVENT_PENDING] = pending < UINT16_MAX ? (uint16_t)pending : UINT16_MAX;
    for (uint32_t i = 0; i < n; i++)
        sim_controller_event(c, c->event_first + i,
                             regs + LS_WIRE_ST_EVENTS + i * LS_WIRE_EVENT_SIZE);
}

static uint16_t flags(const struct sim_controller *c)
{
    return (uint16_t)((c->lit ? LS_WIRE_FLAG_LIT : 0) | (c->holding ? LS_WIRE_FLAG_HOLDING : 0) |
                      (is_open(c->interlock_until_ns) ? LS_WIRE_FLAG_INTERLOCK_OPEN : 0) |
                      (is_open(c->estop_until_ns) ? LS_WIRE_FLAG_ESTOP_PRESSED : 0) |
                      (temperature_c(c) >= c->config.hot_c ? LS_WIRE_FLAG_HOT : 0) |
                      (c->working ? LS_WIRE_FLAG_WORK : 0));
}

static void fill_status(const struct sim_controller *c, uint16_t *regs)
{
    regs[LS_WIRE_ST_STATE] = (uint16_t)c->state;
    regs[LS_WIRE_ST_FAULTS] = c->faults;
    regs[LS_WIRE_ST_FLAGS] = flags(c);
    regs[LS_WIRE_ST_TEMPERATURE] = (uint16_t)(int16_t)temperature_c(c);
    ls_wire_put32(regs + LS_WIRE_ST_BOOT, c->boot);
    regs[LS_WIRE_ST_ARM] = c->arm;
    regs[LS_WIRE_ST_PROGRESS] = (uint16_t)c->progress;
    ls_wire_put64(regs + LS_WIRE_ST_NOW_US, sim_controller_us(c));
    ls_wire_put32(regs + LS_WIRE_ST_FIRED, c->fired);
    ls_wire_put32(regs + LS_WIRE_ST_GRANTED, c->granted);
    ls_wire_put32(regs + LS_WIRE_ST_MISSED, c->missed);
    ls_wire_put32(regs + LS_WIRE_ST_EVENTS_LOST, c->events_lost);
    regs[LS_WIRE_ST_REFUSAL] = c->refusal.reason;
    ls_wire_put32(regs + LS_WIRE_ST_DETAIL, c->refusal.detail);
    ls_wire_put32(regs + LS_WIRE_ST_PROGRAM_CRC, c->program.crc);
    fill_events(c, regs);
}

static void fill_window(const struct sim_controller *c, uint16_t *regs)
{
    uint32_t left = c->config.max_program_bytes / 2 - c->window_address;
    uint32_t n = left < LS_WIRE_WINDOW_DATA ? left : LS_WIRE_WINDOW_DATA;
    ls_wire_put32(regs, c->window_address);
    regs[LS_WIRE_WN_LENGTH] = (uint16_t)n;
    memcpy(regs + LS_WIRE_WN_DATA, c->memory + c->window_address, n * sizeof *regs);
}

static void fill_control(const struct sim_controller *c, uint16_t *regs)
{
    memcpy(regs, c->control, sizeof c->control);
}

static void fill_crc(const struct sim_controller *c, uint16_t *regs)
{
    uint32_t bytes = control32(c, LS_WIRE_CT_BYTES);
    if (bytes <= c->config.max_program_bytes)
        ls_wire_put32(regs, ls_wire_crc32c(c->memory, bytes / 2));
}

int sim_controller_read(struct sim_controller *c, unsigned address, uint16_t *regs, unsigned n)
{
    static const struct {
        unsigned address, size;
        void (*fill)(const struct sim_controller *c, uint16_t *regs);
    } blocks[] = {
        {LS_WIRE_IDENTITY, LS_WIRE_IDENTITY_SIZE, fill_identity},
        {LS_WIRE_LIMITS, LS_WIRE_LIMITS_SIZE, fill_limits},
        {LS_WIRE_STATUS, LS_WIRE_STATUS_SIZE, fill_status},
        {LS_WIRE_CONTROL, LS_WIRE_CONTROL_SIZE, fill_control},
        {LS_WIRE_IMAGE_CRC, LS_WIRE_IMAGE_CRC_SIZE, fill_crc},
        {LS_WIRE_WINDOW, LS_WIRE_WINDOW_SIZE, fill_window},
    };
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
        if (address < blocks[i].address || address + n > blocks[i].address + blocks[i].size)
            continue;
        uint16_t block[SIM_MAX_REGISTERS] = {0};
        blocks[i].fill(c, block);
        memcpy(regs, block + (address - blocks[i].address), n * sizeof *regs);
        return 0;
    }
    return SIM_ANSWER_ADDRESS;
}

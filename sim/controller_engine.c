#include "sim/controller_private.h"

#include <math.h>
#include <string.h>
#include <sys/eventfd.h>

/** The engine's own memory of a run; engine thread only. */
struct run {
    uint16_t arm;
    bool started;
    uint64_t next_us;  /* one period after the last start */
    uint64_t end_us;   /* end of the last pulse */
    uint64_t ready_us; /* after cooling or a stall */
};

static uint64_t true_of(const struct sim_controller *c, uint64_t us)
{
    return sim_clock_true(&c->config.clock, us);
}

static void push_event(struct sim_controller *c, const struct sim_event *event)
{
    c->events[c->event_next++ % c->config.event_queue] = *event;
    if (c->event_next - c->event_first > c->config.event_queue) {
        c->event_first++;
        c->events_lost++;
    }
    if (c->wire->event)
        c->wire->event(c);
}

static bool is_running(const struct sim_controller *c, const struct run *run)
{
    return !c->quit && c->state == LS_WIRE_ARMED && c->arm == run->arm;
}

static uint64_t heartbeat_ns(const struct sim_controller *c)
{
    return c->alive_ns + c->config.heartbeat_ms * 1000000ull;
}

static void check_heartbeat(struct sim_controller *c)
{
    if (c->state == LS_WIRE_ARMED && sim_now_ns() >= heartbeat_ns(c))
        sim_controller_latch(c, LS_WIRE_FAULT_HEARTBEAT);
}

/** Wait until @true_ns while running. False if the run was stopped. */
static bool wait_until(struct sim_controller *c, const struct run *run, uint64_t true_ns)
{
    while (is_running(c, run) && sim_now_ns() < true_ns) {
        uint64_t limit = heartbeat_ns(c);
        sim_controller_wait(c, true_ns < limit ? true_ns : limit);
        check_heartbeat(c);
    }
    return is_running(c, run);
}

static uint64_t until_ns(double ms)
{
    return ms > 0 ? sim_now_ns() + (uint64_t)(ms * 1e6) : UINT64_MAX;
}

static void open_input(struct sim_controller *c, uint64_t *until, double ms, uint16_t fault)
{
    *until = until_ns(ms);
    sim_controller_latch(c, fault);
}

static void faults_before(struct sim_controller *c, struct run *run)
{
    const struct sim_controller_fault *fault;
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_INTERLOCK, c->fired)))
        open_input(c, &c->interlock_until_ns, fault->value, LS_WIRE_FAULT_INTERLOCK);
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_ESTOP, c->fired)))
        open_input(c, &c->estop_until_ns, fault->value, LS_WIRE_FAULT_ESTOP);
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_OVERHEAT, c->fired)))
        open_input(c, &c->overheat_until_ns, fault->value, LS_WIRE_FAULT_OVERTEMP);
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_HEAT, c->fired)))
        c->heat_until_ns = until_ns(fault->value);
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_STALL, c->fired)))
        run->ready_us = sim_controller_us(c) + (uint64_t)(fault->value * 1e3);
}

static void hang_up(struct sim_controller *c, double reconnect_ms)
{
    c->disconnect = true;
    c->reconnect_ms = reconnect_ms;
    eventfd_write(c->kick_fd, 1);
}

/** As after a power cut: all is dark and forgotten. */
static void reboot(struct sim_controller *c)
{
    c->boot += c->boot + 1 ? 1 : 2; /* never 0 */
    c->state = LS_WIRE_IDLE;
    c->faults = 0;
    c->refusal = (struct sim_refusal){0};
    c->arm = 0;
    c->fired = c->granted = c->missed = c->releases = 0;
    c->event_first = c->event_next = c->events_lost = 0;
    c->window_address = c->window_length = 0;
    c->progress = 0;
    c->halt = false;
    c->work_level = 0;
    sim_controller_show_work(c, false);
    sim_books_clear(&c->books);
    memset(c->control, 0, sizeof c->control);
    memset(c->memory, 0, c->config.max_program_bytes / 2 * sizeof *c->memory);
    sim_program_finish(&c->program);
}

static void faults_after(struct sim_controller *c, uint32_t step)
{
    const struct sim_controller_fault *fault;
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_REBOOT, step))) {
        reboot(c);
        hang_up(c, fault->value);
    }
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_DISCONNECT, step)))
        hang_up(c, fault->value);
    if (sim_controller_due(c, SIM_CONTROLLER_HALT, step))
        c->halt = true;
    if ((fault = sim_controller_due(c, SIM_CONTROLLER_DEAD, step)))
        c->dead_until_ns = until_ns(fault->value);
    if (fault)
        eventfd_write(c->kick_fd, 1);
}

static uint64_t later(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

/** Start of step c->fired by the contract's schedule, and where the limits leave room for it after
 * what was shown before this arm; *late if that is later than asked. */
static uint64_t schedule(struct sim_controller *c, const struct run *run,
                         const struct sim_step *step, bool *late)
{
    uint64_t asked = run->started ? later(run->end_us + step->settle_us, run->next_us)
                                  : c->credit_us + step->settle_us;
    uint64_t start = later(asked, later(c->credit_us, run->ready_us));
    start = sim_books_start(&c->books, &c->config, &c->program, step, c->arm, start);
    *late = start > asked;
    return start;
}

/** Lights on: hooks run without the lock, so that a blank is never kept waiting. */
static void light(struct sim_controller *c, const struct sim_step *step, uint64_t start_us)
{
    struct sim_pulse pulse = {.true_ns = true_of(c, start_us),
                              .step = c->fired,
                              .condition = step->condition,
                              .hold = step->flags & LS_WIRE_STEP_HOLD};
    pulse.pulse_us = (double)(true_of(c, start_us + step->pulse_us) - pulse.true_ns) / 1e3;
    c->lit = true;
    c->holding = pulse.hold;
    c->fired++;
    pthread_mutex_unlock(&c->lock);
    if (c->hooks.pulse)
        c->hooks.pulse(c->hooks.user, &pulse);
    pthread_mutex_lock(&c->lock);
}

/** Wait for the end of a lit step; returns it. */
static uint64_t lit_until(struct sim_controller *c, struct run *run, const struct sim_step *step,
                          uint64_t start_us, uint32_t releases)
{
    uint64_t end = start_us + step->pulse_us;
    if (!wait_until(c, run, true_of(c, end)) || !(step->flags & LS_WIRE_STEP_HOLD))
        return end;
    uint64_t limit_us = start_us + c->config.max_hold_us;
    while (is_running(c, run) && c->releases == releases && sim_controller_us(c) < limit_us) {
        uint64_t until = true_of(c, limit_us), silent = heartbeat_ns(c);
        sim_controller_wait(c, until < silent ? until : silent);
        check_heartbeat(c);
    }
    end = sim_controller_us(c);
    if (end > limit_us)
        end = limit_us;
    return end < start_us + step->pulse_us ? start_us + step->pulse_us : end;
}

/** Lights off, and tell. */
static void extinguish(struct sim_controller *c, const struct sim_step *step,
                       struct sim_event event, uint64_t end_us, bool cut)
{
    uint64_t now_us = sim_controller_us(c);
    if (cut && now_us < end_us) {
        end_us = now_us > event.us ? now_us : event.us;
        event.flags |= LS_WIRE_EVENT_CLIPPED;
    }
    event.width_us = (uint32_t)(end_us - event.us);
    push_event(c, &event);
    sim_books_note(&c->books, &c->config, &c->program, step->condition, c->arm, event.us,
                   event.width_us);
    c->holding = false;
    pthread_mutex_unlock(&c->lock);
    if (event.flags & LS_WIRE_EVENT_CLIPPED && c->hooks.dark)
        c->hooks.dark(c->hooks.user, true_of(c, end_us));
    else if (step->flags & LS_WIRE_STEP_HOLD && c->hooks.release)
        c->hooks.release(c->hooks.user, true_of(c, end_us), event.step);
    pthread_mutex_lock(&c->lock);
    c->lit = false;
    pthread_cond_broadcast(&c->wake);
}

/** As much dark after a hold as the limits of duty and power ask of its width. */
static uint64_t cooled_us(const struct sim_controller *c, const struct sim_step *step,
                          uint64_t width_us)
{
    if (!(step->flags & LS_WIRE_STEP_HOLD))
        return 0;
    double duty = (double)c->program.max_duty[step->condition] * 1000 / c->config.max_duty_permille;
    double power = (double)c->program.total[step->condition] / 65535 * c->config.led_power_mw /
                   c->config.max_power_mw;
    return (uint64_t)((double)width_us * fmax(duty, power));
}

static void fire(struct sim_controller *c, struct run *run)
{
    const struct sim_step step = c->program.steps[c->fired];
    bool late, last = c->fired + 1 == c->program.n_steps;
    uint32_t period_us = c->program.period_us;
    struct sim_event event = {.step = c->fired, .us = schedule(c, run, &step, &late)};
    event.flags = late ? LS_WIRE_EVENT_LATE : 0;
    if (!wait_until(c, run, true_of(c, event.us)))
        return;
    uint32_t releases = c->releases;
    light(c, &step, event.us);
    uint64_t end_us = lit_until(c, run, &step, event.us, releases);
    bool running = is_running(c, run);
    run->started = true;
    run->end_us = end_us;
    run->next_us = event.us + period_us;
    run->ready_us = running ? event.us + cooled_us(c, &step, end_us - event.us) : 0;
    if (last && running)
        c->state = LS_WIRE_DONE;
    extinguish(c, &step, event, end_us, !running);
    faults_after(c, event.step);
}

static void run_armed(struct sim_controller *c, struct run *run)
{
    while (is_running(c, run)) {
        check_heartbeat(c);
        if (!is_running(c, run))
            break;
        if (c->fired < c->granted) {
            faults_before(c, run);
            if (is_running(c, run))
                fire(c, run);
        } else {
            sim_controller_wait(c, heartbeat_ns(c));
        }
    }
}

void *sim_controller_engine(void *controller)
{
    struct sim_controller *c = controller;
    pthread_mutex_lock(&c->lock);
    while (!c->quit) {
        if (c->state == LS_WIRE_ARMED) {
            struct run run = {.arm = c->arm};
            run_armed(c, &run);
        } else {
            sim_controller_wait(c, c->watched ? heartbeat_ns(c) : UINT64_MAX);
            if (c->watched && sim_now_ns() >= heartbeat_ns(c))
                sim_controller_show_work(c, false);
        }
    }
    pthread_mutex_unlock(&c->lock);
    return NULL;
}

static void prepare(struct sim_controller *c)
{
    bool refused = false;
    for (uint32_t i = 0; i < c->config.n_faults && !refused; i++) {
        struct sim_controller_fault *fault = &c->config.faults[i];
        refused = fault->kind == SIM_CONTROLLER_REFUSE && fault->count && fault->count--;
    }
    pthread_mutex_unlock(&c->lock);
    struct ls_diag diag = {0};
    if (!refused && c->hooks.commit)
        refused = c->hooks.commit(c->hooks.user, c->program.conditions, c->program.n_conditions,
                                  &c->progress, &diag) != LS_OK;
    pthread_mutex_lock(&c->lock);
    if (refused) {
        c->refusal = (struct sim_refusal){.reason = LS_WIRE_REFUSED_UNPREPARED};
        sim_program_finish(&c->program);
    }
    c->progress = 1000;
    c->state = refused ? LS_WIRE_IDLE : LS_WIRE_LOADED;
}

void *sim_controller_preparation(void *controller)
{
    struct sim_controller *c = controller;
    pthread_mutex_lock(&c->lock);
    while (!c->quit) {
        if (c->state == LS_WIRE_PREPARING)
            prepare(c);
        else
            sim_controller_wait(c, UINT64_MAX);
    }
    pthread_mutex_unlock(&c->lock);
    return NULL;
}

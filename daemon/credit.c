#include "daemon/credit.h"

enum { FLASHING_PERIOD_US = 33333 }; /* 30 Hz */

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

uint32_t ls_credit_window(uint64_t patience_us, uint32_t under_way, uint64_t latency_us)
{
    uint64_t steps = patience_us / 2 * under_way / (latency_us ? latency_us : 1);
    return steps < 1 ? 1 : steps > UINT32_MAX ? UINT32_MAX : (uint32_t)steps;
}

uint32_t ls_credit_first_window(uint64_t patience_us, uint32_t period_us)
{
    uint32_t steps = ls_credit_window(patience_us, 1, period_us);
    return steps < LS_CREDIT_LEAST ? LS_CREDIT_LEAST : steps;
}

uint32_t ls_credit_limit(const struct ls_credit_camera *cameras, uint32_t n_cameras,
                         uint32_t n_steps)
{
    uint32_t limit = n_steps;
    for (uint32_t i = 0; i < n_cameras; i++) {
        uint32_t queued = cameras[i].queued;
        uint32_t room = queued > LS_CREDIT_SPARE ? queued - LS_CREDIT_SPARE : 0;
        limit = least(limit, cameras[i].settled + least(room, cameras[i].window));
    }
    return limit;
}

static bool is_dark(const struct ls_program *program, uint32_t step)
{
    return program->conditions[program->steps[step].condition].kind == LS_CONDITION_DARK;
}

/* The first steps from @from on that are dark for so long that what follows is a flash. */
static void find_break(struct ls_credit *credit, uint32_t from)
{
    const struct ls_program *p = credit->program;
    uint32_t end = from;
    for (bool found = false; !found; from = found ? from : end + 1) {
        for (end = from; end < p->n_steps && is_dark(p, end);)
            end++;
        found = end == p->n_steps ||
                (end > from && (uint64_t)(end - from + 1) * p->period_us > FLASHING_PERIOD_US);
    }
    credit->dark_from = from;
    credit->lit_from = end;
}

void ls_credit_init(struct ls_credit *credit, const struct ls_program *program, uint32_t ring_slots,
                    bool live, uint64_t started_ns)
{
    uint32_t room = ring_slots > LS_CREDIT_SPARE ? ring_slots - LS_CREDIT_SPARE : 1;
    *credit = (struct ls_credit){.bursts = live && program->period_us < FLASHING_PERIOD_US,
                                 .program = program,
                                 .burst = room,
                                 .dark = true,
                                 .started_ns = started_ns};
    if (credit->bursts)
        find_break(credit, 0);
}

uint32_t ls_credit_grant(struct ls_credit *credit, uint32_t granted, uint32_t fired, uint32_t limit,
                         uint32_t window, uint64_t now_ns)
{
    uint32_t most = limit > granted ? limit : granted;
    if (!credit->bursts)
        return most;
    bool dry = granted < fired + 2;
    if (granted == credit->lit_from) {
        find_break(credit, granted);
        credit->dark = true;
    }
    if (granted >= credit->dark_from)
        return least(most, credit->lit_from);
    if (dry && limit <= granted)
        credit->dark = true;
    if (!credit->dark)
        return least(most, credit->lit_from);
    uint32_t wanted = least(fired + least(credit->burst, window), credit->dark_from);
    bool rested = credit->started_ns == 0 || now_ns - credit->started_ns >= LS_CREDIT_PAUSE_NS;
    if (!dry || !rested || limit < wanted || limit <= granted)
        return granted;
    credit->dark = false;
    credit->started_ns = now_ns;
    return least(most, credit->lit_from);
}

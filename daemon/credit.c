#include "daemon/credit.h"

enum { FLASHING_PERIOD_US = 33333 }; /* 30 Hz */

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

uint32_t ls_credit_limit(const struct ls_credit_camera *cameras, uint32_t n_cameras,
                         uint32_t n_steps)
{
    uint32_t limit = n_steps;
    for (uint32_t i = 0; i < n_cameras; i++) {
        uint32_t queued = cameras[i].queued;
        uint32_t room = queued > LS_CREDIT_SPARE ? queued - LS_CREDIT_SPARE : 0;
        limit = least(limit, cameras[i].settled + room);
    }
    return limit;
}

void ls_credit_init(struct ls_credit *credit, uint32_t n_steps, uint32_t ring_slots, bool live,
                    uint32_t period_us)
{
    uint32_t room = ring_slots > LS_CREDIT_SPARE ? ring_slots - LS_CREDIT_SPARE : 1;
    *credit = (struct ls_credit){.bursts = live && period_us < FLASHING_PERIOD_US,
                                 .n_steps = n_steps,
                                 .burst = room,
                                 .dark = true};
}

uint32_t ls_credit_grant(struct ls_credit *credit, uint32_t granted, uint32_t fired, uint32_t limit,
                         uint64_t now_ns)
{
    if (!credit->bursts)
        return limit > granted ? limit : granted;
    if (!credit->dark && granted < credit->n_steps && granted < fired + 2 && limit <= granted)
        credit->dark = true;
    if (!credit->dark)
        return limit > granted ? limit : granted;
    uint32_t wanted = least(credit->burst, credit->n_steps - fired);
    bool rested = credit->started_ns == 0 || now_ns - credit->started_ns >= LS_CREDIT_PAUSE_NS;
    if (!rested || limit < fired + wanted || limit <= granted)
        return granted;
    credit->dark = false;
    credit->started_ns = now_ns;
    return limit;
}

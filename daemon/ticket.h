/*
 * ticket: the bound record of one shot: what was asked, what was fired, what arrived.
 * Layer: daemon. Threads: a plain value, copied. Ownership: none.
 *
 * Every time stands beside the clock it was read from: controller us, camera ns, host
 * CLOCK_MONOTONIC_RAW ns.
 */
#ifndef LS_DAEMON_TICKET_H
#define LS_DAEMON_TICKET_H

#include "drivers/camera.h"

#include <stdint.h>

struct ls_ticket {
    uint32_t shot;      /* step * n_cameras + camera */
    uint32_t step;      /* of the plan */
    uint32_t camera;    /* index in the rig */
    uint32_t attempt;   /* 0, then 1 + for every time it was shot again */
    uint32_t condition; /* index in the plan */
    uint32_t exposure;  /* index in the bracket, shortest first */
    uint32_t repeat;    /* of a dark */
    /* asked */
    double pulse_us;
    /* fired */
    uint32_t controller_step; /* since arm; differs from `step` after a repair or resume */
    uint32_t width_us;        /* pulse really driven */
    uint64_t controller_us;   /* start of the pulse, controller clock */
    /* arrived */
    uint64_t frame_id;  /* as extended by the driver */
    uint64_t camera_ns; /* camera clock */
    uint64_t host_ns;   /* CLOCK_MONOTONIC_RAW */
    enum ls_frame_status status;
    uint32_t trigger_counter;
    double chunk_exposure_us; /* 0 = the camera does not measure it */
    /* derived */
    double exposure_used_us; /* pulse + offset: what the merge divides by */
    double residual_us;      /* of binding by time: frame mapped to controller time - pulse */
    uint32_t raw_crc32c;     /* of the payload */
    uint32_t raw_bytes;
};

#endif

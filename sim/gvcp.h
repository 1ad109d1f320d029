/*
 * gvcp: the control channel of a simulated camera: discovery, register and memory access, control
 * privilege with its heartbeat, resend requests (GigE Vision control protocol, UDP port 3956).
 * Layer: sim. Threads: create/destroy on one thread; one thread of its own answers and calls the
 * hooks; release and silence on any. Ownership: owns its sockets and thread; borrows registers.
 */
#ifndef LS_SIM_GVCP_H
#define LS_SIM_GVCP_H

#include "sim/camera_registers.h"

enum { SIM_GVCP_PORT = 3956 };

/** What a camera does about what a host asks. Called on the channel's thread. */
struct sim_gvcp_hooks {
    void *user;
    /** A permitted write of one word; performs it. */
    enum sim_gvcp_status (*write)(void *user, uint32_t address, uint32_t value);
    /** Packets [first, last] of a block are wanted again. */
    void (*resend)(void *user, uint16_t block, uint32_t first, uint32_t last);
    /** Nobody controls the camera any more. */
    void (*released)(void *user);
};

struct sim_gvcp;

/** Bind @ip_address (host order) and answer. Also joins the limited broadcast, if the machine lets
 * it. LS_ERR_BUSY: the address is in use. (transfer full). */
LS_MUST_CHECK enum ls_err sim_gvcp_create(uint32_t ip_address, struct sim_registers *registers,
                                          const struct sim_gvcp_hooks *hooks, struct sim_gvcp **out,
                                          struct ls_diag *diag);

/** Answer nothing until @until_ns: the cable is out. UINT64_MAX: for ever. */
void sim_gvcp_silence(struct sim_gvcp *gvcp, uint64_t until_ns);

/** Forget the controller as a power cycle does. */
void sim_gvcp_release(struct sim_gvcp *gvcp);

/** NULL is allowed. */
void sim_gvcp_destroy(struct sim_gvcp *gvcp);

/** The lower 16 bits of @value as GigE Vision has them on the wire: big-endian. */
static inline void sim_gev_store16(uint8_t *bytes, uint32_t value)
{
    bytes[0] = (uint8_t)(value >> 8);
    bytes[1] = (uint8_t)value;
}

/** The same of 32 bits. */
static inline void sim_gev_store32(uint8_t *bytes, uint32_t value)
{
    sim_gev_store16(bytes, value >> 16);
    sim_gev_store16(bytes + 2, value);
}

#endif

/*
 * controller_private: the controller's one object, seen by its parts: controller.c (life),
 * controller_state.c (what commands do), controller_engine.c (steps in time),
 * controller_server.c (Modbus).
 * Layer: sim. Threads: everything under `lock` unless stated; `wake` is on CLOCK_MONOTONIC.
 */
#ifndef LS_SIM_CONTROLLER_PRIVATE_H
#define LS_SIM_CONTROLLER_PRIVATE_H

#include "sim/controller.h"
#include "sim/program.h"

#include <modbus.h>
#include <pthread.h>

struct sim_event {
    uint32_t step, width_us;
    uint64_t us;
    uint16_t flags;
};

struct sim_controller {
    struct sim_controller_config config; /* constant, but for the faults' counts */
    struct sim_controller_hooks hooks;   /* constant */
    uint32_t boot;                       /* constant */

    pthread_mutex_t lock;
    pthread_cond_t wake; /* state, grant, quit: engine and preparation wait on it */
    bool quit;

    enum ls_wire_state state;
    uint16_t faults;
    struct sim_refusal refusal;
    uint16_t control[LS_WIRE_CONTROL_SIZE];
    uint32_t window_address, window_length;
    uint16_t *memory; /* program memory */
    struct sim_program program;
    _Atomic uint32_t progress;

    uint16_t arm;
    uint32_t fired, granted, missed;
    uint32_t releases;  /* larger grants and releases since arm */
    uint64_t credit_us; /* when the step the engine waits for was granted */
    uint64_t alive_ns;  /* last sign of life */
    bool lit, holding;
    uint64_t interlock_until_ns, estop_until_ns; /* open until; UINT64_MAX: for ever */
    uint64_t dead_until_ns;
    bool disconnect; /* asked of the server by the engine */

    struct sim_event *events;         /* ring of config.event_queue */
    uint32_t event_first, event_next; /* sequence numbers; [first, next) are kept */
    uint32_t events_lost;

    int listen_fd, kick_fd; /* kick_fd: faults, quit */
    unsigned port;
    modbus_t *modbus;      /* server thread only */
    modbus_mapping_t *map; /* server thread only */
    pthread_t server, engine, preparation;
    unsigned n_threads;
};

/** Time of the controller's clock, us. Any thread, no lock needed. */
uint64_t sim_controller_us(const struct sim_controller *c);

/** A fault knob that is due at @step: consumed once per call. NULL if none. */
struct sim_controller_fault *sim_controller_due(struct sim_controller *c,
                                                enum sim_controller_fault_kind kind, uint32_t step);

/** Latch @faults: dark, stopped. */
void sim_controller_latch(struct sim_controller *c, uint16_t faults);

/** Write into control or window registers. Returns 0 or a Modbus exception code. */
int sim_controller_write(struct sim_controller *c, unsigned address, const uint16_t *regs,
                         unsigned n);

/** Latch @n registers at @address into @regs. Returns 0 or a Modbus exception code. */
int sim_controller_read(struct sim_controller *c, unsigned address, uint16_t *regs, unsigned n);

/** Thread bodies. */
void *sim_controller_engine(void *controller);
void *sim_controller_server(void *controller);
void *sim_controller_preparation(void *controller);

/** Wait on `wake` until @true_ns (UINT64_MAX: no limit). */
void sim_controller_wait(struct sim_controller *c, uint64_t true_ns);

#endif

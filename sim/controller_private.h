/*
 * controller_private: the controller's one object, seen by its parts: controller.c (life),
 * controller_state.c (what commands do), controller_engine.c (steps in time), and its wires:
 * controller_tcp.c, controller_serial.c (both over controller_modbus.c), controller_usb.c.
 * Layer: sim. Threads: everything under `lock` unless stated; `wake` is on CLOCK_MONOTONIC.
 */
#ifndef LS_SIM_CONTROLLER_PRIVATE_H
#define LS_SIM_CONTROLLER_PRIVATE_H

#include "sim/controller.h"
#include "sim/controller_books.h"
#include "sim/program.h"

#include <pthread.h>

struct sim_wire;

struct sim_event {
    uint32_t step, width_us;
    uint64_t us;
    uint16_t flags;
};

struct sim_controller {
    struct sim_controller_config config; /* constant, but for the faults' counts */
    struct sim_controller_hooks hooks;   /* constant */
    uint32_t boot;                       /* under `lock`, as what follows it */

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
    struct sim_books books; /* of all programs since power-up */
    _Atomic uint32_t progress;

    uint16_t arm;
    uint32_t fired, granted, missed;
    uint32_t releases;  /* larger grants and releases since arm */
    uint64_t credit_us; /* when the step the engine waits for was granted */
    uint64_t alive_ns;  /* last sign of life */
    bool lit, holding;
    uint16_t work_channel, work_level;
    bool working;                                /* the work light is on */
    uint64_t working_us;                         /* since then */
    uint16_t shown_channel, shown_level;         /* it, while it is on */
    bool watched;                                /* ... while the host lives */
    uint64_t interlock_until_ns, estop_until_ns; /* open until; UINT64_MAX: for ever */
    uint64_t heat_until_ns, overheat_until_ns;   /* as hot as hot_c, max_c until */
    uint64_t dead_until_ns;
    double reconnect_ms;
    bool disconnect; /* asked of the server by the engine */
    bool halt;

    struct sim_event *events;         /* ring of config.event_queue */
    uint32_t event_first, event_next; /* sequence numbers; [first, next) are kept */
    uint32_t events_lost;

    const struct sim_wire *wire; /* constant */
    void *wire_data;             /* its own; constant */
    int kick_fd;                 /* wakes the server: faults, quit */
    unsigned port;               /* constant, as path */
    char path[128];
    pthread_t server, engine, preparation;
    unsigned n_threads;
};

/** Time of the controller's clock, us. Any thread, no lock needed. */
uint64_t sim_controller_us(const struct sim_controller *c);

/** A fault knob that is due at @step: consumed once per call. NULL if none. */
struct sim_controller_fault *sim_controller_due(struct sim_controller *c,
                                                enum sim_controller_fault_kind kind, uint32_t step);

/** The same of a knob that is due from its step on. */
struct sim_controller_fault *sim_controller_due_from(struct sim_controller *c,
                                                     enum sim_controller_fault_kind kind,
                                                     uint32_t step);

/** Does it answer nothing now? */
bool sim_controller_is_dead(const struct sim_controller *c);

/** Put the work light on (if there is one) or off. */
void sim_controller_show_work(struct sim_controller *c, bool on);

/** Latch @faults: stopped, and dark; after a missed heartbeat alone the work light comes on. */
void sim_controller_latch(struct sim_controller *c, uint16_t faults);

/** What a register request comes to; the numbers are Modbus exception codes. */
enum sim_answer {
    SIM_ANSWER_OK = 0,
    SIM_ANSWER_FUNCTION = 1,
    SIM_ANSWER_ADDRESS = 2,
    SIM_ANSWER_VALUE = 3,
    SIM_ANSWER_REFUSED = 4,
    SIM_ANSWER_NOT_ME = 11,
};

enum { SIM_MAX_REGISTERS = 125 /* read at once */ };

/** A wire. open fills wire_data, port and path; close frees what it left, also after a failed
 * open, with the server thread gone. serve is a thread's body, until quit. event is called under
 * `lock` when an event has been queued; NULL: nothing to do. */
struct sim_wire {
    enum ls_err (*open)(struct sim_controller *c, struct ls_diag *diag);
    void (*serve)(struct sim_controller *c);
    void (*event)(struct sim_controller *c);
    void (*close)(struct sim_controller *c);
};

extern const struct sim_wire sim_wire_tcp, sim_wire_serial, sim_wire_usb;

/** Has it been told to quit? Takes the lock. */
bool sim_controller_quitting(struct sim_controller *c);

/** Write into control or window registers. Returns enum sim_answer. */
int sim_controller_write(struct sim_controller *c, unsigned address, const uint16_t *regs,
                         unsigned n);

/** Latch @n registers at @address into @regs. Returns enum sim_answer. */
int sim_controller_read(struct sim_controller *c, unsigned address, uint16_t *regs, unsigned n);

/** The record of a queued event. */
void sim_controller_event(const struct sim_controller *c, uint32_t sequence,
                          uint16_t regs[LS_WIRE_EVENT_SIZE]);

/** Thread bodies. */
void *sim_controller_engine(void *controller);
void *sim_controller_preparation(void *controller);

/** Wait on `wake` until @true_ns (UINT64_MAX: no limit). */
void sim_controller_wait(struct sim_controller *c, uint64_t true_ns);

#endif

/*
 * link: transactions on a controller's registers, whatever the wire.
 * Layer: drivers. Threads: one at a time. Ownership: a wire's create makes a link, destroy frees
 * it.
 *
 * A wire is a constant table of these operations, embedded first in the wire's own struct. After a
 * timeout, a broken connection or an answer that makes no sense a wire disconnects by itself, since
 * a late answer could be taken for the next one; the next connect starts afresh. A request that the
 * controller refuses leaves it connected.
 */
#ifndef LS_DRIVERS_LINK_H
#define LS_DRIVERS_LINK_H

#include "core/error.h"
#include "drivers/lights.h"
#include "drivers/lights_wire.h"

#include <stdbool.h>
#include <stdint.h>
#include <time.h>

struct ls_link;

/** Every member is required but take_event. Errors of the four transactions: LS_ERR_TIMEOUT and
 * LS_ERR_GONE (now disconnected), LS_ERR_REFUSED (the controller says why in its status),
 * LS_ERR_BUSY, LS_ERR_UNSUPPORTED (it does not have these registers), LS_ERR_MISMATCH (connect:
 * another controller answers). They allocate nothing of ours. */
struct ls_link_ops {
    /** Blocks for two timeouts at most; on USB for one more for each other controller that is asked
     * for its serial number and does not answer. */
    enum ls_err (*connect)(struct ls_link *link, struct ls_diag *diag);
    /** Blocks for 200 ms at most, on USB: transfers under way are awaited. */
    void (*disconnect)(struct ls_link *link);
    /** While connected. One transaction each, which blocks for one timeout at most; write_read is
     * two on USB. If it fails so that the link is given up, a disconnect is added. */
    enum ls_err (*read)(struct ls_link *link, unsigned address, unsigned n, uint16_t *regs,
                        struct ls_diag *diag);
    enum ls_err (*write)(struct ls_link *link, unsigned address, unsigned n, const uint16_t *regs,
                         struct ls_diag *diag);
    enum ls_err (*write_read)(struct ls_link *link, unsigned write_address, unsigned n_write,
                              const uint16_t *write, unsigned read_address, unsigned n_read,
                              uint16_t *read, struct ls_diag *diag);
    /** For wires on which the controller sends event records unasked: the record of arm @arm since
     * power-up @boot whose sequence number is @sequence, if it has come. NULL: events come with the
     * status block alone. Never blocks. */
    bool (*take_event)(struct ls_link *link, uint32_t boot, uint16_t arm, uint32_t sequence,
                       uint16_t record[LS_WIRE_EVENT_SIZE]);
    void (*destroy)(struct ls_link *link); /* NULL is not allowed */
};

struct ls_link {
    const struct ls_link_ops *ops;
    bool connected;
    /* When the controller answered the last read: between these two times of the host's
     * CLOCK_MONOTONIC_RAW. A slow wire knows how much of a transaction was its own. */
    uint64_t before_ns, after_ns;
};

/** CLOCK_MONOTONIC_RAW. */
static inline uint64_t ls_link_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC_RAW, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

/** The same in milliseconds, for time limits. */
static inline int64_t ls_link_now_ms(void)
{
    return (int64_t)(ls_link_now_ns() / 1000000u);
}

/** A wire: how a link to the controller of @config is made, not yet connected. */
struct ls_wire {
    const char *name; /* of ls_lights_config.driver */
    enum ls_err (*create)(const struct ls_lights_config *config, struct ls_link **out,
                          struct ls_diag *diag);
};

#endif

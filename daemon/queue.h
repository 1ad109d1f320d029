/*
 * queue: a bounded lock-free queue of small records, one producer, one consumer.
 * Layer: daemon. Threads: push on one thread, pop on one other; the consumer may change if the
 * hand-over is itself ordered (a mutex). Ownership: embedded; records are copied in and out.
 *
 * What real-time threads and normal threads exchange goes through here: neither ever waits for the
 * other.
 */
#ifndef LS_DAEMON_QUEUE_H
#define LS_DAEMON_QUEUE_H

#include "core/error.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_queue {
    unsigned char *records;
    size_t record_bytes;
    uint32_t mask;               /* capacity - 1 */
    _Atomic uint32_t head, tail; /* popped, pushed; they wrap */
};

/** Room for at least @capacity records (rounded up to a power of two, at most 2^20). */
LS_MUST_CHECK enum ls_err ls_queue_init(struct ls_queue *queue, size_t record_bytes,
                                        uint32_t capacity);

/** Zeroed queues are allowed. */
void ls_queue_finish(struct ls_queue *queue);

/** False: full, nothing was pushed. RT-safe. */
bool ls_queue_push(struct ls_queue *queue, const void *record);

/** False: empty, @record is untouched. RT-safe. */
bool ls_queue_pop(struct ls_queue *queue, void *record);

/** RT-safe. */
bool ls_queue_is_empty(const struct ls_queue *queue);

#endif

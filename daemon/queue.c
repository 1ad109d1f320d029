#include "daemon/queue.h"

#include <stdlib.h>
#include <string.h>

enum { MAX_CAPACITY = 1 << 20 };

enum ls_err ls_queue_init(struct ls_queue *queue, size_t record_bytes, uint32_t capacity)
{
    if (capacity > MAX_CAPACITY)
        return LS_ERR_LIMIT;
    uint32_t n = 1;
    while (n < capacity)
        n *= 2;
    queue->records = calloc(n, record_bytes);
    if (!queue->records)
        return LS_ERR_NOMEM;
    queue->record_bytes = record_bytes;
    queue->mask = n - 1;
    atomic_init(&queue->head, 0);
    atomic_init(&queue->tail, 0);
    return LS_OK;
}

void ls_queue_finish(struct ls_queue *queue)
{
    free(queue->records);
    queue->records = NULL;
}

static void *place(struct ls_queue *queue, uint32_t position)
{
    return queue->records + (size_t)(position & queue->mask) * queue->record_bytes;
}

bool ls_queue_push(struct ls_queue *queue, const void *record)
{
    uint32_t tail = atomic_load_explicit(&queue->tail, memory_order_relaxed);
    uint32_t head = atomic_load_explicit(&queue->head, memory_order_acquire);
    if (tail - head > queue->mask)
        return false;
    memcpy(place(queue, tail), record, queue->record_bytes);
    atomic_store_explicit(&queue->tail, tail + 1, memory_order_release);
    return true;
}

bool ls_queue_pop(struct ls_queue *queue, void *record)
{
    uint32_t head = atomic_load_explicit(&queue->head, memory_order_relaxed);
    uint32_t tail = atomic_load_explicit(&queue->tail, memory_order_acquire);
    if (head == tail)
        return false;
    memcpy(record, place(queue, head), queue->record_bytes);
    atomic_store_explicit(&queue->head, head + 1, memory_order_release);
    return true;
}

bool ls_queue_is_empty(const struct ls_queue *queue)
{
    return atomic_load(&queue->head) == atomic_load(&queue->tail);
}

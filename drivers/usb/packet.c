#include "drivers/usb/packet.h"

#include <string.h>

static bool is_good(const uint16_t *regs, size_t n)
{
    if (n < LS_WIRE_PK_HEADER + LS_WIRE_EVENT_SIZE + 2 || regs[0] != LS_WIRE_PACKET_MAGIC)
        return false;
    size_t records = regs[LS_WIRE_PK_COUNT];
    return n == LS_WIRE_PK_HEADER + records * LS_WIRE_EVENT_SIZE + 2 &&
           ls_wire_get32(regs + n - 2) == ls_wire_crc32c(regs, n - 2);
}

bool ls_event_queue_receive(struct ls_event_queue *queue, const uint8_t *bytes, size_t n)
{
    uint16_t regs[LS_WIRE_PACKET_MAX];
    size_t n_regs = n / 2;
    if (n % 2 == 0 && n_regs <= LS_WIRE_PACKET_MAX)
        ls_wire_get_registers(bytes, n_regs, regs);
    if (n % 2 || n_regs > LS_WIRE_PACKET_MAX || !is_good(regs, n_regs))
        return false;
    for (uint32_t i = 0; i < regs[LS_WIRE_PK_COUNT]; i++) {
        if (queue->tail - queue->head == LS_EVENT_QUEUE)
            return true;
        uint32_t at = queue->tail++ % LS_EVENT_QUEUE;
        queue->entry[at].boot = ls_wire_get32(regs + LS_WIRE_PK_BOOT);
        queue->entry[at].arm = regs[LS_WIRE_PK_ARM];
        queue->entry[at].sequence = ls_wire_get32(regs + LS_WIRE_PK_FIRST) + i;
        memcpy(queue->entry[at].record, regs + LS_WIRE_PK_HEADER + i * LS_WIRE_EVENT_SIZE,
               sizeof queue->entry[at].record);
    }
    return true;
}

bool ls_event_queue_take(struct ls_event_queue *queue, uint32_t boot, uint16_t arm,
                         uint32_t sequence, uint16_t record[LS_WIRE_EVENT_SIZE])
{
    for (; queue->head != queue->tail; queue->head++) {
        uint32_t at = queue->head % LS_EVENT_QUEUE;
        int32_t ahead = (int32_t)(queue->entry[at].sequence - sequence);
        if (queue->entry[at].boot != boot || queue->entry[at].arm != arm || ahead < 0)
            continue;
        if (ahead > 0)
            return false;
        memcpy(record, queue->entry[at].record, sizeof queue->entry[at].record);
        queue->head++;
        return true;
    }
    return false;
}

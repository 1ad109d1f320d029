/*
 * packet: event packets of the USB wire, checked, and the records in them, in order.
 * Layer: drivers/usb. Threads: one at a time. Ownership: embedded; zero-initialise. RT-safe.
 */
#ifndef LS_DRIVERS_USB_PACKET_H
#define LS_DRIVERS_USB_PACKET_H

#include "drivers/lights_wire.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { LS_EVENT_QUEUE = 512 };

struct ls_event_queue {
    struct {
        uint32_t boot, sequence;
        uint16_t arm;
        uint16_t record[LS_WIRE_EVENT_SIZE];
    } entry[LS_EVENT_QUEUE];
    uint32_t head, tail; /* [head, tail) are there; counted without end */
};

/** Take the records of a packet of @n bytes; what does not fit is left out. False: it is malformed,
 * or its CRC is wrong, and none was taken. */
bool ls_event_queue_receive(struct ls_event_queue *queue, const uint8_t *bytes, size_t n);

/** The record @sequence of arm @arm since power-up @boot, if it is there: arms are counted from 1
 * after each. Older ones, and those of another run, are forgotten. */
bool ls_event_queue_take(struct ls_event_queue *queue, uint32_t boot, uint16_t arm,
                         uint32_t sequence, uint16_t record[LS_WIRE_EVENT_SIZE]);

#endif

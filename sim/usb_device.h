/*
 * usb_device: the bytes of the simulated controller as a USB device: descriptors, requests, event
 * packets. drivers/usb/README.md is their document.
 * Layer: sim. Threads: under the controller's lock, but for sim_usb_describe.
 */
#ifndef LS_SIM_USB_DEVICE_H
#define LS_SIM_USB_DEVICE_H

#include "sim/controller_private.h"

/** A control request: @setup is its eight bytes and then its data, @size bytes in all. Returns the
 * bytes of data transferred; *status is 0, or -EPIPE when the device stalls. */
int sim_usb_control(struct sim_controller *c, uint8_t *setup, int size, int *status);

/** The packet numbered @sequence of events from @first on, which is there. Returns its bytes,
 * *next is the event after its last. */
size_t sim_usb_packet(const struct sim_controller *c, uint32_t first, uint16_t sequence,
                      uint8_t bytes[LS_WIRE_USB_PACKET_BYTES], uint32_t *next);

/** The device as umockdev wants it described, numbered @number on bus 1. */
void sim_usb_describe(int number, char *text, size_t size);

#endif

/*
 * usb: a link to a controller over USB, through libusb-1.0's asynchronous transfers.
 * Layer: drivers. Threads, errors and ownership: drivers/link.h; no thread of its own, callbacks
 * run within its calls.
 *
 * Registers travel in vendor requests of the control endpoint; the controller sends event packets
 * of its own accord on an interrupt endpoint, several transfers deep. drivers/usb/README.md has
 * every byte. A packet that is damaged or missing costs nothing but a round trip, since events stay
 * in the status block until they are acknowledged.
 */
#ifndef LS_DRIVERS_USB_USB_H
#define LS_DRIVERS_USB_USB_H

#include "drivers/link.h"

/** The address is the controller's serial number, or "any" for the only one. connect waits one
 * timeout for the controller to be plugged in, and one for each serial number it asks for. Its
 * errors beside drivers/link.h: LS_ERR_REFUSED (no permission), LS_ERR_BUSY (another process has
 * it), LS_ERR_INVALID (several). */
extern const struct ls_wire ls_wire_usb;

#endif

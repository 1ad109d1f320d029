/*
 * lights_image: between the structs of lights.h and the registers of lights_wire.h, for every
 * driver whatever its wire.
 * Layer: drivers. Threads: any; pure. Ownership: as stated per function.
 */
#ifndef LS_DRIVERS_LIGHTS_IMAGE_H
#define LS_DRIVERS_LIGHTS_IMAGE_H

#include "core/error.h"
#include "drivers/lights.h"
#include "drivers/lights_wire.h"

#include <stddef.h>
#include <stdint.h>

/** Registers one condition takes in the program image. RT-safe. */
size_t ls_image_condition_registers(const struct ls_condition *condition);

/** Registers the whole image takes. RT-safe. */
size_t ls_image_registers(const struct ls_program *program);

/** Write the image of a program that passed ls_lights_test into @image, which has room for
 * ls_image_registers(). Returns the registers written. */
size_t ls_image_encode(const struct ls_program *program, uint16_t *image);

/** Decode identity and limits blocks. LS_ERR_UNSUPPORTED: not a dome controller, or one that
 * speaks another version; LS_ERR_INVALID: limits no controller can have (zero lights ...). */
LS_MUST_CHECK enum ls_err ls_wire_decode_info(const uint16_t identity[LS_WIRE_IDENTITY_SIZE],
                                              const uint16_t limits[LS_WIRE_LIMITS_SIZE],
                                              struct ls_lights_info *info, struct ls_diag *diag);

/** Decode a status block, but for the host times. Unknown states read as LS_LIGHTS_FAULT.
 * RT-safe. */
void ls_wire_decode_status(const uint16_t regs[LS_WIRE_STATUS_SIZE],
                           struct ls_lights_status *status);

/** Decode one event record. RT-safe. */
void ls_wire_decode_event(const uint16_t *regs, struct ls_step_event *event);

/** A sentence for a refusal, in @diag; returns LS_ERR_REFUSED. @status is a status block. */
enum ls_err ls_wire_refused(const uint16_t status[LS_WIRE_STATUS_SIZE], const char *doing,
                            struct ls_diag *diag);

#endif

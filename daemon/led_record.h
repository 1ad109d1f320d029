/*
 * led_record: what the last sweep found of the rig's LEDs, kept beside the takes for those to come.
 * Layer: daemon. Threads: any; writers one at a time. Ownership: as stated.
 *
 * The file `leds.json` of the storage folder: { "format" 1, "take" (the sweep), "dead" [], "dim" []
 * (as "checks" of daemon/led_sweep.h has them) }. A sweep that ended complete replaces it. Takes
 * have it as "led_sweep" in take.json, and preflights warn of what it names.
 */
#ifndef LS_DAEMON_LED_RECORD_H
#define LS_DAEMON_LED_RECORD_H

#include "core/error.h"

#include <jansson.h>
#include <stddef.h>

/** Keep what @checks of the sweep @take say. Errors: those of daemon/diskio.h, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_led_record_write(const char *storage, const char *take,
                                              const json_t *checks, struct ls_diag *diag);

/** What is kept, NULL if nothing is; (transfer full). LS_ERR_INVALID (no such record; the sentence
 * names the file and what to do), those of daemon/file.h. */
LS_MUST_CHECK enum ls_err ls_led_record_read(const char *storage, json_t **record,
                                             struct ls_diag *diag);

/** A sentence about LEDs that are dead or dim, "" if there are none. @record: NULL is allowed. */
void ls_led_record_say(const json_t *record, char *text, size_t room);

#endif

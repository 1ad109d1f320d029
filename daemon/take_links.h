/*
 * take_links: does every shot's ticket follow from the plan, and tell of a pulse and a frame of its
 * own? With the counts and checksums of take_verify this closes the chain planned = fired =
 * received = stored.
 * Layer: daemon. Threads: any. Ownership: stated per call.
 */
#ifndef LS_DAEMON_TAKE_LINKS_H
#define LS_DAEMON_TAKE_LINKS_H

#include "daemon/takedir.h"

#include <glib.h>

/**
 * Append to @text one line for every broken link of a shot's last good ticket:
 * planned: its step, camera, condition, exposure and pulse are those that take.json gives the shot;
 * fired: no two steps were fired by one pulse (the same moment of the controller's clock);
 * received: no two shots of a camera have one frame (the same moment of its clock, or of arrival).
 * Moments of 0 were not said; without conditions in take.json the first is left out.
 */
void ls_take_check_links(const struct ls_takedir *take, GString *text);

#endif

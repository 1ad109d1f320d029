/*
 * plan_custom: conditions that a person lists light by light.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the builder's plan.
 *
 * Private to plan. The plan's key `custom` holds a JSON text, which `lightstagectl --custom FILE`
 * puts there:
 *   { "format": 1, "conditions": [
 *       { "id": "rim-left", "channel": "W", "lights": [3, 14, 15], "level": 20000 },
 *       { "id": "soft-key", "channel": "R", "lights": [0, 7], "levels": [65535, 800] } ] }
 * "id": the file's stem, 1 to 31 letters, digits, '-' or '_', none that another condition has;
 * "lights": rows of the rig file, each once; "level": of all, "levels": of each, 1 to 65535. The
 * conditions are of pattern "custom" and come after those of `conditions`, in the order of the
 * list.
 */
#ifndef LS_DAEMON_PLAN_CUSTOM_H
#define LS_DAEMON_PLAN_CUSTOM_H

#include "daemon/plan_builder.h"

/** Read `custom`, if the plan has it. Errors stick to @conf and name line and column, or the item
 * and its key, what was expected and what was found. */
void ls_plan_read_custom(struct ls_conf *conf, struct ls_plan_builder *builder);

#endif

/*
 * probe: which devices answer, found out on a thread of its own, so that a dead device keeps nobody
 * waiting for long.
 * Layer: daemon. Threads: every call on one thread; devices are opened on ls-probe. Ownership: the
 * configuration is (transfer none) and outlives the probe.
 */
#ifndef LS_DAEMON_PROBE_H
#define LS_DAEMON_PROBE_H

#include "core/error.h"
#include "daemon/config.h"

#include <stdbool.h>
#include <stdint.h>

/** What was found. A device that did not answer is not connected and its other fields are 0. */
struct ls_devices {
    bool lights_connected;
    char lights_serial[32];
    struct ls_lights_status lights;
    struct {
        bool connected;
        char model[64], serial[64], unverified[512];
        bool packet_socket;
    } cameras[LS_MAX_CAMERAS];
};

struct ls_probe;

/**
 * Connects to nothing yet. @remember_us: how long a finding is good for; @wait_us: how long a look
 * waits for a newer one. NULL: out of memory.
 */
struct ls_probe *ls_probe_create(const struct ls_config *config, int64_t remember_us,
                                 int64_t wait_us);

/**
 * What is known. Older than remember_us: every device is asked again, which is waited for up to
 * wait_us; then, and while that goes on, a device that has not answered yet is as it was found
 * last. Nothing known yet: up to 3 s; who has not answered by then counts as not connected.
 */
void ls_probe_look(struct ls_probe *probe, struct ls_devices *out);

/** Leave the devices to others and forget what was found. Waits until the device that is being
 * asked has answered or timed out. */
void ls_probe_release(struct ls_probe *probe);

/** Release and free. NULL is allowed. */
void ls_probe_destroy(struct ls_probe *probe);

#endif

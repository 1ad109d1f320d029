/*
 * probe: which devices answer, found out on ls-rig, so that a dead device keeps nobody waiting for
 * long.
 * Layer: daemon. Threads: every call on ls-main; devices are opened on ls-rig. Ownership:
 * configuration and errands are (transfer none) and outlive the probe.
 */
#ifndef LS_DAEMON_PROBE_H
#define LS_DAEMON_PROBE_H

#include "core/error.h"
#include "daemon/config.h"
#include "daemon/errand.h"

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

/** Who looks: its own, the probe's until it is told or has turned away. */
struct ls_look {
    /** ls-main, once, perhaps inside ls_probe_look. */
    void (*done)(struct ls_look *look, const struct ls_devices *found);
    struct ls_probe *probe; /* the probe's, and what follows; NULL: nobody looks */
    unsigned timer;
};

/**
 * Connects to nothing yet. @remember_us: how long a finding is good for; @wait_us: how long a look
 * waits for a newer one. NULL: out of memory.
 */
struct ls_probe *ls_probe_create(const struct ls_config *config, struct ls_errands *errands,
                                 int64_t remember_us, int64_t wait_us);

/**
 * What is known. Older than remember_us: every device is asked again, which is waited for up to
 * wait_us; then, and while that goes on, a device that has not answered yet is as it was found
 * last. Nothing known yet: up to 3 s; who has not answered by then counts as not connected. While
 * another errand has the devices nobody is asked, and what was found last is told at once.
 */
void ls_probe_look(struct ls_probe *probe, struct ls_look *look);

/** Tell it nothing. One that does not look is allowed. */
void ls_probe_turn_away(struct ls_look *look);

/** What was found is out of date: the next look asks anew, and knows nothing before. */
void ls_probe_forget(struct ls_probe *probe);

/** After the errands have ended. NULL is allowed. */
void ls_probe_destroy(struct ls_probe *probe);

#endif

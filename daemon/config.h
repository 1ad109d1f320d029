/*
 * config: the daemon's configuration and the rig it runs, read from libconfig files.
 * Layer: daemon. Threads: loaded once on ls-main, read-only afterwards. Ownership: the ls_config
 * owns every string and array; free with ls_config_destroy.
 *
 * Every key is documented in lightstaged.conf(5) and lightstage-rig(5). An unknown key, a wrong
 * type or a value out of range is LS_ERR_INVALID with file, line, key and what was expected.
 */
#ifndef LS_DAEMON_CONFIG_H
#define LS_DAEMON_CONFIG_H

#include "core/error.h"
#include "core/spectrum.h"
#include "daemon/conf_access.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

enum {
    LS_MAX_CAMERAS = 4,
    LS_MAX_CHANNELS = 16,
    LS_MAX_LIGHTS = 4096,
};

struct ls_config_channel {
    char *name;                   /* "W" */
    bool polariser;               /* kind = "polariser", else "spectrum" */
    struct ls_spectrum *spectrum; /* NULL if unknown */
};

/** One camera of the rig: how to reach it, where it stands, what its numbers mean. */
struct ls_config_camera {
    char *name;
    struct ls_camera_config driver; /* strings owned by the ls_config */
    float position_m[3], look_at_m[3];
    float focal_length_mm, sensor_width_mm, sensor_height_mm;
    char *lens;                  /* for the files' attributes; NULL = not said */
    double aperture, iso_speed;  /* the same; 0 = not said */
    float range_low, range_high; /* radiometrically linear range, of full scale: 0.10, 0.85 */
    double full_scale_dn;        /* clip value of the raw format */
    double black_dn;             /* nominal; darks measure it */
    double electrons_per_dn, read_noise_dn;
    double exposure_offset_us;       /* added by the sensor to a TriggerWidth pulse */
    bool measure_offset;             /* the rig file does not say: 0 until it is measured */
    double exposure_offset_sigma_us; /* of one that was measured, else 0 */
    double max_fps;                  /* triggers closer than 1 / max_fps are missed */
    bool black_check;                /* refuse a clipped black level */
};

struct ls_config_light {
    float position_m[3]; /* stage frame */
    uint32_t address;    /* of the controller */
};

/** Without a rig (n_lights 0) takes are served and none are made. */
struct ls_config {
    char *storage, *socket_path, *calibration_path; /* calibration may be NULL */
    struct ls_lights_config lights_driver;
    uint16_t work_channel, work_level; /* the work light; level 0 = none, dark */
    uint32_t n_lights;
    struct ls_config_light *lights;
    uint32_t n_channels;
    struct ls_config_channel channels[LS_MAX_CHANNELS];
    uint32_t n_cameras;
    struct ls_config_camera cameras[LS_MAX_CAMERAS];
    char *rig_name;
    double link_mbit_s;     /* of the link that all cameras share; 0 = each has its own */
    uint32_t merge_threads; /* default: processors, at most 8 */
    uint32_t ring_slots;    /* per camera, >= 16, default 32 */
    uint32_t retries;       /* repair passes before a shot is named missing, default 3 */
    uint64_t reserve_bytes; /* disk space never used, default 64 MiB */
    uint64_t queue_bytes;   /* memory for what waits for the disk, default 256 MiB */
    uint32_t max_connections, max_connections_each; /* of all clients, of one; 128, 64 */
    uint32_t idle_s; /* a client that wants nothing is kept so long, default 900 */
    struct ls_access access;
    struct ls_listen_config listen; /* without an address: the Unix socket alone */
};

/** Read the daemon file and the rig file it names (relative to it). (transfer full). */
LS_MUST_CHECK enum ls_err ls_config_load(const char *path, struct ls_config **out,
                                         struct ls_diag *diag);

/** NULL is allowed. */
void ls_config_destroy(struct ls_config *config);

/** Index of a channel by name, or -1. */
int ls_config_channel(const struct ls_config *config, const char *name);

#endif

/*
 * camera: a simulated GigE Vision camera on a loopback address of its own.
 * Layer: sim. Threads: create and destroy on one thread; pulse on any (in practice the dome
 * controller's); every callback comes from the camera's own exposure thread, one at a time, in
 * the order of the triggers. Ownership: the camera owns its sockets, threads and registers.
 *
 * Speaks GVCP on port 3956 (discovery, registers, memory, heartbeat, packet resend) and streams
 * GVSP. Registers live in an ArvFakeCamera described by camera.xml. The sensor is modelled in
 * time only: when it exposes, for how long, and whether it was ready. What the picture shows is
 * the callback's business.
 *
 * Time of an exposure:
 *   Timed         exposure = ExposureTime, lit = min(pulse, exposure)
 *   TriggerWidth  exposure = pulse + exposure_offset_us, lit = pulse
 * A trigger is missed when it comes before max(end of the last exposure, last start + 1 /
 * max_frame_rate), or while the camera does not acquire on that trigger: it is counted and
 * produces nothing. Block ids start anew at each AcquisitionStart and wrap 65535 -> 1.
 */
#ifndef LS_SIM_CAMERA_H
#define LS_SIM_CAMERA_H

#include "core/error.h"
#include "sim/stage.h"

#include <stdbool.h>
#include <stdint.h>

enum sim_camera_fate {
    SIM_FATE_SENT,
    SIM_FATE_DROPPED_PULSE,  /* fault: the pulse never reached the camera */
    SIM_FATE_LOST_FRAME,     /* fault: exposed and numbered, but no packet of it left */
    SIM_FATE_MISSED_TRIGGER, /* arrived, but the sensor was busy or not armed */
};

enum { SIM_CAMERA_MAX_FAULTS = 16 };

/** Faults by pulse: the first pulse after create is 1. */
struct sim_camera_faults {
    uint64_t drop_pulse[SIM_CAMERA_MAX_FAULTS];      /* never reaches the camera */
    uint64_t lose_frame[SIM_CAMERA_MAX_FAULTS];      /* its frame is lost, beyond resend */
    uint64_t duplicate_frame[SIM_CAMERA_MAX_FAULTS]; /* its packets are all sent twice */
    uint64_t late_frame[SIM_CAMERA_MAX_FAULTS];      /* its packets leave late_ms later */
    uint64_t early_pulse[SIM_CAMERA_MAX_FAULTS];     /* its edge comes early_us before its light */
    uint64_t double_pulse[SIM_CAMERA_MAX_FAULTS];    /* a second edge comes double_us after it */
    uint64_t lose_leader[SIM_CAMERA_MAX_FAULTS];     /* its leader is lost, resent it comes */
    uint32_t late_ms;
    double early_us, double_us;
    uint64_t crowded_pulse; /* from this pulse on each frame leaves crowded_ms, more or less by
                               half, after the one before has, in their order; 0 = never */
    double crowded_ms;
    double packet_loss;    /* probability that a stream packet is lost, resent ones too */
    uint64_t seed;         /* of packet_loss; of crowded_ms */
    uint64_t silent_pulse; /* from this pulse on it neither answers nor sends; 0 = never */
    uint32_t silent_ms;    /* for so long; 0 = for ever */
    uint64_t reboot_pulse; /* at this pulse it forgets control, acquisition and settings: it has
                              those of power-up then, and a gain of 6 dB; 0 = never */
    uint32_t reboot_ms;    /* it answers again so much later */
};

struct sim_camera_config {
    const char *address;                  /* loopback address to own, e.g. "127.0.0.2" */
    const char *serial, *model;           /* NULL: "SIM<index>", "lightstage-sim" */
    uint32_t index;                       /* sim_exposure.camera */
    uint32_t sensor_width, sensor_height; /* px, multiples of 4 */
    uint32_t pixel_format;                /* PFNC code at power-up; 0 = Mono8 */
    double black_level_dn;                /* what the read-only BlackLevel says, at 8 bit */
    double exposure_offset_us;            /* TriggerWidth; 13.7 on the reference sensor */
    double max_frame_rate_hz;             /* 0 = 100 */
    double clock_drift_ppm;
    uint64_t clock_epoch_ticks; /* camera clock (1 GHz) at create */
    uint64_t first_block;       /* id of the first frame after AcquisitionStart; 0 = 1 */
    bool rolling;               /* SensorShutterMode says Rolling */
    bool timed_only;            /* ExposureMode TriggerWidth is not available */
    struct sim_camera_faults faults;
};

/** What the camera asks of the rest of the simulator. log may be NULL. */
struct sim_camera_callbacks {
    void *user;
    /** Fill @raw with the image in wire layout: rows without padding; Mono12/16 and Bayer12
     * little-endian in 16 bits; "12Packed" as two pixels in three bytes (high 8 of the first,
     * low nibbles first | second << 4, high 8 of the second). */
    void (*render)(void *user, const struct sim_exposure *exposure,
                   const struct sim_raw_format *format, void *raw);
    /** Which condition the LEDs showed longest in [@start_ns, @end_ns), and for how long. Asked
     * after the end, for exposures that no pulse started. Dark: UINT32_MAX, UINT32_MAX, 0. */
    void (*shown)(void *user, uint64_t start_ns, uint64_t end_ns, uint32_t *condition,
                  uint32_t *step, double *lit_us);
    /** Once per exposure, and once per pulse that became none. @frame_id is the block id extended
     * past 16 bits; 0 if there is no frame. @camera_ticks: camera clock at the start of the
     * exposure. */
    void (*log)(void *user, const struct sim_exposure *exposure, uint64_t frame_id,
                uint64_t camera_ticks, enum sim_camera_fate fate);
};

struct sim_camera_stats {
    uint64_t pulses; /* sim_camera_pulse calls */
    uint64_t exposures, sent, lost_frames, dropped_pulses, missed_triggers;
    uint64_t packets_lost, packets_resent, resends_refused, send_errors;
};

struct sim_camera;

/** Bind the address and serve. Errors: LS_ERR_INVALID (config), LS_ERR_BUSY (address in use).
 * @config and its strings are copied; @callbacks is copied, its user outlives the camera.
 * (transfer full). */
LS_MUST_CHECK enum ls_err sim_camera_create(const struct sim_camera_config *config,
                                            const struct sim_camera_callbacks *callbacks,
                                            struct sim_camera **out, struct ls_diag *diag);

/** A pulse on Line0, starting at @true_ns (now, or a moment ago) and @pulse_us wide. Returns at
 * once. @step and @condition are what the LEDs show during it. */
void sim_camera_pulse(struct sim_camera *camera, uint64_t true_ns, double pulse_us, uint32_t step,
                      uint32_t condition);

/** The camera's clock now or at another true time; 1 GHz. */
uint64_t sim_camera_ticks_at(const struct sim_camera *camera, uint64_t true_ns);

/** Counters since create. Any thread. */
void sim_camera_stats(struct sim_camera *camera, struct sim_camera_stats *stats);

/** Stop the threads, close the sockets, free. Pulses must have ended. NULL is allowed. */
void sim_camera_destroy(struct sim_camera *camera);

#endif

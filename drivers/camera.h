/*
 * camera: the interface to a machine-vision camera that is hardware- or software-triggered.
 * Layer: drivers (may include core). Threads: open/apply/start/stop/close on one normal thread;
 * next on the camera's own thread while started; release and wake on any thread; trigger,
 * set_exposure and latch on one thread at a time (the sequencer's while started).
 * Ownership: the caller owns the slots frames land in; between start and stop a slot belongs to
 * the driver until `next` hands it out, then to the caller until `release`.
 *
 * Shutting down: `ls_camera_wake`, join the thread that calls `next`, `ls_camera_stop`. A stop
 * that finds a `next` inside wakes it and waits for it to leave.
 */
#ifndef LS_DRIVERS_CAMERA_H
#define LS_DRIVERS_CAMERA_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum ls_camera_trigger {
    LS_TRIGGER_LINE,     /* hardware line Line0 */
    LS_TRIGGER_SOFTWARE, /* TriggerSoftware, for cameras without a line */
};

enum ls_camera_exposure {
    LS_EXPOSURE_WIDTH, /* ExposureMode TriggerWidth: the pulse is the exposure (+ offset) */
    LS_EXPOSURE_TIMED, /* ExposureTime register */
    LS_EXPOSURE_AUTO,  /* width where a line triggers it and it offers that, else timed */
};

struct ls_camera_config {
    const char *driver;                         /* "aravis" */
    const char *address;                        /* IP address, unicast */
    uint32_t width, height, offset_x, offset_y; /* px; 0 x 0 = sensor size */
    const char *pixel_format;                   /* GenICam name, e.g. "BayerRG12" */
    uint32_t packet_size;                       /* bytes, e.g. 9000 */
    uint32_t packet_delay_ns;                   /* between packets, for cameras on one link */
    uint32_t frame_retention_us;                /* above exposure + readout + margin */
    double gain;                                /* dB, or whatever unit the camera's Gain has */
    double black_level; /* 0 = leave the camera's own, which must then be above 0 */
    bool chunks;
    enum ls_camera_trigger trigger;
    enum ls_camera_exposure exposure;
    double exposure_us; /* not width */
    int rt_priority;    /* SCHED_FIFO priority of the driver's receive thread, 0 = none */
};

struct ls_camera_info {
    char vendor[64], model[64], serial[64];
    uint32_t sensor_width, sensor_height;
    uint32_t width, height; /* as applied */
    char pixel_format[32];  /* as read back */
    size_t payload_bytes;   /* with chunks; the least a slot must hold */
    uint64_t tick_hz;       /* of its timestamps; 0 = has none */
    bool has_chunks, has_trigger_counter, has_chunk_exposure, has_latch, has_trigger_width;
    bool packet_socket;            /* receive path: packet socket, else UDP; before start, which of
                                      them is allowed */
    uint32_t receive_buffer_bytes; /* UDP only: what the kernel grants of the 32 MiB it should be;
                                      with less, frames are lost. 0 with a packet socket */
    bool realtime;                 /* the receive thread runs at rt_priority; known after start */
    enum ls_camera_exposure exposure; /* as applied: width or timed */
    double exposure_us;               /* Timed: as read back */
    double gain, black_level;         /* as read back; 0 if it has none */
    char unverified[512]; /* settings it cannot set or prove, comma-separated; "" = none */
};

enum ls_frame_status {
    LS_FRAME_OK,
    LS_FRAME_LOST, /* incomplete; id, timestamps and chunks are not to be believed */
};

/** A frame in a slot. */
struct ls_camera_frame {
    uint32_t slot;
    enum ls_frame_status status;
    uint32_t payload_bytes;   /* image bytes, without chunks */
    uint64_t frame_id;        /* extended past 16 bits by the driver, 0 never */
    uint64_t camera_ns;       /* start of exposure, camera clock; 0 if info.tick_hz is 0 */
    uint64_t host_ns;         /* arrival, CLOCK_MONOTONIC_RAW */
    uint32_t trigger_counter; /* chunk: edges seen on the line, those it had to ignore included;
                                 valid if info.has_trigger_counter */
    double chunk_exposure_us; /* chunk; valid if info.has_chunk_exposure; else 0 */
};

/** Memory frames land in: slot k is [base + k * stride, + stride). */
struct ls_camera_slots {
    void *base;
    size_t stride; /* >= payload_bytes, page multiple */
    uint32_t n;
};

struct ls_camera_stats {
    uint64_t completed, failed, underruns, resent_packets;
};

struct ls_camera;

enum ls_camera_verb {
    LS_CAMERA_TRIGGER,  /* fire TriggerSoftware */
    LS_CAMERA_EXPOSURE, /* in: exposure_us to write; out: as read back */
    LS_CAMERA_LATCH,    /* out: camera_ns, host_before_ns, host_after_ns */
    LS_CAMERA_WAKE,     /* any thread, never blocks: see ls_camera_wake */
};

struct ls_camera_control {
    enum ls_camera_verb verb;
    double exposure_us;
    uint64_t camera_ns, host_before_ns, host_after_ns;
};

/** A driver; every member is required. The wrapper validates, the driver trusts. */
struct ls_camera_ops {
    const char *name;
    enum ls_err (*open)(const struct ls_camera_config *config, void **priv,
                        struct ls_camera_info *info, struct ls_diag *diag);
    enum ls_err (*apply)(void *priv, const struct ls_camera_config *config,
                         struct ls_camera_info *info, struct ls_diag *diag);
    enum ls_err (*start)(void *priv, const struct ls_camera_slots *slots,
                         struct ls_camera_info *info, struct ls_diag *diag);
    enum ls_err (*next)(void *priv, uint64_t timeout_us, struct ls_camera_frame *frame);
    void (*release)(void *priv, uint32_t slot);
    enum ls_err (*control)(void *priv, struct ls_camera_control *control, struct ls_diag *diag);
    void (*stop)(void *priv, struct ls_camera_stats *stats);
    void (*close)(void *priv);
};

/** Connect and read identity. Blocks for at most a few seconds. Errors: LS_ERR_INVALID (address
 * is no IPv4 address), LS_ERR_NOT_FOUND (driver), LS_ERR_GONE (no camera at the address),
 * LS_ERR_BUSY (controlled by somebody else). @out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_camera_open(const struct ls_camera_config *config,
                                         struct ls_camera **out, struct ls_diag *diag);

/** Write every setting (auto modes off, gamma 1, LUT off, region, format, gain, trigger,
 * exposure mode, chunks, packet size) and read each back. A setting that reads back otherwise is
 * LS_ERR_MISMATCH naming feature, asked, got; one the camera does not have goes to
 * info.unverified. Rolling-shutter cameras are LS_ERR_UNSUPPORTED. */
LS_MUST_CHECK enum ls_err ls_camera_apply(struct ls_camera *camera,
                                          const struct ls_camera_config *config,
                                          struct ls_diag *diag);

/** (transfer none); changes at apply and start only. RT-safe. */
const struct ls_camera_info *ls_camera_info(const struct ls_camera *camera);

/** Start acquisition into the caller's slots (all handed to the driver; at least 4, 16 in real
 * use). Frame ids, and the extension past 16 bits, start anew. */
LS_MUST_CHECK enum ls_err ls_camera_start(struct ls_camera *camera,
                                          const struct ls_camera_slots *slots,
                                          struct ls_diag *diag);

/** Wait up to @timeout_us for a frame; 0 = only look. Errors: LS_ERR_TIMEOUT, LS_ERR_GONE
 * (control lost; frames already here come out first), LS_ERR_ABORTED (ls_camera_wake or
 * ls_camera_stop), LS_ERR_STATE (not started). Allocates nothing, takes no lock of ours. */
LS_MUST_CHECK enum ls_err ls_camera_next(struct ls_camera *camera, uint64_t timeout_us,
                                         struct ls_camera_frame *frame);

/** Hand a slot back to the driver. Any thread. */
void ls_camera_release(struct ls_camera *camera, uint32_t slot);

/** Make this and every later `next` return LS_ERR_ABORTED, until the next start. Any thread.
 * RT-safe. */
void ls_camera_wake(struct ls_camera *camera);

/** Software trigger. LS_ERR_STATE if configured for the line. */
LS_MUST_CHECK enum ls_err ls_camera_trigger(struct ls_camera *camera, struct ls_diag *diag);

/** Set ExposureTime (Timed only), read back into *exposure_us. */
LS_MUST_CHECK enum ls_err ls_camera_set_exposure(struct ls_camera *camera, double *exposure_us,
                                                 struct ls_diag *diag);

/** Latch the camera clock: *camera_ns was true between the two host CLOCK_MONOTONIC_RAW times.
 * LS_ERR_UNSUPPORTED if it has no latch. */
LS_MUST_CHECK enum ls_err ls_camera_latch(struct ls_camera *camera, uint64_t *camera_ns,
                                          uint64_t *host_before_ns, uint64_t *host_after_ns,
                                          struct ls_diag *diag);

/** Stop acquisition; every slot is the caller's again. @stats may be NULL. */
void ls_camera_stop(struct ls_camera *camera, struct ls_camera_stats *stats);

/** Stop if started, release control, free. NULL is allowed. */
void ls_camera_close(struct ls_camera *camera);

#endif

/*
 * lightstage: the C library of lightstaged: status, takes, pictures, relighting.
 * Threads: one at a time per client; clients do not share anything. Ownership: as stated.
 * Signals: what the caller's thread blocks stays blocked; a handler that runs interrupts no call.
 *
 *     struct lightstage_address address = {.size = sizeof address,
 *                                          .where = "/run/lightstaged/socket"};
 *     struct lightstage *stage = NULL;
 *     struct lightstage_error error;
 *     if (lightstage_connect(&address, &stage, &error))
 *         printf("%u: %s\n", error.number, error.text);
 *
 * Calls return 0 or the number that is in @error (NULL is allowed) beside its sentence: 100 and up
 * are the daemon's (PROTOCOL.md lists them), those below enum lightstage_own_error. Texts and
 * structs of the library are const and live as long as is said; those of callbacks until it
 * returns.
 *
 * Structs that a caller fills begin with their own size, the rest 0 is the default (in C++, address
 * = {} and then address.size = sizeof address): the library reads no byte behind that size, and
 * refuses (108) what a newer header set and it does not know. Structs that the library fills are
 * made by the library, which hands out pointers to them. Within a soname both kinds grow at their
 * end alone: a new member begins at or behind the size that there was, never in its padding, and 0
 * means there what there was before. No member goes, moves or changes its meaning; enums and
 * numbers only gain values. lightstage_error, lightstage_shape and lightstage_region never change.
 */
#ifndef LIGHTSTAGE_H
#define LIGHTSTAGE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lightstage;

/** What the library itself says; the daemon's numbers begin at 100. */
enum lightstage_own_error {
    LIGHTSTAGE_UNREACHABLE = 1, /* nobody answers there */
    LIGHTSTAGE_LOST = 2,        /* the connection has ended: only lightstage_close is left to do */
    LIGHTSTAGE_NO_MEMORY = 3,
    LIGHTSTAGE_UNTRUSTED = 4,      /* TLS: a certificate is refused, or one's own cannot be used */
    LIGHTSTAGE_STRANGE = 5,        /* the daemon sent what does not fit the request */
    LIGHTSTAGE_BAD_ARGUMENT = 107, /* as the daemon's, found before sending */
    LIGHTSTAGE_UNSUPPORTED = 108,
    LIGHTSTAGE_OVER_LIMIT = 109, /* also: the caller's buffer is too small */
    LIGHTSTAGE_CANCELLED = 204,
};

/** Never grows. */
struct lightstage_error {
    uint32_t number; /* 0: none */
    char text[512];  /* for a person; may change */
};

/* ---- connection ---- */

struct lightstage_address {
    size_t size;
    const char
        *where; /* path of a Unix socket, or "tls://host:port" with the three below: PEM files */
    const char *certificate, *key, *authority;
};

/** Connect and greet. *out: (transfer full), lightstage_close. */
uint32_t lightstage_connect(const struct lightstage_address *address, struct lightstage **out,
                            struct lightstage_error *error);

/** NULL is allowed; not from a callback. What is in flight ends without a word, its callbacks are
 * not called. */
void lightstage_close(struct lightstage *stage);

enum lightstage_role {
    LIGHTSTAGE_NOBODY = 0, /* of a daemon that knows no roles */
    LIGHTSTAGE_READER = 1, /* sees and fetches */
    LIGHTSTAGE_OPERATOR = 2,
};

/** What this client may do there. */
enum lightstage_role lightstage_role(const struct lightstage *stage);

/** Not 0: the daemon says that it does this: "tiles", "factored"; PROTOCOL.md has the words. */
int lightstage_can(const struct lightstage *stage, const char *capability);

/** soname's library, "0.1.0". */
const char *lightstage_version(void);

/** "busy", "not found": a word for a number, the daemon's or the library's; "error" for others. */
const char *lightstage_error_name(uint32_t number);

/* ---- requests in flight ----
 * A call named ..._begin sends its request and gives its number; its callback comes from
 * lightstage_dispatch, lightstage_wait or any blocking call on the same client, in the thread that
 * calls. A callback that does not return 0 cancels its request and is not called again. Callbacks
 * may begin and cancel requests, and must not make blocking calls, dispatch or wait on their
 * client. */

/** To poll for POLLIN; lightstage_dispatch then. (transfer none). */
int lightstage_descriptor(const struct lightstage *stage);

/** Take what has arrived, and wait for the rest of what has begun to. An error of a request is that
 * request's (lightstage_wait says it); errors here: LIGHTSTAGE_LOST, _STRANGE, _NO_MEMORY. */
uint32_t lightstage_dispatch(struct lightstage *stage, struct lightstage_error *error);

/** How many requests have not ended, and how they ended not been asked for (by lightstage_wait). */
size_t lightstage_in_flight(const struct lightstage *stage);

/** Not 0: lightstage_wait says at once how @request has ended, or that there is none. */
int lightstage_has_ended(const struct lightstage *stage, uint32_t request);

/** Wait until @request has ended, and say how; it is forgotten then. What has been read of others
 * by then is handed out too, so that polling tells of the rest. 107: no such request. */
uint32_t lightstage_wait(struct lightstage *stage, uint32_t request,
                         struct lightstage_error *error);

/** Ask the daemon to end @request: it ends with LIGHTSTAGE_CANCELLED. 107: no such request. */
uint32_t lightstage_cancel(struct lightstage *stage, uint32_t request,
                           struct lightstage_error *error);

/* ---- status and takes ---- */

enum lightstage_take_state {
    LIGHTSTAGE_TAKE_NONE = 0,
    LIGHTSTAGE_TAKE_PREPARING = 1,
    LIGHTSTAGE_TAKE_RUNNING = 2,
    LIGHTSTAGE_TAKE_COMPLETE = 3,
    LIGHTSTAGE_TAKE_INCOMPLETE = 4,
    LIGHTSTAGE_TAKE_ABORTED = 5,
    LIGHTSTAGE_TAKE_FAILED = 6,
};

struct lightstage_take_status {
    enum lightstage_take_state state;
    const char *id; /* empty until the take has a folder */
    const char *token, *message;
    uint32_t steps_planned, steps_bound, conditions_planned, conditions_stored;
    uint32_t shots_lost, shots_repaired;
    double frames_per_second; /* of the whole take once it has ended */
    /* once it has ended */
    const char *repaired; /* what was shot again; NULL until then */
    double seconds, residual_max_us, residual_rms_us;
    uint32_t missing_conditions;
    /* how far the light has drifted since the first reference: the largest of the take so far */
    const char *drift_text;    /* where, with an alarm also what to do; NULL: no second reference */
    double drift, drift_error; /* relative: 0.01 = 1 % more; standard error */
    int drift_alarm;
};

struct lightstage_camera_status {
    int connected, packet_socket;
    const char *name, *model, *serial, *unverified;
};

struct lightstage_status {
    int lights_connected;
    const char *lights_serial, *lights_state;
    int32_t temperature_c;
    size_t n_faults;
    const char *const *faults;
    size_t n_cameras;
    const struct lightstage_camera_status *const *cameras;
    uint64_t disk_free_bytes;
    const char *calibration, *privileges;
    struct lightstage_take_status *take; /* NULL: none yet */
    size_t n_now;
    const char *const *now; /* of: interlock open, e-stop pressed, hot, work light */
    uint32_t missed_triggers;
    uint32_t connections;
    uint64_t stalled_closed; /* connections closed because their client stopped reading */
    uint64_t events_skipped; /* that slow clients did not get */
    uint64_t credit_waits;   /* times that a request waited for its client's credit */
};

/** *out: (transfer full), lightstage_status_free. */
uint32_t lightstage_status(struct lightstage *stage, struct lightstage_status **out,
                           struct lightstage_error *error);

/** NULL is allowed. */
void lightstage_status_free(struct lightstage_status *status);

struct lightstage_started {
    int already; /* by the same token: nothing was started again */
    const struct lightstage_take_status *take;
};

/** Start a take by @plan, the text of a plan file. The same @token again (one's own, e.g. 16 random
 * hex digits) starts nothing: what a lost connection may have started is asked for so. *out:
 * (transfer full), lightstage_started_free; out NULL: of no interest. */
uint32_t lightstage_take_start(struct lightstage *stage, const char *name, const char *token,
                               const char *plan, struct lightstage_started **out,
                               struct lightstage_error *error);

/** Shoot what @take lacks. */
uint32_t lightstage_take_resume(struct lightstage *stage, const char *take, const char *token,
                                struct lightstage_started **out, struct lightstage_error *error);

/** NULL is allowed. */
void lightstage_started_free(struct lightstage_started *started);

/** End the take that runs. */
uint32_t lightstage_take_abort_begin(struct lightstage *stage, uint32_t *request,
                                     struct lightstage_error *error);

/** The same, and hear that it will. */
uint32_t lightstage_take_abort(struct lightstage *stage, struct lightstage_error *error);

typedef int lightstage_on_progress(const struct lightstage_take_status *status, void *user);

/** Follow the take of @token (NULL: whatever runs, or ran last) until it has ended; the last status
 * says how. A callback that does not return 0 ends the following, not the take. */
uint32_t lightstage_take_progress(struct lightstage *stage, const char *token,
                                  lightstage_on_progress *callback, void *user,
                                  struct lightstage_error *error);

/** The same, begun: its callback is not called once it has been cancelled, and the take goes on. */
uint32_t lightstage_take_progress_begin(struct lightstage *stage, const char *token,
                                        lightstage_on_progress *callback, void *user,
                                        uint32_t *request, struct lightstage_error *error);

/** take.json as it is on disk, NUL-terminated. *out: (transfer full), lightstage_text_free. */
uint32_t lightstage_take_show(struct lightstage *stage, const char *take, char **out,
                              struct lightstage_error *error);
void lightstage_text_free(char *text);

/** All lights off, now; a running take ends. */
uint32_t lightstage_blank(struct lightstage *stage, struct lightstage_error *error);

/* ---- the rig, and takes on disk ----
 * What a call hands out, *out: (transfer full), its ..._free, which allows NULL. */

struct lightstage_channel {
    const char *name;
    int polariser; /* of light, rather than a spectrum */
};

struct lightstage_rig_camera {
    const char *name;
    float position_m[3], look_at_m[3];
    float focal_length_mm, sensor_width_mm, sensor_height_mm;
};

struct lightstage_rig {
    const char *name;
    uint32_t n_lights;
    const float *positions_m; /* [n_lights][3] */
    size_t n_channels;
    const struct lightstage_channel *const *channels;
    size_t n_cameras;
    const struct lightstage_rig_camera *const *cameras;
};

uint32_t lightstage_rig(struct lightstage *stage, struct lightstage_rig **out,
                        struct lightstage_error *error);
void lightstage_rig_free(struct lightstage_rig *rig);

/** What a plan would cost. */
struct lightstage_preflight {
    uint32_t conditions, steps, shots;
    double seconds;
    uint64_t bytes, disk_free_bytes;
    double dark_noise_share;         /* of a relit picture's */
    double energy_j, peak_current_a; /* of the LEDs; 0 where the controller tells no power */
    double led_duty;                 /* of the busiest: mean over the take */
    const char *bracket;             /* how exposures are made */
    const char *warnings;            /* one a line */
};

/** Try @plan, the text of a plan file, without lighting anything. */
uint32_t lightstage_preflight(struct lightstage *stage, const char *plan,
                              struct lightstage_preflight **out, struct lightstage_error *error);
void lightstage_preflight_free(struct lightstage_preflight *preflight);

struct lightstage_take_summary {
    const char *id, *name;
    const char *state;   /* as in take.json, or "damaged" */
    const char *problem; /* why it cannot be read; empty if it can */
    uint32_t conditions_planned;
    uint32_t conditions_published;
    uint32_t width, height, n_lights;
};

typedef int lightstage_on_take(const struct lightstage_take_summary *take, void *user);

/** Every take of the daemon's storage; a callback that does not return 0 ends it (204). */
uint32_t lightstage_take_list(struct lightstage *stage, lightstage_on_take *callback, void *user,
                              struct lightstage_error *error);

/** One take in short. */
uint32_t lightstage_take_summary(struct lightstage *stage, const char *take,
                                 struct lightstage_take_summary **out,
                                 struct lightstage_error *error);
void lightstage_take_summary_free(struct lightstage_take_summary *summary);

struct lightstage_verified {
    uint32_t conditions_checked, conditions_missing, conditions_damaged;
    uint32_t shots_planned, shots_ticketed; /* received whole and bound */
    size_t n_findings;                      /* the first ones, a sentence each */
    const char *const *findings;
    uint32_t findings_left_out; /* the others */
};

/** Read every picture of @take. Findings are no error: 0 says only that all has been looked at. */
uint32_t lightstage_take_verify(struct lightstage *stage, const char *take,
                                struct lightstage_verified **out, struct lightstage_error *error);
void lightstage_verified_free(struct lightstage_verified *verified);

/** What people write down about a take. Filled by either side. */
struct lightstage_slate {
    size_t size;
    const char *slate, *scene;
    const char *timecode; /* HH:MM:SS:FF, or ;FF for drop frame */
    const char *notes;
    uint32_t take; /* 0: none */
    int circled;
    int damaged; /* out: what was there could not be read, and is kept beside */
};

enum lightstage_slate_field {
    LIGHTSTAGE_SLATE = 1 << 0,
    LIGHTSTAGE_SLATE_SCENE = 1 << 1,
    LIGHTSTAGE_SLATE_TAKE = 1 << 2,
    LIGHTSTAGE_SLATE_CIRCLED = 1 << 3,
    LIGHTSTAGE_SLATE_TIMECODE = 1 << 4,
    LIGHTSTAGE_SLATE_NOTES = 1 << 5,
};

uint32_t lightstage_take_slate(struct lightstage *stage, const char *take,
                               struct lightstage_slate **out, struct lightstage_error *error);

/** Change those of @fields (enum lightstage_slate_field, or-ed) to what @write says; a text that is
 * NULL is empty. *out: as it now is. */
uint32_t lightstage_take_slate_write(struct lightstage *stage, const char *take,
                                     const struct lightstage_slate *write, uint32_t fields,
                                     struct lightstage_slate **out, struct lightstage_error *error);
void lightstage_slate_free(struct lightstage_slate *slate);

/* ---- what was counted since the daemon started ---- */

struct lightstage_latency {
    const char *part; /* "frame", "merged", "stored", "total": of a picture */
    uint64_t count, sum_ns;
    uint64_t p50_ns, p99_ns; /* to 1.6 % */
    uint64_t max_ns;
    size_t n_below;
    const uint64_t *below; /* how many of them are shorter than 2^(18 + i) ns, from i = 0 */
};

struct lightstage_reason {
    const char *reason; /* "late", "incomplete", "no_frame", ... */
    uint64_t count;
};

struct lightstage_camera_metrics {
    const char *name;
    size_t n_latencies;
    const struct lightstage_latency *const *latencies;
    size_t n_frames_discarded, n_steps_unbound; /* every reason there is */
    const struct lightstage_reason *const *frames_discarded, *const *steps_unbound;
    uint64_t frames_bound, shots_lost, shots_repaired, packets_resent, underruns;
    uint64_t settling_pulses; /* dark, after an exposure was written; their frames are discarded */
};

struct lightstage_metrics {
    size_t n_cameras;
    const struct lightstage_camera_metrics *const *cameras;
    uint64_t pulses, takes_complete, takes_incomplete, takes_aborted, takes_failed;
    int take_running;
    uint32_t connections;
    uint64_t stalled_closed, events_skipped, credit_waits; /* as lightstage_status */
    uint64_t pictures_skipped; /* of Preview, that slow clients did not get */
};

uint32_t lightstage_metrics(struct lightstage *stage, struct lightstage_metrics **out,
                            struct lightstage_error *error);
void lightstage_metrics_free(struct lightstage_metrics *metrics);

/* ---- what happens ---- */

/** A picture that may be fetched from now on, while its take runs too. */
struct lightstage_published {
    const char *take;
    const char *condition; /* its name in the plan */
    const char *channel;   /* empty: more than one */
    uint32_t camera;
    uint32_t light;
    int single_light; /* it shows `light` alone, under `channel` */
};

enum lightstage_alarm_kind {
    LIGHTSTAGE_ALARM_DRIFT = 0, /* the light has changed since the take's first reference */
    LIGHTSTAGE_ALARM_SWEEP = 1, /* what a sweep found wrong */
    LIGHTSTAGE_ALARM_HOT = 2,   /* the take pauses until the dome has cooled */
    LIGHTSTAGE_ALARM_FAULT = 3, /* a take failed, or lacks pictures after every repair */
    LIGHTSTAGE_ALARM_DISK = 4,  /* a take could not be written */
};

struct lightstage_alarm {
    enum lightstage_alarm_kind kind;
    int active; /* 0: it is over */
    const char *text, *take;
};

/** Who is told what; NULL: not that. One that does not return 0 ends the listening (204). */
struct lightstage_listener {
    size_t size;
    int (*progress)(const struct lightstage_take_status *status, void *user);
    int (*published)(const struct lightstage_published *published, void *user);
    int (*alarm)(const struct lightstage_alarm *alarm, void *user);
    int (*missed)(void *user); /* pictures of the take before came too late for this client */
};

/** Listen until it is cancelled; one listening per client. */
uint32_t lightstage_events_begin(struct lightstage *stage,
                                 const struct lightstage_listener *listener, void *user,
                                 uint32_t *request, struct lightstage_error *error);

/** The same, until a callback or the connection ends it. */
uint32_t lightstage_events(struct lightstage *stage, const struct lightstage_listener *listener,
                           void *user, struct lightstage_error *error);

struct lightstage_preview {
    size_t size;
    double exposure_us;  /* the live view: the camera runs freely; 0: only look at takes */
    const char *channel; /* of the live view: its steady light; NULL: none of ours */
    double level;        /* its duty, (0, 1] */
    uint32_t camera;
};

struct lightstage_view {
    const uint8_t *rgb; /* [height][width][3], sRGB, without white balance */
    uint32_t camera, width, height;
    uint32_t bin; /* photosites of a pixel in a row and a column */
    uint64_t frame_id;
    uint64_t skipped; /* pictures before it that this client was too slow for */
    double exposure_us, focus;
    size_t n_clip;      /* 3: red, green, blue; 1: mono */
    const double *clip; /* share of photosites lost to clipping */
};

typedef int lightstage_on_preview(const struct lightstage_view *view, void *user);

/** Look until it is cancelled. */
uint32_t lightstage_preview_begin(struct lightstage *stage,
                                  const struct lightstage_preview *preview,
                                  lightstage_on_preview *callback, void *user, uint32_t *request,
                                  struct lightstage_error *error);

/** The same, until the callback or the connection ends it. */
uint32_t lightstage_preview(struct lightstage *stage, const struct lightstage_preview *preview,
                            lightstage_on_preview *callback, void *user,
                            struct lightstage_error *error);

/** What a camera's frames land in while a take runs, read-only. At index_at stands what PROTOCOL.md
 * says under Ring. It is there until it is freed; a take that ends lets nothing land in it. */
struct lightstage_ring {
    const char *take;
    const char *pixel_format; /* GenICam */
    uint32_t slots, width, height;
    uint64_t stride; /* slot i begins at i x stride */
    uint64_t payload_bytes, index_at, bytes;
    const void *memory; /* [bytes] */
};

/** An operator's, at a Unix socket. *out: (transfer full), lightstage_ring_free. 200: no take. */
uint32_t lightstage_ring(struct lightstage *stage, uint32_t camera, struct lightstage_ring **out,
                         struct lightstage_error *error);
void lightstage_ring_free(struct lightstage_ring *ring);

/** Copy the newest frame, payload_bytes, to @frame. Returns its number, counted from 1; 0: none can
 * be read at this moment: a frame can from its landing until it is merged, milliseconds later; look
 * often. Any thread. */
uint64_t lightstage_ring_newest(const struct lightstage_ring *ring, void *frame);

/* ---- pictures ---- */

struct lightstage_region { /* in pixels of full size; all 0: the whole picture; never grows */
    uint32_t x, y, width, height;
};

/** How a spectrum comes to each light. */
enum lightstage_model {
    LIGHTSTAGE_MEASURED = 0,
    LIGHTSTAGE_SPHERE = 1,
    LIGHTSTAGE_HEADLIGHT = 2,
    LIGHTSTAGE_SEPARATED = 3,
    LIGHTSTAGE_LINEAR = 4,
};
enum lightstage_reference { LIGHTSTAGE_STRENGTHS = 0, LIGHTSTAGE_PAPER = 1 };

/** "measured", "sphere", "headlight", "separated", "linear"; "strengths", "paper". NULL: no such
 * number. */
const char *lightstage_model_name(enum lightstage_model model);
const char *lightstage_reference_name(enum lightstage_reference reference);

/** Not 0: there is one of that name, and *out is it. */
int lightstage_model_by_name(const char *name, enum lightstage_model *out);
int lightstage_reference_by_name(const char *name, enum lightstage_reference *out);

/** What was really done for one spectrum. */
struct lightstage_spectrum {
    const char *channel;
    enum lightstage_model model; /* one of a newer daemon has no name */
    enum lightstage_reference reference;
    uint32_t segments;     /* LINEAR: pictures the matrices were fitted on */
    int blended;           /* LINEAR, mono camera: a blend of the segments' ratios, no matrix */
    double left_out_error; /* LINEAR: estimate of a single light's relative RMS error, as served */
    double left_out_share; /* of the pixels that estimate rests on, [0, 1]; 0: no estimate */
    uint32_t inseparable_lights; /* SEPARATED: whose whole picture is promoted by Eq. 1 */
    uint32_t multiplexed;        /* order of the matrix its lights were shown by; 0: one by one */
    double spare_deviation;      /* sigmas by which its spare column differs from 0 */
    int spare_alarm;             /* by more than five: the lights decoded are not to be trusted */
    uint32_t checked_lights; /* LINEAR: also photographed alone, and held against; 0: no errors */
    double checked_error;    /* relative RMS of their promoted pictures, all pixels */
    double highlight_error;  /* the same where such a light is a highlight */
    double highlight_share;  /* of those lights' pixels that are, [0, 1]; 0: no such error */
};
enum lightstage_layout { LIGHTSTAGE_MOSAIC = 0, LIGHTSTAGE_RGB = 1, LIGHTSTAGE_MONO = 2 };
enum lightstage_quantity {
    LIGHTSTAGE_REFLECTANCE = 0, /* R = k E */
    LIGHTSTAGE_ESTIMATE = 1,    /* E as stored */
};
enum lightstage_sample { LIGHTSTAGE_FLOAT = 0, LIGHTSTAGE_HALF = 1 };

struct lightstage_promotion {
    size_t size;
    enum lightstage_model model;
    enum lightstage_reference reference;
    int ideal_polarisation, plain_conductors; /* SEPARATED */
};

struct lightstage_fetch {
    size_t size;
    const char *take, *channel;
    const uint32_t *lights; /* rows of the rig from 0; NULL with full_sphere */
    size_t n_lights;        /* 0: all */
    int full_sphere;        /* the photographed full sphere of the channel */
    struct lightstage_region region;
    const struct lightstage_promotion *promotion; /* NULL: MEASURED */
    enum lightstage_layout layout;
    enum lightstage_quantity quantity;
    enum lightstage_sample sample;
    uint32_t camera;
    uint32_t level; /* 0, 1, 2: full, half, quarter size */
    /* pictures by their names in the plan, whatever lights they show, as stored: MEASURED, MOSAIC
     * and ESTIMATE, without channel, lights and full_sphere; band.light counts them from 0 */
    const char *const *conditions;
    size_t n_conditions;
    int variance, validity; /* of each pixel as photographed: with MOSAIC */
    /* what lights under many spectra are made of, by SPHERE or HEADLIGHT, HALF and RGB: the ratio
     * picture of each of `spectra`, then each light's white */
    int factored;
    const char *const *spectra; /* in place of channel: each light under one after the other */
    size_t n_spectra;
    uint64_t credit_bytes; /* of values that may come before lightstage_credit gives more; 0: not
                            * counted */
    int memfd;        /* tiles at a Unix socket: in memory that the daemon shares, uncopied; without
                       * credit_bytes the library gives back what a callback has seen */
    double max_error; /* of tiles: those of which no value (factored: nothing that they expand to)
                       * is farther from 0 are left out; 0: none */
};

/** What a band of a factored fetch is of. */
enum lightstage_factor {
    LIGHTSTAGE_WHOLE = 0, /* not factored */
    LIGHTSTAGE_RATIO = 1, /* spectrum over white, the same for every light */
    LIGHTSTAGE_WHITE = 2, /* band.light, to be multiplied by ratio and band.gain */
};

enum lightstage_validity { /* a byte each */
                           LIGHTSTAGE_OK = 0,
                           LIGHTSTAGE_SATURATED = 1, /* a lower bound */
                           LIGHTSTAGE_DARK = 2,      /* unbiased, but noisy */
                           LIGHTSTAGE_GAP = 3,       /* between two exposures too far apart */
};

/** Rows of one picture: [n_rows][width][components] values. */
struct lightstage_band {
    const void *values; /* float or half, as asked for; of any alignment */
    size_t values_bytes;
    uint32_t light;
    uint32_t width, height; /* of the picture */
    uint32_t first_row, n_rows, components;
    enum lightstage_sample sample;
    double reference_exposure_s; /* ESTIMATE: value = E x this */
    double gain_k;               /* that the values have been multiplied by */
    int calibrated;
    const void *variance; /* float [n_rows][width], unit of the values squared; NULL: not asked */
    const uint8_t *validity; /* [n_rows][width], enum lightstage_validity; NULL: not asked */
    enum lightstage_factor factor;
    float gain;
    const char *spectrum;                     /* with a picture's first band; else NULL */
    const struct lightstage_spectrum *report; /* likewise */
    double error_bound; /* with the last tiles of a fetch: of what was left out under max_error */
    uint32_t spectrum_number; /* which of lightstage_fetch.spectra; not of what is factored */
};

typedef int lightstage_on_band(const struct lightstage_band *band, void *user);

/** Pictures one after the other in the order of the lights, each from its first row to its last. */
uint32_t lightstage_fetch_begin(struct lightstage *stage, const struct lightstage_fetch *fetch,
                                lightstage_on_band *callback, void *user, uint32_t *request,
                                struct lightstage_error *error);

/** Let @request, begun with credit_bytes, send @bytes more: from its callback, or whenever its
 * bytes are done with. */
uint32_t lightstage_credit(struct lightstage *stage, uint32_t request, uint64_t bytes,
                           struct lightstage_error *error);

/** out[j] = gain white[j] ratio[j], [n] halves of the same rows, aligned; bit for bit what the
 * daemon sends of that light under that spectrum as HALF. Returns how many are 0 for not being
 * finite. */
size_t lightstage_expand(const uint16_t *white, float gain, const uint16_t *ratio, size_t n,
                         uint16_t *out);

/** The same as ..._begin, to its end; without credit_bytes (107). */
uint32_t lightstage_fetch(struct lightstage *stage, const struct lightstage_fetch *fetch,
                          lightstage_on_band *callback, void *user, struct lightstage_error *error);

/** 64 x 64 pixels of one picture: [64][64][components]; what is beyond the picture is 0. */
struct lightstage_tile {
    const struct lightstage_band *picture; /* without values and rows */
    const void *values; /* of any alignment; NULL: the caller has them, or (hash 0) it is left out
                         * under max_error and is to be 0 */
    size_t values_bytes;
    uint32_t index;  /* through all pictures of the request: where to go on */
    uint32_t number; /* in its picture: y / 64 x ceil(width / 64) + x / 64 */
    uint64_t hash;   /* of the values, the same at any time; 0: left out */
};

/** What a caller has of a request's tiles. */
struct lightstage_have {
    size_t size;
    uint32_t first_tile;    /* those of the request before it are left out */
    const uint64_t *hashes; /* lightstage_tile.hash of the request's tiles from its first on, 0: not
                             * there; equal ones are not sent again */
    size_t n_hashes;        /* fewer than there are: none of the others */
};

typedef int lightstage_on_tile(const struct lightstage_tile *tile, void *user);

/** As lightstage_fetch_begin, in whole tiles: those that touch the region, picture by picture.
 * Without variance and validity. @have NULL: nothing. Values in shared memory (memfd) cannot be
 * written to, and are there until the callback returns, as others are. */
uint32_t lightstage_fetch_tiles_begin(struct lightstage *stage,
                                      const struct lightstage_fetch *fetch,
                                      const struct lightstage_have *have,
                                      lightstage_on_tile *callback, void *user, uint32_t *request,
                                      struct lightstage_error *error);

/** The same, to its end; without credit_bytes (107). */
uint32_t lightstage_fetch_tiles(struct lightstage *stage, const struct lightstage_fetch *fetch,
                                const struct lightstage_have *have, lightstage_on_tile *callback,
                                void *user, struct lightstage_error *error);

/** What has been written into a caller's buffer: [pictures][height][width][components]. Never
 * grows. */
struct lightstage_shape {
    uint32_t pictures, height, width, components;
};

/** The same into @buffer of @bytes, without gaps. LIGHTSTAGE_OVER_LIMIT: it is too small for them;
 * what it holds then is not to be used. Not for factored fetches, whose gains it would drop (107).
 */
uint32_t lightstage_fetch_into(struct lightstage *stage, const struct lightstage_fetch *fetch,
                               void *buffer, size_t bytes, struct lightstage_shape *shape,
                               struct lightstage_error *error);

enum lightstage_weights {
    LIGHTSTAGE_SHARED = 0,      /* [n_channels][n_lights], for red, green and blue alike */
    LIGHTSTAGE_TRISTIMULUS = 1, /* [3][n_lights] of red, green, blue on white; no channels */
    LIGHTSTAGE_PER_TARGET = 2,  /* [3][n_channels][n_lights] */
};

struct lightstage_relight {
    size_t size;
    const char *take;
    enum lightstage_weights mode;
    const char *const *channels;
    size_t n_channels;
    uint32_t n_lights;
    const float *weights; /* radiance x sr, of the first picture, then of the second ... */
    uint32_t n_pictures;  /* made in one pass over the take; 0: one */
    struct lightstage_region region;
    const struct lightstage_promotion *promotion; /* NULL: SPHERE, STRENGTHS */
    double max_error;                             /* what may be left out; 0: nothing */
    uint32_t camera, level;
    uint64_t credit_bytes; /* as of a fetch, of values */
};

/** Rows of one picture, float [n_rows][width][3] in camera RGB. The last one has no rows and tells
 * of all pictures together. */
struct lightstage_relit {
    const void *values; /* of any alignment */
    uint32_t picture;   /* from 0 */
    uint32_t width, height;
    uint32_t first_row, n_rows;
    uint32_t lights_used, lights_skipped; /* these and below: in the last */
    uint64_t tiles_skipped;
    double error_bound; /* of what was left out */
    double seconds;
    int calibrated;
    size_t n_spectra; /* in the last: every channel that shone */
    const struct lightstage_spectrum *const *spectra;
};

typedef int lightstage_on_relit(const struct lightstage_relit *rows, void *user);

/** The same rows of all pictures come before any that are below them. */
uint32_t lightstage_relight_begin(struct lightstage *stage,
                                  const struct lightstage_relight *relight,
                                  lightstage_on_relit *callback, void *user, uint32_t *request,
                                  struct lightstage_error *error);

/** The same, to its end; without credit_bytes (107). */
uint32_t lightstage_relight(struct lightstage *stage, const struct lightstage_relight *relight,
                            lightstage_on_relit *callback, void *user,
                            struct lightstage_error *error);

#ifdef __cplusplus
}
#endif
#endif

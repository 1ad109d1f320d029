#include "sim/camera.h"

#include "sim/draw.h"
#include "sim/gvcp.h"
#include "sim/gvsp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    QUEUE = 256,
    MAX_PENDING_FRAMES = 64,
    MAX_SENSOR_PX = 16384,
};

/** What the exposure thread is to do: expose and send, or only report. */
struct job {
    struct sim_exposure exposure;
    uint64_t frame_id; /* 0: report only */
    uint64_t acquisition;
    enum sim_camera_fate fate;
    bool by_pulse, twice, leader;
    uint32_t late_ms;
    double crowded_ms; /* before it leaves, after the one before has left */
    uint32_t edges;    /* on Line0, this one included */
};

struct sim_camera {
    uint32_t index;
    double exposure_offset_us, max_frame_rate_hz;
    uint64_t first_block;
    struct sim_camera_faults faults;
    struct sim_camera_callbacks callbacks;
    struct sim_clock clock;
    struct sim_registers *registers;
    struct sim_gvcp *gvcp;
    struct sim_gvsp *gvsp;
    pthread_t thread;
    _Atomic uint64_t silent_until_ns;

    pthread_mutex_t lock; /* of everything below */
    pthread_cond_t changed;
    bool quit, acquiring;
    uint64_t acquisition; /* how many there were */
    uint64_t last_frame;  /* id */
    uint64_t busy_until_ns, next_free_ns;
    uint32_t edges;
    struct job queue[QUEUE];
    unsigned head, tail, pending_frames;
    struct sim_camera_stats stats;
};

static bool holds(const uint64_t *pulses, uint64_t pulse)
{
    for (int i = 0; i < SIM_CAMERA_MAX_FAULTS; i++)
        if (pulses[i] && pulses[i] == pulse)
            return true;
    return false;
}

static uint64_t ns_of_us(double us)
{
    return (uint64_t)llround(us * 1e3);
}

static double crowded_ms(const struct sim_camera_faults *f, uint64_t pulse)
{
    bool crowded = f->crowded_pulse && pulse >= f->crowded_pulse;
    return crowded ? f->crowded_ms * (0.5 + sim_draw(f->seed, pulse)) : 0;
}

static void settings_of(struct sim_camera *c, struct sim_camera_settings *settings)
{
    sim_registers_settings(c->registers, settings);
}

/* --- triggers: which exposures happen; all with the lock held --- */

static bool enqueue(struct sim_camera *c, const struct job *job)
{
    if (c->tail - c->head == QUEUE)
        return false;
    c->queue[c->tail++ % QUEUE] = *job;
    c->pending_frames += job->frame_id != 0;
    pthread_cond_signal(&c->changed);
    return true;
}

/** Pulses that come to nothing are counted even when there is no room to report them. */
static void report(struct sim_camera *c, struct job *job, enum sim_camera_fate fate)
{
    if (fate == SIM_FATE_DROPPED_PULSE)
        c->stats.dropped_pulses++;
    else
        c->stats.missed_triggers++;
    job->fate = fate;
    enqueue(c, job);
}

static bool ready(const struct sim_camera *c, uint64_t true_ns)
{
    return c->acquiring && true_ns >= c->busy_until_ns && c->pending_frames < MAX_PENDING_FRAMES &&
           c->tail - c->head < QUEUE;
}

static void expose(struct sim_camera *c, struct job *job, const struct sim_camera_settings *s)
{
    uint64_t start_ns = job->exposure.true_ns;
    uint64_t end_ns = start_ns + ns_of_us(job->exposure.exposure_us);
    uint64_t next_ns = start_ns + (uint64_t)(1e9 / c->max_frame_rate_hz);
    c->busy_until_ns = end_ns > next_ns ? end_ns : next_ns;
    job->frame_id = ++c->last_frame;
    job->acquisition = c->acquisition;
    job->exposure.sequence = c->stats.exposures++;
    if (s->single_frame)
        c->acquiring = false;
    enqueue(c, job);
}

static void expose_unlit(struct sim_camera *c, uint64_t true_ns,
                         const struct sim_camera_settings *s)
{
    struct job job = {
        .edges = c->edges,
        .exposure = {.true_ns = true_ns,
                     .exposure_us = s->exposure_us,
                     .condition = UINT32_MAX,
                     .step = UINT32_MAX,
                     .camera = c->index},
        .fate = SIM_FATE_SENT,
        .leader = true,
    };
    if (ready(c, true_ns))
        expose(c, &job, s);
    else
        report(c, &job, SIM_FATE_MISSED_TRIGGER);
}

static void fall_silent(struct sim_camera *c, uint64_t until_ns)
{
    atomic_store(&c->silent_until_ns, until_ns);
    sim_gvcp_silence(c->gvcp, until_ns);
}

static uint64_t after_ms(uint32_t ms)
{
    return sim_now_ns() + ms * 1000000ull;
}

static void apply_disconnects(struct sim_camera *c, uint64_t pulse)
{
    const struct sim_camera_faults *f = &c->faults;
    if (f->silent_pulse && pulse == f->silent_pulse)
        fall_silent(c, f->silent_ms ? after_ms(f->silent_ms) : UINT64_MAX);
    if (f->reboot_pulse && pulse == f->reboot_pulse) {
        c->acquiring = false;
        fall_silent(c, after_ms(f->reboot_ms));
        sim_registers_reboot(c->registers);
        sim_gvcp_release(c->gvcp);
    }
}

/** An edge on the line, at its time. */
static void take_edge(struct sim_camera *c, struct job *job, const struct sim_camera_settings *s)
{
    sim_registers_set(c->registers, SIM_REG_COUNTER, ++c->edges);
    job->edges = c->edges;
    if (!s->trigger_on || !s->trigger_line)
        return;
    if (ready(c, job->exposure.true_ns))
        expose(c, job, s);
    else
        report(c, job, SIM_FATE_MISSED_TRIGGER);
}

/** The line bounces: as long a pulse again, under whatever light there is then. */
static void take_second_edge(struct sim_camera *c, const struct job *job,
                             const struct sim_camera_settings *s)
{
    struct job again = {
        .exposure = {.true_ns = job->exposure.true_ns + ns_of_us(c->faults.double_us),
                     .exposure_us = job->exposure.exposure_us,
                     .condition = UINT32_MAX,
                     .step = UINT32_MAX,
                     .camera = c->index},
        .fate = SIM_FATE_SENT,
        .leader = true,
    };
    take_edge(c, &again, s);
}

static void take_pulse(struct sim_camera *c, struct job *job, double pulse_us)
{
    struct sim_camera_settings s;
    uint64_t pulse = ++c->stats.pulses;
    settings_of(c, &s);
    job->exposure.exposure_us = s.trigger_width ? pulse_us + c->exposure_offset_us : s.exposure_us;
    /* a dome keeps its light on until the sensor has done what the pulse asked for */
    job->exposure.lit_us =
        s.trigger_width ? job->exposure.exposure_us : fmin(pulse_us, s.exposure_us);
    job->twice = holds(c->faults.duplicate_frame, pulse);
    job->late_ms = holds(c->faults.late_frame, pulse) ? c->faults.late_ms : 0;
    job->crowded_ms = crowded_ms(&c->faults, pulse);
    job->leader = !holds(c->faults.lose_leader, pulse);
    if (holds(c->faults.lose_frame, pulse))
        job->fate = SIM_FATE_LOST_FRAME;
    if (holds(c->faults.early_pulse, pulse)) {
        job->exposure.true_ns -= ns_of_us(c->faults.early_us);
        job->by_pulse = false; /* it shows whatever light there was */
    }
    apply_disconnects(c, pulse);
    if (holds(c->faults.drop_pulse, pulse)) {
        job->edges = c->edges;
        report(c, job, SIM_FATE_DROPPED_PULSE);
        return;
    }
    take_edge(c, job, &s);
    if (holds(c->faults.double_pulse, pulse))
        take_second_edge(c, job, &s);
}

void sim_camera_pulse(struct sim_camera *c, uint64_t true_ns, double pulse_us, uint32_t step,
                      uint32_t condition)
{
    struct job job = {
        .exposure = {.true_ns = true_ns, .condition = condition, .step = step, .camera = c->index},
        .fate = SIM_FATE_SENT,
        .by_pulse = true,
    };
    pthread_mutex_lock(&c->lock);
    take_pulse(c, &job, pulse_us);
    pthread_mutex_unlock(&c->lock);
}

/* --- the exposure thread --- */

static void wait_until(struct sim_camera *c, uint64_t true_ns)
{
    pthread_mutex_lock(&c->lock);
    while (!c->quit && sim_now_ns() < true_ns)
        sim_wait_until(&c->changed, &c->lock, true_ns);
    pthread_mutex_unlock(&c->lock);
}

static uint8_t *put32(uint8_t *at, uint32_t value)
{
    value = htonl(value);
    memcpy(at, &value, 4);
    return at + 4;
}

static uint8_t *put64(uint8_t *at, uint64_t value)
{
    return put32(put32(at, (uint32_t)(value >> 32)), (uint32_t)value);
}

static uint8_t *put_tag(uint8_t *at, uint32_t id, uint32_t bytes)
{
    return put32(put32(at, id), bytes);
}

/** Each chunk is followed by its id and length; the image is the first. */
static void write_chunks(const struct sim_camera_settings *s, const struct job *job, uint64_t ticks,
                         uint8_t *payload)
{
    uint64_t exposure_bits;
    uint32_t image_bytes = (s->image_bytes + 3) & ~3u;
    memset(payload + s->image_bytes, 0, image_bytes - s->image_bytes);
    memcpy(&exposure_bits, &job->exposure.exposure_us, sizeof exposure_bits);
    uint8_t *at = put_tag(payload + image_bytes, SIM_CHUNK_ID_IMAGE, image_bytes);
    if (s->chunk[SIM_CHUNK_TIMESTAMP])
        at = put_tag(put64(at, ticks), SIM_CHUNK_ID_TIMESTAMP, 8);
    if (s->chunk[SIM_CHUNK_EXPOSURE])
        at = put_tag(put64(at, exposure_bits), SIM_CHUNK_ID_EXPOSURE, 8);
    if (s->chunk[SIM_CHUNK_COUNTER])
        put_tag(put32(at, job->edges), SIM_CHUNK_ID_COUNTER, 4);
}

/** Render while the shutter is open if a pulse says what will be seen, else after it closed. */
static void picture(struct sim_camera *c, struct job *job, const struct sim_camera_settings *s,
                    void *raw)
{
    struct sim_exposure *e = &job->exposure;
    const struct sim_camera_callbacks *call = &c->callbacks;
    uint64_t end_ns = e->true_ns + ns_of_us(e->exposure_us);
    if (!job->by_pulse) {
        wait_until(c, end_ns);
        call->shown(call->user, e->true_ns, end_ns, &e->condition, &e->step, &e->lit_us);
    }
    call->render(call->user, e, &s->format, raw);
    wait_until(c, end_ns + job->late_ms * 1000000ull);
    wait_until(c, sim_now_ns() + ns_of_us(job->crowded_ms * 1e3));
}

static uint16_t block_id(uint64_t frame_id)
{
    return (uint16_t)((frame_id - 1) % 65535 + 1);
}

static bool still_wanted(struct sim_camera *c, const struct job *job)
{
    pthread_mutex_lock(&c->lock);
    bool wanted = !c->quit && job->acquisition == c->acquisition;
    pthread_mutex_unlock(&c->lock);
    return wanted && sim_now_ns() >= atomic_load(&c->silent_until_ns);
}

static void make_frame(struct sim_camera *c, struct job *job)
{
    struct sim_camera_settings s;
    settings_of(c, &s);
    uint64_t ticks = sim_clock_at(&c->clock, job->exposure.true_ns);
    struct sim_gvsp_frame *frame = sim_gvsp_begin(c->gvsp, &s);
    if (!frame) {
        job->fate = SIM_FATE_LOST_FRAME;
        return;
    }
    picture(c, job, &s, frame->payload);
    if (s.chunks)
        write_chunks(&s, job, ticks, frame->payload);
    if (!still_wanted(c, job) || !frame->port)
        job->fate = SIM_FATE_LOST_FRAME;
    if (job->fate == SIM_FATE_SENT)
        sim_gvsp_send(c->gvsp, frame, block_id(job->frame_id), ticks, job->leader);
    if (job->fate == SIM_FATE_SENT && job->twice)
        sim_gvsp_repeat(c->gvsp, frame);
}

static void run(struct sim_camera *c, struct job *job)
{
    if (job->frame_id)
        make_frame(c, job);
    if (c->callbacks.log)
        c->callbacks.log(c->callbacks.user, &job->exposure, job->frame_id,
                         sim_clock_at(&c->clock, job->exposure.true_ns), job->fate);
    if (!job->frame_id)
        return;
    pthread_mutex_lock(&c->lock);
    c->pending_frames--;
    c->stats.sent += job->fate == SIM_FATE_SENT;
    c->stats.lost_frames += job->fate == SIM_FATE_LOST_FRAME;
    pthread_mutex_unlock(&c->lock);
}

static uint64_t free_period_ns(const struct sim_camera *c, const struct sim_camera_settings *s)
{
    double rate =
        s->frame_rate_on ? fmin(s->frame_rate_hz, c->max_frame_rate_hz) : c->max_frame_rate_hz;
    uint64_t period_ns = (uint64_t)(1e9 / rate), exposure_ns = ns_of_us(s->exposure_us);
    return period_ns > exposure_ns ? period_ns : exposure_ns;
}

/** Free run: start the exposure that is due. Returns the time of the next, or UINT64_MAX. */
static uint64_t free_run(struct sim_camera *c)
{
    struct sim_camera_settings s;
    uint64_t now = sim_now_ns();
    if (!c->acquiring)
        return UINT64_MAX;
    settings_of(c, &s);
    if (s.trigger_on)
        return UINT64_MAX;
    if (now < c->next_free_ns || now < c->busy_until_ns)
        return c->next_free_ns > c->busy_until_ns ? c->next_free_ns : c->busy_until_ns;
    expose_unlit(c, now, &s);
    c->next_free_ns += free_period_ns(c, &s);
    if (c->next_free_ns < now)
        c->next_free_ns = now;
    return c->next_free_ns;
}

static bool next_job(struct sim_camera *c, struct job *job)
{
    pthread_mutex_lock(&c->lock);
    while (!c->quit && c->head == c->tail) {
        uint64_t due = free_run(c);
        if (c->head != c->tail)
            break;
        if (due == UINT64_MAX) {
            pthread_cond_wait(&c->changed, &c->lock);
            continue;
        }
        pthread_mutex_unlock(&c->lock);
        wait_until(c, due);
        pthread_mutex_lock(&c->lock);
    }
    bool have = !c->quit;
    if (have)
        *job = c->queue[c->head++ % QUEUE];
    pthread_mutex_unlock(&c->lock);
    return have;
}

static void *expose_until_quit(void *user)
{
    struct sim_camera *c = user;
    struct job job;
    while (next_job(c, &job))
        run(c, &job);
    return NULL;
}

/* --- what the host asks, on the control channel's thread --- */

static void start_acquisition(struct sim_camera *c)
{
    if (c->acquiring)
        return;
    c->acquiring = true;
    c->acquisition++;
    c->last_frame = c->first_block - 1;
    c->next_free_ns = sim_now_ns();
    sim_gvsp_forget(c->gvsp);
    pthread_cond_signal(&c->changed);
}

static void trigger_by_software(struct sim_camera *c)
{
    struct sim_camera_settings s;
    settings_of(c, &s);
    if (s.trigger_on && !s.trigger_line)
        expose_unlit(c, sim_now_ns(), &s);
}

static void latch_clock(struct sim_camera *c)
{
    uint64_t ticks = sim_clock_at(&c->clock, sim_now_ns());
    sim_registers_set(c->registers, SIM_REG_TIMESTAMP_HIGH, (uint32_t)(ticks >> 32));
    sim_registers_set(c->registers, SIM_REG_TIMESTAMP_LOW, (uint32_t)ticks);
}

static void fire_test_packet(struct sim_camera *c)
{
    struct sim_camera_settings s;
    settings_of(c, &s);
    sim_gvsp_test_packet(c->gvsp, &s);
}

static void execute(struct sim_camera *c, uint32_t address, uint32_t value)
{
    switch (address) {
    case SIM_REG_ACQUISITION_START:
        if (value)
            start_acquisition(c);
        break;
    case SIM_REG_ACQUISITION_STOP:
        if (value)
            c->acquiring = false;
        break;
    case SIM_REG_TRIGGER_SOFTWARE:
        if (value)
            trigger_by_software(c);
        break;
    case SIM_REG_TIMESTAMP_CONTROL:
        if (value & 2)
            latch_clock(c);
        break;
    case SIM_REG_PACKET_SIZE:
        if (value >> 31)
            fire_test_packet(c);
        break;
    }
}

static enum sim_gvcp_status on_write(void *user, uint32_t address, uint32_t value)
{
    struct sim_camera *c = user;
    pthread_mutex_lock(&c->lock);
    enum sim_gvcp_status status = sim_registers_write(c->registers, address, value, c->acquiring);
    if (!status)
        execute(c, address, value);
    pthread_mutex_unlock(&c->lock);
    return status;
}

static void on_resend(void *user, uint16_t block, uint32_t first, uint32_t last)
{
    struct sim_camera *c = user;
    struct sim_camera_settings s;
    settings_of(c, &s);
    if (sim_now_ns() >= atomic_load(&c->silent_until_ns))
        sim_gvsp_resend(c->gvsp, &s, block, first, last);
}

static void on_released(void *user)
{
    struct sim_camera *c = user;
    pthread_mutex_lock(&c->lock);
    c->acquiring = false;
    sim_registers_set(c->registers, SIM_REG_STREAM_PORT, 0);
    pthread_mutex_unlock(&c->lock);
}

/* --- life --- */

static enum ls_err check_config(const struct sim_camera_config *config,
                                const struct sim_camera_callbacks *callbacks, uint32_t *ip,
                                struct ls_diag *diag)
{
    struct in_addr at;
    if (!config->address || inet_pton(AF_INET, config->address, &at) != 1)
        return ls_fail(diag, LS_ERR_INVALID, "camera: address \"%s\": expected an IPv4 address",
                       config->address ? config->address : "");
    if (config->sensor_width < 4 || config->sensor_width > MAX_SENSOR_PX ||
        config->sensor_height < 4 || config->sensor_height > MAX_SENSOR_PX)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: sensor %u x %u: expected 4..%d each way",
                       config->address, config->sensor_width, config->sensor_height, MAX_SENSOR_PX);
    if (!(config->faults.packet_loss >= 0 && config->faults.packet_loss < 1))
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: packet loss %g: expected [0, 1)",
                       config->address, config->faults.packet_loss);
    if (!callbacks->render || !callbacks->shown)
        return ls_fail(diag, LS_ERR_INVALID, "camera %s: render and shown are required",
                       config->address);
    *ip = ntohl(at.s_addr);
    return LS_OK;
}

static struct sim_camera *allocate(const struct sim_camera_config *config,
                                   const struct sim_camera_callbacks *callbacks)
{
    struct sim_camera *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->index = config->index;
    c->exposure_offset_us = config->exposure_offset_us;
    c->max_frame_rate_hz = config->max_frame_rate_hz > 0 ? config->max_frame_rate_hz : 100;
    c->first_block = config->first_block ? config->first_block : 1;
    c->faults = config->faults;
    c->callbacks = *callbacks;
    c->clock =
        (struct sim_clock){sim_now_ns(), config->clock_epoch_ticks, 1e9, config->clock_drift_ppm};
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&c->changed, &attributes);
    pthread_condattr_destroy(&attributes);
    pthread_mutex_init(&c->lock, NULL);
    return c;
}

static void free_parts(struct sim_camera *c)
{
    sim_gvcp_destroy(c->gvcp);
    sim_gvsp_destroy(c->gvsp);
    sim_registers_destroy(c->registers);
    pthread_cond_destroy(&c->changed);
    pthread_mutex_destroy(&c->lock);
    free(c);
}

static enum ls_err open_channels(struct sim_camera *c, const struct sim_camera_config *config,
                                 uint32_t ip, struct ls_diag *diag)
{
    struct sim_gvcp_hooks hooks = {c, on_write, on_resend, on_released};
    enum ls_err err = sim_registers_create(config, ip, &c->registers, diag);
    if (!err)
        err = sim_gvsp_create(ip, config->faults.packet_loss, config->faults.seed, &c->gvsp, diag);
    if (err)
        return err;
    sim_registers_set(c->registers, SIM_REG_STREAM_SOURCE, sim_gvsp_source_port(c->gvsp));
    return sim_gvcp_create(ip, c->registers, &hooks, &c->gvcp, diag);
}

enum ls_err sim_camera_create(const struct sim_camera_config *config,
                              const struct sim_camera_callbacks *callbacks, struct sim_camera **out,
                              struct ls_diag *diag)
{
    uint32_t ip = 0;
    enum ls_err err = check_config(config, callbacks, &ip, diag);
    if (err)
        return err;
    struct sim_camera *c = allocate(config, callbacks);
    if (!c)
        return LS_ERR_NOMEM;
    err = open_channels(c, config, ip, diag);
    if (!err && pthread_create(&c->thread, NULL, expose_until_quit, c))
        err = ls_fail(diag, LS_ERR_OS, "camera %s: cannot start its thread", config->address);
    if (err) {
        free_parts(c);
        return err;
    }
    *out = c;
    return LS_OK;
}

uint64_t sim_camera_ticks_at(const struct sim_camera *c, uint64_t true_ns)
{
    return sim_clock_at(&c->clock, true_ns);
}

void sim_camera_stats(struct sim_camera *c, struct sim_camera_stats *stats)
{
    struct sim_gvsp_stats stream;
    sim_gvsp_stats(c->gvsp, &stream);
    pthread_mutex_lock(&c->lock);
    *stats = c->stats;
    pthread_mutex_unlock(&c->lock);
    stats->packets_lost = stream.packets_lost;
    stats->packets_resent = stream.packets_resent;
    stats->resends_refused = stream.resends_refused;
    stats->send_errors = stream.send_errors;
}

void sim_camera_destroy(struct sim_camera *c)
{
    if (!c)
        return;
    pthread_mutex_lock(&c->lock);
    c->quit = true;
    pthread_cond_signal(&c->changed);
    pthread_mutex_unlock(&c->lock);
    pthread_join(c->thread, NULL);
    free_parts(c);
}

#include "camera_fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

/** First bytes of each picture. */
struct stamp {
    uint32_t magic, camera, step, condition, pixel_format;
};

enum { MAGIC = 0x57a6e001 };

void bench_address(char address[BENCH_ADDRESS], unsigned n)
{
    unsigned pid = (unsigned)getpid();
    snprintf(address, BENCH_ADDRESS, "127.%u.%u.%u", 64 + (pid >> 8 & 127), pid & 255, 1 + n % 250);
}

double bench_seconds(void)
{
    return (double)sim_now_ns() * 1e-9;
}

static uint8_t pattern_byte(uint32_t step, size_t at)
{
    return (uint8_t)(step * 31 + at * 7 + (at >> 8));
}

static void render(void *user, const struct sim_exposure *exposure,
                   const struct sim_raw_format *format, void *raw)
{
    struct bench *bench = user;
    uint8_t *bytes = raw;
    size_t n = (size_t)format->width * format->height * (format->pixel_format >> 16 & 0xff) / 8;
    struct stamp stamp = {MAGIC, exposure->camera, exposure->step, exposure->condition,
                          format->pixel_format};
    if (bench->whole_pattern)
        for (size_t i = 0; i < n; i++)
            bytes[i] = pattern_byte(exposure->step, i);
    memcpy(raw, &stamp, sizeof stamp);
}

static void shown(void *user, uint64_t start_ns, uint64_t end_ns, uint32_t *condition,
                  uint32_t *step, double *lit_us)
{
    *condition = 77;
    *step = 7;
    *lit_us = (double)(end_ns - start_ns) * 1e-3;
}

static void keep_log(void *user, const struct sim_exposure *exposure, uint64_t frame_id,
                     uint64_t camera_ticks, enum sim_camera_fate fate)
{
    struct bench *bench = user;
    pthread_mutex_lock(&bench->lock);
    if (bench->n_log < BENCH_LOG)
        bench->log[bench->n_log++] = (struct bench_entry){*exposure, frame_id, camera_ticks, fate};
    pthread_cond_broadcast(&bench->logged);
    pthread_mutex_unlock(&bench->lock);
}

struct bench *bench_new(unsigned n)
{
    struct bench *bench = g_new0(struct bench, 1);
    bench_address(bench->address, n);
    pthread_mutex_init(&bench->lock, NULL);
    pthread_cond_init(&bench->logged, NULL);
    bench->whole_pattern = true;
    bench->sim_config = (struct sim_camera_config){
        .address = bench->address,
        .index = n,
        .sensor_width = 320,
        .sensor_height = 240,
        .black_level_dn = 4,
        .exposure_offset_us = 13.7,
        .max_frame_rate_hz = 10000, /* ready again by the time a frame is in */
        .clock_drift_ppm = 80,
        .clock_epoch_ticks = 987654321012345u,
    };
    bench->config = (struct ls_camera_config){
        .driver = "aravis",
        .address = bench->address,
        .pixel_format = "Mono8",
        .packet_size = 1500,
        .chunks = true,
        .trigger = LS_TRIGGER_LINE,
        .exposure = LS_EXPOSURE_WIDTH,
    };
    return bench;
}

static void must(enum ls_err err, const struct ls_diag *diag, const char *what)
{
    if (err)
        g_error("%s: %s: %s", what, ls_err_name(err), diag->text);
}

void bench_plug_in(struct bench *bench)
{
    struct sim_camera_callbacks callbacks = {bench, render, shown, keep_log};
    struct ls_diag diag = {0};
    must(sim_camera_create(&bench->sim_config, &callbacks, &bench->sim, &diag), &diag, "sim");
}

void bench_power_up(struct bench *bench)
{
    struct ls_diag diag = {0};
    bench_plug_in(bench);
    must(ls_camera_open(&bench->config, &bench->camera, &diag), &diag, "open");
    must(ls_camera_apply(bench->camera, &bench->config, &diag), &diag, "apply");
}

void bench_start(struct bench *bench, uint32_t n_slots)
{
    struct ls_diag diag = {0};
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    size_t stride = (ls_camera_info(bench->camera)->payload_bytes + page - 1) / page * page;
    void *base = mmap(NULL, stride * n_slots, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_POPULATE, -1, 0);
    g_assert_true(base != MAP_FAILED);
    bench->slots = (struct ls_camera_slots){base, stride, n_slots};
    must(ls_camera_start(bench->camera, &bench->slots, &diag), &diag, "start");
}

void bench_stop(struct bench *bench, struct ls_camera_stats *stats)
{
    ls_camera_stop(bench->camera, stats);
    if (bench->slots.base)
        munmap(bench->slots.base, bench->slots.stride * bench->slots.n);
    bench->slots = (struct ls_camera_slots){0};
}

void bench_close(struct bench *bench)
{
    if (bench->camera)
        bench_stop(bench, NULL);
    ls_camera_close(bench->camera);
    sim_camera_destroy(bench->sim);
    pthread_cond_destroy(&bench->logged);
    pthread_mutex_destroy(&bench->lock);
    g_free(bench);
}

void bench_pulse_at(struct bench *bench, uint64_t true_ns, uint32_t step, double pulse_us)
{
    sim_camera_pulse(bench->sim, true_ns, pulse_us, step, 1000 + step);
}

uint64_t bench_pulse(struct bench *bench, uint32_t step, double pulse_us)
{
    uint64_t now = sim_now_ns();
    bench_pulse_at(bench, now, step, pulse_us);
    return now;
}

struct ls_camera_frame bench_next(struct bench *bench, uint64_t timeout_us)
{
    struct ls_camera_frame frame = {0};
    struct ls_diag diag = {0};
    must(ls_camera_next(bench->camera, timeout_us, &frame), &diag, "next");
    return frame;
}

bool bench_shows(const struct bench *bench, const struct ls_camera_frame *frame, uint32_t step)
{
    const uint8_t *bytes = (uint8_t *)bench->slots.base + frame->slot * bench->slots.stride;
    struct stamp stamp;
    memcpy(&stamp, bytes, sizeof stamp);
    if (stamp.magic != MAGIC || stamp.step != step || stamp.camera != bench->sim_config.index)
        return false;
    if (bench->whole_pattern)
        for (size_t i = sizeof stamp; i < frame->payload_bytes; i++)
            if (bytes[i] != pattern_byte(step, i))
                return false;
    return true;
}

static bool find_logged(struct bench *bench, uint32_t step, struct bench_entry *entry)
{
    bool found = false;
    for (unsigned i = 0; !found && i < bench->n_log; i++) {
        *entry = bench->log[i];
        found = entry->exposure.step == step;
    }
    return found;
}

struct bench_entry bench_logged(struct bench *bench, uint32_t step)
{
    struct bench_entry entry = {0};
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += 5;
    pthread_mutex_lock(&bench->lock);
    while (!find_logged(bench, step, &entry))
        if (pthread_cond_timedwait(&bench->logged, &bench->lock, &until))
            g_error("step %u never reached the log", step);
    pthread_mutex_unlock(&bench->lock);
    return entry;
}

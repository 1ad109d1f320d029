#include "tests/drivers/dome_fixture.h"

#include <glib.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static enum ls_err on_commit(void *user, const struct sim_condition *conditions, uint32_t n,
                             _Atomic uint32_t *progress, struct ls_diag *diag)
{
    struct dome_log *log = user;
    log->n_conditions = n;
    for (uint32_t i = 0; i < n && i < DOME_CONDITIONS; i++) {
        log->conditions[i].n_leds = conditions[i].n_leds;
        for (uint32_t k = 0; k < conditions[i].n_leds && k < DOME_LEDS; k++)
            log->conditions[i].leds[k] = conditions[i].leds[k];
    }
    log->n_commits++;
    while (log->hold_commit && sem_wait(&log->let_commit))
        ;
    return LS_OK;
}

static void on_pulse(void *user, const struct sim_pulse *pulse)
{
    struct dome_log *log = user;
    log->pulses[log->n_pulses % DOME_PULSES] = *pulse;
    log->n_pulses++;
}

static void on_release(void *user, uint64_t true_ns, uint32_t step)
{
    struct dome_log *log = user;
    log->release_ns[step % DOME_PULSES] = true_ns;
    log->n_releases++;
}

static void on_dark(void *user, uint64_t true_ns)
{
    struct dome_log *log = user;
    log->dark_ns[log->n_darks % 64] = true_ns;
    log->n_darks++;
    sem_post(&log->dark);
}

static void on_work(void *user, uint64_t true_ns, uint16_t channel, double duty)
{
    struct dome_log *log = user;
    log->work_channel = channel;
    log->work_duty = duty;
}

struct ready {
    unsigned port;
    char path[128];
};

static void child(const struct sim_controller_config *config, struct dome_log *log, int ready_fd,
                  int hold_fd)
{
    struct sim_controller_hooks hooks = {log, on_commit, on_pulse, on_release, on_dark, on_work};
    struct sim_controller *controller;
    struct ls_diag diag = {0};
    char byte;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (sim_controller_create(config, &hooks, &controller, &diag)) {
        g_printerr("%s\n", diag.text);
        _exit(1);
    }
    struct ready ready = {.port = sim_controller_port(controller)};
    g_strlcpy(ready.path, sim_controller_path(controller), sizeof ready.path);
    if (write(ready_fd, &ready, sizeof ready) != sizeof ready)
        _exit(1);
    close(ready_fd);
    while (read(hold_fd, &byte, 1) > 0)
        ;
    sim_controller_destroy(controller);
    _exit(0);
}

struct dome dome_start(const struct sim_controller_config *config)
{
    struct dome dome = {0};
    int ready[2], hold[2];
    dome.log =
        mmap(NULL, sizeof *dome.log, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    g_assert_true(dome.log != MAP_FAILED);
    g_assert_no_errno(sem_init(&dome.log->let_commit, 1, 0));
    g_assert_no_errno(sem_init(&dome.log->dark, 1, 0));
    g_assert_no_errno(pipe(ready));
    g_assert_no_errno(pipe(hold));
    dome.pid = fork();
    g_assert_cmpint(dome.pid, >=, 0);
    if (!dome.pid) {
        close(ready[0]);
        close(hold[1]);
        child(config, dome.log, ready[1], hold[0]);
    }
    close(ready[1]);
    close(hold[0]);
    dome.hold_fd = hold[1];
    struct ready said;
    g_assert_cmpint(read(ready[0], &said, sizeof said), ==, sizeof said);
    close(ready[0]);
    dome.port = said.port;
    dome.baud = config->baud;
    dome.wire = (enum sim_controller_wire)config->wire;
    g_strlcpy(dome.path, said.path, sizeof dome.path);
    if (dome.wire == SIM_WIRE_USB)
        g_setenv("UMOCKDEV_DIR", dome.path, true);
    return dome;
}

struct ls_lights_config dome_address(const struct dome *dome)
{
    static const char *const drivers[] = {"modbus", "modbus-rtu", "usb"};
    static const char *const addresses[] = {"127.0.0.1", NULL, "any"};
    return (struct ls_lights_config){
        .driver = drivers[dome->wire],
        .address = addresses[dome->wire] ? addresses[dome->wire] : dome->path,
        .port = dome->port,
        .baud = dome->baud,
        .unit = 1,
        .timeout_ms = 2000, /* a busy machine */
    };
}

void dome_stop(struct dome *dome)
{
    int status = 0;
    close(dome->hold_fd);
    g_assert_cmpint(waitpid(dome->pid, &status, 0), ==, dome->pid);
    g_assert_cmpint(status, ==, 0);
    munmap(dome->log, sizeof *dome->log);
}

void dome_wait_dark(struct dome *dome)
{
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += 10;
    g_assert_no_errno(sem_timedwait(&dome->log->dark, &until));
}

struct sim_controller_config dome_small(void)
{
    struct sim_controller_config config;
    sim_controller_defaults(&config);
    config.n_lights = 12;
    config.n_channels = 3;
    config.min_period_us = 1000;
    config.max_current_ma = 6000;
    config.baud = 921600;                   /* a status, 245 bytes, takes 3 ms */
    config.clock.epoch_ticks = 5000000000u; /* beyond 32 bits */
    config.clock.drift_ppm = -80;
    return config;
}

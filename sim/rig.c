#include "sim/rig.h"

#include "sim/log.h"
#include "sim/showing.h"

#include <jansson.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct sim_rig {
    const struct sim_config *config;
    struct sim_scene *scene;
    struct sim_showing *showing;
    struct sim_log *log;
    struct sim_camera *cameras[SIM_MAX_CAMERAS];
    uint32_t n_cameras;
    struct sim_controller *controller;
    bool working; /* the work light is on; under the controller's lock */
    _Atomic bool ending;
};

struct commit {
    struct sim_rig *rig;
    _Atomic uint32_t *progress;
};

/** A commit cannot be cancelled, and nothing is left to save in it: leave from within. */
static void on_progress(void *user, double done)
{
    struct commit *commit = user;
    if (commit->rig->ending)
        _exit(EXIT_SUCCESS);
    *commit->progress = (uint32_t)(done * 1000);
}

static enum ls_err on_commit(void *user, const struct sim_condition *conditions, uint32_t n,
                             _Atomic uint32_t *progress, struct ls_diag *diag)
{
    struct sim_rig *rig = user;
    struct commit commit = {rig, progress};
    enum ls_err err = sim_scene_commit(rig->scene, conditions, n, on_progress, &commit, diag);
    if (!err)
        err = sim_showing_commit(rig->showing, conditions, n, diag);
    if (err)
        fprintf(stderr, "lightstage-sim: preparing a program: %s\n", diag->text);
    return err;
}

static void on_pulse(void *user, const struct sim_pulse *pulse)
{
    struct sim_rig *rig = user;
    sim_showing_begin(rig->showing, pulse);
    for (uint32_t i = 0; i < rig->n_cameras; i++)
        sim_camera_pulse(rig->cameras[i], pulse->true_ns, pulse->pulse_us, pulse->step,
                         pulse->condition);
}

static void on_release(void *user, uint64_t true_ns, uint32_t step)
{
    struct sim_rig *rig = user;
    sim_showing_end(rig->showing, true_ns);
}

static void on_dark(void *user, uint64_t true_ns)
{
    struct sim_rig *rig = user;
    sim_showing_end(rig->showing, true_ns);
}

static void on_work(void *user, uint64_t true_ns, uint16_t channel, double duty)
{
    struct sim_rig *rig = user;
    sim_showing_work(rig->showing, true_ns, channel, sim_scene_quantise(rig->scene, duty));
    if (duty > 0)
        fprintf(stderr, "lightstage-sim: work light: channel %u at %.4f\n", channel, duty);
    else if (rig->working)
        fputs("lightstage-sim: work light: off\n", stderr);
    rig->working = duty > 0;
}

static void on_render(void *user, const struct sim_exposure *exposure,
                      const struct sim_raw_format *format, void *raw)
{
    struct sim_rig *rig = user;
    struct ls_diag diag = {0};
    size_t bytes = sim_raw_bytes(format);
    if (sim_scene_expose(rig->scene, exposure, format, raw, bytes, &diag)) {
        fprintf(stderr, "lightstage-sim: camera %u: %s\n", exposure->camera, diag.text);
        memset(raw, 0, bytes);
    }
}

static void on_shown(void *user, uint64_t start_ns, uint64_t end_ns, uint32_t *condition,
                     uint32_t *step, double *lit_us)
{
    struct sim_rig *rig = user;
    sim_showing_in(rig->showing, start_ns, end_ns, condition, step, lit_us);
}

static void on_log(void *user, const struct sim_exposure *exposure, uint64_t frame_id,
                   uint64_t camera_ticks, enum sim_camera_fate fate)
{
    struct sim_rig *rig = user;
    struct sim_shown shown = sim_showing_describe(rig->showing, exposure->condition);
    sim_log_exposure(rig->log, exposure, frame_id, camera_ticks, &shown, fate);
}

static enum ls_err create_cameras(struct sim_rig *rig, struct ls_diag *diag)
{
    struct sim_camera_callbacks callbacks = {rig, on_render, on_shown, on_log};
    enum ls_err err = LS_OK;
    while (!err && rig->n_cameras < rig->config->scene.n_cameras) {
        err = sim_camera_create(&rig->config->cameras[rig->n_cameras], &callbacks,
                                &rig->cameras[rig->n_cameras], diag);
        rig->n_cameras += !err;
    }
    return err;
}

static enum ls_err create_controller(struct sim_rig *rig, struct ls_diag *diag)
{
    struct sim_controller_hooks hooks = {rig, on_commit, on_pulse, on_release, on_dark, on_work};
    struct sim_controller_config config = rig->config->controller;
    config.n_lights = sim_scene_geometry(rig->scene)->n_lights;
    return sim_controller_create(&config, &hooks, &rig->controller, diag);
}

enum ls_err sim_rig_create(const struct sim_config *config, struct sim_rig **out,
                           struct ls_diag *diag)
{
    struct sim_rig *rig = calloc(1, sizeof *rig);
    *out = NULL;
    if (!rig)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    rig->config = config;
    enum ls_err err = sim_log_open(config->log, &rig->log, diag);
    if (!err)
        err = sim_showing_create(&rig->showing, diag);
    if (!err)
        err = sim_scene_create(&config->scene, &rig->scene, diag);
    if (!err)
        err = create_cameras(rig, diag);
    if (!err)
        err = create_controller(rig, diag);
    if (err)
        (void)!sim_rig_destroy(rig, NULL);
    else
        *out = rig;
    return err;
}

char *sim_rig_ready_line(const struct sim_rig *rig)
{
    json_t *cameras = json_array();
    for (uint32_t i = 0; i < rig->n_cameras; i++)
        json_array_append_new(cameras, json_string(rig->config->cameras[i].address));
    json_t *line = json_pack("{s:i, s:s, s:i, s:s, s:o, s:i, s:i}", "pid", (int)getpid(),
                             "modbus_address", rig->config->controller.address, "modbus_port",
                             (int)sim_controller_port(rig->controller), "controller_path",
                             sim_controller_path(rig->controller), "cameras", cameras, "lights",
                             (int)sim_scene_geometry(rig->scene)->n_lights, "channels",
                             (int)rig->config->scene.n_channels);
    char *text = line ? json_dumps(line, JSON_COMPACT) : NULL;
    json_decref(line);
    return text;
}

enum ls_err sim_rig_destroy(struct sim_rig *rig, struct ls_diag *diag)
{
    if (!rig)
        return LS_OK;
    rig->ending = true;
    sim_controller_destroy(rig->controller);
    for (uint32_t i = 0; i < rig->n_cameras; i++)
        sim_camera_destroy(rig->cameras[i]);
    sim_scene_destroy(rig->scene);
    sim_showing_destroy(rig->showing);
    enum ls_err err = sim_log_close(rig->log, diag);
    free(rig);
    return err;
}

#include "sim/config.h"

#include "core/pixel.h"
#include "sim/config_read.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define U32_MAX 4294967295.0
#define I64_MAX 9007199254740992.0 /* 2^53: exact in the reader's arithmetic */

static const struct sim_key scene_keys[] = {
    {"scene", SIM_KEY_STRING, SIM_FIELD(struct sim_scene_config, scene),
     "stilllife grey chrome gloss highlights stamp replay"},
    {"seed", SIM_KEY_U64, SIM_RANGE(struct sim_scene_config, seed, 0, I64_MAX)},
    {"positions", SIM_KEY_PATH, SIM_FIELD(struct sim_scene_config, positions_csv)},
    {"axes", SIM_KEY_STRING, SIM_FIELD(struct sim_scene_config, axes)},
    {"unit", SIM_KEY_STRING, SIM_FIELD(struct sim_scene_config, unit), "m cm mm"},
    {"lights", SIM_KEY_U32, SIM_RANGE(struct sim_scene_config, n_lights, 1, SIM_MAX_LIGHTS)},
    {"radius_m", SIM_KEY_DOUBLE, SIM_RANGE(struct sim_scene_config, radius_m, 0.1, 100)},
    {"gain_sigma", SIM_KEY_DOUBLE, SIM_RANGE(struct sim_scene_config, gain_sigma, 0, 1)},
    {"pwm_levels", SIM_KEY_U32, SIM_RANGE(struct sim_scene_config, pwm_levels, 0, 65535)},
    {"channels", SIM_KEY_OTHER},
    {"led_faults", SIM_KEY_OTHER},
    {"spectra", SIM_KEY_PATH, SIM_FIELD(struct sim_scene_config, spectra_dir)},
    {"replay", SIM_KEY_PATH, SIM_FIELD(struct sim_scene_config, replay_dir)},
    {"replay_linear", SIM_KEY_BOOL, SIM_FIELD(struct sim_scene_config, replay_linear)},
    {"sphere_radius_m", SIM_KEY_DOUBLE,
     SIM_RANGE(struct sim_scene_config, sphere_radius_m, 1e-3, 0.1)},
    {"memory_bytes", SIM_KEY_U64, SIM_RANGE(struct sim_scene_config, memory_bytes, 0, I64_MAX)},
    {"threads", SIM_KEY_U32, SIM_RANGE(struct sim_scene_config, threads, 1, 2)},
    {"stamp_frames", SIM_KEY_U32, SIM_RANGE(struct sim_scene_config, stamp_frames, 0, 64)},
    {NULL},
};

static const struct sim_key channel_keys[] = {
    {"name", SIM_KEY_STRING, SIM_FIELD(struct sim_channel_config, name)},
    {"kind", SIM_KEY_CHOICE, SIM_FIELD(struct sim_channel_config, kind),
     "spectrum vertical horizontal"},
    {"spectrum", SIM_KEY_STRING, SIM_FIELD(struct sim_channel_config, spectrum)},
    {"droop", SIM_KEY_DOUBLE, SIM_RANGE(struct sim_channel_config, droop, 1, 10)},
    {"drift", SIM_KEY_DOUBLE, SIM_RANGE(struct sim_channel_config, drift, -0.9, 9)},
    {"drift_pulses", SIM_KEY_DOUBLE, SIM_RANGE(struct sim_channel_config, drift_pulses, 1e-3, 1e9)},
    {NULL},
};

static const struct sim_key led_fault_keys[] = {
    {"light", SIM_KEY_U32, SIM_RANGE(struct sim_led_fault, light, 0, SIM_MAX_LIGHTS - 1)},
    {"channel", SIM_KEY_STRING, SIM_FIELD(struct sim_led_fault, channel)},
    {"strength", SIM_KEY_DOUBLE, SIM_RANGE(struct sim_led_fault, strength, 0, 10)},
    {NULL},
};

/** A camera as written down: what it sees, how it talks. */
struct camera {
    struct sim_view_config view;
    struct sim_camera_config wire;
    struct sim_camera_names names;
    char pixel_format[32];
};

static const struct sim_key camera_keys[] = {
    {"address", SIM_KEY_STRING, SIM_FIELD(struct camera, names.address)},
    {"serial", SIM_KEY_STRING, SIM_FIELD(struct camera, names.serial)},
    {"model", SIM_KEY_STRING, SIM_FIELD(struct camera, names.model)},
    {"position_m", SIM_KEY_VECTOR, SIM_FIELD(struct camera, view.position_m)},
    {"look_at_m", SIM_KEY_VECTOR, SIM_FIELD(struct camera, view.look_at_m)},
    {"focal_length_mm", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.focal_length_mm, 1, 2000)},
    {"sensor_width_mm", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.sensor_width_mm, 0.1, 100)},
    {"width", SIM_KEY_U32, SIM_RANGE(struct camera, view.width, 4, 16384)},
    {"height", SIM_KEY_U32, SIM_RANGE(struct camera, view.height, 4, 16384)},
    {"cfa", SIM_KEY_STRING, SIM_FIELD(struct camera, view.cfa), "RG GR GB BG mono"},
    {"blur_px", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.blur_px, 0, 2)},
    {"full_well_e", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.full_well_e, 10, 1e9)},
    {"black", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.black, 0, 0.5)},
    {"read_noise_e", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.read_noise_e, 0, 1e6)},
    {"dark_current_e_s", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.dark_current_e_s, 0, 1e9)},
    {"prnu", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.prnu, 0, 0.5)},
    {"hot_per_mpixel", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.hot_per_mpixel, 0, 1e6)},
    {"ambient", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.ambient, 0, 1e6)},
    {"white_exposure_us", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, view.white_exposure_us, 1, 1e8)},
    {"exposure_offset_us", SIM_KEY_DOUBLE,
     SIM_RANGE(struct camera, view.exposure_offset_us, -40, 1000)},
    {"pixel_format", SIM_KEY_STRING, SIM_FIELD(struct camera, pixel_format)},
    {"max_frame_rate_hz", SIM_KEY_DOUBLE,
     SIM_RANGE(struct camera, wire.max_frame_rate_hz, 0.01, 1e5)},
    {"clock_drift_ppm", SIM_KEY_DOUBLE, SIM_RANGE(struct camera, wire.clock_drift_ppm, -1e4, 1e4)},
    {"clock_epoch_ticks", SIM_KEY_U64,
     SIM_RANGE(struct camera, wire.clock_epoch_ticks, 0, I64_MAX)},
    {"first_block", SIM_KEY_U64, SIM_RANGE(struct camera, wire.first_block, 1, 65535)},
    {"rolling", SIM_KEY_BOOL, SIM_FIELD(struct camera, wire.rolling)},
    {"timed_only", SIM_KEY_BOOL, SIM_FIELD(struct camera, wire.timed_only)},
    {NULL},
};

#define CONTROLLER(field, min, max) SIM_RANGE(struct sim_controller_config, field, min, max)

static const struct sim_key controller_keys[] = {
    {"wire", SIM_KEY_CHOICE, SIM_FIELD(struct sim_controller_config, wire),
     "modbus modbus-rtu usb"},
    {"address", SIM_KEY_STRING, SIM_FIELD(struct sim_controller_config, address)},
    {"baud", SIM_KEY_U32, CONTROLLER(baud, 1200, 4e6)},
    {"port", SIM_KEY_U32, CONTROLLER(port, 0, 65535)},
    {"unit", SIM_KEY_U32, CONTROLLER(unit, 0, 247)},
    {"serial", SIM_KEY_STRING, SIM_FIELD(struct sim_controller_config, serial)},
    {"firmware", SIM_KEY_U32, CONTROLLER(firmware, 0, U32_MAX)},
    {"pwm_period_us", SIM_KEY_U32, CONTROLLER(pwm_period_us, 1, 1e6)},
    {"min_pulse_us", SIM_KEY_U32, CONTROLLER(min_pulse_us, 1, 1e9)},
    {"max_pulse_us", SIM_KEY_U32, CONTROLLER(max_pulse_us, 1, 1e9)},
    {"min_period_us", SIM_KEY_U32, CONTROLLER(min_period_us, 1, 1e9)},
    {"max_duty_permille", SIM_KEY_U32, CONTROLLER(max_duty_permille, 1, 1000)},
    {"max_current_ma", SIM_KEY_U32, CONTROLLER(max_current_ma, 1, U32_MAX)},
    {"led_current_ma", SIM_KEY_U32, CONTROLLER(led_current_ma, 1, 1e6)},
    {"max_power_mw", SIM_KEY_U32, CONTROLLER(max_power_mw, 1, U32_MAX)},
    {"led_power_mw", SIM_KEY_U32, CONTROLLER(led_power_mw, 1, 1e6)},
    {"max_conditions", SIM_KEY_U32, CONTROLLER(max_conditions, 1, 65535)},
    {"max_steps", SIM_KEY_U32, CONTROLLER(max_steps, 1, 1e7)},
    {"max_program_bytes", SIM_KEY_U32, CONTROLLER(max_program_bytes, 1024, 1u << 28)},
    {"max_hold_us", SIM_KEY_U32, CONTROLLER(max_hold_us, 1, 1e9)},
    {"heartbeat_ms", SIM_KEY_U32, CONTROLLER(heartbeat_ms, 1, 3600000)},
    {"event_queue", SIM_KEY_U32, CONTROLLER(event_queue, 1, 1e6)},
    {"temperature_c", SIM_KEY_I32, CONTROLLER(temperature_c, -40, 150)},
    {"hot_c", SIM_KEY_I32, CONTROLLER(hot_c, 0, 150)},
    {"max_c", SIM_KEY_I32, CONTROLLER(max_c, 0, 150)},
    {"clock_drift_ppm", SIM_KEY_DOUBLE, CONTROLLER(clock.drift_ppm, -1e4, 1e4)},
    {"clock_epoch_us", SIM_KEY_U64, CONTROLLER(clock.epoch_ticks, 0, I64_MAX)},
    {NULL},
};

/** A fault as written down. */
struct fault {
    uint32_t kind, camera, at, count;
    double value;
    uint64_t seed;
};

enum fault_kind {
    /* of the controller, in the order of enum sim_controller_fault_kind */
    FAULT_STALL,
    FAULT_REFUSE,
    FAULT_DISCONNECT,
    FAULT_INTERLOCK,
    FAULT_ESTOP,
    FAULT_DEAD,
    FAULT_CORRUPT,
    FAULT_REBOOT_CONTROLLER,
    FAULT_LATE,
    FAULT_LOSE_PACKET,
    FAULT_DAMAGE_PACKET,
    FAULT_HALT,
    FAULT_HEAT,
    FAULT_OVERHEAT,
    FAULT_DAMAGE_ANSWER,
    /* of a camera */
    FAULT_DROP_PULSE,
    FAULT_LOSE_FRAME,
    FAULT_DUPLICATE_FRAME,
    FAULT_LATE_FRAME,
    FAULT_EARLY_PULSE,
    FAULT_DOUBLE_PULSE,
    FAULT_LOSE_LEADER,
    FAULT_CROWDED,
    FAULT_PACKET_LOSS,
    FAULT_SILENT,
    FAULT_REBOOT,
};

static const struct sim_key fault_keys[] = {
    {"kind", SIM_KEY_CHOICE, SIM_FIELD(struct fault, kind),
     "stall refuse disconnect interlock estop dead corrupt restart late lose_packet damage_packet "
     "halt heat overheat damage_answer "
     "drop_pulse lose_frame duplicate_frame late_frame early_pulse double_pulse lose_leader "
     "crowded packet_loss silent reboot"},
    {"camera", SIM_KEY_U32, SIM_RANGE(struct fault, camera, 0, SIM_MAX_CAMERAS - 1)},
    {"at", SIM_KEY_U32, SIM_RANGE(struct fault, at, 0, U32_MAX)},
    {"count", SIM_KEY_U32, SIM_RANGE(struct fault, count, 1, U32_MAX)},
    {"value", SIM_KEY_DOUBLE, SIM_RANGE(struct fault, value, 0, 1e9)},
    {"seed", SIM_KEY_U64, SIM_RANGE(struct fault, seed, 0, I64_MAX)},
    {NULL},
};

static const struct sim_key top_keys[] = {
    {"scene", SIM_KEY_OTHER},
    {"cameras", SIM_KEY_OTHER},
    {"controller", SIM_KEY_OTHER},
    {"faults", SIM_KEY_OTHER},
    {"log", SIM_KEY_PATH, SIM_FIELD(struct sim_config, log)},
    {NULL},
};

static void default_camera(struct sim_config *config, uint32_t i)
{
    struct sim_camera_names *names = &config->names[i];
    config->cameras[i] = (struct sim_camera_config){
        .max_frame_rate_hz = 100,
        .clock_drift_ppm = 20.0 - 15.0 * i,
        .clock_epoch_ticks = 1000000000ull * (77 + 1000 * i),
    };
    snprintf(names->address, sizeof names->address, "127.0.0.%u", 2 + i);
    snprintf(names->serial, sizeof names->serial, "SIM%u", i);
    snprintf(names->model, sizeof names->model, "lightstage-sim");
}

/** What follows from other keys, and the pointers. */
static void derive(struct sim_config *config)
{
    for (uint32_t i = 0; i < config->scene.n_cameras; i++) {
        struct sim_camera_config *camera = &config->cameras[i];
        const struct sim_view_config *view = &config->scene.views[i];
        camera->index = i;
        camera->address = config->names[i].address;
        camera->serial = config->names[i].serial;
        camera->model = config->names[i].model;
        camera->sensor_width = view->width;
        camera->sensor_height = view->height;
        camera->exposure_offset_us = view->exposure_offset_us;
        camera->black_level_dn = round(view->black * 255);
    }
    config->controller.n_lights = config->scene.n_lights;
    config->controller.n_channels = config->scene.n_channels;
    config->controller.pwm_levels =
        (config->scene.pwm_levels ? config->scene.pwm_levels : 65535) + 1;
}

void sim_config_defaults(struct sim_config *config)
{
    memset(config, 0, sizeof *config);
    sim_scene_config_default(&config->scene);
    sim_controller_defaults(&config->controller);
    config->controller.clock.epoch_ticks = 3600000000u;
    config->controller.clock.drift_ppm = -35;
    for (uint32_t i = 0; i < SIM_MAX_CAMERAS; i++)
        default_camera(config, i);
    derive(config);
}

static enum ls_err list_of(const config_setting_t *s, int most, struct ls_diag *diag)
{
    if (config_setting_type(s) != CONFIG_TYPE_LIST || config_setting_length(s) < 1 ||
        config_setting_length(s) > most)
        return sim_config_fail(s, diag, "%s: expected a list of 1..%d groups, ( { ... }, ... )",
                               config_setting_name(s), most);
    return LS_OK;
}

static enum ls_err read_channels(const config_setting_t *s, struct sim_scene_config *scene,
                                 struct ls_diag *diag)
{
    enum ls_err err = list_of(s, SIM_MAX_CHANNELS, diag);
    if (err)
        return err;
    scene->n_channels = (uint32_t)config_setting_length(s);
    for (uint32_t i = 0; !err && i < scene->n_channels; i++) {
        const config_setting_t *group = config_setting_get_elem(s, i);
        scene->channels[i] = (struct sim_channel_config){.droop = 1, .drift_pulses = 100};
        err = sim_config_read(group, channel_keys, &scene->channels[i], diag);
        if (!err && (!scene->channels[i].name[0] || !scene->channels[i].spectrum[0]))
            err = sim_config_fail(group, diag, "channel %u: expected a name and a spectrum", i);
    }
    return err;
}

static bool names_channel(const struct sim_scene_config *scene, const char *name)
{
    for (uint32_t i = 0; i < scene->n_channels; i++)
        if (!strcmp(scene->channels[i].name, name))
            return true;
    return false;
}

/* After the channels, which they name. */
static enum ls_err read_led_faults(const config_setting_t *s, struct sim_scene_config *scene,
                                   struct ls_diag *diag)
{
    enum ls_err err = list_of(s, SIM_MAX_LED_FAULTS, diag);
    if (err)
        return err;
    scene->n_led_faults = (uint32_t)config_setting_length(s);
    for (uint32_t i = 0; !err && i < scene->n_led_faults; i++) {
        const config_setting_t *group = config_setting_get_elem(s, i);
        struct sim_led_fault *fault = &scene->led_faults[i];
        err = sim_config_read(group, led_fault_keys, fault, diag);
        if (!err && fault->channel[0] && !names_channel(scene, fault->channel))
            err = sim_config_fail(group, diag, "channel: \"%s\": the scene has no such channel",
                                  fault->channel);
    }
    return err;
}

static enum ls_err read_scene(const config_setting_t *s, struct sim_config *config,
                              struct ls_diag *diag)
{
    enum ls_err err = sim_config_read(s, scene_keys, &config->scene, diag);
    const config_setting_t *channels = config_setting_get_member(s, "channels");
    const config_setting_t *faults = config_setting_get_member(s, "led_faults");
    if (!err && channels)
        err = read_channels(channels, &config->scene, diag);
    return !err && faults ? read_led_faults(faults, &config->scene, diag) : err;
}

static enum ls_err set_pixel_format(const config_setting_t *s, struct camera *camera,
                                    struct ls_diag *diag)
{
    static const struct {
        const char *cfa, *prefix, *first;
    } orders[] = {{"RG", "BayerRG", "BayerRG8"},
                  {"GR", "BayerGR", "BayerGR8"},
                  {"GB", "BayerGB", "BayerGB8"},
                  {"BG", "BayerBG", "BayerBG8"},
                  {"mono", "Mono", "Mono8"}};
    for (size_t i = 0; i < sizeof orders / sizeof *orders; i++) {
        if (strcmp(orders[i].cfa, camera->view.cfa))
            continue;
        const char *name = camera->pixel_format[0] ? camera->pixel_format : orders[i].first;
        const struct ls_pixel_format *format = ls_pixel_by_name(name);
        if (!format || strncmp(name, orders[i].prefix, strlen(orders[i].prefix)))
            return sim_config_fail(s, diag,
                                   "pixel_format: \"%s\": expected a %s... format, e.g. %s", name,
                                   orders[i].prefix, orders[i].first);
        camera->wire.pixel_format = format->code;
        return LS_OK;
    }
    return sim_config_fail(s, diag, "cfa: \"%s\": expected one of: RG GR GB BG mono",
                           camera->view.cfa);
}

/** Width and height first: the other defaults of a view follow from them. */
static void size_view(const config_setting_t *s, struct sim_view_config *view)
{
    int width = (int)view->width, height = (int)view->height;
    config_setting_lookup_int(s, "width", &width);
    config_setting_lookup_int(s, "height", &height);
    if (width >= 4 && width <= 16384 && height >= 4 && height <= 16384)
        sim_view_config_default(view, (uint32_t)width, (uint32_t)height);
}

static enum ls_err read_camera(const config_setting_t *s, uint32_t i, struct sim_config *config,
                               struct ls_diag *diag)
{
    struct camera camera = {config->scene.views[i], config->cameras[i], config->names[i], ""};
    if (config_setting_type(s) == CONFIG_TYPE_GROUP)
        size_view(s, &camera.view);
    enum ls_err err = sim_config_read(s, camera_keys, &camera, diag);
    if (!err)
        err = set_pixel_format(s, &camera, diag);
    if (!err && (camera.view.width % 4 || camera.view.height % 4))
        err = sim_config_fail(s, diag, "camera of %u x %u: expected multiples of 4",
                              camera.view.width, camera.view.height);
    config->scene.views[i] = camera.view;
    config->cameras[i] = camera.wire;
    config->names[i] = camera.names;
    return err;
}

static enum ls_err read_cameras(const config_setting_t *s, struct sim_config *config,
                                struct ls_diag *diag)
{
    enum ls_err err = list_of(s, SIM_MAX_CAMERAS, diag);
    if (err)
        return err;
    for (uint32_t i = config->scene.n_cameras; i < SIM_MAX_CAMERAS; i++)
        config->scene.views[i] = config->scene.views[0];
    config->scene.n_cameras = (uint32_t)config_setting_length(s);
    for (uint32_t i = 0; !err && i < config->scene.n_cameras; i++)
        err = read_camera(config_setting_get_elem(s, i), i, config, diag);
    return err;
}

static enum ls_err add_pulses(const config_setting_t *s, uint64_t *pulses,
                              const struct fault *fault, struct ls_diag *diag)
{
    uint32_t n = 0;
    while (n < SIM_CAMERA_MAX_FAULTS && pulses[n])
        n++;
    if (fault->count > SIM_CAMERA_MAX_FAULTS - n || !fault->at)
        return sim_config_fail(s, diag,
                               "fault: expected at = 1 or more (the first pulse is 1), and at most "
                               "%u pulses of a kind and camera",
                               SIM_CAMERA_MAX_FAULTS);
    for (uint32_t i = 0; i < fault->count; i++)
        pulses[n + i] = (uint64_t)fault->at + i;
    return LS_OK;
}

static enum ls_err add_camera_fault(const config_setting_t *s, struct sim_camera_faults *faults,
                                    const struct fault *fault, struct ls_diag *diag)
{
    switch ((enum fault_kind)fault->kind) {
    case FAULT_DROP_PULSE:
        return add_pulses(s, faults->drop_pulse, fault, diag);
    case FAULT_LOSE_FRAME:
        return add_pulses(s, faults->lose_frame, fault, diag);
    case FAULT_DUPLICATE_FRAME:
        return add_pulses(s, faults->duplicate_frame, fault, diag);
    case FAULT_LATE_FRAME:
        faults->late_ms = (uint32_t)fault->value;
        return add_pulses(s, faults->late_frame, fault, diag);
    case FAULT_EARLY_PULSE:
        faults->early_us = fault->value * 1e3;
        return add_pulses(s, faults->early_pulse, fault, diag);
    case FAULT_DOUBLE_PULSE:
        faults->double_us = fault->value * 1e3;
        return add_pulses(s, faults->double_pulse, fault, diag);
    case FAULT_LOSE_LEADER:
        return add_pulses(s, faults->lose_leader, fault, diag);
    case FAULT_CROWDED:
        faults->crowded_pulse = fault->at;
        faults->crowded_ms = fault->value;
        faults->seed = fault->seed;
        return LS_OK;
    case FAULT_SILENT:
        faults->silent_pulse = fault->at;
        faults->silent_ms = (uint32_t)fault->value;
        return LS_OK;
    case FAULT_REBOOT:
        faults->reboot_pulse = fault->at;
        faults->reboot_ms = (uint32_t)fault->value;
        return LS_OK;
    default:
        if (fault->value > 1)
            return sim_config_fail(s, diag, "packet_loss: value: expected a probability in 0..1");
        faults->packet_loss = fault->value;
        faults->seed = fault->seed;
        return LS_OK;
    }
}

static enum ls_err read_fault(const config_setting_t *s, struct sim_config *config,
                              struct ls_diag *diag)
{
    struct fault fault = {.kind = UINT32_MAX, .count = 1};
    enum ls_err err = sim_config_read(s, fault_keys, &fault, diag);
    if (err)
        return err;
    if (fault.kind == UINT32_MAX)
        return sim_config_fail(s, diag, "fault without a kind");
    if (fault.camera >= config->scene.n_cameras)
        return sim_config_fail(s, diag, "camera: %u: expected 0..%u", fault.camera,
                               config->scene.n_cameras - 1);
    if (fault.kind >= FAULT_DROP_PULSE)
        return add_camera_fault(s, &config->cameras[fault.camera].faults, &fault, diag);
    if (config->controller.n_faults == SIM_CONTROLLER_MAX_FAULTS)
        return sim_config_fail(s, diag, "expected at most %u faults of the controller",
                               SIM_CONTROLLER_MAX_FAULTS);
    config->controller.faults[config->controller.n_faults++] = (struct sim_controller_fault){
        (enum sim_controller_fault_kind)fault.kind, fault.at, fault.count, fault.value};
    return LS_OK;
}

static enum ls_err read_faults(const config_setting_t *s, struct sim_config *config,
                               struct ls_diag *diag)
{
    enum ls_err err = config_setting_length(s) ? list_of(s, 64, diag) : LS_OK;
    for (int i = 0; !err && i < config_setting_length(s); i++)
        err = read_fault(config_setting_get_elem(s, (unsigned)i), config, diag);
    return err;
}

static enum ls_err read_all(const config_setting_t *root, struct sim_config *config,
                            struct ls_diag *diag)
{
    const config_setting_t *scene = config_setting_get_member(root, "scene");
    const config_setting_t *cameras = config_setting_get_member(root, "cameras");
    const config_setting_t *controller = config_setting_get_member(root, "controller");
    const config_setting_t *faults = config_setting_get_member(root, "faults");
    enum ls_err err = sim_config_read(root, top_keys, config, diag);
    if (!err && scene)
        err = read_scene(scene, config, diag);
    if (!err && cameras)
        err = read_cameras(cameras, config, diag);
    if (!err && controller)
        err = sim_config_read(controller, controller_keys, &config->controller, diag);
    if (!err && faults)
        err = read_faults(faults, config, diag);
    if (err)
        return err;
    derive(config);
    return sim_scene_config_check(&config->scene, diag);
}

enum ls_err sim_config_load(const char *path, struct sim_config *config, struct ls_diag *diag)
{
    config_t file;
    enum ls_err err;
    sim_config_defaults(config);
    FILE *stream = fopen(path, "re");
    if (!stream)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %s", path, strerror(errno));
    fclose(stream);
    config_init(&file);
    if (config_read_file(&file, path) != CONFIG_TRUE)
        err = ls_fail(diag, LS_ERR_INVALID, "%s:%d: %s",
                      config_error_file(&file) ? config_error_file(&file) : path,
                      config_error_line(&file), config_error_text(&file));
    else
        err = read_all(config_root_setting(&file), config, diag);
    config_destroy(&file);
    return err;
}

#include "sim/scene.h"

#include "sim/view.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

void sim_view_config_default(struct sim_view_config *view, uint32_t width, uint32_t height)
{
    *view = (struct sim_view_config){
        .position_m = {0, 0, 1.6},
        .focal_length_mm = 25,
        .sensor_width_mm = 11.26,
        .width = width,
        .height = height,
        .cfa = "RG",
        .full_well_e = 10500,
        .black = 1.0 / 64,
        .read_noise_e = 5,
        .dark_current_e_s = 10,
        .prnu = 0.005,
        .hot_per_mpixel = 20,
        .white_exposure_us = 4000,
        .exposure_offset_us = 13.7,
    };
}

void sim_scene_config_default(struct sim_scene_config *config)
{
    static const struct sim_channel_config channels[] = {
        {"W", SIM_CHANNEL_SPECTRUM, "white", 1.20}, {"R", SIM_CHANNEL_SPECTRUM, "red", 1.20},
        {"A", SIM_CHANNEL_SPECTRUM, "amber", 1.14}, {"G", SIM_CHANNEL_SPECTRUM, "green", 1.20},
        {"C", SIM_CHANNEL_SPECTRUM, "cyan", 1.20},  {"B", SIM_CHANNEL_SPECTRUM, "blue", 1.20},
        {"V", SIM_CHANNEL_VERTICAL, "white", 1.20}, {"H", SIM_CHANNEL_HORIZONTAL, "white", 1.20},
    };
    *config = (struct sim_scene_config){
        .scene = "stilllife",
        .seed = 1,
        .axes = "right,up,towards",
        .unit = "m",
        .n_lights = 346,
        .radius_m = 1.35,
        .gain_sigma = 0.05,
        .pwm_levels = 1000,
        .n_channels = sizeof channels / sizeof *channels,
        .n_cameras = 1,
        .sphere_radius_m = 0.1,
        .memory_bytes = 4ull << 30,
        .threads = 2,
    };
    memcpy(config->channels, channels, sizeof channels);
    sim_view_config_default(&config->views[0], 512, 512);
}

struct range {
    const char *key;
    double value, low, high;
};

static enum ls_err check_ranges(const char *where, const struct range *r, size_t n,
                                struct ls_diag *diag)
{
    for (size_t i = 0; i < n; i++)
        if (!(r[i].value >= r[i].low && r[i].value <= r[i].high))
            return ls_fail(diag, LS_ERR_INVALID, "%s%s: expected %g to %g, found %g", where,
                           r[i].key, r[i].low, r[i].high, r[i].value);
    return LS_OK;
}

static enum ls_err check_view(const struct sim_view_config *v, uint32_t index, struct ls_diag *diag)
{
    char where[32];
    snprintf(where, sizeof where, "camera %u: ", index);
    const struct range ranges[] = {
        {"width", v->width, 1, 16384},
        {"height", v->height, 1, 16384},
        {"focal_length_mm", v->focal_length_mm, 1, 1000},
        {"sensor_width_mm", v->sensor_width_mm, 0.1, 100},
        {"blur_px", v->blur_px, 0, SIM_BLUR_MAX_PX},
        {"full_well_e", v->full_well_e, 100, 1e7},
        {"black", v->black, 0, 0.5},
        {"read_noise_e", v->read_noise_e, 0, 1000},
        {"dark_current_e_s", v->dark_current_e_s, 0, 1e5},
        {"prnu", v->prnu, 0, 0.2},
        {"hot_per_mpixel", v->hot_per_mpixel, 0, 1e4},
        {"ambient", v->ambient, 0, 10},
        {"white_exposure_us", v->white_exposure_us, 1, 1e7},
        {"exposure_offset_us", v->exposure_offset_us, -40, 1000},
    };
    enum ls_err err = check_ranges(where, ranges, sizeof ranges / sizeof *ranges, diag);
    enum ls_cfa cfa;
    if (!err && sim_view_cfa(v->cfa, &cfa))
        return ls_fail(diag, LS_ERR_INVALID, "%scfa: expected RG, GR, GB, BG or mono, found \"%s\"",
                       where, v->cfa);
    double distance2 = 0;
    for (int k = 0; k < 3; k++)
        distance2 += pow(v->position_m[k] - v->look_at_m[k], 2);
    if (!err && !(distance2 > 1e-6 && distance2 < 1e6))
        return ls_fail(diag, LS_ERR_INVALID,
                       "%sposition_m and look_at_m: expected 1 mm to 1 km apart", where);
    return err;
}

static enum ls_err check_channels(const struct sim_scene_config *c, struct ls_diag *diag)
{
    for (uint32_t s = 0; s < c->n_channels; s++) {
        const struct sim_channel_config *channel = &c->channels[s];
        if (!channel->name[0])
            return ls_fail(diag, LS_ERR_INVALID, "channel %u: name: expected one", s);
        for (uint32_t other = 0; other < s; other++)
            if (!strcmp(c->channels[other].name, channel->name))
                return ls_fail(diag, LS_ERR_INVALID, "channel %u: name \"%s\" stands twice", s,
                               channel->name);
        if (!(channel->droop >= 1 && channel->droop <= 10))
            return ls_fail(diag, LS_ERR_INVALID, "channel %s: droop: expected 1 to 10, found %g",
                           channel->name, channel->droop);
    }
    return LS_OK;
}

static enum ls_err check_scene(const struct sim_scene_config *c, struct ls_diag *diag)
{
    static const char *const scenes[] = {"stilllife",  "grey",  "chrome", "gloss",
                                         "highlights", "stamp", "replay"};
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; i++)
        if (!strcmp(c->scene, scenes[i]))
            return strcmp(c->scene, "replay") || c->replay_dir[0]
                       ? LS_OK
                       : ls_fail(diag, LS_ERR_INVALID, "replay_dir: expected a folder of images");
    return ls_fail(
        diag, LS_ERR_INVALID,
        "scene: expected stilllife, grey, chrome, gloss, highlights, stamp or replay, found \"%s\"",
        c->scene);
}

enum ls_err sim_scene_config_check(const struct sim_scene_config *c, struct ls_diag *diag)
{
    const struct range ranges[] = {
        {"lights", c->positions_csv[0] ? 1 : c->n_lights, 1, SIM_MAX_LIGHTS},
        {"radius_m", c->positions_csv[0] ? 1 : c->radius_m, 0.2, 100},
        {"gain_sigma", c->gain_sigma, 0, 0.3},
        {"pwm_levels", c->pwm_levels, 0, 65535},
        {"channels", c->n_channels, 1, SIM_MAX_CHANNELS},
        {"cameras", c->n_cameras, 1, SIM_MAX_CAMERAS},
        {"sphere_radius_m", c->sphere_radius_m, 0.001, 0.1},
        {"threads", c->threads, 1, 2},
        {"stamp_frames", c->stamp_frames, 0, 64},
    };
    enum ls_err err = check_ranges("", ranges, sizeof ranges / sizeof *ranges, diag);
    if (!err)
        err = check_scene(c, diag);
    if (!err)
        err = check_channels(c, diag);
    for (uint32_t i = 0; i < c->n_cameras && !err; i++)
        err = check_view(&c->views[i], i, diag);
    return err;
}

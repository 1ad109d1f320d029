#include "sim/world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double brightest_colour = 0.8; /* p(s, c) of a coloured LED in its best channel */

static void scale(struct ls_spectrum *s, double factor)
{
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        s->v[i] *= factor;
}

/* Green of a colour camera, the only channel of a mono one. */
static uint32_t reference_colour(const struct sim_scene *scene, uint32_t camera)
{
    return scene->colours[camera] == 3 ? 1 : 0;
}

/* Sensitivities such that daylight of luminance 1 reads 1 in camera 0's green and the white LED,
 * scaled to that, reads 1 in every camera's. */
static enum ls_err scale_cameras(struct sim_scene *scene, struct ls_spectrum *white,
                                 struct ls_diag *diag)
{
    struct ls_spectrum d65;
    enum ls_err err = ls_daylight(6503.616, &d65);
    if (err)
        return ls_fail(diag, err, "the daylight of 6504 K cannot be made");
    struct ls_spectrum luminance = ls_cie_1931[1];
    double y = ls_spectrum_dot(&d65, &luminance) / ls_spectrum_integral(&luminance);
    for (uint32_t i = 0; i < scene->config.n_cameras; i++) {
        int mono = scene->view[i].cfa == LS_CFA_NONE;
        scene->colours[i] = mono ? 1 : 3;
        for (uint32_t c = 0; c < scene->colours[i]; c++)
            scene->camera[i][c] = scene->library.camera[mono ? 3 : c];
        const struct ls_spectrum *reference = &scene->camera[i][reference_colour(scene, i)];
        double p = i ? ls_spectrum_dot(white, reference) : ls_spectrum_dot(&d65, reference) / y;
        for (uint32_t c = 0; c < scene->colours[i]; c++)
            scale(&scene->camera[i][c], 1 / p);
        if (i == 0)
            scale(white, 1 / ls_spectrum_dot(white, reference));
    }
    return LS_OK;
}

static void filter_source(struct sim_scene *scene, struct sim_source *source,
                          const struct ls_spectrum *reference)
{
    double before = ls_spectrum_dot(&source->spectrum, reference);
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        source->spectrum.v[i] *= scene->library.polariser.v[i];
    double after = ls_spectrum_dot(&source->spectrum, reference);
    scene->polariser_gain = after / before;
    scale(&source->spectrum, before / after);
}

static void scale_source(struct sim_scene *scene, uint32_t channel, const struct ls_spectrum *white)
{
    struct sim_source *source = &scene->source[channel];
    const struct ls_spectrum *reference = &scene->camera[0][reference_colour(scene, 0)];
    double best = 0;
    for (uint32_t c = 0; c < scene->colours[0]; c++)
        best = fmax(best, ls_spectrum_dot(&source->spectrum, &scene->camera[0][c]));
    if (!strcmp(scene->config.channels[channel].spectrum, "white"))
        source->spectrum = *white;
    else
        scale(&source->spectrum, brightest_colour / best);
    if (source->kind != SIM_CHANNEL_SPECTRUM)
        filter_source(scene, source, reference);
}

static enum ls_err build_sources(struct sim_scene *scene, struct ls_diag *diag)
{
    const struct ls_spectrum *found = ls_spectra_find(scene->library.leds, "white");
    if (!found)
        return ls_fail(diag, LS_ERR_INVALID, "leds.csv: has no column \"white\"");
    struct ls_spectrum white = *found;
    enum ls_err err = scale_cameras(scene, &white, diag);
    if (err)
        return err;
    for (uint32_t s = 0; s < scene->config.n_channels; s++) {
        const struct sim_channel_config *channel = &scene->config.channels[s];
        const struct ls_spectrum *led = ls_spectra_find(scene->library.leds, channel->spectrum);
        if (!led)
            return ls_fail(diag, LS_ERR_INVALID, "channel %s: leds.csv has no column \"%s\"",
                           channel->name, channel->spectrum);
        scene->source[s] = (struct sim_source){channel->kind, *led};
        scale_source(scene, s, &white);
    }
    return LS_OK;
}

static void draw_channel(struct sim_scene *scene, uint32_t channel)
{
    uint32_t n = scene->geometry.n_lights;
    float *gain = scene->gain + (size_t)channel * n;
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        uint64_t key = sim_hash(scene->config.seed ^ 0x4741494e) + ((uint64_t)channel << 32) + i;
        gain[i] = (float)fmax(0.2, 1 + scene->config.gain_sigma * sim_normal(sim_hash(key)));
        sum += gain[i];
    }
    double factor = n / sum;
    if (scene->config.channels[channel].kind != SIM_CHANNEL_SPECTRUM)
        factor *= scene->polariser_gain;
    for (uint32_t i = 0; i < n; i++)
        gain[i] = scene->kind == SIM_WORLD_REPLAY ? 1 : (float)(gain[i] * factor);
}

static enum ls_err build_lights(struct sim_scene *scene, struct ls_diag *diag)
{
    const struct sim_scene_config *c = &scene->config;
    enum ls_err err =
        c->positions_csv[0]
            ? sim_geometry_load(c->positions_csv, c->axes, c->unit, &scene->geometry, diag)
            : sim_geometry_sphere(c->n_lights, c->radius_m, &scene->geometry, diag);
    if (!err)
        err = sim_library_load(c->spectra_dir[0] ? c->spectra_dir : SIM_SPECTRA_DIR,
                               &scene->library, diag);
    return err;
}

static enum ls_err build_cameras(struct sim_scene *scene, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < scene->config.n_cameras && !err; i++) {
        const struct sim_view_config *config = &scene->config.views[i];
        err = sim_view_build(config, &scene->subject, &scene->view[i], diag);
        if (!err)
            err =
                sim_sensor_build(config, sim_hash(scene->config.seed) + i, &scene->sensor[i], diag);
    }
    return err;
}

static enum ls_err build_responses(struct sim_scene *scene, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < scene->config.n_cameras && !err; i++)
        err = sim_response_build(&scene->library, &scene->subject, scene->source,
                                 scene->config.n_channels, scene->camera[i], scene->colours[i],
                                 &scene->response[i], diag);
    return err;
}

static enum ls_err build(struct sim_scene *scene, struct ls_diag *diag)
{
    const struct sim_scene_config *c = &scene->config;
    enum ls_err err = build_lights(scene, diag);
    if (err)
        return err;
    sim_subject_build(c->scene, c->sphere_radius_m, &scene->subject);
    if ((err = build_cameras(scene, diag)) || (err = build_sources(scene, diag)))
        return err;
    scene->gain = calloc((size_t)c->n_channels * scene->geometry.n_lights, sizeof *scene->gain);
    if (!scene->gain)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the strengths of the lights");
    for (uint32_t s = 0; s < c->n_channels; s++)
        draw_channel(scene, s);
    if ((err = build_responses(scene, diag)))
        return err;
    if (scene->kind == SIM_WORLD_REPLAY)
        return sim_replay_load(scene, diag);
    return sim_bounce_build(&scene->subject, &scene->geometry, &scene->bounce, diag);
}

enum ls_err sim_scene_create(const struct sim_scene_config *config, struct sim_scene **out,
                             struct ls_diag *diag)
{
    enum ls_err err = sim_scene_config_check(config, diag);
    if (err)
        return err;
    struct sim_scene *scene = calloc(1, sizeof *scene);
    if (!scene)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a scene");
    scene->config = *config;
    scene->kind = !strcmp(config->scene, "stamp")    ? SIM_WORLD_STAMP
                  : !strcmp(config->scene, "replay") ? SIM_WORLD_REPLAY
                                                     : SIM_WORLD_TRACED;
    pthread_rwlock_init(&scene->lock, NULL);
    pthread_mutex_init(&scene->work_lock, NULL);
    err = build(scene, diag);
    if (err) {
        sim_scene_destroy(scene);
        return err;
    }
    *out = scene;
    return LS_OK;
}

void sim_scene_destroy(struct sim_scene *scene)
{
    if (!scene)
        return;
    sim_pictures_finish(scene);
    for (uint32_t i = 0; i < scene->config.n_cameras; i++) {
        sim_view_finish(&scene->view[i]);
        sim_sensor_finish(&scene->sensor[i]);
        sim_stamp_frames_finish(&scene->stamp_frames[i]);
        sim_response_finish(&scene->response[i]);
    }
    sim_bounce_finish(&scene->bounce);
    sim_library_finish(&scene->library);
    sim_geometry_finish(&scene->geometry);
    pthread_rwlock_destroy(&scene->lock);
    pthread_mutex_destroy(&scene->work_lock);
    free(scene->gain);
    free(scene->replay);
    free(scene);
}

const struct sim_scene_config *sim_scene_config(const struct sim_scene *scene)
{
    return &scene->config;
}

const struct sim_geometry *sim_scene_geometry(const struct sim_scene *scene)
{
    return &scene->geometry;
}

double sim_scene_gain(const struct sim_scene *scene, uint32_t light, uint32_t channel)
{
    return scene->gain[(size_t)channel * scene->geometry.n_lights + light];
}

double sim_scene_droop(const struct sim_scene *scene, uint32_t channel, double n_lit)
{
    uint32_t n = scene->geometry.n_lights;
    if (n < 2 || n_lit <= 1 || scene->kind == SIM_WORLD_REPLAY)
        return 1;
    return 1 + (scene->config.channels[channel].droop - 1) * (n_lit - 1) / (n - 1);
}

double sim_scene_drift(const struct sim_scene *scene, uint32_t channel, uint64_t sequence)
{
    const struct sim_channel_config *c = &scene->config.channels[channel];
    return c->drift ? 1 - c->drift * expm1(-(double)sequence / c->drift_pulses) : 1;
}

double sim_scene_quantise(const struct sim_scene *scene, double duty)
{
    duty = fmax(0, fmin(1, duty));
    uint32_t levels = scene->config.pwm_levels;
    return levels ? floor(duty * levels + 0.5) / levels : duty;
}

double sim_world_rate(const struct sim_view_config *view)
{
    return 0.5 / (0.9 / M_PI * view->white_exposure_us * 1e-6);
}

static double strength(const struct sim_scene *scene, const struct sim_led *led)
{
    double out = 1;
    for (uint32_t i = 0; i < scene->config.n_led_faults; i++) {
        const struct sim_led_fault *f = &scene->config.led_faults[i];
        if (f->light == led->light &&
            (!f->channel[0] || !strcmp(f->channel, scene->config.channels[led->channel].name)))
            out *= f->strength;
    }
    return out;
}

float sim_world_weight(const struct sim_scene *scene, const struct sim_led *led, uint32_t n_lit)
{
    return (float)(led->duty * sim_scene_gain(scene, led->light, led->channel) *
                   strength(scene, led) / sim_scene_droop(scene, led->channel, n_lit));
}

uint32_t sim_world_lit(const struct sim_led *leds, uint32_t n_leds)
{
    uint32_t lit = 0;
    for (uint32_t k = 0; k < n_leds; k++)
        lit += leds[k].duty > 0;
    return lit;
}

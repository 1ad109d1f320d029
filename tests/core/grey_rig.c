#include "tests/core/grey_rig.h"

#include "core/dark.h"
#include "core/merge.h"
#include "drivers/lights_wire.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { EXPOSURES = 3, DARKS = 64 };
/* 4 ms is where a white facing a light reads one half; the grey sphere reads a third of that, and
 * its terminator a tenth of that again. */
static const double exposure_us[EXPOSURES] = {600, 4000, 24000};

/* The others stand around the subject, as far away as the first, one of them above. */
static void place_cameras(struct sim_scene_config *c, const struct grey_rig_options *o)
{
    static const double at[SIM_MAX_CAMERAS][3] = {
        {0, 0, 1.6}, {1.4, 0.3, -0.7}, {-1.4, 0.3, -0.7}, {0, 1.5, 0.5}};
    c->n_cameras = o->n_cameras;
    for (uint32_t k = 0; k < o->n_cameras; k++) {
        struct sim_view_config *v = &c->views[k];
        sim_view_config_default(v, o->size_px, o->size_px);
        memcpy(v->position_m, at[k], sizeof v->position_m);
        memset(v->look_at_m, 0, sizeof v->look_at_m);
        g_strlcpy(v->cfa, o->cfa, sizeof v->cfa);
        v->sensor_width_mm = 11.26;
        v->focal_length_mm = v->sensor_width_mm * 1.6 / (0.2 / 0.78);
    }
}

static uint32_t choose_channels(struct sim_scene_config *c, const char *letters)
{
    uint32_t n = 0;
    for (uint32_t s = 0; s < c->n_channels; s++)
        if (strchr(letters, c->channels[s].name[0]))
            c->channels[n++] = c->channels[s];
    g_assert_cmpuint(n, ==, strlen(letters));
    return c->n_channels = n;
}

static void add(GArray *conditions, uint32_t n, const uint32_t *lights, uint32_t channel,
                double duty)
{
    struct sim_condition c = {.kind = LS_WIRE_CONDITION_LIST, .n_leds = n};
    c.leds = g_new0(struct sim_led, n);
    for (uint32_t i = 0; i < n; i++)
        c.leds[i] = (struct sim_led){(uint16_t)lights[i], (uint16_t)channel, (float)duty};
    g_array_append_val(conditions, c);
}

static void commit(struct grey_rig *rig, double sphere_duty, uint32_t n_groups, double group_duty)
{
    struct ls_diag diag = {{0}};
    uint32_t n = rig->n_lights;
    GArray *conditions = g_array_new(FALSE, FALSE, sizeof(struct sim_condition));
    uint32_t *lights = g_new0(uint32_t, n);
    for (uint32_t s = 0; s < rig->n_channels; s++)
        for (uint32_t i = 0; i < n; i++)
            add(conditions, 1, &i, s, 1);
    for (uint32_t i = 0; i < n; i++)
        lights[i] = i;
    for (uint32_t s = 0; s < rig->n_channels; s++)
        add(conditions, n, lights, s, sim_scene_quantise(rig->scene, sphere_duty));
    for (uint32_t s = 0; s < rig->n_channels; s++)
        for (uint32_t g = 0; g < n_groups; g++) {
            uint32_t m = 0;
            for (uint32_t i = g; i < n; i += n_groups)
                lights[m++] = i;
            add(conditions, m, lights, s, sim_scene_quantise(rig->scene, group_duty));
        }
    enum ls_err err = sim_scene_commit(rig->scene, (struct sim_condition *)(void *)conditions->data,
                                       conditions->len, NULL, NULL, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (guint i = 0; i < conditions->len; i++)
        g_free(g_array_index(conditions, struct sim_condition, i).leds);
    g_array_free(conditions, TRUE);
    g_free(lights);
}

static const struct ls_pixel_format *format_of(const struct grey_rig *rig)
{
    return ls_pixel_by_name(strcmp(rig->options.cfa, "mono") ? "BayerRG12" : "Mono12");
}

static double exposure_of(const struct grey_rig *rig, uint32_t k)
{
    return exposure_us[k] * rig->options.exposure_scale;
}

static void expose(struct grey_rig *rig, uint32_t camera, uint32_t condition, uint32_t k, void *raw)
{
    const struct ls_pixel_format *format = format_of(rig);
    struct sim_exposure e = {.exposure_us = exposure_of(rig, k),
                             .lit_us = condition == UINT32_MAX ? 0 : exposure_of(rig, k),
                             .condition = condition,
                             .camera = camera,
                             .sequence = rig->sequence++};
    struct sim_raw_format f = {.width = rig->options.size_px,
                               .height = rig->options.size_px,
                               .pixel_format = format->code};
    g_assert_cmpint(sim_scene_expose(rig->scene, &e, &f, raw, sim_raw_bytes(&f), NULL), ==, LS_OK);
}

static void make_darks(struct grey_rig *rig, uint32_t camera)
{
    uint32_t size = rig->options.size_px;
    void *raw = g_malloc(ls_pixel_payload_bytes(format_of(rig), size, size));
    for (uint32_t k = 0; k < EXPOSURES; k++) {
        struct ls_dark *dark = NULL;
        g_assert_cmpint(ls_dark_create(format_of(rig), size, size, &dark, NULL), ==, LS_OK);
        for (int j = 0; j < DARKS; j++) {
            expose(rig, camera, UINT32_MAX, k, raw);
            g_assert_cmpint(ls_dark_add(dark, raw), ==, LS_OK);
        }
        rig->dark[camera][k] = g_new(float, rig->n_pixels);
        g_assert_cmpint(ls_dark_mean(dark, rig->dark[camera][k]), ==, LS_OK);
        ls_dark_destroy(dark);
    }
    g_free(raw);
}

struct grey_rig *grey_rig_create(const struct grey_rig_options *o, double sphere_duty,
                                 uint32_t n_groups, double group_duty)
{
    struct ls_diag diag = {{0}};
    struct grey_rig *rig = g_new0(struct grey_rig, 1);
    struct sim_scene_config config;
    sim_scene_config_default(&config);
    g_strlcpy(config.scene, o->scene, sizeof config.scene);
    config.seed = o->seed;
    config.gain_sigma = o->gain_sigma;
    rig->n_channels = choose_channels(&config, o->channels);
    place_cameras(&config, o);
    rig->options = *o;
    enum ls_err err = sim_scene_create(&config, &rig->scene, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    rig->n_lights = sim_scene_geometry(rig->scene)->n_lights;
    rig->n_pixels = o->size_px * o->size_px;
    rig->sphere.radius_m = config.sphere_radius_m;
    for (uint32_t k = 0; k < o->n_cameras; k++) {
        const struct sim_view_config *v = &config.views[k];
        memcpy(rig->camera_m[k], v->position_m, sizeof v->position_m);
        g_assert_cmpint(ls_pinhole_aim(v->position_m, v->look_at_m, v->focal_length_mm,
                                       v->sensor_width_mm, v->width, v->height, &rig->camera[k],
                                       NULL),
                        ==, LS_OK);
        make_darks(rig, k);
    }
    commit(rig, sphere_duty, n_groups, group_duty);
    return rig;
}

void grey_rig_destroy(struct grey_rig *rig)
{
    for (uint32_t k = 0; k < SIM_MAX_CAMERAS; k++)
        for (uint32_t j = 0; j < EXPOSURES; j++)
            g_free(rig->dark[k][j]);
    sim_scene_destroy(rig->scene);
    g_free(rig);
}

uint32_t grey_rig_light(const struct grey_rig *rig, uint32_t channel, uint32_t light)
{
    return channel * rig->n_lights + light;
}

uint32_t grey_rig_full(const struct grey_rig *rig, uint32_t channel)
{
    return rig->n_channels * rig->n_lights + channel;
}

uint32_t grey_rig_group(const struct grey_rig *rig, uint32_t channel, uint32_t group,
                        uint32_t n_groups)
{
    return rig->n_channels * (rig->n_lights + 1) + channel * n_groups + group;
}

void grey_rig_picture(struct grey_rig *rig, uint32_t camera, uint32_t condition, float *e,
                      uint8_t *validity)
{
    const struct sim_view_config *v = &sim_scene_config(rig->scene)->views[camera];
    const struct ls_pixel_format *format = format_of(rig);
    uint32_t size = rig->options.size_px;
    double max_dn = ls_pixel_max_dn(format);
    struct ls_merge_params params = {.format = format,
                                     .width = size,
                                     .height = size,
                                     .n_exposures = EXPOSURES,
                                     .range_low = LS_MERGE_RANGE_LOW,
                                     .range_high = LS_MERGE_RANGE_HIGH,
                                     .full_scale_dn = max_dn,
                                     .clip_dn = max_dn,
                                     .electrons_per_dn = v->full_well_e / max_dn,
                                     .read_noise_dn = v->read_noise_e * max_dn / v->full_well_e};
    struct ls_merge_spans spans = {.e = e, .validity = validity};
    void *raw[EXPOSURES];
    for (uint32_t k = 0; k < EXPOSURES; k++) {
        params.exposure_s[k] = exposure_of(rig, k) * 1e-6;
        spans.raw[k] = raw[k] = g_malloc(ls_pixel_payload_bytes(format, size, size));
        spans.dark[k] = rig->dark[camera][k];
        expose(rig, camera, condition, k, raw[k]);
    }
    g_assert_cmpint(ls_merge_check(&params, NULL), ==, LS_OK);
    ls_merge_rows(&params, &spans, 0, params.height);
    for (uint32_t k = 0; k < EXPOSURES; k++)
        g_free(raw[k]);
}

void grey_rig_position(const struct grey_rig *rig, uint32_t light, double position_m[3])
{
    for (int k = 0; k < 3; k++)
        position_m[k] = (double)sim_scene_geometry(rig->scene)->position_m[light][k];
}

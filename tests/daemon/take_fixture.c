#include "tests/daemon/take_fixture.h"

#include "core/envlights.h"
#include "core/half.h"
#include "core/merge.h"
#include "daemon/store.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CHANNELS = 3, COLOURS = 3, SAMPLES = 81 };
static const char *const names[CHANNELS] = {"W", "R", "V"};
static const double reference_s = TAKE_REFERENCE_S, exposures_s[2] = {TAKE_SHORT_S, TAKE_LONG_S};

/* ---- calibration ---- */

static double bell(double nm, double centre, double width)
{
    return exp(-0.5 * (nm - centre) * (nm - centre) / (width * width));
}

static double sensitivity(int colour, double nm)
{
    static const double centre[COLOURS] = {600, 540, 460};
    return bell(nm, centre[colour], 35);
}

/* Of strength 1, in a unit where p(W, green) = 1. */
double made_spectrum(int c, double nm)
{
    static double unit;
    if (unit == 0)
        for (int i = 0; i < SAMPLES; i++) {
            double at = 380 + 5 * i;
            unit += 5 * sensitivity(1, at) * (0.6 * bell(at, 560, 70) + 0.4 * bell(at, 450, 12));
        }
    double white = 0.6 * bell(nm, 560, 70) + 0.4 * bell(nm, 450, 12);
    return (c == 1 ? bell(nm, 630, 10) : white) / unit;
}

static double reflectance(int patch, double nm)
{
    return 0.1 + 0.8 * bell(nm, 420 + 55 * patch, 40);
}

static void table(struct ls_spectral_table *out, uint32_t rows)
{
    *out = (struct ls_spectral_table){.start_nm = 380, .step_nm = 5, .n = SAMPLES, .rows = rows};
    out->v = calloc((size_t)SAMPLES * rows, sizeof(float));
}

static void fill_lights(struct ls_calibration *cal)
{
    GRand *random = g_rand_new_with_seed(11);
    double omega[TAKE_LIGHTS];
    for (int i = 0; i < TAKE_LIGHTS; i++) {
        double z = 1 - 2 * (i + 0.5) / TAKE_LIGHTS, a = 2.4 * i, r = sqrt(1 - z * z);
        double d[3] = {r * cos(a), z, r * sin(a)};
        for (int x = 0; x < 3; x++) {
            cal->direction[i][x] = (float)d[x];
            cal->position_m[i][x] = (float)(1.35 * d[x]);
        }
    }
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])cal->direction, TAKE_LIGHTS, omega, NULL),
                    ==, LS_OK);
    for (int c = 0; c < CHANNELS; c++) {
        double g[TAKE_LIGHTS], mean = 0;
        for (int i = 0; i < TAKE_LIGHTS; i++)
            mean += (g[i] = g_rand_double_range(random, 0.9, 1.1)) / TAKE_LIGHTS;
        for (int i = 0; i < TAKE_LIGHTS; i++) {
            cal->k[c * TAKE_LIGHTS + i] = (float)(mean / g[i]);
            cal->sigma_k[c * TAKE_LIGHTS + i] = 0.001f;
            cal->omega_sr[i] = (float)omega[i];
        }
    }
    g_rand_free(random);
}

static double integral(int channel, int colour, int patch)
{
    double sum = 0;
    for (int i = 0; i < SAMPLES; i++) {
        double nm = 380 + 5 * i, w = i == 0 || i == SAMPLES - 1 ? 2.5 : 5;
        sum += w * made_spectrum(channel, nm) * sensitivity(colour, nm) *
               (patch < 0 ? 1 : reflectance(patch, nm));
    }
    return sum;
}

static void fill_channels(struct ls_calibration *cal)
{
    for (int c = 0; c < CHANNELS; c++) {
        g_strlcpy(cal->channels[c].name, names[c], sizeof cal->channels[c].name);
        cal->channels[c].polariser = c == 2;
        table(&cal->channels[c].spectrum, 1);
        for (int i = 0; i < SAMPLES; i++)
            cal->channels[c].spectrum.v[i] = (float)made_spectrum(c, 380 + 5 * i);
        for (int t = 0; t < COLOURS; t++)
            cal->p[c][t] = (float)integral(c, t, -1);
    }
    cal->n_patterns = 2;
    cal->patterns = calloc(2, sizeof *cal->patterns);
    for (uint32_t c = 0; c < 2; c++) {
        cal->patterns[c].channel = c;
        g_strlcpy(cal->patterns[c].pattern, "sphere", sizeof cal->patterns[c].pattern);
        cal->patterns[c].duty = TAKE_LEVEL / 65535.0;
        cal->patterns[c].factor = 1.2;
    }
}

static void fill_chart(struct ls_calibration *cal)
{
    cal->n_patches = TAKE_PATCHES;
    cal->patch_names = calloc(TAKE_PATCHES, sizeof *cal->patch_names);
    cal->L = calloc((size_t)TAKE_PATCHES * COLOURS * CHANNELS, sizeof(float));
    table(&cal->reflectance, TAKE_PATCHES);
    for (int p = 0; p < TAKE_PATCHES; p++) {
        snprintf(cal->patch_names[p], sizeof cal->patch_names[p], "patch %d", p);
        for (int i = 0; i < SAMPLES; i++)
            cal->reflectance.v[p * SAMPLES + i] = (float)reflectance(p, 380 + 5 * i);
        for (int t = 0; t < COLOURS; t++)
            for (int c = 0; c < CHANNELS; c++)
                cal->L[(p * COLOURS + t) * CHANNELS + c] = (float)integral(c, t, p);
    }
}

static void fill_camera(struct ls_calibration *cal)
{
    static const double m[3][3] = {{1.7, -0.2, -0.3}, {-0.4, 1.8, -0.5}, {-0.1, -0.8, 2.9}};
    struct ls_calibration_camera *camera = &cal->camera;
    table(&camera->sensitivity, COLOURS);
    for (int t = 0; t < COLOURS; t++)
        for (int i = 0; i < SAMPLES; i++)
            camera->sensitivity.v[t * SAMPLES + i] = (float)sensitivity(t, 380 + 5 * i);
    camera->black_dn = 64;
    camera->full_scale_dn = 4095;
    camera->electrons_per_dn = 10;
    camera->read_noise_dn = 2;
    camera->exposure_offset_us = 13.7;
    camera->range_low = 0.1;
    camera->range_high = 0.85;
    g_strlcpy(camera->cfa, "RG", sizeof camera->cfa);
    g_strlcpy(camera->pixel_format, "BayerRG12", sizeof camera->pixel_format);
    cal->has_m = true;
    memcpy(cal->m, m, sizeof m);
}

struct ls_calibration *made_calibration(void)
{
    struct ls_calibration *cal = NULL;
    g_assert_cmpint(ls_calibration_create(TAKE_LIGHTS, CHANNELS, COLOURS, &cal, NULL), ==, LS_OK);
    fill_lights(cal);
    fill_channels(cal);
    fill_chart(cal);
    fill_camera(cal);
    cal->scale = 2.5;
    return cal;
}

/* ---- take.json ---- */

static json_t *conditions_json(void)
{
    json_t *list = json_array();
    json_array_append_new(list, json_pack("{ss ss si si}", "id", "dark-0", "kind", "dark",
                                          "exposure", 0, "repeats", 64));
    for (int i = 0; i < TAKE_LIGHTS; i++) {
        char id[16];
        snprintf(id, sizeof id, "W-%04d", i);
        json_array_append_new(list,
                              json_pack("{ss ss si ss si si}", "id", id, "kind", "one", "light", i,
                                        "channel", "W", "level", 65535, "repeats", 1));
    }
    for (int c = 0; c < 2; c++) {
        char id[16];
        snprintf(id, sizeof id, "sphere-%s", names[c]);
        json_array_append_new(list,
                              json_pack("{ss ss ss si si}", "id", id, "kind", "sphere", "channel",
                                        names[c], "level", TAKE_LEVEL, "repeats", 1));
    }
    return list;
}

static json_t *cameras_json(uint32_t n)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < n; i++)
        json_array_append_new(list, json_pack("{sssssisisfsfsfsfs[ff]}", "name",
                                              i ? "side" : "front", "pixel_format", "BayerRG12",
                                              "width", TAKE_W, "height", TAKE_H, "full_scale_dn",
                                              4095.0, "electrons_per_dn", 10.0, "read_noise_dn",
                                              2.0, "black_dn", 64.0, "range", 0.1, 0.85));
    return list;
}

static json_t *rig_json(uint32_t n_cameras)
{
    struct ls_calibration *cal = made_calibration();
    json_t *positions = json_array();
    for (int i = 0; i < TAKE_LIGHTS; i++)
        json_array_append_new(positions, json_pack("[fff]", (double)cal->position_m[i][0],
                                                   (double)cal->position_m[i][1],
                                                   (double)cal->position_m[i][2]));
    ls_calibration_destroy(cal);
    return json_pack("{ss s{so} s[{ssss}{ssss}{ssss}] so}", "name", "test", "lights", "position_m",
                     positions, "channels", "name", "W", "kind", "spectrum", "name", "R", "kind",
                     "spectrum", "name", "V", "kind", "polariser", "cameras",
                     cameras_json(n_cameras));
}

char *take_json_text(const struct ls_calibration *calibration, uint32_t n_cameras)
{
    char *cal_text = NULL;
    json_t *cal = json_null();
    if (calibration) {
        g_assert_cmpint(ls_calibration_write(calibration, &cal_text, NULL), ==, LS_OK);
        cal = json_loads(cal_text, 0, NULL);
        free(cal_text);
    }
    json_t *doc = json_pack("{s{sssssoso} so s[ff] sf so}", "plan", "text", "x", "subject", "still",
                            "pulse_us", json_array(), "conditions", conditions_json(), "rig",
                            rig_json(n_cameras), "exposure_s", exposures_s[0], exposures_s[1],
                            "reference_exposure_s", reference_s, "calibration", cal);
    g_assert_nonnull(doc);
    char *text = json_dumps(doc, JSON_REAL_PRECISION(17));
    char *out = g_strdup(text);
    free(text);
    json_decref(doc);
    return out;
}

/* ---- pictures ---- */

static float as_half(double value)
{
    return ls_half_to_float(ls_half_from_float((float)value));
}

static void make_pixels(struct made_take *take)
{
    GRand *random = g_rand_new_with_seed(7);
    for (int i = 0; i < TAKE_LIGHTS; i++)
        for (int p = 0; p < TAKE_PIXELS; p++)
            take->light[i][p] = as_half(0.2 + 0.1 * (1 + sin(p * 0.01 * (i + 1))) +
                                        g_rand_double_range(random, 0, 0.1));
    for (int p = 0; p < TAKE_PIXELS; p++) {
        double v = 0, ratio = 0.5 + 0.3 * sin((p % TAKE_W) * 0.05);
        for (int i = 0; i < TAKE_LIGHTS; i++)
            v += (double)take->light[i][p] * take->k[0][i] / take->k[1][i];
        take->sphere_r[p] = as_half(v * ratio * TAKE_LEVEL / 65535 / 1.2);
    }
    g_rand_free(random);
}

uint8_t made_validity(int light, int pixel)
{
    if (light != TAKE_FLAGGED)
        return LS_VALIDITY_OK;
    return pixel % 7 == 0    ? LS_VALIDITY_SATURATED
           : pixel % 53 == 0 ? LS_VALIDITY_GAP
           : pixel % 5 == 0  ? LS_VALIDITY_DARK
                             : LS_VALIDITY_OK;
}

static void publish(struct ls_store *store, uint32_t camera, const char *id, int light,
                    const float *pixels)
{
    uint16_t *half = g_new(uint16_t, TAKE_PIXELS);
    uint8_t *validity = g_new(uint8_t, TAKE_PIXELS);
    for (int p = 0; p < TAKE_PIXELS; p++)
        validity[p] = made_validity(light, p);
    ls_half_from_floats(pixels, half, TAKE_PIXELS);
    struct ls_store_picture picture = {
        .condition = id,
        .camera = camera,
        .mosaic = {.width = TAKE_W, .height = TAKE_H, .half = half, .validity = validity}};
    g_assert_cmpint(ls_store_publish(store, &picture, NULL), ==, LS_OK);
    g_free(validity);
    g_free(half);
}

static void publish_dark(struct ls_store *store, uint32_t camera)
{
    float *dn = g_new0(float, TAKE_PIXELS);
    struct ls_store_picture picture = {.condition = "dark-0",
                                       .camera = camera,
                                       .mosaic = {.width = TAKE_W, .height = TAKE_H, .floats = dn}};
    g_assert_cmpint(ls_store_publish(store, &picture, NULL), ==, LS_OK);
    g_free(dn);
}

static void ticket_all(struct ls_store *store, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++) {
        const struct ls_ticket ticket = {.shot = i, .step = i, .condition = i};
        g_assert_cmpint(ls_store_ticket(store, &ticket, NULL), ==, LS_OK);
    }
}

static void publish_all(struct made_take *take, struct ls_store *store, uint32_t camera,
                        int missing)
{
    publish_dark(store, camera);
    for (int i = 0; i < TAKE_LIGHTS; i++) {
        char id[16];
        snprintf(id, sizeof id, "W-%04d", i);
        if (i != missing)
            publish(store, camera, id, i, take->light[(i + (int)camera) % TAKE_LIGHTS]);
    }
    publish(store, camera, "sphere-R", -1, take->sphere_r);
    publish(store, camera, "sphere-W", -1, take->light[0]);
}

static void write_take(struct made_take *take, const char *storage, const char *json,
                       uint32_t n_cameras, int missing)
{
    static const char *const conditions[] = {"dark-0", "W-0000", "W-0001", "W-0002",   "W-0003",
                                             "W-0004", "W-0005", "W-0006", "sphere-W", "sphere-R"};
    struct ls_store *store = NULL;
    struct ls_diag diag = {0};
    const struct ls_store_config config = {.root = storage,
                                           .name = "made",
                                           .take_json = json,
                                           .utc_s = 1767323045,
                                           .n_cameras = n_cameras,
                                           .n_shots = G_N_ELEMENTS(conditions),
                                           .conditions = conditions,
                                           .n_conditions = G_N_ELEMENTS(conditions),
                                           .need_bytes = 1 << 20};
    const struct ls_store_end end = {.state =
                                         missing < 0 ? LS_STORE_COMPLETE : LS_STORE_INCOMPLETE};
    enum ls_err err = ls_store_create(&config, &store, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    take->id = g_strdup(ls_store_id(store));
    ticket_all(store, TAKE_LIGHTS + 3);
    for (uint32_t camera = 0; camera < n_cameras; camera++)
        publish_all(take, store, camera, missing);
    g_assert_cmpint(ls_store_set_state(store, &end, &diag), ==, LS_OK);
    g_assert_cmpint(ls_store_close(store, &diag), ==, LS_OK);
}

static struct made_take *make(const char *storage, bool calibrated, uint32_t n_cameras, int missing)
{
    struct made_take *take = g_new0(struct made_take, 1);
    struct ls_calibration *cal = made_calibration();
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < TAKE_LIGHTS; i++)
            take->k[c][i] = calibrated ? (double)cal->k[c * TAKE_LIGHTS + i] : 1;
    take->scale = calibrated ? cal->scale / reference_s : 1;
    make_pixels(take);
    char *json = take_json_text(calibrated ? cal : NULL, n_cameras);
    write_take(take, storage, json, n_cameras, missing);
    g_free(json);
    if (calibrated)
        take->calibration = cal;
    else
        ls_calibration_destroy(cal);
    return take;
}

struct made_take *make_take(const char *storage, bool calibrated, int missing)
{
    return make(storage, calibrated, 1, missing);
}

struct made_take *make_take_of_two_cameras(const char *storage)
{
    return make(storage, true, 2, -1);
}

void made_take_free(struct made_take *take)
{
    ls_calibration_destroy(take->calibration);
    g_free(take->id);
    g_free(take);
}

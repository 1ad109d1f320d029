#include "tests/core/still_life.h"

#include "core/demosaic.h"
#include "sim/geometry.h"
#include "sim/truth.h"

#include <math.h>
#include <string.h>

enum { LIGHTS = STILL_LIFE_LIGHTS, SPECTRA = STILL_LIFE_SPECTRA, COLOURS = STILL_LIFE_COLOURS };
enum { FRAMES = 2 };

void still_life_load(struct still_life *w, uint32_t side, const char *cfa, double blur_px)
{
    struct ls_diag diag = {0};
    struct sim_scene_config config;
    struct sim_scene *scene = NULL;
    struct ls_calibration *calibration = NULL;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], side, side);
    g_strlcpy(config.views[0].cfa, cfa, sizeof config.views[0].cfa);
    config.views[0].blur_px = blur_px;
    config.n_channels = SPECTRA; /* W R A G C B */
    g_assert_cmpint(sim_scene_create(&config, &scene, &diag), ==, LS_OK);
    const struct sim_region region = {0, 0, 0, side, side};
    const double duties[SPECTRA] = {0.5, 0.5, 0.5, 0.5, 0.5, 0.5};
    bool mono = !strcmp(cfa, "mono");
    size_t pixels = (size_t)side * side;
    *w = (struct still_life){.side = side, .colours = mono ? 1 : COLOURS};
    w->n = pixels * w->colours;
    g_assert_cmpint(sim_truth_calibration(scene, 0, mono ? "Mono8" : "BayerRG8", duties, SPECTRA,
                                          &calibration, &diag),
                    ==, LS_OK);
    g_autofree float *all = g_new(float, SPECTRA * w->n);
    w->specular = g_new(float, LIGHTS *pixels);
    w->bounced = g_new(float, pixels);
    for (int s = 0; s < SPECTRA; s++) {
        w->truth[s] = g_new(float, LIGHTS * w->n);
        for (uint32_t c = 0; c < w->colours; c++)
            w->p[s][c] = (double)calibration->p[s][c];
    }
    for (uint32_t i = 0; i < LIGHTS; i++) {
        memcpy(w->directions[i], sim_scene_geometry(scene)->direction[i], sizeof w->directions[i]);
        g_assert_cmpint(sim_truth_field(scene, &region, i, all, &diag), ==, LS_OK);
        g_assert_cmpint(sim_truth_specular(scene, &region, i, w->specular + i * pixels, &diag), ==,
                        LS_OK);
        for (uint32_t s = 0; s < SPECTRA; s++) {
            memcpy(w->truth[s] + i * w->n, all + s * w->n, w->n * sizeof *all);
            w->g[s][i] = sim_scene_gain(scene, i, s);
        }
    }
    const double *at = config.views[0].position_m;
    for (int k = 0; k < 3; k++)
        w->camera[k] = (float)(at[k] / sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]));
    g_assert_cmpint(sim_truth_bounced(scene, &region, w->bounced, &diag), ==, LS_OK);
    ls_calibration_destroy(calibration);
    sim_scene_destroy(scene);
}

void still_life_free(struct still_life *w)
{
    for (int s = 0; s < SPECTRA; s++)
        g_free(w->truth[s]);
    g_free(w->specular);
    g_free(w->bounced);
}

/* ---- the camera ---- */

static const double full_well_e = 10500, read_e = 5;
static const double single_rate = 0.8 / (0.9 * M_1_PI); /* full scales per unit of R, at t */

static double gaussian(GRand *rand)
{
    double u = 1 - g_rand_double(rand);
    return sqrt(-2 * log(u)) * cos(2 * M_PI * g_rand_double(rand));
}

double still_life_rate(double n_lights)
{
    return single_rate * fmin(1, 4 / n_lights);
}

double still_life_variance(double x, double rate)
{
    double information = 0;
    for (int k = 2; k >= 0; k--) {
        double scale = rate / (1 << 3 * k), raw = fmax(x, 0) * scale;
        if (raw <= 0.85 || k == 2)
            information += scale * scale /
                           ((raw * full_well_e + read_e * read_e) / (full_well_e * full_well_e));
    }
    return 1 / information / FRAMES;
}

/* Variance of the camera's pictures relative to that of two frames. */
static double share_of(const struct still_life_camera *camera)
{
    return camera->frames > 0 ? (double)FRAMES / camera->frames : 1;
}

struct ls_linear_noise still_life_noise(const struct still_life_camera *camera, double rate)
{
    if (!camera->noise)
        return (struct ls_linear_noise){0};
    double share = share_of(camera) / FRAMES;
    return (struct ls_linear_noise){pow(read_e / full_well_e / rate, 2) * share,
                                    1 / (full_well_e * rate) * share};
}

static void through_mosaic(const struct still_life *w, float *rgb)
{
    uint32_t side = w->side;
    g_autofree float *mosaic = g_new(float, (size_t)side *side);
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++)
            mosaic[y * side + x] =
                rgb[(y * side + x) * 3 + (unsigned)ls_cfa_channel(LS_CFA_RGGB, x, y)];
    const struct ls_demosaic_region all = {0, 0, side, side};
    const struct ls_demosaic_source source = {mosaic, side, all, side, side, LS_CFA_RGGB};
    const struct ls_demosaic_target target = {{rgb, rgb + 1, rgb + 2}, 3, 3 * side};
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_GRADIENT, &target), ==, LS_OK);
}

void still_life_take(const struct still_life *w, const struct still_life_camera *camera,
                     double n_lights, float *picture)
{
    double rate = still_life_rate(n_lights), share = share_of(camera);
    for (size_t j = 0; j < w->n && camera->noise; j++)
        picture[j] += (float)(gaussian(camera->rand) *
                              sqrt(share * still_life_variance((double)picture[j], rate)));
    if (camera->mosaic && w->colours == 3)
        through_mosaic(w, picture);
}

#include "tests/sim/paper_stage.h"

#include "core/cell_lighting.h"
#include "core/envlights.h"
#include "core/profile.h"
#include "core/segments.h"
#include "tests/sim/measured_spectra.h"

#include <string.h>

enum { SIZE = 96 };

void ok(enum ls_err err, const struct ls_diag *diag)
{
    g_assert_cmpstr(diag->text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

static void mean_of(const struct sim_sample *sample, const float *picture, float out[3])
{
    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (uint32_t y = sample->y; y < sample->y + sample->height; y++)
            for (uint32_t x = sample->x; x < sample->x + sample->width; x++)
                sum += (double)picture[3 * (y * SIZE + x) + (uint32_t)c];
        out[c] = (float)(sum / (sample->width * sample->height));
    }
}

void stage_photograph(struct stage *stage)
{
    const struct sim_region all = {0, 0, 0, SIZE, SIZE};
    struct sim_sample samples[SIM_SAMPLES];
    struct ls_diag diag = {{0}};
    g_autofree float *pictures_of = g_new(float, CHANNELS *SIZE *SIZE * 3);
    stage->field = g_new0(samples_of, LIGHTS);
    ok(sim_truth_samples(stage->scene, 0, samples, &diag), &diag);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        ok(sim_truth_field(stage->scene, &all, i, pictures_of, &diag), &diag);
        for (int s = 0; s < CHANNELS; s++)
            for (int p = 0; p < SAMPLES; p++)
                mean_of(&samples[p], pictures_of + s * SIZE * SIZE * 3, stage->field[i][s][p]);
    }
}

void stage_photograph_real(struct stage *stage)
{
    const struct sim_region all = {0, 0, 0, SIZE, SIZE};
    struct sim_sample samples[SIM_SAMPLES];
    struct ls_diag diag = {{0}};
    g_autofree float *picture = g_new(float, SIZE *SIZE * 3);
    float rgb[3];
    ok(sim_truth_samples(stage->scene, 0, samples, &diag), &diag);
    ok(sim_truth_environment(stage->scene, &all, &stage->lobes, 20000, picture, NULL, &diag),
       &diag);
    for (int p = 0; p < SAMPLES; p++) {
        mean_of(&samples[p], picture, rgb);
        for (int c = 0; c < 3; c++)
            stage->real[p][c] = (double)rgb[c];
    }
}

void read_row(const struct ls_spectral_table *table, int row, struct ls_spectrum *out)
{
    g_assert_cmpuint(table->n, ==, LS_SPECTRUM_N);
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        out->v[i] = (double)table->v[row * LS_SPECTRUM_N + i];
}

void stage_light_up(struct stage *stage, const struct ls_spectra *illuminants, const char *left,
                    const char *right, double sharpness)
{
    const double at[2][3] = {{-0.8, 0.36, 0.48}, {0.8, 0.36, 0.48}};
    const char *const name[2] = {left, right};
    struct ls_diag diag = {{0}};
    for (int l = 0; l < 2; l++) {
        struct ls_lobe *lobe = &stage->lobe[l];
        lobe->spectrum = *ls_spectra_find(illuminants, name[l]);
        double green = ls_spectrum_dot(&lobe->spectrum, &stage->sensitivity[1]);
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            lobe->spectrum.v[i] /= green;
        memcpy(lobe->direction, at[l], sizeof lobe->direction);
        lobe->sharpness = sharpness;
        lobe->radiance = 0.5;
    }
    stage->lobes = (struct ls_lobes){.n = 2, .item = stage->lobe};
    ok(ls_envlights_lobes(stage->directions, LIGHTS, NULL, &stage->lobes, stage->cells, &diag),
       &diag);
}

void stage_finish(struct stage *stage)
{
    sim_scene_destroy(stage->scene);
    ls_calibration_destroy(stage->cal);
    g_free(stage->field);
    g_free(stage->cells);
    g_free(stage);
}

struct stage *stage_new(const char *folder)
{
    struct stage *stage = g_new0(struct stage, 1);
    struct sim_scene_config config;
    struct ls_diag diag = {{0}};
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], SIZE, SIZE);
    g_strlcpy(config.spectra_dir, folder, sizeof config.spectra_dir);
    config.gain_sigma = 0.05;
    ok(sim_scene_create(&config, &stage->scene, &diag), &diag);
    ok(sim_truth_calibration(stage->scene, 0, "BayerRG8", NULL, 0, &stage->cal, &diag), &diag);
    memcpy(stage->m, stage->cal->m, sizeof stage->m);
    for (int c = 0; c < 3; c++)
        read_row(&stage->cal->camera.sensitivity, c, &stage->sensitivity[c]);
    for (int p = 0; p < CHART; p++)
        read_row(&stage->cal->reflectance, p, &stage->reflectance[p]);
    stage->directions = (const float(*)[3])sim_scene_geometry(stage->scene)->direction;
    stage->cells = g_new0(double, LIGHTS * 2);
    for (uint32_t s = 0; s < CHANNELS; s++)
        for (uint32_t i = 0; i < LIGHTS; i++) {
            stage->g[s][i] = sim_scene_gain(stage->scene, i, s);
            stage->k[s][i] = 1 / stage->g[s][i];
        }
    ok(ls_segments_partition(stage->directions, LIGHTS, SEGMENTS, stage->segment, &diag), &diag);
    return stage;
}

double stage_p(const struct stage *stage, int s, int c, int colours)
{
    const double *mix = ls_profile_find("paper")->mono_mix;
    const float *p = stage->cal->p[s];
    if (colours == 3)
        return (double)p[c];
    return mix[0] * (double)p[0] + mix[1] * (double)p[1] + mix[2] * (double)p[2];
}

void apply_m(const double *m, const double in[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = m[3 * r] * in[0] + m[3 * r + 1] * in[1] + m[3 * r + 2] * in[2];
}

double *stage_strengths(const struct stage *stage, enum method method)
{
    const struct ls_calibration *cal = stage->cal;
    const double *mix = ls_profile_find("paper")->mono_mix;
    static double chart[CHART * 3 * SPECTRA];
    struct ls_spectrum after_m[3] = {{{0}}};
    struct ls_lighting lighting = {.n_patches = CHART,
                                   .n_channels = method == MONO ? 1 : 3,
                                   .n_spectra = SPECTRA,
                                   .chart = chart,
                                   .m = stage->m};
    struct ls_lighting_solver *solver;
    struct ls_diag diag = {{0}};
    memset(chart, 0, sizeof chart);
    for (uint32_t r = 0; r < CHART * 3; r++)
        for (uint32_t s = 0; s < SPECTRA; s++) {
            double l = (double)cal->L[r * cal->n_channels + s];
            if (method == MONO)
                chart[r / 3 * SPECTRA + s] += mix[r % 3] * l;
            else
                chart[r * SPECTRA + s] = l;
        }
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        for (int t = 0; t < 9; t++)
            after_m[t / 3].v[i] += stage->m[t] * stage->sensitivity[t % 3].v[i];
    ls_lighting_defaults(&lighting);
    if (method == PER_TARGET) {
        lighting.mode = LS_SOLVE_PER_TARGET;
        lighting.method = LS_SOLVE_LEAST_SQUARES;
        lighting.tikhonov = 1e-3;
    }
    ok(ls_lighting_solver_create(&lighting, 3, &solver, &diag), &diag);
    struct ls_spectral_chart reader = {.solver = solver,
                                       .reflectance = stage->reflectance,
                                       .n_patches = CHART,
                                       .reader = method == MONO ? after_m : stage->sensitivity,
                                       .n_readers = 3};
    double *alpha = g_new0(double, LIGHTS *ls_lighting_solver_outputs(solver));
    ok(ls_cell_lighting_lobes(&reader, &stage->lobes, stage->cells, LIGHTS, alpha, NULL, &diag),
       &diag);
    ls_lighting_solver_destroy(solver);
    return alpha;
}

#include "tests/sim/paper_take.h"

#include "core/half.h"
#include "core/profile.h"
#include "core/relight.h"
#include "tests/sim/measured_spectra.h"

#include <string.h>

const struct ls_demosaic_region paper_whole = {0, 0, SIDE, SIDE};
static const struct ls_tile_region tile = {0, 0, 1, 1};

/* The white light of V and F is without noise, so its floor is a formality. */
static const struct ls_field_noise quiet = {1e-14, 0, 0};

/* ---- photographs ---- */

static int colour_at(const struct paper_take *take, int pixel)
{
    return take->colours == 1
               ? 0
               : ls_cfa_channel(LS_CFA_RGGB, (uint32_t)(pixel % SIDE), (uint32_t)(pixel / SIDE));
}

static int sample_at(int pixel)
{
    return pixel / SIDE / SQUARE * ACROSS + pixel % SIDE / SQUARE;
}

/* As the paper's mono camera would have it: its mix, in colour 0. */
static void see(struct paper_take *take)
{
    const double *mix = ls_profile_find("paper")->mono_mix;
    for (int i = 0; i < LIGHTS; i++)
        for (int s = 0; s < CHANNELS; s++)
            for (int p = 0; p < SAMPLES; p++) {
                float *to = take->rgb[i][s][p];
                memcpy(to, take->stage->field[i][s][p], 3 * sizeof *to);
                if (take->colours == 1)
                    to[0] = (float)(mix[0] * (double)to[0] + mix[1] * (double)to[1] +
                                    mix[2] * (double)to[2]);
            }
}

static void store(struct paper_take *take)
{
    for (int s = 0; s < CHANNELS; s++)
        for (int i = 0; i < LIGHTS; i++) {
            size_t picture = (size_t)s * LIGHTS + (size_t)i;
            uint16_t *half = take->halves + picture * PIXELS;
            for (int j = 0; j < PIXELS; j++) {
                double r = (double)take->rgb[i][s][sample_at(j)][colour_at(take, j)];
                half[j] = ls_half_from_float((float)(take->stage->g[s][i] * r));
            }
            take->tiles[picture] = half;
            take->pictures[s][i].tiles = &take->tiles[picture];
        }
}

bool paper_every(const struct stage *stage, int light, uint32_t of)
{
    return true;
}

bool paper_segment(const struct stage *stage, int light, uint32_t of)
{
    return stage->segment[light] == of;
}

bool paper_head(const struct stage *stage, int light, uint32_t of)
{
    int nearer = 0;
    for (int i = 0; i < LIGHTS; i++)
        nearer += stage->directions[i][2] > stage->directions[light][2] ||
                  (i < light && stage->directions[i][2] == stage->directions[light][2]);
    return nearer < 3;
}

/* ---- sums ---- */

float *paper_take_demosaic(const struct paper_take *take, const float *mosaic)
{
    float *out = g_new(float, PIXELS * take->colours);
    g_assert_cmpint(ls_relight_demosaic(&take->field, mosaic, paper_whole, paper_whole, out), ==,
                    LS_OK);
    return out;
}

float *paper_take_photograph(const struct paper_take *take, int s, paper_choice *of, uint32_t q)
{
    g_autofree float *mosaic = g_new0(float, PIXELS);
    for (int i = 0; i < LIGHTS; i++)
        for (int j = 0; of(take->stage, i, q) && j < PIXELS; j++)
            mosaic[j] += (float)(take->stage->g[s][i] *
                                 (double)take->rgb[i][s][sample_at(j)][colour_at(take, j)]);
    return paper_take_demosaic(take, mosaic);
}

float *paper_take_sum(const struct paper_take *take, int channel, const double *w)
{
    float row[LIGHTS], *mosaic = g_new(float, PIXELS);
    struct ls_diag diag = {{0}};
    const struct ls_accumulate_job job = {
        .pictures = take->pictures[channel], .n_pictures = LIGHTS, .n_sums = 1, .weights = row};
    ls_relight_row(take->stage->k[channel], w, LIGHTS, row);
    ok(ls_accumulate(&take->field, &job, &tile, mosaic, NULL, &diag), &diag);
    return mosaic;
}

float *paper_take_white(const struct paper_take *take, int s, paper_choice *of, uint32_t q,
                        const double *phi, float row[LIGHTS])
{
    double w[LIGHTS];
    for (int i = 0; i < LIGHTS; i++)
        w[i] = of(take->stage, i, q) ? take->stage->g[s][i] * (phi ? phi[i * SEGMENTS] : 1) : 0;
    ls_relight_row(take->stage->k[0], w, LIGHTS, row);
    g_autofree float *mosaic = paper_take_sum(take, 0, w);
    return paper_take_demosaic(take, mosaic);
}

/* ---- life ---- */

static void split_lights(struct paper_take *take)
{
    struct ls_diag diag = {{0}};
    for (int i = 0; i < LIGHTS; i++) {
        struct ls_polarisation_path path = {.camera = {0, 0, 1.6}, .camera_up = {0, 1, 0}};
        struct ls_polarisation a;
        for (int x = 0; x < 3; x++)
            path.light[x] = 1.35 * (double)take->stage->directions[i][x];
        ok(ls_polarisation_assume(&path, &a, &diag), &diag);
        ok(ls_split_make(a, take->stage->k[V][i], take->stage->k[H][i], &take->split[i], &diag),
           &diag);
    }
}

static void make_fields(struct paper_take *take)
{
    struct ls_diag diag = {{0}};
    double white[3];
    enum ls_cfa cfa = take->colours == 3 ? LS_CFA_RGGB : LS_CFA_NONE;
    take->field = (struct ls_field){.n_lights = LIGHTS,
                                    .n_spectra = SPECTRA,
                                    .n_channels = (uint32_t)take->colours,
                                    .width = SIDE,
                                    .height = SIDE,
                                    .cfa = cfa,
                                    .scale = 1,
                                    .p = take->p[0],
                                    .noise = quiet};
    take->polarised = (struct ls_separated_field){.n_lights = LIGHTS,
                                                  .n_channels = (uint32_t)take->colours,
                                                  .width = SIDE,
                                                  .height = SIDE,
                                                  .cfa = cfa,
                                                  .v = take->pictures[V],
                                                  .h = take->pictures[H],
                                                  .split = take->split,
                                                  .noise = quiet};
    for (int c = 0; c < 3; c++)
        white[c] = take->p[V][c] + take->p[H][c];
    if (take->colours == 3)
        ok(ls_conductor_make(white, LS_CONDUCTOR_THRESHOLD, false, &take->polarised.conductor,
                             &diag),
           &diag);
}

void paper_take_forget(struct paper_take *take)
{
    for (int s = 0; s < SPECTRA; s++)
        g_clear_pointer(&take->map[s], g_free);
    g_clear_pointer(&take->phi, g_free);
}

struct paper_take *paper_take_new(const struct stage *stage, bool mono)
{
    struct paper_take *take = g_new0(struct paper_take, 1);
    take->stage = stage;
    take->colours = mono ? 1 : 3;
    take->rgb = g_malloc(LIGHTS * sizeof *take->rgb);
    take->halves = g_new(uint16_t, (size_t)CHANNELS * LIGHTS * PIXELS);
    take->tiles = g_new(const void *, CHANNELS *LIGHTS);
    for (int s = 0; s < CHANNELS; s++)
        for (int c = 0; c < take->colours; c++)
            take->p[s][c] = stage_p(stage, s, c, take->colours);
    see(take);
    store(take);
    split_lights(take);
    make_fields(take);
    return take;
}

void paper_take_finish(struct paper_take *take)
{
    paper_take_forget(take);
    g_free(take->rgb);
    g_free(take->halves);
    g_free(take->tiles);
    g_free(take);
}

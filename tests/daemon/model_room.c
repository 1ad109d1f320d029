#include "tests/daemon/model_room.h"

#include "core/relight.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const struct ls_demosaic_region whole = {0, 0, FULL_W, FULL_H};

const Lightstage__Model models[MODELS] = {LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__MODEL__HEADLIGHT,
                                          LIGHTSTAGE__MODEL__SEPARATED, LIGHTSTAGE__MODEL__LINEAR};

void room_enter(struct room *room, gconstpointer data)
{
    static const struct full_take_options plain;
    struct ls_diag diag = {0};
    room->take = make_full_take(data ? data : &plain);
    enum ls_err err =
        ls_field_source_open(room->take->root, room->take->id, 0, &room->source, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

void room_leave(struct room *room, gconstpointer data)
{
    ls_field_source_close(room->source);
    full_take_free(room->take);
}

/* ---- asking ---- */

void fill_weights(double w[FULL_LIGHTS])
{
    for (int i = 0; i < FULL_LIGHTS; i++)
        w[i] = g_test_rand_double_range(-0.5, 2);
}

float *rendered_with_report(struct room *room, const struct ls_render_job *job,
                            struct ls_render_report *report)
{
    struct ls_render *render = NULL;
    struct ls_diag diag = {0};
    struct ls_demosaic_region band;
    size_t n = (size_t)job->region.width * job->region.height * 3;
    float *out = g_new0(float, n * job->n_pictures), *pixels = NULL;
    enum ls_err err = ls_render_open(room->source, job, &render, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (bool done = false; !done; free(pixels)) {
        g_assert_cmpint(ls_render_step(render, &band, &pixels, &done, &diag), ==, LS_OK);
        size_t some = (size_t)band.width * band.height * 3;
        for (uint32_t k = 0; k < job->n_pictures; k++)
            memcpy(out + n * k + (size_t)(band.y - job->region.y) * band.width * 3,
                   pixels + some * k, some * sizeof *out);
    }
    ls_render_report(render, report);
    ls_render_close(render);
    return out;
}

float *rendered(struct room *room, const struct ls_render_job *job)
{
    struct ls_render_report report;
    return rendered_with_report(room, job, &report);
}

float *red_by(struct room *room, Lightstage__Model model, const double *w)
{
    const struct ls_render_term term = {.channel = FULL_CR, .weights = w, .target = -1};
    const struct ls_render_job job = {.promotion = {.model = model},
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .region = whole};
    return rendered(room, &job);
}

/* ---- expected, from the fixture's own numbers ---- */

void add_lights(const struct full_take *take, int channel, const double *w, float *mosaic)
{
    for (int p = 0; p < FULL_PIXELS; p++) {
        double sum = (double)mosaic[p];
        for (int i = 0; i < FULL_LIGHTS; i++)
            sum += w[i] * take->k[channel][i] * (double)take->light[channel][i][p];
        mosaic[p] = (float)sum;
    }
}

float *demosaiced(const struct room *room, const float *mosaic)
{
    float *rgb = g_new0(float, VALUES);
    g_assert_cmpint(ls_relight_demosaic(&room->source->field, mosaic, whole, whole, rgb), ==,
                    LS_OK);
    return rgb;
}

float *summed(const struct room *room, int channel, const double *w)
{
    float *mosaic = g_new0(float, FULL_PIXELS);
    add_lights(room->take, channel, w, mosaic);
    float *rgb = demosaiced(room, mosaic);
    g_free(mosaic);
    return rgb;
}

float *scaled(const struct room *room, const float *picture, const char *pattern)
{
    float *mosaic = g_new(float, FULL_PIXELS);
    for (int p = 0; p < FULL_PIXELS; p++)
        mosaic[p] = (float)((double)picture[p] * full_take_factor(pattern));
    float *rgb = demosaiced(room, mosaic);
    g_free(mosaic);
    return rgb;
}

void strengths(const struct full_take *take, bool (*of)(int i, int q), int q, double g[FULL_LIGHTS])
{
    for (int i = 0; i < FULL_LIGHTS; i++)
        g[i] = of(i, q) ? 1 / take->k[FULL_CR][i] : 0;
}

bool every(int i, int q)
{
    return true;
}

void row_of(const struct full_take *take, const double *g, float row[FULL_LIGHTS])
{
    for (int i = 0; i < FULL_LIGHTS; i++)
        row[i] = (float)(g[i] * take->k[FULL_CW][i]);
}

/* Sums of twelve values of at most about 1, in float here and there: 1e-6 of each; ratios and
 * matrices are below 3. */
void assert_close(const struct room *room, const float *got, const float *expected)
{
    double most = 0;
    for (int j = 0; j < VALUES; j++)
        most = fmax(most, fabs((double)expected[j]));
    for (int j = 0; j < VALUES; j++)
        if (!(fabs((double)got[j] - (double)expected[j]) <= 1e-4 * most))
            g_error("value %d (row %d) is %g, expected %g", j, j / (3 * FULL_W), (double)got[j],
                    (double)expected[j]);
}

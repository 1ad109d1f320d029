#include "compare.h"

#include "core/envlights.h"
#include "daemon/field_maps.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

enum { THREADS = 2 };

/* Blocks handed out to threads. */
struct sweep {
    struct judge_comparison comparison;
    const struct ls_field *field;
    struct sim_sweep *truth;
    float *bounced;
    struct judge_tally tally[THREADS]; /* all of it in the first, once the threads are done */
    pthread_mutex_t lock;
    uint32_t next_block; /* under lock, as what follows */
    enum ls_err err;
    struct ls_diag diag;
};

static bool take_block(struct sweep *s, uint32_t *index)
{
    pthread_mutex_lock(&s->lock);
    *index = s->next_block++;
    bool more = !s->err && *index < judge_n_blocks(s->field);
    pthread_mutex_unlock(&s->lock);
    return more;
}

struct worker {
    struct sweep *sweep;
    struct judge_tally *tally;
};

static void *work(void *data)
{
    struct worker *w = data;
    struct ls_diag diag = {0};
    for (uint32_t index; take_block(w->sweep, &index);) {
        enum ls_err err = judge_compare_block(&w->sweep->comparison, index, w->tally, &diag);
        if (!err)
            continue;
        pthread_mutex_lock(&w->sweep->lock);
        w->sweep->err = err;
        w->sweep->diag = diag;
        pthread_mutex_unlock(&w->sweep->lock);
    }
    return NULL;
}

static enum ls_err run_threads(struct sweep *s)
{
    pthread_t threads[THREADS];
    struct worker workers[THREADS];
    int started = 0;
    pthread_mutex_init(&s->lock, NULL);
    for (; started < THREADS; started++) {
        workers[started] = (struct worker){s, &s->tally[started]};
        if (pthread_create(&threads[started], NULL, work, &workers[started]))
            break;
    }
    if (!started)
        s->err = LS_ERR_OS;
    for (int i = 0; i < started; i++)
        pthread_join(threads[i], NULL);
    pthread_mutex_destroy(&s->lock);
    return s->err;
}

static void add_ratio(struct judge_ratio_sum *to, const struct judge_ratio_sum *from)
{
    to->difference += from->difference;
    to->truth += from->truth;
}

static size_t sample_sums(const struct sweep *s)
{
    return (size_t)s->field->n_lights * s->field->n_spectra * SIM_SAMPLES;
}

static void add_tally(const struct sweep *s, struct judge_tally *to, const struct judge_tally *from)
{
    add_ratio(&to->field, &from->field);
    add_ratio(&to->interreflection, &from->interreflection);
    add_ratio(&to->highlight, &from->highlight);
    to->black_difference += from->black_difference;
    to->black_pixels += from->black_pixels;
    for (size_t i = 0; i < sample_sums(s); i++)
        for (int c = 0; c < JUDGE_COLOURS; c++) {
            to->samples[i].promoted[c] += from->samples[i].promoted[c];
            to->samples[i].truth[c] += from->samples[i].truth[c];
        }
}

/* A sample's means over its pixels. */
static struct judge_sample_sum sample_mean(const struct sweep *s, uint32_t light, uint32_t spectrum,
                                           uint32_t sample)
{
    const struct sim_sample *r = &s->comparison.samples[sample];
    struct judge_sample_sum mean =
        s->tally[0]
            .samples[((size_t)light * s->field->n_spectra + spectrum) * SIM_SAMPLES + sample];
    for (int c = 0; c < JUDGE_COLOURS; c++) {
        mean.promoted[c] /= (double)r->width * r->height;
        mean.truth[c] /= (double)r->width * r->height;
    }
    return mean;
}

static double largest(const double v[JUDGE_COLOURS])
{
    return fmax(v[0], fmax(v[1], v[2]));
}

static bool is_swatch(const struct sim_sample *sample)
{
    return !strcmp(sample->group, "chart") || !strcmp(sample->group, "fabric");
}

/* The chart's white patch is its sample of that name. */
static uint32_t white_patch(const struct sweep *s)
{
    for (uint32_t k = 0; k < SIM_SAMPLES; k++)
        if (!strcmp(s->comparison.samples[k].name, "white"))
            return k;
    return 0;
}

static double olat_mae(const struct sweep *s)
{
    uint32_t patch = white_patch(s);
    double brightest = 0, sum = 0;
    uint64_t n = 0;
    for (uint32_t i = 0; i < s->field->n_lights; i++) {
        struct judge_sample_sum w = sample_mean(s, i, 0, patch);
        brightest = fmax(brightest, largest(w.truth));
    }
    for (uint32_t i = 0; i < s->field->n_lights; i++) {
        struct judge_sample_sum white = sample_mean(s, i, 0, patch);
        if (largest(white.truth) < 0.1 * brightest)
            continue;
        for (uint32_t k = 1; k < s->field->n_spectra; k++) {
            struct judge_sample_sum scale = sample_mean(s, i, k, patch);
            for (uint32_t j = 0; j < SIM_SAMPLES; j++) {
                if (!is_swatch(&s->comparison.samples[j]))
                    continue;
                struct judge_sample_sum v = sample_mean(s, i, k, j);
                for (int c = 0; c < JUDGE_COLOURS; c++, n++)
                    sum += fabs(v.promoted[c] - v.truth[c]) / largest(scale.truth);
            }
        }
    }
    return n ? 100 * sum / (double)n : NAN;
}

/* Relit through one spectrum only, each light weighted by the environment's mean radiance. */
static double promotion(const struct sweep *s, uint32_t spectrum, const double *weights)
{
    double promoted[SIM_SAMPLES][JUDGE_COLOURS] = {0}, truth[SIM_SAMPLES][JUDGE_COLOURS] = {0};
    for (uint32_t i = 0; i < s->field->n_lights; i++)
        for (uint32_t j = 0; j < SIM_SAMPLES; j++) {
            struct judge_sample_sum v = sample_mean(s, i, spectrum, j);
            for (int c = 0; c < JUDGE_COLOURS; c++) {
                promoted[j][c] += weights[i] * v.promoted[c];
                truth[j][c] += weights[i] * v.truth[c];
            }
        }
    double sum = 0, scale = largest(truth[white_patch(s)]);
    unsigned n = 0;
    for (uint32_t j = 0; j < SIM_SAMPLES; j++)
        for (int c = 0; is_swatch(&s->comparison.samples[j]) && c < JUDGE_COLOURS; c++, n++)
            sum += fabs(promoted[j][c] - truth[j][c]) / scale;
    return n ? 100 * sum / n : NAN;
}

/* Wavelength-mean radiance of the environment over each light's cell. */
static enum ls_err mean_weights(const struct judge *judge, double *weights, struct ls_diag *diag)
{
    const struct ls_field *f = &judge->source->field;
    const double grid_nm = (LS_SPECTRUM_N - 1) * LS_SPECTRUM_STEP_NM;
    double *cells = calloc((size_t)f->n_lights * judge->lobes->n, sizeof *cells);
    enum ls_err err =
        cells ? ls_envlights_lobes(f->directions, f->n_lights, NULL, judge->lobes, cells, diag)
              : LS_ERR_NOMEM;
    for (uint32_t i = 0; i < f->n_lights && !err; i++) {
        weights[i] = 0;
        for (size_t l = 0; l < judge->lobes->n; l++)
            weights[i] += cells[i * judge->lobes->n + l] *
                          ls_spectrum_integral(&judge->lobes->item[l].spectrum) / grid_nm;
    }
    free(cells);
    return err;
}

static double percent(const struct judge_ratio_sum *sum)
{
    return sum->truth > 0 ? 100 * sqrt(sum->difference / sum->truth) : NAN;
}

static enum ls_err summarise(const struct sweep *s, struct judge_field_errors *out,
                             struct ls_diag *diag)
{
    const struct judge_tally *t = &s->tally[0];
    LS_CLEANUP_FREE double *weights = calloc(s->field->n_lights, sizeof *weights);
    enum ls_err err = weights ? mean_weights(s->comparison.judge, weights, diag)
                              : ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    if (err)
        return err;
    *out = (struct judge_field_errors){
        .olat_mae = olat_mae(s),
        .field_rms = percent(&t->field),
        .interreflection_rms = percent(&t->interreflection),
        .highlight_rms = percent(&t->highlight),
        .black_mean_sigma = t->black_pixels ? t->black_difference / (double)t->black_pixels : NAN,
    };
    for (uint32_t k = 1; k < s->field->n_spectra; k++) {
        out->promotion_by_spectrum[k] = promotion(s, k, weights);
        out->promotion += out->promotion_by_spectrum[k] / (s->field->n_spectra - 1);
    }
    return LS_OK;
}

/* The scene's channel of a spectrum. */
static enum ls_err find_channel(const struct judge *judge, uint32_t spectrum, uint32_t *channel,
                                struct ls_diag *diag)
{
    const struct sim_scene_config *config = sim_scene_config(judge->scene);
    const struct ls_field_source *source = judge->source;
    const char *name = source->facts->channels[source->channel_of[spectrum]].name;
    for (*channel = 0; *channel < config->n_channels; ++*channel)
        if (!strcmp(config->channels[*channel].name, name))
            return LS_OK;
    return ls_fail(diag, LS_ERR_INVALID, "the scene has no channel %s", name);
}

static enum ls_err open_spectra(struct sweep *s, struct ls_diag *diag)
{
    struct ls_field_source *source = s->comparison.judge->source;
    struct ls_way way;
    uint32_t channels[LS_FIELD_MAX_SPECTRA];
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < s->field->n_spectra && !err; k++) {
        err = find_channel(s->comparison.judge, k, &channels[k], diag);
        if (!err) /* makes its map */
            err = ls_promotion_find(source, &s->comparison.judge->promotion, source->channel_of[k],
                                    NULL, &way, diag);
    }
    if (!err)
        err = sim_sweep_create(s->comparison.judge->scene, source->camera, channels,
                               s->field->n_spectra, &s->truth, diag);
    s->comparison.truth = s->truth;
    return err;
}

static enum ls_err open_tallies(struct sweep *s, struct ls_diag *diag)
{
    for (int t = 0; t < THREADS; t++) {
        s->tally[t].samples = calloc(sample_sums(s), sizeof *s->tally[t].samples);
        if (!s->tally[t].samples)
            return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the samples' sums");
    }
    return LS_OK;
}

static enum ls_err find_bounced(struct sweep *s, struct ls_diag *diag)
{
    const struct judge *judge = s->comparison.judge;
    const struct sim_region whole = {judge->source->camera, 0, 0, s->field->width,
                                     s->field->height};
    s->bounced = calloc((size_t)whole.width * whole.height, sizeof *s->bounced);
    s->comparison.bounced = s->bounced;
    return s->bounced ? sim_truth_bounced(judge->scene, &whole, s->bounced, diag)
                      : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mask");
}

static enum ls_err prepare(struct sweep *s, struct ls_diag *diag)
{
    const struct judge *judge = s->comparison.judge;
    if (!judge->source->calibrated)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no calibration: nothing to judge",
                       judge->source->take);
    if (s->field->n_channels != JUDGE_COLOURS)
        return ls_fail(diag, LS_ERR_STATE, "take %s is of a mono camera: nothing to judge",
                       judge->source->take);
    enum ls_err err = open_spectra(s, diag);
    if (!err)
        err = sim_truth_samples(judge->scene, judge->source->camera, s->comparison.samples, diag);
    if (!err)
        err = open_tallies(s, diag);
    if (!err)
        err = find_bounced(s, diag);
    return err;
}

static void finish(struct sweep *s)
{
    for (int t = 0; t < THREADS; t++)
        free(s->tally[t].samples);
    free(s->bounced);
    sim_sweep_destroy(s->truth);
}

enum ls_err judge_field_errors(const struct judge *judge, struct judge_field_errors *out,
                               struct ls_diag *diag)
{
    const struct ls_field *field = &judge->source->field;
    struct sweep s = {.comparison = {.judge = judge, .field = field}, .field = field};
    enum ls_err err = prepare(&s, diag);
    if (!err && run_threads(&s))
        err = ls_fail(diag, s.err, "%s", s.diag.text);
    for (int t = 1; t < THREADS && !err; t++)
        add_tally(&s, &s.tally[0], &s.tally[t]);
    if (!err)
        err = summarise(&s, out, diag);
    finish(&s);
    return err;
}

#include "judge.h"

#include "core/demosaic.h"
#include "core/envlights.h"
#include "core/half.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

enum {
    BAND_ROWS = LS_TILE_SIDE,
    THREADS = 2,
    MAX_SPECTRA = LS_FIELD_MAX_SPECTRA,
};

/* Squared differences and squared truth of one class of samples, per spectrum together. */
struct ratio_sum {
    double difference, truth;
};

/* Sums over a sample's pixels under one light in one spectrum. */
struct sample_sum {
    double promoted[JUDGE_COLOURS], truth[JUDGE_COLOURS];
};

/* What one thread adds up. */
struct tally {
    struct ratio_sum field, interreflection, highlight;
    struct sample_sum *samples; /* [light][spectrum][sample] */
    double black_difference;    /* sum over velvet pixels of (relit - true) / sigma */
    uint64_t black_pixels;
};

struct sweep {
    const struct judge *judge;
    const struct ls_field *field;
    const float *ratio[MAX_SPECTRA];       /* whole pictures */
    uint32_t sim_channel[MAX_SPECTRA];     /* the scene's channel of a spectrum */
    uint32_t n_sim_channels;
    struct sim_sample samples[SIM_SAMPLES];
    uint32_t next_band; /* under lock */
    pthread_mutex_t lock;
    struct tally tally[THREADS];
    enum ls_err err;
    struct ls_diag diag;
};

/* Buffers of one thread for one band. */
struct band {
    struct ls_demosaic_region rows, window; /* rows judged, and with the demosaic's halo */
    float *truth;                           /* [sim channel][window][3] */
    float *mosaic;                          /* [window] */
    float *promoted_white, *rgb;            /* [rows][3] */
    float *bounced, *specular;              /* [rows] */
    double *black_relit, *black_true, *black_variance; /* [rows], mosaic */
};

static size_t pixels(const struct ls_demosaic_region *r)
{
    return (size_t)r->width * r->height;
}

/* Camera colour of a mosaic pixel. */
static unsigned colour_at(const struct ls_field *f, uint32_t x, uint32_t y)
{
    return ls_cfa_channel(f->cfa, x, y);
}

float judge_stored(const struct ls_field *f, const struct ls_picture *picture, uint32_t x,
                   uint32_t y)
{
    uint32_t tx = x / LS_TILE_SIDE, ty = y / LS_TILE_SIDE;
    uint32_t left = f->width - tx * LS_TILE_SIDE;
    uint32_t tile_width = left < LS_TILE_SIDE ? left : LS_TILE_SIDE;
    const uint8_t *tile = picture->tiles[ty * ls_field_tiles_x(f) + tx];
    uint16_t half = 0;
    if (tile)
        memcpy(&half, tile + 2 * ((y % LS_TILE_SIDE) * tile_width + x % LS_TILE_SIDE), sizeof half);
    return ls_half_to_float(half);
}

/* E of one light over the window, as R: k E scale. */
static void load_light(const struct ls_field *f, uint32_t light, const struct ls_demosaic_region *w,
                       float *out)
{
    double gain = f->k[light] * f->scale;
    for (uint32_t y = 0; y < w->height; y++)
        for (uint32_t x = 0; x < w->width; x++)
            out[(size_t)y * w->width + x] =
                (float)(gain * judge_stored(f, &f->white[light], w->x + x, w->y + y));
}

static enum ls_err demosaic(const struct ls_field *f, const struct band *b, const float *mosaic,
                            float *rgb)
{
    const struct ls_demosaic_source source = { .data = mosaic,
                                               .stride = b->window.width,
                                               .window = b->window,
                                               .image_width = f->width,
                                               .image_height = f->height,
                                               .cfa = f->cfa };
    const struct ls_demosaic_target target = { { rgb, rgb + 1, rgb + 2 }, 3, 3 * f->width };
    return ls_demosaic(&source, b->rows, LS_DEMOSAIC_GRADIENT, &target);
}

/* The true mosaic of one spectrum from the true RGB of every pixel. */
static void true_mosaic(const struct ls_field *f, const struct band *b, const float *rgb,
                        float *mosaic)
{
    for (uint32_t y = 0; y < b->window.height; y++)
        for (uint32_t x = 0; x < b->window.width; x++) {
            size_t j = (size_t)y * b->window.width + x;
            mosaic[j] = rgb[3 * j + colour_at(f, b->window.x + x, b->window.y + y)];
        }
}

static void add_ratio(struct ratio_sum *sum, double difference, double truth)
{
    sum->difference += difference;
    sum->truth += truth;
}

static void compare(const struct sweep *s, struct tally *t, const struct band *b, uint32_t spectrum,
                    const float *truth)
{
    size_t first = (size_t)b->rows.y * s->field->width * 3;
    const float *ratio = s->ratio[spectrum] + first;
    for (size_t j = 0; j < pixels(&b->rows); j++) {
        double difference = 0, total = 0;
        for (int c = 0; c < JUDGE_COLOURS; c++) {
            double promoted = (double)b->promoted_white[3 * j + c] * ratio[3 * j + c];
            double d = promoted - truth[3 * j + c];
            difference += d * d;
            total += (double)truth[3 * j + c] * truth[3 * j + c];
        }
        add_ratio(&t->field, difference, total);
        if (b->bounced[j] > 0.2f)
            add_ratio(&t->interreflection, difference, total);
        if (b->specular[j] > 0.5f)
            add_ratio(&t->highlight, difference, total);
    }
}

/* Add what of the sample rectangles lies in these rows. */
static void add_samples(const struct sweep *s, struct tally *t, const struct band *b, uint32_t light,
                        uint32_t spectrum, const float *truth)
{
    const float *ratio = spectrum ? s->ratio[spectrum] + (size_t)b->rows.y * s->field->width * 3
                                  : NULL;
    for (uint32_t k = 0; k < SIM_SAMPLES; k++) {
        const struct sim_sample *r = &s->samples[k];
        struct sample_sum *sum =
            &t->samples[((size_t)light * s->field->n_spectra + spectrum) * SIM_SAMPLES + k];
        for (uint32_t y = r->y; y < r->y + r->height; y++) {
            if (y < b->rows.y || y >= b->rows.y + b->rows.height)
                continue;
            for (uint32_t x = r->x; x < r->x + r->width; x++) {
                size_t j = (size_t)(y - b->rows.y) * s->field->width + x;
                for (int c = 0; c < JUDGE_COLOURS; c++) {
                    double white = b->promoted_white[3 * j + c];
                    sum->promoted[c] += ratio ? white * ratio[3 * j + c] : white;
                    sum->truth[c] += truth[3 * j + c];
                }
            }
        }
    }
}

/*
 * Variance of a merged E from its own frames' noise, in (R / k)^2: 1 / sum t^2 / sigma^2 over the
 * exposures in range (or the longest), sigma^2 = read + shot + quantisation.
 */
static double frame_variance(const struct sweep *s, double e_full_scale_per_s)
{
    const struct ls_take_facts *facts = s->judge->source->facts;
    const struct ls_calibration_camera *camera = &facts->calibration->camera;
    double information = 0;
    for (uint32_t i = 0; i < facts->n_exposures; i++) {
        double t = facts->exposure_s[i];
        double signal_dn = e_full_scale_per_s * t * facts->full_scale_dn;
        double raw = (signal_dn + camera->black_dn) / facts->full_scale_dn;
        bool longest = i + 1 == facts->n_exposures;
        bool in_range = raw >= camera->range_low && raw <= camera->range_high;
        if (!in_range && !(longest && information == 0))
            continue;
        double variance_dn = facts->read_noise_dn * facts->read_noise_dn + 1.0 / 12 +
                             fmax(signal_dn, 0) / facts->electrons_per_dn;
        information += t * t / variance_dn;
    }
    return 1 / (information * facts->full_scale_dn * facts->full_scale_dn);
}

/* The constant map of radiance 1 through channel W, on the mosaic. */
static void add_black(const struct sweep *s, const struct band *b, uint32_t light,
                      const float *light_mosaic, const float *true_white)
{
    const struct ls_field *f = s->field;
    /* stored = E x reference: R = k scale stored, so R = gain E with E in full scale / s */
    double gain = f->k[light] * f->scale * s->judge->source->facts->reference_exposure_s;
    double omega = f->omega_sr[light];
    for (uint32_t k = 0; k < SIM_SAMPLES; k++) {
        const struct sim_sample *r = &s->samples[k];
        if (strcmp(r->group, "velvet"))
            continue;
        for (uint32_t y = r->y; y < r->y + r->height; y++) {
            if (y < b->rows.y || y >= b->rows.y + b->rows.height)
                continue;
            for (uint32_t x = r->x; x < r->x + r->width; x++) {
                size_t j = (size_t)(y - b->rows.y) * f->width + x;
                size_t w = (size_t)(y - b->window.y) * b->window.width + (x - b->window.x);
                double truth = true_white[3 * w + colour_at(f, x, y)];
                b->black_relit[j] += omega * light_mosaic[w];
                b->black_true[j] += omega * truth;
                b->black_variance[j] +=
                    omega * omega * gain * gain * frame_variance(s, truth / gain);
            }
        }
    }
}

static void close_black(struct tally *t, const struct band *b)
{
    for (size_t j = 0; j < pixels(&b->rows); j++) {
        if (b->black_variance[j] <= 0)
            continue;
        t->black_difference += (b->black_relit[j] - b->black_true[j]) / sqrt(b->black_variance[j]);
        t->black_pixels++;
    }
}

static enum ls_err judge_light(struct sweep *s, struct tally *t, struct band *b, uint32_t light,
                               struct ls_diag *diag)
{
    const struct sim_region window = { s->judge->source->camera, b->window.x, b->window.y,
                                       b->window.width, b->window.height };
    const struct sim_region rows = { window.camera, b->rows.x, b->rows.y, b->rows.width,
                                     b->rows.height };
    size_t plane = pixels(&b->window) * JUDGE_COLOURS;
    enum ls_err err = sim_truth_field(s->judge->scene, &window, light, b->truth, diag);
    if (!err)
        err = sim_truth_specular(s->judge->scene, &rows, light, b->specular, diag);
    if (err)
        return err;
    load_light(s->field, light, &b->window, b->mosaic);
    add_black(s, b, light, b->mosaic, b->truth + s->sim_channel[0] * plane);
    err = demosaic(s->field, b, b->mosaic, b->promoted_white);
    for (uint32_t k = 0; k < s->field->n_spectra && !err; k++) {
        true_mosaic(s->field, b, b->truth + s->sim_channel[k] * plane, b->mosaic);
        err = demosaic(s->field, b, b->mosaic, b->rgb);
        if (err)
            return err;
        add_samples(s, t, b, light, k, b->rgb);
        if (k)
            compare(s, t, b, k, b->rgb);
    }
    return err;
}

static void free_band(struct band *b)
{
    free(b->truth);
    free(b->mosaic);
    free(b->promoted_white);
    free(b->rgb);
    free(b->bounced);
    free(b->specular);
    free(b->black_relit);
    free(b->black_true);
    free(b->black_variance);
}

static enum ls_err open_band(const struct sweep *s, uint32_t index, struct band *b)
{
    uint32_t y0 = index * BAND_ROWS, left = s->field->height - y0;
    *b = (struct band){ .rows = { 0, y0, s->field->width, left < BAND_ROWS ? left : BAND_ROWS } };
    b->window = ls_demosaic_needs(b->rows, s->field->width, s->field->height);
    size_t n = pixels(&b->rows), w = pixels(&b->window);
    b->truth = calloc(w * JUDGE_COLOURS * s->n_sim_channels, sizeof(float));
    b->mosaic = calloc(w, sizeof(float));
    b->promoted_white = calloc(n * JUDGE_COLOURS, sizeof(float));
    b->rgb = calloc(n * JUDGE_COLOURS, sizeof(float));
    b->bounced = calloc(n, sizeof(float));
    b->specular = calloc(n, sizeof(float));
    b->black_relit = calloc(n, sizeof(double));
    b->black_true = calloc(n, sizeof(double));
    b->black_variance = calloc(n, sizeof(double));
    return b->truth && b->mosaic && b->promoted_white && b->rgb && b->bounced && b->specular &&
                   b->black_relit && b->black_true && b->black_variance
               ? LS_OK
               : LS_ERR_NOMEM;
}

static enum ls_err judge_band(struct sweep *s, struct tally *t, uint32_t index, struct ls_diag *diag)
{
    struct band b;
    enum ls_err err = open_band(s, index, &b);
    const struct sim_region rows = { s->judge->source->camera, b.rows.x, b.rows.y, b.rows.width,
                                     b.rows.height };
    if (!err)
        err = sim_truth_bounced(s->judge->scene, &rows, b.bounced, diag);
    for (uint32_t i = 0; i < s->field->n_lights && !err; i++)
        err = judge_light(s, t, &b, i, diag);
    if (!err)
        close_black(t, &b);
    free_band(&b);
    return err;
}

static bool take_band(struct sweep *s, uint32_t *index)
{
    pthread_mutex_lock(&s->lock);
    *index = s->next_band++;
    bool more = !s->err && *index * BAND_ROWS < s->field->height;
    pthread_mutex_unlock(&s->lock);
    return more;
}

struct worker {
    struct sweep *sweep;
    struct tally *tally;
};

static void *work(void *data)
{
    struct worker *w = data;
    struct ls_diag diag = { 0 };
    for (uint32_t index; take_band(w->sweep, &index);) {
        enum ls_err err = judge_band(w->sweep, w->tally, index, &diag);
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
        workers[started] = (struct worker){ s, &s->tally[started] };
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

/* The sums of a sample over both threads, as means over its pixels. */
static struct sample_sum sample_mean(const struct sweep *s, uint32_t light, uint32_t spectrum,
                                     uint32_t sample)
{
    size_t at = ((size_t)light * s->field->n_spectra + spectrum) * SIM_SAMPLES + sample;
    double n = (double)s->samples[sample].width * s->samples[sample].height;
    struct sample_sum out = { 0 };
    for (int t = 0; t < THREADS; t++)
        for (int c = 0; c < JUDGE_COLOURS; c++) {
            out.promoted[c] += s->tally[t].samples[at].promoted[c] / n;
            out.truth[c] += s->tally[t].samples[at].truth[c] / n;
        }
    return out;
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
        if (!strcmp(s->samples[k].name, "white"))
            return k;
    return 0;
}

static double olat_mae(const struct sweep *s)
{
    uint32_t patch = white_patch(s);
    double brightest = 0, sum = 0;
    uint64_t n = 0;
    for (uint32_t i = 0; i < s->field->n_lights; i++) {
        struct sample_sum w = sample_mean(s, i, 0, patch);
        brightest = fmax(brightest, largest(w.truth));
    }
    for (uint32_t i = 0; i < s->field->n_lights; i++) {
        struct sample_sum white = sample_mean(s, i, 0, patch);
        if (largest(white.truth) < 0.1 * brightest)
            continue;
        for (uint32_t k = 1; k < s->field->n_spectra; k++) {
            struct sample_sum scale = sample_mean(s, i, k, patch);
            for (uint32_t j = 0; j < SIM_SAMPLES; j++) {
                if (!is_swatch(&s->samples[j]))
                    continue;
                struct sample_sum v = sample_mean(s, i, k, j);
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
    double promoted[SIM_SAMPLES][JUDGE_COLOURS] = { 0 }, truth[SIM_SAMPLES][JUDGE_COLOURS] = { 0 };
    for (uint32_t i = 0; i < s->field->n_lights; i++)
        for (uint32_t j = 0; j < SIM_SAMPLES; j++) {
            struct sample_sum v = sample_mean(s, i, spectrum, j);
            for (int c = 0; c < JUDGE_COLOURS; c++) {
                promoted[j][c] += weights[i] * v.promoted[c];
                truth[j][c] += weights[i] * v.truth[c];
            }
        }
    double sum = 0, scale = largest(truth[white_patch(s)]);
    unsigned n = 0;
    for (uint32_t j = 0; j < SIM_SAMPLES; j++)
        for (int c = 0; is_swatch(&s->samples[j]) && c < JUDGE_COLOURS; c++, n++)
            sum += fabs(promoted[j][c] - truth[j][c]) / scale;
    return n ? 100 * sum / n : NAN;
}

/* Wavelength-mean radiance of the environment over each light's cell. */
static enum ls_err mean_weights(const struct judge *judge, double *weights, struct ls_diag *diag)
{
    const struct ls_field *f = &judge->source->field;
    double *cells = calloc((size_t)f->n_lights * judge->lobes->n, sizeof *cells);
    enum ls_err err = cells ? ls_envlights_lobes(f->directions, f->n_lights, NULL, judge->lobes,
                                                 cells, diag)
                            : LS_ERR_NOMEM;
    for (uint32_t i = 0; i < f->n_lights && !err; i++) {
        weights[i] = 0;
        for (size_t l = 0; l < judge->lobes->n; l++)
            weights[i] += cells[i * judge->lobes->n + l] *
                          ls_spectrum_mean(&judge->lobes->item[l].spectrum);
    }
    free(cells);
    return err;
}

static double percent(const struct sweep *s, size_t offset)
{
    struct ratio_sum sum = { 0 };
    for (int t = 0; t < THREADS; t++) {
        const struct ratio_sum *part =
            (const struct ratio_sum *)((const char *)&s->tally[t] + offset);
        add_ratio(&sum, part->difference, part->truth);
    }
    return sum.truth > 0 ? 100 * sqrt(sum.difference / sum.truth) : NAN;
}

static enum ls_err summarise(const struct sweep *s, struct judge_field_errors *out,
                             struct ls_diag *diag)
{
    double *weights = calloc(s->field->n_lights, sizeof *weights);
    enum ls_err err = weights ? mean_weights(s->judge, weights, diag) : LS_ERR_NOMEM;
    if (!err) {
        *out = (struct judge_field_errors){
            .olat_mae = olat_mae(s),
            .field_rms = percent(s, offsetof(struct tally, field)),
            .interreflection_rms = percent(s, offsetof(struct tally, interreflection)),
            .highlight_rms = percent(s, offsetof(struct tally, highlight)),
        };
        for (uint32_t k = 1; k < s->field->n_spectra; k++) {
            out->promotion_by_spectrum[k] = promotion(s, k, weights);
            out->promotion += out->promotion_by_spectrum[k] / (s->field->n_spectra - 1);
        }
        double difference = 0;
        uint64_t n = 0;
        for (int t = 0; t < THREADS; t++) {
            difference += s->tally[t].black_difference;
            n += s->tally[t].black_pixels;
        }
        out->black_mean_sigma = n ? difference / (double)n : NAN;
    }
    free(weights);
    return err;
}

static enum ls_err prepare(struct sweep *s, struct ls_diag *diag)
{
    const struct sim_scene_config *config = sim_scene_config(s->judge->scene);
    const struct ls_field_source *source = s->judge->source;
    if (!source->calibrated)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no calibration: nothing to judge",
                       source->take);
    s->n_sim_channels = config->n_channels;
    for (uint32_t k = 0; k < s->field->n_spectra; k++) {
        const char *name = source->facts->channels[source->channel_of[k]].name;
        for (s->sim_channel[k] = 0; s->sim_channel[k] < config->n_channels; s->sim_channel[k]++)
            if (!strcmp(config->channels[s->sim_channel[k]].name, name))
                break;
        if (s->sim_channel[k] == config->n_channels)
            return ls_fail(diag, LS_ERR_INVALID, "the scene has no channel %s", name);
        enum ls_err err = k ? ls_field_source_ratio(s->judge->source, k, &s->ratio[k], diag) : LS_OK;
        if (err)
            return err;
    }
    for (int t = 0; t < THREADS; t++) {
        s->tally[t].samples = calloc((size_t)s->field->n_lights * s->field->n_spectra * SIM_SAMPLES,
                                     sizeof *s->tally[t].samples);
        if (!s->tally[t].samples)
            return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    }
    return sim_truth_samples(s->judge->scene, source->camera, s->samples, diag);
}

enum ls_err judge_field_errors(const struct judge *judge, struct judge_field_errors *out,
                               struct ls_diag *diag)
{
    struct sweep s = { .judge = judge, .field = &judge->source->field };
    enum ls_err err = prepare(&s, diag);
    if (!err) {
        err = run_threads(&s);
        if (err)
            ls_fail(diag, err, "%s", s.diag.text);
    }
    if (!err)
        err = summarise(&s, out, diag);
    for (int t = 0; t < THREADS; t++)
        free(s.tally[t].samples);
    return err;
}

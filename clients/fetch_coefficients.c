#include "clients/fetch_coefficients.h"

#include "clients/calibrate_take.h"
#include "clients/picture_attrs.h"
#include "clients/picture_file.h"
#include "core/bases.h"
#include "core/demosaic.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HARMONICS = (LS_HARMONICS_MAX_DEGREE + 1) * (LS_HARMONICS_MAX_DEGREE + 1) };

/* One coefficient: what it is called, and the pictures it comes from. */
struct coefficient {
    char name[24];
    enum ls_basis_form form;
    double peak;
    const struct ls_lit_picture *shown, *other; /* other NULL: dark */
};

struct work {
    struct ls_command_context *context;
    const struct ls_fetch_coefficients *wanted;
    struct ls_calibrate_take *take;
    uint32_t channel;
    struct ls_demosaic_region region, needs; /* wanted, and what it is made of */
    const struct ls_lit_picture *shown_picture;
    float *shown, *other, *out; /* [needs.height][needs.width] */
    json_t *frames;
};

static struct ls_diag *diag_of(const struct work *w)
{
    return &w->context->diag;
}

/* ---- pictures ---- */

/* What E in full scale / s is multiplied by to be a sum of the lights' R. */
static enum ls_err find_unit(const struct work *w, const struct ls_lit_picture *picture,
                             double *unit, struct ls_diag *diag)
{
    const struct ls_take_document *d = w->take->document;
    const struct ls_calibration *c = d->calibration;
    int channel = c ? ls_calibration_channel(c, d->channels[w->channel].name) : 0;
    *unit = d->reference_exposure_s / picture->duty;
    if (!c)
        return LS_OK;
    double factor =
        channel < 0 ? 0
                    : ls_calibration_factor(c, (uint32_t)channel, picture->pattern, picture->duty);
    *unit = c->scale * factor / picture->duty;
    if (factor > 0)
        return LS_OK;
    struct ls_diag why = {"its calibration lacks the channel"};
    if (channel >= 0)
        ls_calibration_lacks_factor(c, (uint32_t)channel, picture->pattern, picture->duty, &why);
    return ls_fail(diag, LS_ERR_STATE, "take %s is uncalibrated for %s: %.300s", w->take->id,
                   picture->id, why.text);
}

static enum ls_err keep(void *user, const struct ls_lit_picture *picture, const float *e,
                        const uint8_t *validity, struct ls_diag *diag)
{
    struct work *w = user;
    const struct ls_demosaic_region *r = &w->needs;
    double unit;
    float *out = picture == w->shown_picture ? w->shown : w->other;
    enum ls_err err = find_unit(w, picture, &unit, diag);
    for (uint32_t y = 0; y < r->height && !err; y++)
        for (uint32_t x = 0; x < r->width; x++)
            out[(size_t)y * r->width + x] =
                (float)(unit * (double)e[(size_t)(r->y + y) * w->take->document->width + r->x + x]);
    return err;
}

static enum ls_err fetch(struct work *w, const struct ls_lit_picture *picture)
{
    const struct ls_calibrate_region region = {w->needs.x, w->needs.y, w->needs.width,
                                               w->needs.height};
    return ls_calibrate_fetch(w->take, &picture, 1, region, keep, w);
}

/* ---- a file ---- */

static enum ls_err fill_image(const struct work *w, struct ls_image *image)
{
    const struct ls_take_document *d = w->take->document;
    const struct ls_demosaic_source source = {.data = w->out,
                                              .stride = w->needs.width,
                                              .window = w->needs,
                                              .image_width = d->width,
                                              .image_height = d->height,
                                              .cfa = d->cfa};
    uint32_t colours = w->wanted->rgb && !d->mono ? 3 : 1;
    enum ls_err err = ls_image_init(image, w->region.width, w->region.height, colours,
                                    (size_t)4 << 30, diag_of(w));
    if (err)
        return err;
    size_t n = (size_t)w->region.width * w->region.height;
    if (colours == 1)
        memcpy(image->pixels, w->out, n * sizeof *w->out);
    const struct ls_demosaic_target target = {
        .plane = {image->pixels, image->pixels + 1, image->pixels + 2},
        .pixel_step = 3,
        .row_step = 3 * (size_t)w->region.width};
    if (colours == 3)
        err = ls_demosaic(&source, w->region, LS_DEMOSAIC_GRADIENT, &target);
    return err ? ls_fail(diag_of(w), err,
                         "take %s: %u x %u px at %u, %u of %u x %u do not demosaic (%s)",
                         w->take->id, w->region.width, w->region.height, w->region.x, w->region.y,
                         d->width, d->height, ls_cfa_name(d->cfa))
               : LS_OK;
}

static enum ls_err write_file(struct work *w, const struct coefficient *c)
{
    char path[4096];
    const struct ls_take_document *d = w->take->document;
    const struct ls_picture_place place = {(int32_t)w->region.x, (int32_t)w->region.y, d->width,
                                           d->height};
    struct ls_image image = {0};
    struct ls_exr_attrs attrs = {0};
    if (snprintf(path, sizeof path, "%s.%s.exr", w->wanted->output, c->name) >= (int)sizeof path)
        return ls_fail(diag_of(w), LS_ERR_INVALID, "--output: the path is too long");
    ls_picture_attrs_take(d, d->calibration != NULL, &attrs);
    ls_exr_attrs_string(&attrs, "lightstage/channel", w->wanted->channel);
    ls_exr_attrs_string(&attrs, "lightstage/cfa", w->wanted->rgb ? "none" : ls_cfa_name(d->cfa));
    ls_exr_attrs_string(&attrs, "lightstage/units", "R x sr");
    ls_exr_attrs_string(&attrs, "lightstage/coefficient", c->name);
    enum ls_err err = fill_image(w, &image);
    if (!err)
        err = ls_picture_file_exr(path, &image, w->wanted->half ? LS_EXR_HALF : LS_EXR_FLOAT,
                                  &place, NULL, &attrs, diag_of(w));
    ls_exr_attrs_finish(&attrs);
    ls_image_finish(&image);
    if (!err && json_array_append_new(w->frames,
                                      json_pack("{ss ss}", "file", path, "coefficient", c->name)))
        err = ls_fail(diag_of(w), LS_ERR_NOMEM, "%s is written, but there is no memory to list it",
                      path);
    return err;
}

static enum ls_err make(struct work *w, const struct coefficient *c)
{
    size_t n = (size_t)w->needs.width * w->needs.height;
    w->shown_picture = c->shown;
    enum ls_err err = fetch(w, c->shown);
    if (!c->other)
        memset(w->other, 0, n * sizeof *w->other);
    else if (!err && c->other != c->shown)
        err = fetch(w, c->other);
    if (err)
        return err;
    ls_harmonic_coefficient(c->form, c->peak, w->take->document->n_lights, w->shown,
                            c->other == c->shown ? w->shown : w->other, n, w->out);
    return write_file(w, c);
}

/* ---- which ---- */

static const struct ls_lit_picture *find(const struct work *w, unsigned index, const char *half)
{
    char pattern[24];
    snprintf(pattern, sizeof pattern, "harmonic-%02u%s", index, half);
    return ls_calibrate_find(w->take, w->channel, -1, pattern);
}

/* Harmonic 0 is every light at weight 1, biased and as the positive half of its pair. */
static bool choose_harmonic(const struct work *w, unsigned index, double *weights,
                            struct coefficient *out)
{
    const struct ls_take_document *d = w->take->document;
    snprintf(out->name, sizeof out->name, "harmonic-%02u", index);
    out->form = LS_BASIS_POSITIVE;
    out->shown = find(w, index, "p");
    out->other = find(w, index, "n");
    if (!out->shown) {
        out->form = LS_BASIS_BIASED;
        out->shown = find(w, index, "");
        out->other = find(w, 0, "");
    }
    out->peak = ls_harmonic_weights(index, out->form, (const float(*)[3])d->position_m, d->n_lights,
                                    weights);
    return out->shown && (out->form != LS_BASIS_BIASED || out->other);
}

static bool choose_gradient(const struct work *w, unsigned axis, struct coefficient *out)
{
    static const char *const names[] = {"x", "y", "z", "full"};
    snprintf(out->name, sizeof out->name, "gradient-%s", names[axis]);
    out->form = LS_BASIS_BIASED;
    out->peak = 1;
    out->shown = ls_calibrate_find(w->take, w->channel, -1, out->name);
    out->other = ls_calibrate_find(w->take, w->channel, -1, "gradient-full");
    return out->shown && out->other;
}

/* Can both pictures be brought to the lights' R? */
static enum ls_err check_units(const struct work *w, const struct coefficient *c)
{
    double unit;
    enum ls_err err = find_unit(w, c->shown, &unit, diag_of(w));
    return err || !c->other ? err : find_unit(w, c->other, &unit, diag_of(w));
}

static enum ls_err choose(const struct work *w, struct coefficient all[HARMONICS], uint32_t *found)
{
    uint32_t n = w->wanted->gradients ? 4 : HARMONICS;
    LS_CLEANUP_FREE double *weights = calloc(w->take->document->n_lights, sizeof *weights);
    enum ls_err err = weights ? LS_OK : ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    *found = 0;
    for (uint32_t i = 0; i < n && !err; i++) {
        struct coefficient *c = &all[*found];
        *c = (struct coefficient){{0}};
        if (!(w->wanted->gradients ? choose_gradient(w, i, c) : choose_harmonic(w, i, weights, c)))
            continue;
        (*found)++;
        err = check_units(w, c);
    }
    if (!err && !*found)
        return ls_fail(diag_of(w), LS_ERR_NOT_FOUND,
                       "the plan of take %s has no %s in %s: photograph them with kind \"%s\"",
                       w->take->id, w->wanted->gradients ? "gradients" : "harmonics",
                       w->wanted->channel, w->wanted->gradients ? "gradients" : "harmonics");
    return err;
}

/* A missing factor is known before the first file is written. */
static enum ls_err make_all(struct work *w)
{
    struct coefficient all[HARMONICS];
    uint32_t n;
    enum ls_err err = choose(w, all, &n);
    for (uint32_t i = 0; i < n && !err; i++)
        err = make(w, &all[i]);
    return err;
}

/* ---- the whole ---- */

static enum ls_err prepare(struct work *w)
{
    const struct ls_take_document *d = w->take->document;
    const struct lightstage_region *r = &w->wanted->region;
    int channel = ls_calibrate_channel(w->take, w->wanted->channel);
    if (channel < 0)
        return ls_fail(diag_of(w), LS_ERR_NOT_FOUND, "take %s has no channel \"%.32s\"",
                       w->take->id, w->wanted->channel);
    w->channel = (uint32_t)channel;
    w->region = (struct ls_demosaic_region){r->x, r->y, r->width, r->height};
    if (!r->width)
        w->region = (struct ls_demosaic_region){0, 0, d->width, d->height};
    if ((uint64_t)w->region.x + w->region.width > d->width ||
        (uint64_t)w->region.y + w->region.height > d->height)
        return ls_fail(diag_of(w), LS_ERR_INVALID, "--region: the picture is %u x %u pixels",
                       d->width, d->height);
    w->needs =
        w->wanted->rgb && !d->mono ? ls_demosaic_needs(w->region, d->width, d->height) : w->region;
    size_t n = (size_t)w->needs.width * w->needs.height;
    w->shown = calloc(n, sizeof *w->shown);
    w->other = calloc(n, sizeof *w->other);
    w->out = calloc(n, sizeof *w->out);
    w->frames = json_array();
    return w->shown && w->other && w->out && w->frames
               ? LS_OK
               : ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory for a picture");
}

static enum ls_err tell(struct work *w)
{
    char path[4096];
    json_t *document =
        json_pack("{ss ss sb sO}", "take", w->take->id, "channel", w->wanted->channel, "calibrated",
                  w->take->document->calibration != NULL, "frames", w->frames);
    char *text = json_dumps(document, JSON_INDENT(1));
    snprintf(path, sizeof path, "%s.json", w->wanted->output);
    enum ls_err err = text ? ls_command_write_file(path, text, strlen(text), diag_of(w))
                           : ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    if (!err && w->context->json)
        ls_command_print_json(json_incref(document));
    else if (!err)
        printf("%zu coefficients\n", json_array_size(w->frames));
    free(text);
    json_decref(document);
    return err;
}

int ls_fetch_coefficients(struct ls_command_context *context,
                          const struct ls_fetch_coefficients *wanted)
{
    struct work w = {.context = context, .wanted = wanted};
    int code = ls_command_open(context);
    if (code)
        return code;
    enum ls_err err = ls_calibrate_take_open(context, wanted->take, wanted->camera, &w.take);
    if (!err)
        err = prepare(&w);
    if (!err)
        err = make_all(&w);
    if (!err)
        err = tell(&w);
    free(w.shown);
    free(w.other);
    free(w.out);
    json_decref(w.frames);
    ls_calibrate_take_close(w.take);
    code = err ? ls_command_failed(context, err) : LS_EXIT_OK;
    return err == LS_ERR_NOT_FOUND || err == LS_ERR_STATE ? LS_EXIT_STATE : code;
}

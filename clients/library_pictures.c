/* Fetch, in rows. */
#include "clients/library_pictures.h"

#include "core/factored.h"

#include <string.h>

uint32_t ls_library_fill_promoted(Lightstage__Promotion *to, Lightstage__Region *to_region,
                                  const struct lightstage_promotion *promotion,
                                  const struct lightstage_region *region,
                                  struct lightstage_error *error)
{
    struct lightstage_promotion p = {0};
    uint32_t number = promotion ? ls_library_take_in(&p, sizeof p, promotion, error) : 0;
    lightstage__promotion__init(to);
    lightstage__region__init(to_region);
    to->model = (Lightstage__Model)p.model;
    to->reference = (Lightstage__Reference)p.reference;
    to->ideal_polarisation = p.ideal_polarisation != 0;
    to->plain_conductors = p.plain_conductors != 0;
    to_region->x = region->x;
    to_region->y = region->y;
    to_region->width = region->width;
    to_region->height = region->height;
    return number;
}

struct fetch_call {
    lightstage_on_band *callback;
    void *user;
};

struct lightstage_band ls_library_band(const Lightstage__FetchReply *r,
                                       struct lightstage_spectrum *report)
{
    if (r->spectrum)
        *report = ls_library_spectrum(r->spectrum);
    return (struct lightstage_band){
        .light = r->light,
        .width = r->width,
        .height = r->height,
        .first_row = r->first_row,
        .n_rows = r->n_rows,
        .components = r->components,
        .sample = (enum lightstage_sample)r->sample,
        .reference_exposure_s = r->reference_exposure_s,
        .gain_k = r->gain_k,
        .calibrated = r->calibrated,
        .factor = (enum lightstage_factor)r->factor,
        .gain = r->gain,
        .spectrum = r->spectrum ? r->spectrum->channel : NULL,
        .report = r->spectrum ? report : NULL,
        .error_bound = r->error_bound,
        .spectrum_number = r->spectrum_number,
    };
}

static uint32_t take_band(const struct ls_reply *reply, void *user, struct lightstage_error *error)
{
    const Lightstage__FetchReply *r = (const Lightstage__FetchReply *)reply->message;
    const struct fetch_call *call = user;
    struct lightstage_spectrum report;
    struct lightstage_band band = ls_library_band(r, &report);
    size_t sample = r->sample == LIGHTSTAGE__SAMPLE__HALF ? 2 : 4;
    size_t pixels = (size_t)r->width * r->n_rows;
    size_t variances = r->variance ? sizeof(float) * pixels : 0;
    size_t validities = r->validity ? pixels : 0;
    /* 2^16 of each at most, so that no product overflows */
    if (r->width > 65536 || r->height > 65536 || r->components > 16 || r->first_row > r->height ||
        r->n_rows > r->height - r->first_row ||
        reply->payload_bytes != sample * r->components * pixels + variances + validities)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon sent rows that do not fit the picture");
    band.values = reply->payload;
    band.values_bytes = sample * r->components * pixels;
    if (r->variance)
        band.variance = reply->payload + band.values_bytes;
    if (r->validity)
        band.validity = reply->payload + band.values_bytes + variances;
    return ls_library_stopped(call->callback(&band, call->user), error);
}

uint32_t ls_library_fill_fetch(struct ls_library_fetch *out, const struct lightstage_fetch *fetch,
                               struct lightstage_error *error)
{
    Lightstage__Fetch *body = &out->body;
    struct lightstage_fetch f;
    uint32_t number = ls_library_take_in(&f, sizeof f, fetch, error);
    if (!number)
        number =
            ls_library_fill_promoted(&out->promotion, &out->region, f.promotion, &f.region, error);
    if (number)
        return number;
    if (!f.take || !(f.channel || f.n_conditions || f.n_spectra))
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT,
                               "a take and a channel (or spectra, or conditions) are needed");
    lightstage__fetch__init(body);
    body->take = (char *)f.take;
    body->channel = (char *)(f.channel ? f.channel : "");
    body->conditions = (char **)f.conditions;
    body->n_conditions = f.n_conditions;
    body->variance = f.variance != 0;
    body->validity = f.validity != 0;
    body->factored = f.factored != 0;
    body->spectra = (char **)f.spectra;
    body->n_spectra = f.n_spectra;
    body->credit_bytes = f.credit_bytes;
    body->memfd = f.memfd != 0;
    body->lights = (uint32_t *)f.lights;
    body->n_lights = f.n_lights;
    body->full_sphere = f.full_sphere != 0;
    body->region = &out->region;
    body->promotion = f.promotion ? &out->promotion : NULL;
    body->layout = (Lightstage__Layout)f.layout;
    body->quantity = (Lightstage__Quantity)f.quantity;
    body->sample = (Lightstage__Sample)f.sample;
    body->camera = f.camera;
    body->level = f.level;
    body->max_error = f.max_error;
    return 0;
}

uint32_t ls_library_credit_by_caller(struct lightstage_error *error)
{
    return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT,
                           "credit_bytes goes with a call named _begin");
}

uint32_t ls_library_no_credit(const struct lightstage_fetch *fetch, struct lightstage_error *error)
{
    struct lightstage_fetch f;
    uint32_t number = ls_library_take_in(&f, sizeof f, fetch, error);
    return !number && f.credit_bytes ? ls_library_credit_by_caller(error) : number;
}

uint32_t lightstage_fetch_begin(struct lightstage *stage, const struct lightstage_fetch *fetch,
                                lightstage_on_band *callback, void *user, uint32_t *request,
                                struct lightstage_error *error)
{
    struct ls_library_fetch own;
    const struct fetch_call call = {callback, user};
    uint32_t number = ls_library_fill_fetch(&own, fetch, error);
    return number ? number
                  : ls_library_begin(stage, LS_MESSAGE_FETCH, &own.body.base, NULL, 0, take_band,
                                     &call, sizeof call, request, error);
}

uint32_t lightstage_credit(struct lightstage *stage, uint32_t request, uint64_t bytes,
                           struct lightstage_error *error)
{
    Lightstage__Credit body = LIGHTSTAGE__CREDIT__INIT;
    body.request = request;
    body.bytes = bytes;
    return ls_library_tell(stage, LS_MESSAGE_CREDIT, &body.base, error);
}

size_t lightstage_expand(const uint16_t *white, float gain, const uint16_t *ratio, size_t n,
                         uint16_t *out)
{
    return ls_factored_expand(white, gain, ratio, n, out);
}

uint32_t lightstage_fetch(struct lightstage *stage, const struct lightstage_fetch *fetch,
                          lightstage_on_band *callback, void *user, struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = ls_library_no_credit(fetch, error);
    if (!number)
        number = lightstage_fetch_begin(stage, fetch, callback, user, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}

struct into {
    char *to;
    size_t used, bytes;
    struct lightstage_shape shape;
    int too_small, uneven;
};

/* Pictures come in order and whole, so bytes are only added. */
static int append_band(const struct lightstage_band *band, void *user)
{
    struct into *into = user;
    struct lightstage_shape *shape = &into->shape;
    if (!band->first_row && !shape->pictures)
        *shape = (struct lightstage_shape){0, band->height, band->width, band->components};
    into->uneven = band->width != shape->width || band->height != shape->height ||
                   band->components != shape->components;
    into->too_small = band->values_bytes > into->bytes - into->used;
    if (into->too_small || into->uneven)
        return 1;
    memcpy(into->to + into->used, band->values, band->values_bytes);
    into->used += band->values_bytes;
    shape->pictures += band->first_row + band->n_rows == band->height;
    return 0;
}

uint32_t lightstage_fetch_into(struct lightstage *stage, const struct lightstage_fetch *fetch,
                               void *buffer, size_t bytes, struct lightstage_shape *shape,
                               struct lightstage_error *error)
{
    struct into into = {.to = buffer, .bytes = bytes};
    struct lightstage_fetch f;
    uint32_t number = ls_library_take_in(&f, sizeof f, fetch, error);
    if (!number && f.factored)
        number = ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT,
                                 "a factored fetch has gains that a buffer has no room for");
    if (number)
        return number;
    number = lightstage_fetch(stage, fetch, append_band, &into, error);
    if (into.too_small)
        return ls_library_fail(error, LIGHTSTAGE_OVER_LIMIT,
                               "the pictures, of %u x %u pixels of %u, do not fit into %zu bytes",
                               into.shape.width, into.shape.height, into.shape.components, bytes);
    if (into.uneven)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon sent pictures of different sizes");
    if (!number)
        *shape = into.shape;
    return number;
}

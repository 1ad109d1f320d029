/* Relight, and what is said of spectra. */
#include "clients/library_pictures.h"

#include <stdlib.h>

struct lightstage_spectrum ls_library_spectrum(const Lightstage__SpectrumReport *r)
{
    return (struct lightstage_spectrum){
        .channel = r->channel,
        .model = (enum lightstage_model)r->model,
        .reference = (enum lightstage_reference)r->reference,
        .segments = r->segments,
        .blended = r->blended,
        .left_out_error = r->left_out_error,
        .left_out_share = r->left_out_share,
        .inseparable_lights = r->inseparable_lights,
        .multiplexed = r->multiplexed,
        .spare_deviation = r->spare_deviation,
        .spare_alarm = r->spare_alarm,
        .checked_lights = r->checked_lights,
        .checked_error = r->checked_error,
        .highlight_error = r->highlight_error,
        .highlight_share = r->highlight_share,
    };
}

struct relight_call {
    lightstage_on_relit *callback;
    void *user;
};

/* With its spectra, of which there are few, in memory of its own. */
static uint32_t tell(const struct relight_call *call, struct lightstage_relit *rows,
                     const Lightstage__RelightReply *r, struct lightstage_error *error)
{
    size_t n = r->n_spectra;
    struct lightstage_spectrum *spectra = calloc(n + 1, sizeof *spectra);
    const struct lightstage_spectrum **at = calloc(n + 1, sizeof *at);
    uint32_t number = 0;
    for (size_t i = 0; i < n && spectra && at; i++) {
        spectra[i] = ls_library_spectrum(r->spectra[i]);
        at[i] = &spectra[i];
    }
    rows->n_spectra = n;
    rows->spectra = at;
    if (!spectra || !at)
        number = ls_library_fail(error, LIGHTSTAGE_NO_MEMORY, "out of memory");
    else
        number = ls_library_stopped(call->callback(rows, call->user), error);
    free(spectra);
    free(at);
    return number;
}

static uint32_t take_relit(const struct ls_reply *reply, void *user, struct lightstage_error *error)
{
    const Lightstage__RelightReply *r = (const Lightstage__RelightReply *)reply->message;
    const struct relight_call *call = user;
    struct lightstage_relit rows = {
        .values = reply->payload,
        .picture = r->picture,
        .width = r->width,
        .height = r->height,
        .first_row = r->first_row,
        .n_rows = r->n_rows,
        .lights_used = r->lights_used,
        .lights_skipped = r->lights_skipped,
        .tiles_skipped = r->tiles_skipped,
        .error_bound = r->error_bound,
        .seconds = r->seconds,
        .calibrated = r->calibrated,
    };
    if (r->width > 65536 || r->height > 65536 || r->first_row > r->height ||
        r->n_rows > r->height - r->first_row ||
        reply->payload_bytes != sizeof(float) * 3 * r->width * r->n_rows)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon sent rows that do not fit the picture");
    return tell(call, &rows, r, error);
}

/* 0: they overflow. */
static size_t weights_bytes(const struct lightstage_relight *r)
{
    size_t rows = r->mode == LIGHTSTAGE_TRISTIMULUS ? 3 : r->n_channels;
    size_t n = r->n_pictures ? r->n_pictures : 1, bytes = 0;
    if (r->mode == LIGHTSTAGE_PER_TARGET && __builtin_mul_overflow(rows, 3, &rows))
        return 0;
    if (__builtin_mul_overflow(n * sizeof(float), rows, &bytes) ||
        __builtin_mul_overflow(bytes, r->n_lights, &bytes))
        return 0;
    return bytes;
}

uint32_t lightstage_relight_begin(struct lightstage *stage,
                                  const struct lightstage_relight *relight,
                                  lightstage_on_relit *callback, void *user, uint32_t *request,
                                  struct lightstage_error *error)
{
    Lightstage__Relight body = LIGHTSTAGE__RELIGHT__INIT;
    struct lightstage_relight r;
    Lightstage__Promotion promotion;
    Lightstage__Region region;
    const struct relight_call call = {callback, user};
    uint32_t number = ls_library_take_in(&r, sizeof r, relight, error);
    if (!number)
        number = ls_library_fill_promoted(&promotion, &region, r.promotion, &r.region, error);
    if (number)
        return number;
    if (!r.take || !r.weights || !weights_bytes(&r))
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT,
                               "a take, and weights of lights and channels, are needed");
    body.take = (char *)r.take;
    body.mode = (Lightstage__WeightMode)r.mode;
    body.channels = (char **)r.channels;
    body.n_channels = r.n_channels;
    body.n_lights = r.n_lights;
    body.n_pictures = r.n_pictures;
    body.region = &region;
    body.promotion = r.promotion ? &promotion : NULL;
    body.max_error = r.max_error;
    body.camera = r.camera;
    body.level = r.level;
    body.credit_bytes = r.credit_bytes;
    return ls_library_begin(stage, LS_MESSAGE_RELIGHT, &body.base, r.weights, weights_bytes(&r),
                            take_relit, &call, sizeof call, request, error);
}

uint32_t lightstage_relight(struct lightstage *stage, const struct lightstage_relight *relight,
                            lightstage_on_relit *callback, void *user,
                            struct lightstage_error *error)
{
    struct lightstage_relight r;
    uint32_t request = 0;
    uint32_t number = ls_library_take_in(&r, sizeof r, relight, error);
    if (!number && r.credit_bytes)
        number = ls_library_credit_by_caller(error);
    if (!number)
        number = lightstage_relight_begin(stage, relight, callback, user, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}

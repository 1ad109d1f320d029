#include "daemon/fetch_private.h"

#include "proto/frame.h"
#include "proto/message.h"

void ls_fetch_describe(const struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                       struct ls_demosaic_region band, Lightstage__FetchReply *body)
{
    lightstage__fetch_reply__init(body);
    body->light = self->full_sphere ? 0 : self->lights[self->light];
    body->width = self->region.width;
    body->height = self->region.height;
    body->first_row = band.y - self->region.y;
    body->n_rows = band.height;
    body->components = ls_fetch_components(self);
    body->sample = self->half ? LIGHTSTAGE__SAMPLE__HALF : LIGHTSTAGE__SAMPLE__FLOAT;
    body->reference_exposure_s = self->source->facts->reference_exposure_s;
    body->gain_k = picture->k;
    body->calibrated = self->source->calibrated;
    body->level = self->reduction.level;
    body->spectrum_number = (uint32_t)(self->now - self->spectra);
    if (!self->factored.wanted)
        return;
    bool ratio = ls_factored_is_ratio(&self->factored);
    body->factor = ratio ? LIGHTSTAGE__FACTOR__RATIO : LIGHTSTAGE__FACTOR__WHITE;
    body->light = ratio ? self->factored.at : body->light;
    body->gain = (float)picture->gain;
}

bool ls_fetch_next_picture(struct ls_fetch_job *self)
{
    self->row = 0;
    self->reported = false;
    if (ls_factored_is_ratio(&self->factored)) {
        self->factored.at++;
    } else if (++self->now == self->spectra + self->n_spectra) {
        self->now = self->spectra;
        self->light++;
    }
    return self->light == self->n_lights;
}

enum ls_err ls_fetch_send(struct ls_fetch_job *self, Lightstage__FetchReply *body,
                          bool picture_ends, struct ls_chunk *chunk, bool *last,
                          struct ls_diag *diag)
{
    Lightstage__SpectrumReport report;
    if (!self->reported && !self->full_sphere) {
        const struct ls_factored *f = &self->factored;
        ls_promotion_report(self->source, &self->promotion,
                            ls_factored_is_ratio(f) ? &f->ways[f->at] : &self->now->way, &report);
        body->spectrum = &report;
    }
    self->reported = true;
    *last = picture_ends && ls_fetch_next_picture(self);
    body->error_bound = *last ? self->tiles.error_bound : 0;
    size_t lent = chunk->lent ? chunk->lent->n_bytes : 0;
    return ls_message_frame(LS_MESSAGE_FETCH | LS_MESSAGE_REPLY, self->job.request,
                            *last ? LS_FRAME_LAST : 0, &body->base, chunk->payload_bytes + lent,
                            &chunk->head, &chunk->head_bytes, diag);
}

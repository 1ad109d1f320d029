#include "daemon/factored.h"

#include "core/half.h"
#include "daemon/light_set.h"

#include <stdio.h>
#include <string.h>

static enum ls_err check(const Lightstage__Fetch *fetch, const struct ls_promotion *promotion,
                         struct ls_diag *diag)
{
    if (promotion->model != LIGHTSTAGE__MODEL__SPHERE &&
        promotion->model != LIGHTSTAGE__MODEL__HEADLIGHT)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: only by sphere and headlight is a light white times a ratio; by "
                       "other models it cannot be factored");
    if (fetch->layout != LIGHTSTAGE__LAYOUT__RGB || fetch->sample != LIGHTSTAGE__SAMPLE__HALF ||
        fetch->level > 0)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: what is factored is full-size RGB in halves: a mean or a luminance "
                       "of products is no product");
    if (fetch->channel[0] || fetch->n_spectra < 1 || fetch->n_spectra > LS_FIELD_MAX_SPECTRA)
        return ls_fail(diag, LS_ERR_INVALID,
                       "fetch: factored: expected 1 to %d spectra, and no channel",
                       LS_FIELD_MAX_SPECTRA);
    return LS_OK;
}

enum ls_err ls_factored_read(const Lightstage__Fetch *fetch, const struct ls_promotion *promotion,
                             struct ls_factored *out, struct ls_diag *diag)
{
    *out = (struct ls_factored){.wanted = fetch->factored};
    if (!fetch->factored)
        return LS_OK;
    enum ls_err err = check(fetch, promotion, diag);
    for (; out->n < fetch->n_spectra && !err; out->n++)
        if ((size_t)snprintf(out->names[out->n], sizeof out->names[0], "%s",
                             fetch->spectra[out->n]) >= sizeof out->names[0])
            err = ls_fail(diag, LS_ERR_INVALID, "fetch: expected the name of a channel");
    return err;
}

/* By a spectrum of the take. */
static enum ls_err find(struct ls_field_source *source, const struct ls_promotion *promotion,
                        const char *name, const struct ls_job *asker, struct ls_way *out,
                        struct ls_diag *diag)
{
    int channel = ls_take_facts_channel(source->facts, name);
    if (channel < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "take %s has no channel \"%s\"", source->take, name);
    enum ls_err err = ls_promotion_find(source, promotion, (uint32_t)channel, asker, out, diag);
    if (!err && out->kind != LS_WAY_RATIO)
        err = ls_fail(diag, LS_ERR_UNSUPPORTED,
                      "fetch: %s of take %s is photographed, not promoted: it has no ratio", name,
                      source->take);
    return err;
}

enum ls_err ls_factored_find(struct ls_factored *f, struct ls_field_source *source,
                             const struct ls_promotion *promotion, const struct ls_way *white,
                             const struct ls_job *asker, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (ls_light_set_is_coloured(white->set) || ls_light_set_is_summed(white->set))
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a light of take %s is made of several pictures, or its gains differ "
                       "by the camera's colours: it is no product of two pictures",
                       source->take);
    for (uint32_t i = 0; i < f->n && !err; i++)
        err = find(source, promotion, f->names[i], asker, &f->ways[i], diag);
    return err;
}

bool ls_factored_is_ratio(const struct ls_factored *f)
{
    return f->at < f->n;
}

void ls_factored_fill(const struct ls_factored *f, const struct ls_field_source *source,
                      struct ls_demosaic_region r, uint16_t *out)
{
    const struct ls_field_map *map = f->ways[f->at].map;
    size_t stride = (size_t)source->width * map->depth, row = (size_t)r.width * map->depth;
    const float *from = map->values + r.y * stride + (size_t)r.x * map->depth;
    for (uint32_t y = 0; y < r.height; y++, from += stride, out += row)
        ls_half_from_floats(from, out, row);
}

#include "daemon/pixel_quality.h"

#include "core/merge_variance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct ls_pixel_quality ls_pixel_quality_of(const Lightstage__Fetch *fetch)
{
    return (struct ls_pixel_quality){.variance = fetch->variance, .validity = fetch->validity};
}

enum ls_err ls_pixel_quality_check(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    if ((fetch->variance || fetch->validity) && fetch->layout != LIGHTSTAGE__LAYOUT__MOSAIC)
        return ls_fail(
            diag, LS_ERR_UNSUPPORTED,
            "fetch: validity and variance are of photographed pixels; ask for the mosaic");
    if ((fetch->variance || fetch->validity) && fetch->level > 0)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: validity and variance are of photographed pixels, not of means of "
                       "them; ask for level 0");
    return LS_OK;
}

static enum ls_err describe_merge(const struct ls_take_facts *facts, struct ls_merge_params *out,
                                  struct ls_diag *diag)
{
    *out = (struct ls_merge_params){.n_exposures = facts->n_exposures,
                                    .range_low = facts->range_low,
                                    .range_high = facts->range_high,
                                    .full_scale_dn = facts->full_scale_dn,
                                    .electrons_per_dn = facts->electrons_per_dn,
                                    .read_noise_dn = facts->read_noise_dn};
    memcpy(out->exposure_s, facts->exposure_s, facts->n_exposures * sizeof *out->exposure_s);
    if (!isfinite(facts->black_dn + facts->range_low + facts->range_high))
        return ls_fail(diag, LS_ERR_STATE,
                       "take.json lacks range or black_dn of the camera: no variance can be told");
    return LS_OK;
}

static enum ls_err put_variance(const struct ls_picture_map *map, const struct ls_take_facts *facts,
                                struct ls_demosaic_region r, double gain, uint8_t *out,
                                struct ls_diag *diag)
{
    struct ls_merge_params params;
    enum ls_err err = describe_merge(facts, &params, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE float *row = malloc(r.width * sizeof *row);
    if (!row)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    double reference = facts->reference_exposure_s, scale = reference * gain * reference * gain;
    for (uint32_t y = 0; y < r.height; y++, out += r.width * sizeof *row) {
        ls_picture_map_read(map, r.x, r.y + y, r.width, 1, (float)(1 / reference), row);
        ls_merge_variance(&params, facts->black_dn, row, r.width, row);
        for (uint32_t x = 0; x < r.width; x++)
            row[x] = (float)(scale * (double)row[x]);
        memcpy(out, row, r.width * sizeof *row);
    }
    return LS_OK;
}

enum ls_err ls_pixel_quality_append(struct ls_pixel_quality wanted,
                                    const struct ls_picture_map *map,
                                    const struct ls_take_facts *facts,
                                    struct ls_demosaic_region region, double gain,
                                    struct ls_chunk *chunk, Lightstage__FetchReply *body,
                                    struct ls_diag *diag)
{
    size_t n = (size_t)region.width * region.height, values = chunk->payload_bytes;
    size_t variance = wanted.variance ? n * sizeof(float) : 0, validity = wanted.validity ? n : 0;
    enum ls_err err = LS_OK;
    if (variance + validity == 0)
        return LS_OK;
    uint8_t *payload = realloc(chunk->payload, values + variance + validity);
    if (!payload)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    chunk->payload = payload;
    chunk->payload_bytes = values + variance + validity;
    body->variance = wanted.variance;
    body->validity = wanted.validity;
    if (variance)
        err = put_variance(map, facts, region, gain, payload + values, diag);
    if (!err && validity)
        err = ls_picture_map_validity(map, region.x, region.y, region.width, region.height,
                                      payload + values + variance, diag);
    return err;
}

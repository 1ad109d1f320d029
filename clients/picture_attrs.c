#include "clients/picture_attrs.h"

#include "core/view.h"

#include <stdio.h>

/* The time of day of "YYYY:MM:DD hh:mm:ss" as SMPTE 12M packs it, frame 0: its digits are BCD. */
static void add_timecode(const char *date, struct ls_exr_attrs *attrs)
{
    unsigned hour, minute, second;
    if (sscanf(date + 11, "%2x:%2x:%2x", &hour, &minute, &second) == 3)
        ls_exr_attrs_timecode(attrs, "timeCode", hour << 24 | minute << 16 | second << 8, 0);
}

static void add_lens(const struct ls_document_camera *camera, struct ls_exr_attrs *attrs)
{
    if (camera->lens[0])
        ls_exr_attrs_string(attrs, "lensModel", camera->lens);
    if (camera->aperture > 0)
        ls_exr_attrs_float(attrs, "aperture", camera->aperture);
    if (camera->iso_speed > 0)
        ls_exr_attrs_float(attrs, "isoSpeed", camera->iso_speed);
}

void ls_picture_attrs_take(const struct ls_take_document *document, bool calibrated,
                           struct ls_exr_attrs *attrs)
{
    const struct ls_document_camera *camera = &document->camera;
    float matrix[16];
    ls_world_to_camera(camera->position_m, camera->look_at_m, matrix);
    if (document->date[0]) {
        ls_exr_attrs_string(attrs, "capDate", document->date);
        ls_exr_attrs_float(attrs, "utcOffset", 0);
        add_timecode(document->date, attrs);
    }
    add_lens(camera, attrs);
    ls_exr_attrs_string(attrs, "cameraMake", camera->vendor);
    ls_exr_attrs_string(attrs, "cameraModel", camera->model);
    ls_exr_attrs_string(attrs, "cameraSerialNumber", camera->serial);
    ls_exr_attrs_m44f(attrs, "worldToCamera", matrix);
    ls_exr_attrs_string(attrs, "lightstage/take", document->id);
    ls_exr_attrs_string(attrs, "lightstage/calibration", calibrated ? "given" : "none");
    ls_exr_attrs_int(attrs, "lightstage/conventions", 1);
}

void ls_picture_attrs_light(const struct ls_take_document *document, uint32_t light,
                            struct ls_exr_attrs *attrs)
{
    ls_exr_attrs_int(attrs, "lightstage/light", (int32_t)light);
    if (light >= document->n_lights)
        return;
    ls_exr_attrs_v3f(attrs, "lightstage/position", document->position_m[light]);
    ls_exr_attrs_v3f(attrs, "lightstage/direction", document->direction[light]);
}

void ls_picture_attrs_fetched(const struct ls_take_document *document,
                              const struct lightstage_band *band, const char *channel,
                              struct ls_exr_attrs *attrs)
{
    ls_exr_attrs_float(attrs, "expTime", (float)document->longest_exposure_s);
    ls_exr_attrs_string(attrs, "lightstage/channel", channel);
    ls_exr_attrs_int(attrs, "lightstage/blackSubtracted", 1);
    ls_exr_attrs_float(attrs, "lightstage/gain", (float)band->gain_k);
    ls_exr_attrs_float(attrs, "lightstage/referenceExposure", (float)band->reference_exposure_s);
}

void ls_picture_attrs_primaries(const struct ls_primaries *primaries, struct ls_exr_attrs *attrs)
{
    float xy[8];
    for (int i = 0; i < 8; i++)
        xy[i] = (float)primaries->xy[i / 2][i % 2];
    ls_exr_attrs_chromaticities(attrs, "chromaticities", xy);
}

#include "daemon/attributes.h"

#include "core/pixel.h"
#include "core/view.h"

#include <math.h>
#include <time.h>

/* Two decimal digits as SMPTE 12M packs them. */
static uint32_t bcd(int value)
{
    return (uint32_t)(value / 10 * 16 + value % 10);
}

static void add_lens(const struct ls_config_camera *camera, struct ls_exr_attrs *attrs)
{
    if (camera->lens)
        ls_exr_attrs_string(attrs, "lensModel", camera->lens);
    if (camera->aperture > 0)
        ls_exr_attrs_float(attrs, "aperture", (float)camera->aperture);
    if (camera->iso_speed > 0)
        ls_exr_attrs_float(attrs, "isoSpeed", (float)camera->iso_speed);
}

static void add_standard(const struct ls_picture_facts *picture, struct ls_exr_attrs *attrs)
{
    const struct ls_config_camera *camera = &picture->config->cameras[picture->camera];
    char date[32];
    float matrix[16];
    time_t utc = (time_t)picture->utc_s;
    struct tm tm;
    gmtime_r(&utc, &tm);
    strftime(date, sizeof date, "%Y:%m:%d %H:%M:%S", &tm);
    ls_world_to_camera(camera->position_m, camera->look_at_m, matrix);
    ls_exr_attrs_string(attrs, "capDate", date);
    ls_exr_attrs_float(attrs, "utcOffset", 0);
    /* the take's wall time, to the second: frame 0 */
    ls_exr_attrs_timecode(attrs, "timeCode",
                          bcd(tm.tm_hour) << 24 | bcd(tm.tm_min) << 16 | bcd(tm.tm_sec) << 8, 0);
    add_lens(camera, attrs);
    ls_exr_attrs_float(attrs, "expTime", (float)picture->longest_exposure_s);
    ls_exr_attrs_string(attrs, "cameraMake", picture->info->vendor);
    ls_exr_attrs_string(attrs, "cameraModel", picture->info->model);
    ls_exr_attrs_string(attrs, "cameraSerialNumber", picture->info->serial);
    ls_exr_attrs_m44f(attrs, "worldToCamera", matrix);
}

static void add_light(const struct ls_config *config, int32_t light, struct ls_exr_attrs *attrs)
{
    const float *p = config->lights[light].position_m;
    double length = sqrt((double)p[0] * p[0] + (double)p[1] * p[1] + (double)p[2] * p[2]);
    const float direction[3] = {(float)(p[0] / length), (float)(p[1] / length),
                                (float)(p[2] / length)};
    ls_exr_attrs_int(attrs, "lightstage/light", light);
    ls_exr_attrs_v3f(attrs, "lightstage/position", p);
    ls_exr_attrs_v3f(attrs, "lightstage/direction", direction);
}

static void add_condition(const struct ls_picture_facts *picture, struct ls_exr_attrs *attrs)
{
    const struct ls_config *config = picture->config;
    const struct ls_plan_condition *c = &picture->plan->conditions[picture->condition];
    ls_exr_attrs_string(attrs, "lightstage/condition", c->id);
    if (c->light >= 0 && (uint32_t)c->light < config->n_lights)
        add_light(config, c->light, attrs);
    if (c->channel >= 0 && (uint32_t)c->channel < config->n_channels)
        ls_exr_attrs_string(attrs, "lightstage/channel", config->channels[c->channel].name);
    if (c->level > 0)
        ls_exr_attrs_float(attrs, "lightstage/duty", (float)c->level / 65535);
    if (c->pattern[0])
        ls_exr_attrs_string(attrs, "lightstage/pattern", c->pattern);
}

void ls_picture_attributes(const struct ls_picture_facts *picture, struct ls_exr_attrs *attrs)
{
    const struct ls_plan_condition *c = &picture->plan->conditions[picture->condition];
    const struct ls_pixel_format *format = ls_pixel_by_name(picture->info->pixel_format);
    add_standard(picture, attrs);
    add_condition(picture, attrs);
    ls_exr_attrs_string(attrs, "lightstage/take", picture->take);
    ls_exr_attrs_string(attrs, "lightstage/cfa", ls_cfa_name(format ? format->cfa : LS_CFA_NONE));
    ls_exr_attrs_string(attrs, "lightstage/calibration",
                        picture->config->calibration_path ? "given" : "none");
    ls_exr_attrs_int(attrs, "lightstage/conventions", 1);
    if (c->dark) {
        ls_exr_attrs_string(attrs, "lightstage/units", "DN");
        ls_exr_attrs_int(attrs, "lightstage/blackSubtracted", 0);
        return;
    }
    ls_exr_attrs_string(attrs, "lightstage/units", "full scale / s x referenceExposure");
    ls_exr_attrs_string(attrs, "lightstage/model", "measured");
    ls_exr_attrs_string(attrs, "lightstage/reference", "none");
    ls_exr_attrs_float(attrs, "lightstage/gain", 1);
    ls_exr_attrs_int(attrs, "lightstage/blackSubtracted", 1);
    ls_exr_attrs_float(attrs, "lightstage/referenceExposure", (float)picture->reference_exposure_s);
}

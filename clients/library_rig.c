/* The rig, and what a plan would cost on it. */
#include "clients/library.h"

#include <string.h>

struct rig_arrays {
    const struct lightstage_channel **channel_at;
    struct lightstage_channel *channels;
    const struct lightstage_rig_camera **camera_at;
    struct lightstage_rig_camera *cameras;
    float *positions;
};

static void vector(float out[3], const float *v, size_t n)
{
    memcpy(out, v, (n < 3 ? n : 3) * sizeof *v);
}

static void fill_rig(struct lightstage_rig *rig, const struct rig_arrays *to,
                     const Lightstage__RigReply *r)
{
    for (size_t i = 0; i < r->n_channels; i++) {
        to->channels[i].name = r->channels[i]->name;
        to->channels[i].polariser = r->channels[i]->polariser;
        to->channel_at[i] = &to->channels[i];
    }
    for (size_t i = 0; i < r->n_cameras; i++) {
        const Lightstage__RigCamera *c = r->cameras[i];
        struct lightstage_rig_camera *camera = &to->cameras[i];
        camera->name = c->name;
        vector(camera->position_m, c->position_m, c->n_position_m);
        vector(camera->look_at_m, c->look_at_m, c->n_look_at_m);
        camera->focal_length_mm = c->focal_length_mm;
        camera->sensor_width_mm = c->sensor_width_mm;
        camera->sensor_height_mm = c->sensor_height_mm;
        to->camera_at[i] = camera;
    }
    rig->name = r->name;
    rig->n_lights = r->n_lights;
    rig->positions_m = to->positions;
    rig->n_channels = r->n_channels;
    rig->channels = to->channel_at;
    rig->n_cameras = r->n_cameras;
    rig->cameras = to->camera_at;
}

/* The rig, then its arrays, floats last, so that each is aligned. */
static void *make_rig(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__RigReply *r = (const Lightstage__RigReply *)reply->message;
    struct rig_arrays to;
    if (reply->payload_bytes / (3 * sizeof(float)) != r->n_lights) {
        ls_library_fail(error, LIGHTSTAGE_STRANGE, "the daemon sent positions of other lights");
        return NULL;
    }
    struct lightstage_rig *rig = ls_library_keep(
        reply,
        sizeof *rig + r->n_channels * (sizeof *to.channel_at + sizeof *to.channels) +
            r->n_cameras * (sizeof *to.camera_at + sizeof *to.cameras) + reply->payload_bytes,
        error);
    if (!rig)
        return NULL;
    to.channel_at = (const struct lightstage_channel **)(rig + 1);
    to.channels = (struct lightstage_channel *)(to.channel_at + r->n_channels);
    to.camera_at = (const struct lightstage_rig_camera **)(to.channels + r->n_channels);
    to.cameras = (struct lightstage_rig_camera *)(to.camera_at + r->n_cameras);
    to.positions = (float *)(to.cameras + r->n_cameras);
    memcpy(to.positions, reply->payload, reply->payload_bytes);
    fill_rig(rig, &to, r);
    return rig;
}

uint32_t lightstage_rig(struct lightstage *stage, struct lightstage_rig **out,
                        struct lightstage_error *error)
{
    Lightstage__Rig body = LIGHTSTAGE__RIG__INIT;
    return ls_library_ask(stage, LS_MESSAGE_RIG, &body.base, NULL, 0, make_rig, out, error);
}

void lightstage_rig_free(struct lightstage_rig *rig)
{
    ls_library_release(rig);
}

static void *make_preflight(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__PreflightReply *r = (const Lightstage__PreflightReply *)reply->message;
    struct lightstage_preflight *preflight = ls_library_keep(reply, sizeof *preflight, error);
    if (preflight)
        *preflight = (struct lightstage_preflight){
            .conditions = r->conditions,
            .steps = r->steps,
            .shots = r->shots,
            .seconds = r->seconds,
            .bytes = r->bytes,
            .disk_free_bytes = r->disk_free_bytes,
            .dark_noise_share = r->dark_noise_share,
            .energy_j = r->energy_j,
            .peak_current_a = r->peak_current_a,
            .led_duty = r->led_duty,
            .bracket = r->bracket,
            .warnings = r->warnings,
        };
    return preflight;
}

uint32_t lightstage_preflight(struct lightstage *stage, const char *plan,
                              struct lightstage_preflight **out, struct lightstage_error *error)
{
    Lightstage__Preflight body = LIGHTSTAGE__PREFLIGHT__INIT;
    return ls_library_ask(stage, LS_MESSAGE_PREFLIGHT, &body.base, plan, strlen(plan),
                          make_preflight, out, error);
}

void lightstage_preflight_free(struct lightstage_preflight *preflight)
{
    ls_library_release(preflight);
}

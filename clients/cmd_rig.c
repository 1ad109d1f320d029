#include "clients/command.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

struct rig {
    const Lightstage__RigReply *reply;
    const uint8_t *positions; /* float32 [n_lights][3] */
};

static void position(const struct rig *rig, uint32_t light, float out[3])
{
    memcpy(out, rig->positions + (size_t)light * 3 * sizeof(float), 3 * sizeof(float));
}

static json_t *vector(const float *v, size_t n)
{
    json_t *out = json_array();
    for (size_t i = 0; i < n; i++)
        json_array_append_new(out, json_real((double)v[i]));
    return out;
}

static void print_json(const struct rig *rig)
{
    json_t *lights = json_array(), *channels = json_array(), *cameras = json_array();
    for (uint32_t i = 0; i < rig->reply->n_lights; i++) {
        float p[3];
        position(rig, i, p);
        json_array_append_new(lights, vector(p, 3));
    }
    for (size_t i = 0; i < rig->reply->n_channels; i++)
        json_array_append_new(channels,
                              json_pack("{ss ss}", "name", rig->reply->channels[i]->name, "kind",
                                        rig->reply->channels[i]->polariser ? "polariser"
                                                                           : "spectrum"));
    for (size_t i = 0; i < rig->reply->n_cameras; i++) {
        const Lightstage__RigCamera *c = rig->reply->cameras[i];
        json_array_append_new(
            cameras, json_pack("{ss so so sf sf sf}", "name", c->name, "position_m",
                               vector(c->position_m, c->n_position_m), "look_at_m",
                               vector(c->look_at_m, c->n_look_at_m), "focal_length_mm",
                               (double)c->focal_length_mm, "sensor_width_mm",
                               (double)c->sensor_width_mm, "sensor_height_mm",
                               (double)c->sensor_height_mm));
    }
    ls_command_print_json(json_pack("{ss so so so}", "name", rig->reply->name, "lights_m", lights,
                                    "channels", channels, "cameras", cameras));
}

static void print_text(const struct rig *rig)
{
    float nearest = INFINITY, farthest = 0;
    for (uint32_t i = 0; i < rig->reply->n_lights; i++) {
        float p[3];
        position(rig, i, p);
        float d = sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        nearest = fminf(nearest, d);
        farthest = fmaxf(farthest, d);
    }
    printf("rig       %s\nlights    %u, %.2f to %.2f m from the centre\nchannels ",
           ls_clean(rig->reply->name), rig->reply->n_lights, (double)nearest, (double)farthest);
    for (size_t i = 0; i < rig->reply->n_channels; i++)
        printf(" %s%s", ls_clean(rig->reply->channels[i]->name),
               rig->reply->channels[i]->polariser ? " (polarised)" : "");
    putchar('\n');
    for (size_t i = 0; i < rig->reply->n_cameras; i++)
        printf("camera    %s, %g mm\n", ls_clean(rig->reply->cameras[i]->name),
               (double)rig->reply->cameras[i]->focal_length_mm);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    Lightstage__Rig body = LIGHTSTAGE__RIG__INIT;
    struct ls_reply reply;
    if (ls_command_option(context, &ls_command_rig, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_rig, argc, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_call(context, LS_MESSAGE_RIG, &body.base, NULL, 0, &reply);
    if (code)
        return code;
    struct rig rig = {(const Lightstage__RigReply *)reply.message, reply.payload};
    if (reply.payload_bytes < (size_t)rig.reply->n_lights * 3 * sizeof(float)) {
        ls_fail(&context->diag, LS_ERR_INVALID, "the daemon sent too few positions");
        code = ls_command_failed(context, LS_ERR_GONE);
    } else if (context->json) {
        print_json(&rig);
    } else {
        print_text(&rig);
    }
    ls_reply_finish(&reply);
    return code;
}

const struct ls_command ls_command_rig = {"rig", "Lights, channels and cameras as configured",
                                          "[--json]", run};

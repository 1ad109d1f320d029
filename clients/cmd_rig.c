#include "clients/command.h"

#include <math.h>
#include <stdio.h>

static json_t *vector(const float v[3])
{
    json_t *out = json_array();
    for (size_t i = 0; i < 3; i++)
        json_array_append_new(out, json_real((double)v[i]));
    return out;
}

static void print_json(const struct lightstage_rig *rig)
{
    json_t *lights = json_array(), *channels = json_array(), *cameras = json_array();
    for (size_t i = 0; i < rig->n_lights; i++)
        json_array_append_new(lights, vector(rig->positions_m + 3 * i));
    for (size_t i = 0; i < rig->n_channels; i++)
        json_array_append_new(channels,
                              json_pack("{ss ss}", "name", rig->channels[i]->name, "kind",
                                        rig->channels[i]->polariser ? "polariser" : "spectrum"));
    for (size_t i = 0; i < rig->n_cameras; i++) {
        const struct lightstage_rig_camera *c = rig->cameras[i];
        json_array_append_new(cameras,
                              json_pack("{ss so so sf sf sf}", "name", c->name, "position_m",
                                        vector(c->position_m), "look_at_m", vector(c->look_at_m),
                                        "focal_length_mm", (double)c->focal_length_mm,
                                        "sensor_width_mm", (double)c->sensor_width_mm,
                                        "sensor_height_mm", (double)c->sensor_height_mm));
    }
    ls_command_print_json(json_pack("{ss so so so}", "name", rig->name, "lights_m", lights,
                                    "channels", channels, "cameras", cameras));
}

static void print_text(const struct lightstage_rig *rig)
{
    float nearest = INFINITY, farthest = 0;
    for (size_t i = 0; i < rig->n_lights; i++) {
        const float *p = rig->positions_m + 3 * i;
        float d = sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        nearest = fminf(nearest, d);
        farthest = fmaxf(farthest, d);
    }
    ls_say("rig       %s\nlights    %u, %.2f to %.2f m from the centre\nchannels ", rig->name,
           rig->n_lights, (double)nearest, (double)farthest);
    for (size_t i = 0; i < rig->n_channels; i++)
        ls_say(" %s%s", rig->channels[i]->name, rig->channels[i]->polariser ? " (polarised)" : "");
    putchar('\n');
    for (size_t i = 0; i < rig->n_cameras; i++)
        ls_say("camera    %s, %g mm\n", rig->cameras[i]->name,
               (double)rig->cameras[i]->focal_length_mm);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    struct lightstage_rig *rig = NULL;
    if (ls_command_option(context, &ls_command_rig, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_rig, argc, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context, lightstage_rig(context->stage, &rig, &context->error));
    if (!code && context->json)
        print_json(rig);
    else if (!code)
        print_text(rig);
    lightstage_rig_free(rig);
    return code;
}

const struct ls_command ls_command_rig = {"rig", "Lights, channels and cameras as configured",
                                          "[--json]", run};

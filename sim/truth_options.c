#include "sim/truth_options.h"

#include <stdlib.h>
#include <string.h>

/* A number at *text, which is moved behind it; -1 if there is none. */
static long whole(const char **text)
{
    char *end;
    long value = **text >= '0' && **text <= '9' ? strtol(*text, &end, 10) : -1;
    if (value >= 0)
        *text = end;
    return value;
}

static enum ls_err bad(struct ls_diag *diag, const char *option, const char *expected,
                       const char *found)
{
    return ls_fail(diag, LS_ERR_INVALID, "%s: expected %s, found \"%s\"", option, expected, found);
}

static enum ls_err lights(const struct sim_scene *scene, const char *text,
                          struct sim_truth_options *o, struct ls_diag *diag)
{
    long most = sim_scene_geometry(scene)->n_lights;
    o->n_lights = 0;
    for (const char *at = text;; at++) {
        long first = whole(&at), last = first;
        if (*at == '-') {
            at++;
            last = whole(&at);
        }
        if (first < 0 || last < first || last >= most || (*at && *at != ','))
            return bad(diag, "--lights", "numbers and ranges of lights the rig has", text);
        for (long i = first; i <= last && o->n_lights < SIM_MAX_LIGHTS; i++)
            o->lights[o->n_lights++] = (uint32_t)i;
        if (!*at)
            return LS_OK;
    }
}

static int channel_index(const struct sim_scene_config *config, const char *name, size_t length)
{
    for (uint32_t s = 0; s < config->n_channels; s++)
        if (strlen(config->channels[s].name) == length &&
            !strncmp(config->channels[s].name, name, length))
            return (int)s;
    return -1;
}

static enum ls_err channels(const struct sim_scene *scene, const char *text,
                            struct sim_truth_options *o, struct ls_diag *diag)
{
    o->n_channels = 0;
    for (const char *at = text; o->n_channels < SIM_MAX_CHANNELS;) {
        size_t length = strcspn(at, ",");
        int index = channel_index(sim_scene_config(scene), at, length);
        if (index < 0)
            return bad(diag, "--channels", "names of channels the rig has", text);
        o->channels[o->n_channels++] = (uint32_t)index;
        if (!at[length])
            return LS_OK;
        at += length + 1;
    }
    return bad(diag, "--channels", "each channel once", text);
}

static enum ls_err duties(const char *text, struct sim_truth_options *o, struct ls_diag *diag)
{
    o->n_duties = 0;
    for (const char *at = text; o->n_duties < SIM_MAX_DUTIES; at++) {
        char *end;
        double duty = strtod(at, &end);
        if (end == at || !(duty > 0 && duty <= 1) || (*end && *end != ','))
            break;
        o->duties[o->n_duties++] = duty;
        if (!*end)
            return LS_OK;
        at = end;
    }
    return bad(diag, "--duty", "numbers in (0, 1], at most 64", text);
}

static enum ls_err region(const char *text, struct sim_truth_options *o, struct ls_diag *diag)
{
    long v[4];
    const char *at = text;
    for (int k = 0; k < 4; k++) {
        v[k] = whole(&at);
        if (v[k] < 0 || *at != (k < 3 ? ',' : 0))
            return bad(diag, "--region", "x,y,width,height", text);
        at += k < 3;
    }
    o->region = (struct sim_region){o->region.camera, (uint32_t)v[0], (uint32_t)v[1],
                                    (uint32_t)v[2], (uint32_t)v[3]};
    return LS_OK;
}

static enum ls_err camera(const struct sim_scene *scene, const char *text,
                          struct sim_truth_options *o, struct ls_diag *diag)
{
    const char *at = text;
    long index = whole(&at);
    if (index < 0 || *at || index >= sim_scene_config(scene)->n_cameras)
        return bad(diag, "--camera", "the index of a camera", text);
    o->region.camera = (uint32_t)index;
    return LS_OK;
}

static enum ls_err option(const struct sim_scene *scene, const char *name, const char *value,
                          struct sim_truth_options *o, struct ls_diag *diag)
{
    if (!strcmp(name, "--config"))
        return LS_OK;
    if (!strcmp(name, "--output"))
        o->output = value;
    else if (!strcmp(name, "--weights"))
        o->weights = value;
    else if (!strcmp(name, "--lobes"))
        o->lobes = value;
    else if (!strcmp(name, "--pixel-format"))
        o->pixel_format = value;
    else if (!strcmp(name, "--lights"))
        return lights(scene, value, o, diag);
    else if (!strcmp(name, "--channels"))
        return channels(scene, value, o, diag);
    else if (!strcmp(name, "--duty"))
        return duties(value, o, diag);
    else if (!strcmp(name, "--region"))
        return region(value, o, diag);
    else if (!strcmp(name, "--camera"))
        return camera(scene, value, o, diag);
    else
        return ls_fail(diag, LS_ERR_INVALID, "%s: unknown option", name);
    return LS_OK;
}

static enum ls_err complete(const struct sim_scene *scene, unsigned needs,
                            struct sim_truth_options *o, struct ls_diag *diag)
{
    static const struct {
        const char *cfa, *format;
    } formats[] = {{"mono", "Mono12"},   {"RG", "BayerRG12"}, {"GR", "BayerGR12"},
                   {"GB", "BayerGB12"}, {"BG", "BayerBG12"}};
    const struct {
        unsigned need;
        const char *name;
        int given;
    } required[] = {{SIM_NEED_OUTPUT, "--output", o->output != NULL},
                    {SIM_NEED_LIGHTS, "--lights", o->n_lights > 0},
                    {SIM_NEED_CHANNELS, "--channels", o->n_channels > 0},
                    {SIM_NEED_WEIGHTS, "--weights", o->weights != NULL},
                    {SIM_NEED_LOBES, "--lobes", o->lobes != NULL}};
    const struct sim_view_config *view = &sim_scene_config(scene)->views[o->region.camera];
    for (size_t i = 0; i < sizeof required / sizeof *required; i++)
        if (needs & required[i].need && !required[i].given)
            return ls_fail(diag, LS_ERR_INVALID, "%s is missing", required[i].name);
    for (size_t i = 0; !o->pixel_format && i < sizeof formats / sizeof *formats; i++)
        if (!strcmp(view->cfa, formats[i].cfa))
            o->pixel_format = formats[i].format;
    if (!o->region.width) {
        o->region.width = view->width;
        o->region.height = view->height;
    }
    return LS_OK;
}

enum ls_err sim_truth_options_parse(const struct sim_scene *scene, int argc, char **argv,
                                    unsigned needs, struct sim_truth_options *out,
                                    struct ls_diag *diag)
{
    static const double usual[] = {1, 0.5, 0.25, 0.1, 0.05, 0.02, 728.0 / 65535, 0.01, 0.005};
    *out = (struct sim_truth_options){.n_duties = sizeof usual / sizeof *usual};
    memcpy(out->duties, usual, sizeof usual);
    enum ls_err err = LS_OK;
    for (int i = 1; i < argc && !err; i++) {
        if (!strcmp(argv[i], "--mosaic"))
            out->mosaic = 1;
        else if (i + 1 == argc)
            return ls_fail(diag, LS_ERR_INVALID, "%s: expected a value, or unknown", argv[i]);
        else {
            err = option(scene, argv[i], argv[i + 1], out, diag);
            i++;
        }
    }
    return err ? err : complete(scene, needs, out, diag);
}

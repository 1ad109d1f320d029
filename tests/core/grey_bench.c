#include "tests/core/grey_bench.h"

#include "core/pixel.h"
#include "core/vec3.h"

#include <glib.h>
#include <math.h>
#include <string.h>

/* Pictures in the order of the rig's conditions. */
static uint32_t pictures_of(const struct grey_rig *rig)
{
    return rig->n_channels * (rig->n_lights + 1 + GREY_GROUPS);
}

struct grey_bench *grey_bench_new(const struct grey_rig_options *options)
{
    struct grey_bench *b = g_new0(struct grey_bench, 1);
    b->rig = grey_rig_create(options, grey_sphere_duty, GREY_GROUPS, grey_group_duty);
    b->n_pictures = pictures_of(b->rig);
    b->photographs = g_malloc0_n((gsize)b->n_pictures * options->n_cameras, sizeof *b->photographs);
    return b;
}

void grey_bench_free(struct grey_bench *b)
{
    for (uint32_t k = 0; k < b->n_pictures * b->rig->options.n_cameras; k++) {
        g_free(b->photographs[k].e);
        g_free(b->photographs[k].validity);
    }
    g_free(b->photographs);
    grey_rig_destroy(b->rig);
    g_free(b);
}

static enum ls_cfa cfa_of(const struct grey_bench *b)
{
    return strcmp(b->rig->options.cfa, "mono") ? LS_CFA_RGGB : LS_CFA_NONE;
}

static void tint(const struct grey_bench *b, uint32_t light, float *e)
{
    for (uint32_t p = 0; p < b->rig->n_pixels; p++) {
        uint32_t x = p % b->rig->options.size_px, y = p / b->rig->options.size_px;
        e[p] *= (float)b->tint[light][ls_cfa_channel(LS_CFA_RGGB, x, y)];
    }
}

struct reading {
    struct grey_bench *bench;
    const struct ls_lit_picture *first;
};

static enum ls_err read_pictures(void *user, uint32_t camera,
                                 const struct ls_lit_picture *const *pictures, uint32_t n,
                                 const struct ls_outline *around, ls_lit_use *use, void *use_user,
                                 struct ls_diag *diag)
{
    const struct reading *r = user;
    const struct grey_bench *b = r->bench;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < n && !err; k++) {
        uint32_t condition = (uint32_t)(pictures[k] - r->first);
        size_t at = (size_t)condition * b->rig->options.n_cameras + camera;
        if (!b->photographs[at].e) {
            b->photographs[at].e = g_new(float, b->rig->n_pixels);
            b->photographs[at].validity = g_new(uint8_t, b->rig->n_pixels);
            grey_rig_picture(b->rig, camera, condition, b->photographs[at].e,
                             b->photographs[at].validity);
            if (b->tint && pictures[k]->light >= 0)
                tint(b, (uint32_t)pictures[k]->light, b->photographs[at].e);
        }
        err = use(use_user, pictures[k], b->photographs[at].e, b->photographs[at].validity, diag);
    }
    return err;
}

/* Where the rig file says a light is: turned by misplaced_deg in a direction of its own. */
static void believed(const struct grey_bench *b, uint32_t light, float position[3])
{
    double d[3], e1[3], e2[3], angle = light * 2.399963, turn = b->misplaced_deg * M_PI / 180;
    grey_rig_position(b->rig, light, d);
    double distance = ls_unit3(d);
    ls_tangents(d, e1, e2);
    ls_along3(d, e1, turn * cos(angle), d);
    ls_along3(d, e2, turn * sin(angle), d);
    ls_unit3(d);
    for (int k = 0; k < 3; k++)
        position[k] = (float)(distance * d[k]);
}

static struct ls_lit_picture *list_pictures(const struct grey_bench *b)
{
    const struct grey_rig *rig = b->rig;
    struct ls_lit_picture *pictures = g_new0(struct ls_lit_picture, b->n_pictures);
    for (uint32_t c = 0; c < rig->n_channels; c++) {
        for (uint32_t i = 0; i < rig->n_lights; i++)
            pictures[grey_rig_light(rig, c, i)] =
                (struct ls_lit_picture){.channel = c, .light = (int32_t)i, .duty = 1};
        for (uint32_t g = 0; g <= GREY_GROUPS; g++) {
            bool full = g == GREY_GROUPS;
            struct ls_lit_picture *p =
                &pictures[full ? grey_rig_full(rig, c) : grey_rig_group(rig, c, g, GREY_GROUPS)];
            *p = (struct ls_lit_picture){.channel = c,
                                         .light = -1,
                                         .duty = full ? grey_sphere_duty : grey_group_duty,
                                         .weights = g_new0(float, rig->n_lights)};
            g_strlcpy(p->pattern, full ? "sphere" : "segments-14", sizeof p->pattern);
            for (uint32_t i = 0; i < rig->n_lights; i++)
                p->weights[i] = full || i % GREY_GROUPS == g;
        }
    }
    return pictures;
}

/* The sphere is looked for from two centimetres beside it. */
static void describe(const struct grey_bench *b, struct ls_grey_rig *out)
{
    const struct grey_rig *rig = b->rig;
    *out = (struct ls_grey_rig){.n_lights = rig->n_lights,
                                .n_channels = rig->n_channels,
                                .n_cameras = rig->options.n_cameras,
                                .n_pictures = b->n_pictures,
                                .nominal = rig->sphere,
                                .reflectance = grey_reflectance};
    out->nominal.centre_m[0] += 0.015;
    out->nominal.centre_m[1] -= 0.012;
    for (uint32_t c = 0; c < rig->n_channels; c++) {
        const struct sim_channel_config *channel = &sim_scene_config(rig->scene)->channels[c];
        out->channels[c].name = channel->name;
        out->channels[c].spectrum = !strchr("VH", channel->name[0]);
    }
    for (uint32_t k = 0; k < rig->options.n_cameras; k++) {
        out->cameras[k].pinhole = rig->camera[k];
        out->cameras[k].cfa = cfa_of(b);
    }
}

struct ls_grey *grey_bench_measure(struct grey_bench *b)
{
    struct ls_grey_rig rig;
    struct ls_grey *grey = NULL;
    struct ls_diag diag = {{0}};
    float(*position)[3] = g_malloc0_n(b->rig->n_lights, sizeof *position);
    struct ls_lit_picture *pictures = list_pictures(b);
    struct reading reading = {b, pictures};
    const struct ls_grey_source source = {read_pictures, &reading};
    describe(b, &rig);
    for (uint32_t i = 0; i < b->rig->n_lights; i++)
        believed(b, i, position[i]);
    rig.position_m = (const float(*)[3])position;
    rig.pictures = pictures;
    enum ls_err err = ls_grey_measure(&rig, &source, &grey, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (uint32_t k = 0; k < grey->n_cameras; k++) {
        const double *at = grey->cameras[k].sphere.centre_m;
        g_test_message("camera %u: sphere off by %.3f %.3f %.3f mm", k, 1e3 * at[0], 1e3 * at[1],
                       1e3 * at[2]);
    }
    g_test_message("lights stand %.3f degrees off, chi2 %.2f", grey->settled.spread_deg,
                   grey->settled.chi2);
    for (uint32_t k = 0; k < b->n_pictures; k++)
        g_free(pictures[k].weights);
    g_free(pictures);
    g_free(position);
    return grey;
}

static double factor(const struct grey_bench *b, uint32_t channel, uint32_t lit, double duty)
{
    return sim_scene_droop(b->rig->scene, channel, lit) * duty /
           sim_scene_quantise(b->rig->scene, duty);
}

double grey_bench_sphere_factor(const struct grey_bench *b, uint32_t channel)
{
    return factor(b, channel, b->rig->n_lights, grey_sphere_duty);
}

double grey_bench_group_factor(const struct grey_bench *b, uint32_t channel)
{
    double sum = 0;
    for (uint32_t g = 0; g < GREY_GROUPS; g++)
        sum += factor(b, channel,
                      b->rig->n_lights / GREY_GROUPS + (g < b->rig->n_lights % GREY_GROUPS),
                      grey_group_duty);
    return sum / GREY_GROUPS;
}

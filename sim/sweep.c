#include "sim/sweep.h"

#include "sim/world.h"

#include <stdlib.h>
#include <string.h>

enum { OWN_COLOUR = -1 };

struct sim_sweep {
    const struct sim_scene *scene;
    uint32_t camera, n, reference;          /* colour in which the specular share is taken */
    uint32_t channel[SIM_MAX_CHANNELS + 1]; /* the last one is white, for the specular share */
    float *nodes;                           /* [light][channel, n + 1][node * colours] */
};

struct tile {
    struct sim_tile seen;
    uint32_t dx, dy; /* in the region and the blur's reach around it */
    struct {         /* by colour, or of each pixel's own */
        float a[3][SIM_TILE_PX], b[3][SIM_TILE_PX];
    } source[SIM_MAX_CHANNELS + 1];
};

struct sim_sweep_region {
    const struct sim_sweep *sweep;
    struct sim_region at;
    uint32_t n_tiles, n_planes; /* colours in which a channel is seen before the blur */
    struct tile *tiles;
    struct sim_planes channel[SIM_MAX_CHANNELS]; /* before the blur */
    struct sim_planes reference;                 /* white: specular, all */
    float *room;                                 /* of these, then a plane */
    struct sim_terms terms;
};

static uint32_t colours(const struct sim_sweep *s)
{
    return s->scene->colours[s->camera];
}

static float *nodes_of(const struct sim_sweep *s, uint32_t light, uint32_t channel)
{
    size_t nodes = (size_t)s->scene->subject.n_nodes * colours(s);
    return s->nodes + ((size_t)light * (s->n + 1) + channel) * nodes;
}

static enum ls_err bounce_all(struct sim_sweep *s)
{
    const struct sim_scene *scene = s->scene;
    size_t nodes = (size_t)scene->subject.n_nodes * colours(s);
    s->nodes = calloc((size_t)scene->geometry.n_lights * (s->n + 1) * nodes + 1, sizeof *s->nodes);
    if (!s->nodes)
        return LS_ERR_NOMEM;
    for (uint32_t i = 0; nodes && i < scene->geometry.n_lights; i++)
        for (uint32_t k = 0; k <= s->n; k++)
            sim_bounce_add(&scene->bounce, &scene->subject, &scene->response[s->camera], i,
                           s->channel[k], 1, nodes_of(s, i, k));
    return LS_OK;
}

static enum ls_err check(const struct sim_scene *scene, uint32_t camera, const uint32_t *channels,
                         uint32_t n, struct ls_diag *diag)
{
    if (scene->kind != SIM_WORLD_TRACED)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "only a traced scene can be swept");
    if (camera >= scene->config.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the scene has %u", camera,
                       scene->config.n_cameras);
    if (n > SIM_MAX_CHANNELS)
        return ls_fail(diag, LS_ERR_INVALID, "%u channels: expected at most %d", n,
                       SIM_MAX_CHANNELS);
    for (uint32_t k = 0; k < n; k++)
        if (channels[k] >= scene->config.n_channels)
            return ls_fail(diag, LS_ERR_INVALID, "channel %u: the scene has %u", channels[k],
                           scene->config.n_channels);
    return LS_OK;
}

enum ls_err sim_sweep_create(const struct sim_scene *scene, uint32_t camera,
                             const uint32_t *channels, uint32_t n, struct sim_sweep **out,
                             struct ls_diag *diag)
{
    enum ls_err err = check(scene, camera, channels, n, diag);
    if (err)
        return err;
    struct sim_sweep *s = calloc(1, sizeof *s);
    if (!s)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a sweep");
    *s = (struct sim_sweep){.scene = scene, .camera = camera, .n = n};
    for (uint32_t k = 0; k < n; k++)
        s->channel[k] = channels[k];
    s->channel[n] = 0;
    s->reference = colours(s) == 3 ? 1 : 0;
    if (bounce_all(s)) {
        sim_sweep_destroy(s);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the bounced light of every light");
    }
    *out = s;
    return LS_OK;
}

void sim_sweep_destroy(struct sim_sweep *sweep)
{
    if (!sweep)
        return;
    free(sweep->nodes);
    free(sweep);
}

static const struct sim_blur *blur_of(const struct sim_sweep *s)
{
    return &s->scene->view[s->camera].blur;
}

static int colour_of(const struct sim_sweep_region *r, uint32_t plane)
{
    return r->n_planes == 1 ? OWN_COLOUR : (int)plane;
}

static void prepare_tile(const struct sim_sweep_region *r, uint32_t dx, uint32_t dy,
                         struct tile *tile)
{
    const struct sim_sweep *s = r->sweep;
    const struct sim_scene *scene = s->scene;
    const struct sim_response *response = &scene->response[s->camera];
    uint32_t reach = blur_of(s)->reach, n = s->n;
    uint32_t w = r->reference.width - dx, h = r->reference.height - dy;
    tile->dx = dx;
    tile->dy = dy;
    sim_tile_prepare(&scene->subject, &scene->view[s->camera], (int32_t)(r->at.x + dx - reach),
                     (int32_t)(r->at.y + dy - reach), w < SIM_TILE ? w : SIM_TILE,
                     h < SIM_TILE ? h : SIM_TILE, &tile->seen);
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t c = 0; c < r->n_planes; c++)
            sim_tile_factors(&tile->seen, response, s->channel[k], colour_of(r, c),
                             tile->source[k].a[c], tile->source[k].b[c]);
    sim_tile_factors(&tile->seen, response, s->channel[n], (int)s->reference, tile->source[n].a[0],
                     tile->source[n].b[0]);
}

/* Planes of every channel and of the reference, and a plane of the region's own size. */
static enum ls_err allocate(struct sim_sweep_region *r)
{
    uint32_t reach = blur_of(r->sweep)->reach, n = r->sweep->n;
    uint32_t width = r->at.width + 2 * reach, height = r->at.height + 2 * reach;
    size_t plane = (size_t)width * height;
    r->n_planes = reach ? colours(r->sweep) : 1;
    r->n_tiles = (width + SIM_TILE - 1) / SIM_TILE * ((height + SIM_TILE - 1) / SIM_TILE);
    r->room = malloc((n * r->n_planes + 3) * plane * sizeof *r->room);
    r->tiles = calloc(r->n_tiles, sizeof *r->tiles);
    if (!r->room || !r->tiles)
        return LS_ERR_NOMEM;
    for (uint32_t k = 0; k < n; k++)
        r->channel[k] = (struct sim_planes){r->room + (2 + k * r->n_planes) * plane, r->n_planes,
                                            width, height};
    r->reference = (struct sim_planes){r->room, 2, width, height};
    return LS_OK;
}

enum ls_err sim_sweep_open(const struct sim_sweep *sweep, const struct sim_region *region,
                           struct sim_sweep_region **out, struct ls_diag *diag)
{
    enum ls_err err = sim_truth_check(sweep->scene, region, diag);
    if (err)
        return err;
    struct sim_sweep_region *r = calloc(1, sizeof *r);
    if (r)
        *r = (struct sim_sweep_region){.sweep = sweep, .at = *region};
    if (!r || allocate(r)) {
        sim_sweep_close(r);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the truth of %u x %u pixels",
                       region->width, region->height);
    }
    uint32_t tiles_x = (r->reference.width + SIM_TILE - 1) / SIM_TILE;
    for (uint32_t i = 0; i < r->n_tiles; i++)
        prepare_tile(r, i % tiles_x * SIM_TILE, i / tiles_x * SIM_TILE, &r->tiles[i]);
    *out = r;
    return LS_OK;
}

void sim_sweep_close(struct sim_sweep_region *region)
{
    if (!region)
        return;
    free(region->tiles);
    free(region->room);
    free(region);
}

/* A tile's values into their place in a plane. */
static void put(const struct tile *tile, const float *value, const struct sim_planes *planes,
                uint32_t k)
{
    sim_planes_put(planes, k, tile->dx, tile->dy, tile->seen.width, tile->seen.height, value);
}

/* The radiance of a channel at every pixel of a tile: in every colour, or in @colour alone. */
static void shine(const struct sim_sweep_region *r, const struct tile *tile, uint32_t light,
                  uint32_t k, uint32_t n_planes, int colour, int reached,
                  float value[3][SIM_TILE_PX])
{
    const struct sim_sweep *s = r->sweep;
    const struct sim_response *response = &s->scene->response[s->camera];
    uint32_t channel = s->channel[k];
    memset(value, 0, n_planes * sizeof *value);
    for (uint32_t c = 0; reached && c < n_planes; c++)
        sim_tile_add(&r->terms, response->kind[channel], response->diffuse[channel],
                     tile->source[k].a[c], tile->source[k].b[c], 1, value[c]);
    if (!s->scene->subject.n_nodes || !tile->seen.n_seen)
        return;
    if (n_planes == 3)
        sim_tile_bounce_rgb(&tile->seen, nodes_of(s, light, k), value);
    else
        sim_tile_bounce(&tile->seen, nodes_of(s, light, k), colours(s), colour, value[0]);
}

/* White in the reference colour: what is specular, and all. */
static void shine_reference(const struct sim_sweep_region *r, const struct tile *tile,
                            uint32_t light, int reached)
{
    const struct sim_sweep *s = r->sweep;
    uint32_t n = s->n;
    float value[3][SIM_TILE_PX] = {{0}};
    if (reached && tile->seen.has_specular)
        sim_tile_add(&r->terms, s->scene->response[s->camera].kind[s->channel[n]], 0,
                     tile->source[n].a[0], tile->source[n].b[0], 1, value[0]);
    put(tile, value[0], &r->reference, 0);
    shine(r, tile, light, n, 1, (int)s->reference, reached, value);
    put(tile, value[0], &r->reference, 1);
}

static void light_tile(struct sim_sweep_region *r, const struct tile *tile, uint32_t light)
{
    const struct sim_scene *scene = r->sweep->scene;
    float value[3][SIM_TILE_PX];
    int reached = tile->seen.n_seen &&
                  sim_tile_shade(&scene->subject, &scene->geometry, &tile->seen, light, &r->terms);
    shine_reference(r, tile, light, reached);
    for (uint32_t k = 0; k < r->sweep->n; k++) {
        shine(r, tile, light, k, r->n_planes, OWN_COLOUR, reached, value);
        for (uint32_t c = 0; c < r->n_planes; c++)
            put(tile, value[c], &r->channel[k], c);
    }
}

void sim_sweep_light(struct sim_sweep_region *r, uint32_t light, float *mosaic, float *specular)
{
    const struct sim_sweep *s = r->sweep;
    const struct sim_view *view = &s->scene->view[s->camera];
    size_t plane = (size_t)r->at.width * r->at.height;
    float *all =
        r->room + (size_t)(2 + s->n * r->n_planes) * r->reference.width * r->reference.height;
    for (uint32_t i = 0; i < r->n_tiles; i++)
        light_tile(r, &r->tiles[i], light);
    sim_blur_plane(&view->blur, &r->reference, 0, specular);
    sim_blur_plane(&view->blur, &r->reference, 1, all);
    for (size_t j = 0; j < plane; j++)
        specular[j] = all[j] > 0 ? specular[j] / all[j] : 0;
    for (uint32_t k = 0; k < s->n; k++)
        sim_blur_mosaic(&view->blur, &r->channel[k], view->cfa, r->at.x, r->at.y,
                        mosaic + k * plane);
}

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
    float a[SIM_MAX_CHANNELS + 1][SIM_TILE_PX], b[SIM_MAX_CHANNELS + 1][SIM_TILE_PX];
};

struct sim_sweep_region {
    const struct sim_sweep *sweep;
    struct sim_region at;
    uint32_t n_tiles;
    struct tile *tiles;
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

static void prepare_tile(const struct sim_sweep *s, const struct sim_region *r, uint32_t dx,
                         uint32_t dy, struct tile *tile)
{
    const struct sim_scene *scene = s->scene;
    uint32_t w = r->width - dx < SIM_TILE ? r->width - dx : SIM_TILE;
    uint32_t h = r->height - dy < SIM_TILE ? r->height - dy : SIM_TILE;
    sim_tile_prepare(&scene->subject, &scene->view[s->camera], r->x + dx, r->y + dy, w, h,
                     &tile->seen);
    for (uint32_t k = 0; k <= s->n; k++)
        sim_tile_factors(&tile->seen, &scene->response[s->camera], s->channel[k],
                         k < s->n ? OWN_COLOUR : (int)s->reference, tile->a[k], tile->b[k]);
}

enum ls_err sim_sweep_open(const struct sim_sweep *sweep, const struct sim_region *region,
                           struct sim_sweep_region **out, struct ls_diag *diag)
{
    enum ls_err err = sim_truth_check(sweep->scene, region, diag);
    if (err)
        return err;
    uint32_t tiles_x = (region->width + SIM_TILE - 1) / SIM_TILE;
    uint32_t tiles_y = (region->height + SIM_TILE - 1) / SIM_TILE;
    struct sim_sweep_region *r = calloc(1, sizeof *r);
    struct tile *tiles = calloc((size_t)tiles_x * tiles_y, sizeof *tiles);
    if (!r || !tiles) {
        free(r);
        free(tiles);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the truth of %u x %u pixels",
                       region->width, region->height);
    }
    *r = (struct sim_sweep_region){
        .sweep = sweep, .at = *region, .n_tiles = tiles_x * tiles_y, .tiles = tiles};
    for (uint32_t i = 0; i < r->n_tiles; i++)
        prepare_tile(sweep, region, i % tiles_x * SIM_TILE, i / tiles_x * SIM_TILE, &tiles[i]);
    *out = r;
    return LS_OK;
}

void sim_sweep_close(struct sim_sweep_region *region)
{
    if (!region)
        return;
    free(region->tiles);
    free(region);
}

/* A tile's values into their place in a plane of the region. */
static void place(const struct sim_sweep_region *r, const struct sim_tile *tile, const float *value,
                  float *plane)
{
    for (uint32_t row = 0; row < tile->height; row++)
        memcpy(plane + (size_t)(tile->y - r->at.y + row) * r->at.width + (tile->x - r->at.x),
               value + row * tile->width, tile->width * sizeof *value);
}

/* The radiance of a channel at every pixel of a tile. */
static void shine(const struct sim_sweep_region *r, const struct tile *tile, uint32_t light,
                  uint32_t k, int colour, int reached, float *value)
{
    const struct sim_sweep *s = r->sweep;
    const struct sim_response *response = &s->scene->response[s->camera];
    uint32_t channel = s->channel[k];
    memset(value, 0, SIM_TILE_PX * sizeof *value);
    if (reached)
        sim_tile_add(&r->terms, response->kind[channel], response->diffuse[channel], tile->a[k],
                     tile->b[k], 1, value);
    if (s->scene->subject.n_nodes && tile->seen.n_seen)
        sim_tile_bounce(&tile->seen, nodes_of(s, light, k), colours(s), colour, value);
}

static void share_specular(const struct sim_sweep_region *r, const struct tile *tile,
                           uint32_t light, float *value)
{
    const struct sim_sweep *s = r->sweep;
    float all[SIM_TILE_PX];
    memset(value, 0, SIM_TILE_PX * sizeof *value);
    sim_tile_add(&r->terms, s->scene->response[s->camera].kind[s->channel[s->n]], 0, tile->a[s->n],
                 tile->b[s->n], 1, value);
    shine(r, tile, light, s->n, (int)s->reference, 1, all);
    for (uint32_t k = 0; k < tile->seen.n; k++)
        value[k] = all[k] > 0 ? value[k] / all[k] : 0;
}

void sim_sweep_light(struct sim_sweep_region *r, uint32_t light, float *mosaic, float *specular)
{
    const struct sim_scene *scene = r->sweep->scene;
    size_t plane = (size_t)r->at.width * r->at.height;
    for (uint32_t i = 0; i < r->n_tiles; i++) {
        const struct tile *tile = &r->tiles[i];
        float value[SIM_TILE_PX] = {0};
        int reached = tile->seen.n_seen && sim_tile_shade(&scene->subject, &scene->geometry,
                                                          &tile->seen, light, &r->terms);
        if (reached && tile->seen.has_specular)
            share_specular(r, tile, light, value);
        place(r, &tile->seen, value, specular);
        for (uint32_t k = 0; k < r->sweep->n; k++) {
            shine(r, tile, light, k, OWN_COLOUR, reached, value);
            place(r, &tile->seen, value, mosaic + k * plane);
        }
    }
}

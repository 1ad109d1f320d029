#include "sim/truth.h"

#include "sim/world.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

/* A part of the radiance that is wanted beside the whole. */
enum part {
    PART_NONE,
    PART_SPECULAR,
    PART_BOUNCED,
};

/* Sums over lights and sources: out[picture][y][x][colour] += weight x radiance. */
struct sums {
    const struct sim_scene *scene;
    const struct sim_region *region;
    const struct sim_response *response;
    const float *weights; /* [picture][source][light] */
    uint32_t n_pictures;
    enum part part;
    float *out, *some;                /* of the whole, of the part */
    struct sim_planes whole, portion; /* the same before the blur, [picture][colour] */
    float *nodes;                     /* [picture][node * colours] */
    uint32_t tiles_x, n_tiles;
    _Atomic uint32_t next_tile;
    _Atomic int failed;
};

uint32_t sim_truth_colours(const struct sim_scene *scene, uint32_t camera)
{
    return scene->colours[camera];
}

enum ls_err sim_truth_check(const struct sim_scene *scene, const struct sim_region *r,
                            struct ls_diag *diag)
{
    if (scene->kind == SIM_WORLD_STAMP)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "the stamp scene has no truth but its stamps");
    if (r->camera >= scene->config.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the scene has %u", r->camera,
                       scene->config.n_cameras);
    const struct sim_view *view = &scene->view[r->camera];
    if (!r->width || !r->height || r->width > view->width || r->height > view->height ||
        r->x > view->width - r->width || r->y > view->height - r->height)
        return ls_fail(diag, LS_ERR_INVALID,
                       "region %u x %u at (%u, %u) is not inside the sensor of %u x %u", r->width,
                       r->height, r->x, r->y, view->width, view->height);
    return LS_OK;
}

static float weight_of(const struct sums *s, uint32_t picture, uint32_t source, uint32_t light)
{
    size_t row = (size_t)picture * s->response->n_sources + source;
    return s->weights[row * s->scene->geometry.n_lights + light];
}

static void bounce_sums(struct sums *s)
{
    const struct sim_scene *scene = s->scene;
    size_t size = (size_t)scene->subject.n_nodes * s->response->n_colours;
    for (uint32_t p = 0; size && p < s->n_pictures; p++)
        for (uint32_t k = 0; k < s->response->n_sources; k++)
            for (uint32_t i = 0; i < scene->geometry.n_lights; i++) {
                float w = weight_of(s, p, k, i);
                if (w != 0)
                    sim_bounce_add(&scene->bounce, &scene->subject, s->response, i, k, w,
                                   s->nodes + p * size);
            }
}

struct scratch {
    struct sim_tile tile;
    struct sim_terms terms;
    float a[SIM_MAX_CHANNELS][3][SIM_TILE_PX], b[SIM_MAX_CHANNELS][3][SIM_TILE_PX];
    float (*sum)[3][SIM_TILE_PX], (*some)[3][SIM_TILE_PX]; /* [picture] */
    float room[][3][SIM_TILE_PX];
};

static void add_light(const struct sums *s, struct scratch *t, uint32_t light)
{
    int shaded = 0;
    const struct sim_response *r = s->response;
    for (uint32_t p = 0; p < s->n_pictures; p++)
        for (uint32_t k = 0; k < r->n_sources; k++) {
            float w = weight_of(s, p, k, light);
            if (w == 0)
                continue;
            if (!shaded++ && !sim_tile_shade(&s->scene->subject, &s->scene->geometry, &t->tile,
                                             light, &t->terms))
                return;
            for (uint32_t c = 0; c < r->n_colours; c++) {
                sim_tile_add(&t->terms, r->kind[k], r->diffuse[k], t->a[k][c], t->b[k][c], w,
                             t->sum[p][c]);
                if (s->part == PART_SPECULAR && t->tile.has_specular)
                    sim_tile_add(&t->terms, r->kind[k], 0, t->a[k][c], t->b[k][c], w,
                                 t->some[p][c]);
            }
        }
}

static void add_bounce(const struct sums *s, struct scratch *t)
{
    uint32_t colours = s->response->n_colours;
    size_t nodes = (size_t)s->scene->subject.n_nodes * colours;
    for (uint32_t p = 0; nodes && p < s->n_pictures; p++)
        for (uint32_t c = 0; c < colours; c++) {
            const float *at = s->nodes + p * nodes;
            sim_tile_bounce(&t->tile, at, colours, (int)c, t->sum[p][c]);
            if (s->part == PART_BOUNCED)
                sim_tile_bounce(&t->tile, at, colours, (int)c, t->some[p][c]);
        }
}

static void write_tile(const struct sums *s, uint32_t dx, uint32_t dy, const struct sim_tile *tile,
                       const float (*sum)[3][SIM_TILE_PX], const struct sim_planes *planes)
{
    uint32_t colours = s->response->n_colours;
    for (uint32_t p = 0; p < s->n_pictures; p++)
        for (uint32_t c = 0; c < colours; c++)
            sim_planes_put(planes, p * colours + c, dx, dy, tile->width, tile->height, sum[p][c]);
}

static void sum_tile(const struct sums *s, struct scratch *t, uint32_t index)
{
    const struct sim_scene *scene = s->scene;
    const struct sim_region *r = s->region;
    const struct sim_view *view = &scene->view[r->camera];
    uint32_t dx = index % s->tiles_x * SIM_TILE, dy = index / s->tiles_x * SIM_TILE;
    uint32_t w = s->whole.width - dx < SIM_TILE ? s->whole.width - dx : SIM_TILE;
    uint32_t h = s->whole.height - dy < SIM_TILE ? s->whole.height - dy : SIM_TILE;
    sim_tile_prepare(&scene->subject, view, (int32_t)(r->x + dx - view->blur.reach),
                     (int32_t)(r->y + dy - view->blur.reach), w, h, &t->tile);
    if (!t->tile.n_seen)
        return;
    uint32_t colours = s->response->n_colours;
    for (uint32_t k = 0; k < s->response->n_sources; k++)
        for (uint32_t c = 0; c < colours; c++)
            sim_tile_factors(&t->tile, s->response, k, (int)c, t->a[k][c], t->b[k][c]);
    memset(t->room, 0, 2 * s->n_pictures * sizeof *t->room);
    for (uint32_t i = 0; i < scene->geometry.n_lights; i++)
        add_light(s, t, i);
    add_bounce(s, t);
    write_tile(s, dx, dy, &t->tile, t->sum, &s->whole);
    if (s->part)
        write_tile(s, dx, dy, &t->tile, t->some, &s->portion);
}

static void *take_tiles(void *arg)
{
    struct sums *s = arg;
    LS_CLEANUP_FREE struct scratch *t = malloc(sizeof *t + 2 * s->n_pictures * sizeof *t->room);
    uint32_t tile;
    if (!t)
        s->failed = 1;
    else {
        t->sum = t->room;
        t->some = t->room + s->n_pictures;
    }
    while (t && (tile = s->next_tile++) < s->n_tiles)
        sum_tile(s, t, tile);
    return NULL;
}

static enum ls_err replay_sums(const struct sums *s)
{
    const struct sim_region *r = s->region;
    const struct sim_view *view = &s->scene->view[0];
    size_t pixels = (size_t)view->width * view->height;
    for (uint32_t p = 0; p < s->n_pictures; p++)
        for (uint32_t i = 0; i < s->scene->geometry.n_lights; i++) {
            float w = weight_of(s, p, 0, i);
            for (uint32_t y = 0; w != 0 && y < r->height; y++)
                for (uint32_t x = 0; x < r->width; x++)
                    s->out[((size_t)p * r->height + y) * r->width + x] +=
                        w * s->scene->replay[i * pixels + (r->y + y) * view->width + r->x + x];
        }
    return LS_OK;
}

/* Add the blurred planes to pictures whose colours lie side by side. */
static void add_blurred(const struct sums *s, const struct sim_planes *planes, float *plane,
                        float *pictures)
{
    uint32_t colours = s->response->n_colours;
    size_t n = (size_t)s->region->width * s->region->height;
    for (uint32_t k = 0; k < planes->n; k++) {
        float *out = pictures + k / colours * n * colours + k % colours;
        sim_blur_plane(&s->scene->view[s->region->camera].blur, planes, k, plane);
        for (size_t i = 0; i < n; i++)
            out[i * colours] += plane[i];
    }
}

static void trace_tiles(struct sums *s)
{
    s->tiles_x = (s->whole.width + SIM_TILE - 1) / SIM_TILE;
    s->n_tiles = s->tiles_x * ((s->whole.height + SIM_TILE - 1) / SIM_TILE);
    pthread_t helper;
    int helped = s->scene->config.threads > 1 && s->n_tiles > 8 &&
                 !pthread_create(&helper, NULL, take_tiles, s);
    take_tiles(s);
    if (helped)
        pthread_join(helper, NULL);
}

static enum ls_err traced_sums(struct sums *s)
{
    uint32_t reach = s->scene->view[s->region->camera].blur.reach;
    uint32_t width = s->region->width + 2 * reach, height = s->region->height + 2 * reach;
    uint32_t n_planes = s->n_pictures * s->response->n_colours;
    size_t values = (size_t)n_planes * width * height;
    size_t nodes = (size_t)s->n_pictures * s->scene->subject.n_nodes * s->response->n_colours;
    LS_CLEANUP_FREE float *at_nodes = calloc(nodes + 1, sizeof *at_nodes);
    LS_CLEANUP_FREE float *whole = calloc(values, sizeof *whole);
    LS_CLEANUP_FREE float *portion = s->part ? calloc(values, sizeof *portion) : NULL;
    LS_CLEANUP_FREE float *plane = malloc((size_t)width * height * sizeof *plane);
    if (!at_nodes || !whole || (s->part && !portion) || !plane)
        return LS_ERR_NOMEM;
    s->nodes = at_nodes;
    s->whole = (struct sim_planes){whole, n_planes, width, height};
    s->portion = (struct sim_planes){portion, n_planes, width, height};
    bounce_sums(s);
    trace_tiles(s);
    if (s->failed)
        return LS_ERR_NOMEM;
    add_blurred(s, &s->whole, plane, s->out);
    if (s->part)
        add_blurred(s, &s->portion, plane, s->some);
    return LS_OK;
}

static enum ls_err sum_up(struct sums *s, struct ls_diag *diag)
{
    enum ls_err err = s->scene->kind == SIM_WORLD_REPLAY ? replay_sums(s) : traced_sums(s);
    return err ? ls_fail(diag, err, "out of memory for the truth of %u pictures", s->n_pictures)
               : LS_OK;
}

static size_t region_values(const struct sim_scene *scene, const struct sim_region *r)
{
    return (size_t)r->width * r->height * scene->colours[r->camera];
}

/* @some: a part of the same pictures, or NULL. */
static enum ls_err relight(const struct sim_scene *scene, const struct sim_region *region,
                           const float *weights, uint32_t n_pictures, float *out, enum part part,
                           float *some, struct ls_diag *diag)
{
    enum ls_err err = sim_truth_check(scene, region, diag);
    if (err)
        return err;
    size_t n = n_pictures * region_values(scene, region);
    memset(out, 0, n * sizeof *out);
    if (some)
        memset(some, 0, n * sizeof *some);
    struct sums s = {.scene = scene,
                     .region = region,
                     .response = &scene->response[region->camera],
                     .weights = weights,
                     .n_pictures = n_pictures,
                     .part = part,
                     .out = out,
                     .some = some};
    return sum_up(&s, diag);
}

enum ls_err sim_truth_relight(const struct sim_scene *scene, const struct sim_region *region,
                              const float *weights, uint32_t n_pictures, float *out,
                              struct ls_diag *diag)
{
    return relight(scene, region, weights, n_pictures, out, PART_NONE, NULL, diag);
}

static float *new_weights(const struct sim_scene *scene, uint32_t n_pictures)
{
    return calloc((size_t)n_pictures * scene->config.n_channels * scene->geometry.n_lights,
                  sizeof(float));
}

enum ls_err sim_truth_field(const struct sim_scene *scene, const struct sim_region *region,
                            uint32_t light, float *out, struct ls_diag *diag)
{
    uint32_t n = scene->config.n_channels, lights = scene->geometry.n_lights;
    if (light >= lights)
        return ls_fail(diag, LS_ERR_INVALID, "light %u: the rig has %u", light, lights);
    LS_CLEANUP_FREE float *weights = new_weights(scene, n);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    for (uint32_t s = 0; s < n; s++)
        weights[((size_t)s * n + s) * lights + light] = 1;
    return relight(scene, region, weights, n, out, PART_NONE, NULL, diag);
}

/* ---- environments ---- */

static void integrate_lobes(const struct sim_geometry *g, const struct ls_lobe *lobes, uint32_t n,
                            uint32_t n_directions, float *weights)
{
    for (uint32_t k = 0; k < n_directions; k++) {
        float d[3];
        sim_geometry_fibonacci(k, n_directions, d);
        uint32_t light = sim_geometry_nearest(g, d);
        for (uint32_t lobe = 0; lobe < n; lobe++)
            weights[(size_t)lobe * g->n_lights + light] +=
                (float)(ls_lobe_radiance(&lobes[lobe], (const double[3]){d[0], d[1], d[2]}) * 4 *
                        M_PI / n_directions);
    }
}

/* At most SIM_MAX_CHANNELS lobes, added to out and their specular part to some. */
static enum ls_err add_lobes(const struct sim_scene *scene, const struct sim_region *region,
                             const struct ls_lobe *lobes, uint32_t n, uint32_t n_directions,
                             float *out, float *some, struct ls_diag *diag)
{
    struct sim_source sources[SIM_MAX_CHANNELS];
    struct sim_response response;
    for (uint32_t i = 0; i < n; i++)
        sources[i] = (struct sim_source){SIM_CHANNEL_SPECTRUM, lobes[i].spectrum};
    LS_CLEANUP_FREE float *weights = calloc((size_t)n * scene->geometry.n_lights, sizeof *weights);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    enum ls_err err = sim_response_build(&scene->library, &scene->subject, sources, n,
                                         scene->camera[region->camera],
                                         scene->colours[region->camera], &response, diag);
    if (err)
        return err;
    integrate_lobes(&scene->geometry, lobes, n, n_directions, weights);
    struct sums s = {.scene = scene,
                     .region = region,
                     .response = &response,
                     .weights = weights,
                     .n_pictures = 1,
                     .part = some ? PART_SPECULAR : PART_NONE,
                     .out = out,
                     .some = some};
    err = sum_up(&s, diag);
    sim_response_finish(&response);
    return err;
}

/* share[pixel] = some / all of one colour, or the largest over colours if @colour is negative. */
static void divide(const struct sim_scene *scene, const struct sim_region *region,
                   const float *some, const float *all, int colour, float *share)
{
    uint32_t colours = scene->colours[region->camera];
    for (size_t i = 0; i < (size_t)region->width * region->height; i++) {
        share[i] = 0;
        for (uint32_t c = 0; c < colours; c++) {
            size_t at = i * colours + c;
            if (all[at] > 0 && (colour < 0 || (uint32_t)colour == c))
                share[i] = sim_max(share[i], some[at] / all[at]);
        }
    }
}

enum ls_err sim_truth_environment(const struct sim_scene *scene, const struct sim_region *region,
                                  const struct ls_lobes *lobes, uint32_t n_directions, float *out,
                                  float *specular, struct ls_diag *diag)
{
    enum ls_err err = sim_truth_check(scene, region, diag);
    if (err)
        return err;
    if (scene->kind == SIM_WORLD_REPLAY)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "a replayed folder has no spectral truth");
    size_t values = region_values(scene, region);
    LS_CLEANUP_FREE float *some = specular ? calloc(values, sizeof *some) : NULL;
    if (specular && !some)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mask");
    memset(out, 0, values * sizeof *out);
    for (size_t i = 0; i < lobes->n && !err; i += SIM_MAX_CHANNELS) {
        size_t n = lobes->n - i < SIM_MAX_CHANNELS ? lobes->n - i : SIM_MAX_CHANNELS;
        err = add_lobes(scene, region, lobes->item + i, (uint32_t)n, n_directions, out, some, diag);
    }
    if (specular && !err)
        divide(scene, region, some, out, -1, specular);
    return err;
}

/* ---- shares ---- */

/* share[pixel] = part / total, in green or mono. */
static enum ls_err share(const struct sim_scene *scene, const struct sim_region *region,
                         const float *weights, enum part part, float *out, struct ls_diag *diag)
{
    enum ls_err err = sim_truth_check(scene, region, diag);
    if (err)
        return err;
    size_t n = region_values(scene, region);
    LS_CLEANUP_FREE float *some = malloc(n * sizeof *some);
    LS_CLEANUP_FREE float *all = malloc(n * sizeof *all);
    if (!some || !all)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mask");
    err = relight(scene, region, weights, 1, all, part, some, diag);
    if (!err)
        divide(scene, region, some, all, scene->colours[region->camera] == 3 ? 1 : 0, out);
    return err;
}

enum ls_err sim_truth_bounced(const struct sim_scene *scene, const struct sim_region *region,
                              float *bounced, struct ls_diag *diag)
{
    LS_CLEANUP_FREE float *weights = new_weights(scene, 1);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    for (uint32_t i = 0; i < scene->geometry.n_lights; i++)
        weights[i] = 1;
    return share(scene, region, weights, PART_BOUNCED, bounced, diag);
}

enum ls_err sim_truth_specular(const struct sim_scene *scene, const struct sim_region *region,
                               uint32_t light, float *specular, struct ls_diag *diag)
{
    if (light >= scene->geometry.n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "light %u: the rig has %u", light,
                       scene->geometry.n_lights);
    LS_CLEANUP_FREE float *weights = new_weights(scene, 1);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    weights[light] = 1;
    return share(scene, region, weights, PART_SPECULAR, specular, diag);
}

#include "sim/world.h"

#include "core/half.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum {
    MAX_TILES = 5, /* across a patch with its surroundings */
    MAX_PIECES = MAX_TILES * MAX_TILES,
    PATCH_PX = MAX_PIECES * SIM_TILE_PX,
    SLOT_BYTES = 8 << 20, /* that patches shrink for, a thread's */
    MIN_PATCHES = 16,     /* that they shrink for, to keep two threads busy */
};

/* A picture that wants a light. */
struct use {
    uint32_t picture;
    uint16_t channel;
    float weight;
};

struct job {
    const struct sim_scene *scene;
    uint32_t camera;
    struct sim_picture *const *pictures;
    uint32_t n;
    struct use *uses; /* by light */
    uint32_t *first;  /* uses of light i: [first[i], first[i + 1]) */
    uint32_t *slot;   /* accumulator of a picture with several LEDs; UINT32_MAX: single */
    uint32_t n_slots;
    float *nodes; /* [picture][node * colours] */
    sim_scene_progress *progress;
    void *user;
    uint32_t n_planes; /* colours seen before the blur; 1: each pixel's own, as without one */
    uint32_t side;     /* of a patch, px */
    uint32_t patches_x, patches_y;
    _Atomic uint32_t next_patch;
    _Atomic int failed;
};

void sim_tile_factors(const struct sim_tile *tile, const struct sim_response *r, uint32_t source,
                      int colour, float *a, float *b)
{
    for (uint32_t k = 0; k < tile->n; k++) {
        uint32_t c = colour >= 0 ? (uint32_t)colour : tile->colour[k];
        a[k] = sim_response_of(r, source, c, tile->material[k]);
        b[k] = sim_response_of(r, source, c, SIM_MAT_FLAT);
    }
    for (uint32_t k = tile->n; k < SIM_TILE_PX; k++)
        a[k] = b[k] = 0;
}

void sim_tile_add(const struct sim_terms *terms, enum sim_channel_kind kind, float diffuse,
                  const float *restrict a, const float *restrict b, float weight,
                  float *restrict out)
{
    const float *specular = terms->specular[kind];
    for (uint32_t k = 0; k < SIM_TILE_PX; k++) {
        float mirrored = specular[k] * (a[k] + terms->flat[k] * (b[k] - a[k]));
        out[k] += weight * (diffuse * terms->diffuse[k] * a[k] + mirrored);
    }
}

void sim_tile_bounce(const struct sim_tile *tile, const float *nodes, uint32_t n_colours,
                     int colour, float *out)
{
    for (uint32_t k = 0; k < tile->n; k++) {
        uint32_t c = colour >= 0 ? (uint32_t)colour : tile->colour[k];
        const uint32_t *node = tile->node[k];
        const float *share = tile->share[k];
        out[k] +=
            (share[0] * nodes[node[0] * n_colours + c] + share[1] * nodes[node[1] * n_colours + c] +
             share[2] * nodes[node[2] * n_colours + c] +
             share[3] * nodes[node[3] * n_colours + c]) *
            tile->weave[k];
    }
}

void sim_tile_bounce_rgb(const struct sim_tile *tile, const float *nodes, float out[3][SIM_TILE_PX])
{
    for (uint32_t k = 0; k < tile->n; k++) {
        const float *share = tile->share[k], *at[4];
        for (int i = 0; i < 4; i++)
            at[i] = nodes + (size_t)3 * tile->node[k][i];
        for (int c = 0; c < 3; c++)
            out[c][k] += (share[0] * at[0][c] + share[1] * at[1][c] + share[2] * at[2][c] +
                          share[3] * at[3][c]) *
                         tile->weave[k];
    }
}

static float *nodes_of(const struct job *job, uint32_t picture)
{
    const struct sim_scene *scene = job->scene;
    return job->nodes + (size_t)picture * scene->subject.n_nodes * scene->colours[job->camera];
}

/* A tile of a patch, and what the light of the moment does there. */
struct piece {
    struct sim_tile tile;
    uint32_t dx, dy; /* in the patch */
    int reached;
    struct sim_terms terms;
    float a[SIM_MAX_CHANNELS][3][SIM_TILE_PX], b[SIM_MAX_CHANNELS][3][SIM_TILE_PX];
};

/* What one thread works on: a patch of the sensor, traced with the blur's reach around it. */
struct scratch {
    uint32_t x, y, width, height; /* of the patch, without its surroundings */
    uint32_t n_pieces;
    struct piece piece[MAX_PIECES];
    float seen[3][PATCH_PX];                  /* before the blur, by colour */
    float mosaic[PATCH_PX];                   /* after it */
    float source[SIM_MAX_CHANNELS][PATCH_PX]; /* mosaics of the light at strength 1 ... */
    int has_source[SIM_MAX_CHANNELS];         /* ... those that were wanted so far */
    float slots[];                            /* [slot][side * side] */
};

static size_t pixels_of(const struct scratch *s)
{
    return (size_t)s->width * s->height;
}

static float *slot_of(const struct job *job, struct scratch *s, uint32_t slot)
{
    return s->slots + (size_t)slot * job->side * job->side;
}

/* The mosaic of @weight times a channel's direct light, or none without @direct, and of the light
 * that @nodes throw back, or none without them. */
static void develop(const struct job *job, struct scratch *s, uint32_t channel, int direct,
                    float weight, const float *nodes, float *mosaic)
{
    const struct sim_view *view = &job->scene->view[job->camera];
    const struct sim_response *r = &job->scene->response[job->camera];
    const struct sim_planes planes = {s->seen[0], job->n_planes, s->width + 2 * view->blur.reach,
                                      s->height + 2 * view->blur.reach};
    for (uint32_t i = 0; i < s->n_pieces; i++) {
        const struct piece *p = &s->piece[i];
        float value[3][SIM_TILE_PX];
        memset(value, 0, job->n_planes * sizeof *value);
        for (uint32_t c = 0; direct && p->reached && c < job->n_planes; c++)
            sim_tile_add(&p->terms, r->kind[channel], r->diffuse[channel], p->a[channel][c],
                         p->b[channel][c], weight, value[c]);
        if (nodes && p->tile.n_seen && job->n_planes == 3)
            sim_tile_bounce_rgb(&p->tile, nodes, value);
        else if (nodes && p->tile.n_seen)
            sim_tile_bounce(&p->tile, nodes, r->n_colours, -1, value[0]);
        for (uint32_t c = 0; c < job->n_planes; c++)
            sim_planes_put(&planes, c, p->dx, p->dy, p->tile.width, p->tile.height, value[c]);
    }
    sim_blur_mosaic(&view->blur, &planes, view->cfa, s->x, s->y, mosaic);
}

static void store(const struct job *job, const struct scratch *s, uint32_t picture, float *value)
{
    size_t width = job->scene->view[job->camera].width;
    uint16_t *image = job->pictures[picture]->half[job->camera] + s->y * width + s->x;
    for (size_t k = 0; k < pixels_of(s); k++)
        value[k] = sim_min(value[k] * sim_picture_scale, LS_HALF_MAX);
    for (uint32_t row = 0; row < s->height; row++)
        ls_half_from_floats(value + (size_t)row * s->width, image + row * width, s->width);
}

/* A picture of one LED. */
static void store_single(const struct job *job, struct scratch *s, const struct use *use)
{
    const float *nodes = job->scene->subject.n_nodes ? nodes_of(job, use->picture) : NULL;
    develop(job, s, use->channel, 1, use->weight, nodes, s->mosaic);
    store(job, s, use->picture, s->mosaic);
}

static void add_to_slot(const struct job *job, struct scratch *s, const struct use *use)
{
    float *restrict out = slot_of(job, s, job->slot[use->picture]);
    const float *restrict source = s->source[use->channel];
    if (!s->has_source[use->channel]++)
        develop(job, s, use->channel, 1, 1, NULL, s->source[use->channel]);
    for (size_t k = 0; k < pixels_of(s); k++)
        out[k] += use->weight * source[k];
}

static void light_patch(const struct job *job, struct scratch *s, uint32_t light)
{
    const struct sim_scene *scene = job->scene;
    int reached = 0;
    if (job->first[light] == job->first[light + 1])
        return;
    for (uint32_t i = 0; i < s->n_pieces; i++) {
        struct piece *p = &s->piece[i];
        p->reached = p->tile.n_seen &&
                     sim_tile_shade(&scene->subject, &scene->geometry, &p->tile, light, &p->terms);
        reached |= p->reached;
    }
    memset(s->has_source, 0, sizeof s->has_source);
    for (uint32_t i = job->first[light]; i < job->first[light + 1]; i++) {
        const struct use *use = &job->uses[i];
        if (job->slot[use->picture] == UINT32_MAX)
            store_single(job, s, use);
        else if (reached)
            add_to_slot(job, s, use);
    }
}

static void prepare_piece(const struct job *job, struct scratch *s, uint32_t dx, uint32_t dy)
{
    const struct sim_scene *scene = job->scene;
    const struct sim_view *view = &scene->view[job->camera];
    struct piece *p = &s->piece[s->n_pieces++];
    uint32_t reach = view->blur.reach;
    uint32_t w = s->width + 2 * reach - dx, h = s->height + 2 * reach - dy;
    p->dx = dx;
    p->dy = dy;
    sim_tile_prepare(&scene->subject, view, (int32_t)(s->x + dx - reach),
                     (int32_t)(s->y + dy - reach), w < SIM_TILE ? w : SIM_TILE,
                     h < SIM_TILE ? h : SIM_TILE, &p->tile);
    for (uint32_t k = 0; k < scene->config.n_channels; k++)
        for (uint32_t c = 0; c < job->n_planes; c++)
            sim_tile_factors(&p->tile, &scene->response[job->camera], k,
                             job->n_planes == 1 ? -1 : (int)c, p->a[k][c], p->b[k][c]);
}

static void prepare_patch(const struct job *job, struct scratch *s, uint32_t index)
{
    const struct sim_view *view = &job->scene->view[job->camera];
    uint32_t reach = view->blur.reach;
    s->x = index % job->patches_x * job->side;
    s->y = index / job->patches_x * job->side;
    s->width = view->width - s->x < job->side ? view->width - s->x : job->side;
    s->height = view->height - s->y < job->side ? view->height - s->y : job->side;
    s->n_pieces = 0;
    for (uint32_t dy = 0; dy < s->height + 2 * reach; dy += SIM_TILE)
        for (uint32_t dx = 0; dx < s->width + 2 * reach; dx += SIM_TILE)
            prepare_piece(job, s, dx, dy);
}

static void render_patch(const struct job *job, struct scratch *s, uint32_t index)
{
    const struct sim_scene *scene = job->scene;
    prepare_patch(job, s, index);
    memset(s->slots, 0, (size_t)job->n_slots * job->side * job->side * sizeof *s->slots);
    for (uint32_t i = 0; i < scene->geometry.n_lights; i++)
        light_patch(job, s, i);
    for (uint32_t p = 0; p < job->n; p++) {
        if (job->slot[p] == UINT32_MAX)
            continue;
        float *value = slot_of(job, s, job->slot[p]);
        if (scene->subject.n_nodes) {
            develop(job, s, 0, 0, 0, nodes_of(job, p), s->mosaic);
            for (size_t k = 0; k < pixels_of(s); k++)
                value[k] += s->mosaic[k];
        }
        store(job, s, p, value);
    }
}

static void take_patches(struct job *job, int report)
{
    size_t slots = (size_t)job->n_slots * job->side * job->side;
    LS_CLEANUP_FREE struct scratch *s = malloc(sizeof *s + slots * sizeof *s->slots);
    uint32_t patch, n = job->patches_x * job->patches_y;
    if (!s)
        job->failed = 1;
    while (s && (patch = job->next_patch++) < n) {
        render_patch(job, s, patch);
        if (report && job->progress)
            job->progress(job->user, (double)patch / n);
    }
}

static void *help(void *job)
{
    take_patches(job, 0);
    return NULL;
}

static void count_uses(struct job *job)
{
    for (uint32_t p = 0; p < job->n; p++)
        for (uint32_t k = 0; k < job->pictures[p]->n_leds; k++)
            job->first[job->pictures[p]->leds[k].light + 1]++;
    for (uint32_t i = 0; i < job->scene->geometry.n_lights; i++)
        job->first[i + 1] += job->first[i];
}

static void list_uses(struct job *job, uint32_t *fill)
{
    memcpy(fill, job->first, job->scene->geometry.n_lights * sizeof *fill);
    for (uint32_t p = 0; p < job->n; p++) {
        const struct sim_picture *picture = job->pictures[p];
        uint32_t lit = sim_world_lit(picture->leds, picture->n_leds);
        job->slot[p] = picture->n_leds == 1 ? UINT32_MAX : job->n_slots++;
        for (uint32_t k = 0; k < picture->n_leds; k++)
            job->uses[fill[picture->leds[k].light]++] = (struct use){
                p, picture->leds[k].channel, sim_world_weight(job->scene, &picture->leds[k], lit)};
    }
}

static void bounce_all(struct job *job)
{
    const struct sim_scene *scene = job->scene;
    size_t size = (size_t)scene->subject.n_nodes * scene->colours[job->camera];
    for (uint32_t i = 0; size && i < scene->geometry.n_lights; i++)
        for (uint32_t u = job->first[i]; u < job->first[i + 1]; u++)
            sim_bounce_add(&scene->bounce, &scene->subject, &scene->response[job->camera], i,
                           job->uses[u].channel, job->uses[u].weight,
                           job->nodes + job->uses[u].picture * size);
}

static enum ls_err prepare(struct job *job)
{
    const struct sim_scene *scene = job->scene;
    size_t n_uses = 0, lights = scene->geometry.n_lights;
    for (uint32_t p = 0; p < job->n; p++)
        n_uses += job->pictures[p]->n_leds;
    size_t nodes = (size_t)job->n * scene->subject.n_nodes * scene->colours[job->camera];
    job->uses = calloc(n_uses + 1, sizeof *job->uses);
    job->first = calloc(lights + 1, sizeof *job->first);
    job->slot = calloc(job->n + 1, sizeof *job->slot);
    job->nodes = calloc(nodes + 1, sizeof *job->nodes);
    LS_CLEANUP_FREE uint32_t *fill = calloc(lights, sizeof *fill);
    if (!job->uses || !job->first || !job->slot || !job->nodes || !fill)
        return LS_ERR_NOMEM;
    count_uses(job);
    list_uses(job, fill);
    bounce_all(job);
    return LS_OK;
}

static void finish(struct job *job)
{
    free(job->uses);
    free(job->first);
    free(job->slot);
    free(job->nodes);
}

static void replay(const struct sim_scene *scene, uint32_t camera, const struct sim_picture *p)
{
    size_t n = (size_t)scene->view[camera].width * scene->view[camera].height;
    uint32_t lit = sim_world_lit(p->leds, p->n_leds);
    for (size_t at = 0; at < n; at += SIM_TILE_PX) {
        float sum[SIM_TILE_PX] = {0};
        size_t count = n - at < SIM_TILE_PX ? n - at : SIM_TILE_PX;
        for (uint32_t k = 0; k < p->n_leds; k++) {
            float weight = sim_picture_scale * sim_world_weight(scene, &p->leds[k], lit);
            const float *image = scene->replay + p->leds[k].light * n + at;
            for (size_t i = 0; i < count; i++)
                sum[i] += weight * image[i];
        }
        ls_half_from_floats(sum, p->half[camera] + at, count);
    }
}

/* Patches so large that little of their surroundings is traced twice. */
static void choose_patches(struct job *job)
{
    const struct sim_view *view = &job->scene->view[job->camera];
    uint32_t reach = view->blur.reach, tiles = reach ? MAX_TILES : 1;
    do {
        job->side = tiles * SIM_TILE - 2 * reach;
        job->patches_x = (view->width + job->side - 1) / job->side;
        job->patches_y = (view->height + job->side - 1) / job->side;
    } while (tiles-- > 2 &&
             ((size_t)job->n_slots * job->side * job->side * sizeof(float) > SLOT_BYTES ||
              job->patches_x * job->patches_y < MIN_PATCHES));
}

static void run(struct job *job, uint32_t threads)
{
    pthread_t helper;
    int helped = threads > 1 && !pthread_create(&helper, NULL, help, job);
    take_patches(job, 1);
    if (helped)
        pthread_join(helper, NULL);
}

enum ls_err sim_render(const struct sim_scene *scene, uint32_t camera,
                       struct sim_picture *const *pictures, uint32_t n,
                       sim_scene_progress *progress, void *user, struct ls_diag *diag)
{
    if (scene->kind == SIM_WORLD_REPLAY) {
        for (uint32_t p = 0; p < n; p++)
            replay(scene, camera, pictures[p]);
        return LS_OK;
    }
    struct job job = {.scene = scene,
                      .camera = camera,
                      .pictures = pictures,
                      .n = n,
                      .progress = progress,
                      .user = user,
                      .n_planes = scene->view[camera].blur.reach ? scene->colours[camera] : 1};
    enum ls_err err = prepare(&job);
    if (!err) {
        choose_patches(&job);
        run(&job, scene->config.threads);
    }
    finish(&job);
    if (err || job.failed)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory rendering %u conditions", n);
    return LS_OK;
}

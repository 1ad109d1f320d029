#include "sim/world.h"

#include "core/half.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

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
    uint32_t tiles_x, tiles_y;
    _Atomic uint32_t next_tile;
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

static void store(const struct job *job, const struct sim_tile *tile, uint32_t picture,
                  float *value)
{
    const struct sim_scene *scene = job->scene;
    if (scene->subject.n_nodes && tile->n_seen)
        sim_tile_bounce(tile,
                        job->nodes +
                            (size_t)picture * scene->subject.n_nodes * scene->colours[job->camera],
                        scene->colours[job->camera], -1, value);
    for (uint32_t k = 0; k < tile->n; k++)
        value[k] = sim_min(value[k] * sim_picture_scale, LS_HALF_MAX);
    uint16_t *image = job->pictures[picture]->half[job->camera];
    for (uint32_t row = 0; row < tile->height; row++)
        ls_half_from_floats(value + row * tile->width,
                            image + (size_t)(tile->y + row) * scene->view[job->camera].width +
                                tile->x,
                            tile->width);
}

struct scratch {
    struct sim_tile tile;
    struct sim_terms terms;
    float a[SIM_MAX_CHANNELS][SIM_TILE_PX], b[SIM_MAX_CHANNELS][SIM_TILE_PX];
    float single[SIM_TILE_PX];
    float slots[][SIM_TILE_PX];
};

static void light_tile(const struct job *job, struct scratch *s, uint32_t light)
{
    const struct sim_scene *scene = job->scene;
    const struct sim_response *r = &scene->response[job->camera];
    if (job->first[light] == job->first[light + 1])
        return;
    int reached = s->tile.n_seen &&
                  sim_tile_shade(&scene->subject, &scene->geometry, &s->tile, light, &s->terms);
    for (uint32_t i = job->first[light]; i < job->first[light + 1]; i++) {
        const struct use *use = &job->uses[i];
        uint32_t slot = job->slot[use->picture], c = use->channel;
        float *out = slot == UINT32_MAX ? s->single : s->slots[slot];
        if (slot == UINT32_MAX)
            memset(s->single, 0, sizeof s->single);
        if (reached)
            sim_tile_add(&s->terms, r->kind[c], r->diffuse[c], s->a[c], s->b[c], use->weight, out);
        if (slot == UINT32_MAX)
            store(job, &s->tile, use->picture, s->single);
    }
}

static void render_tile(const struct job *job, struct scratch *s, uint32_t index)
{
    const struct sim_scene *scene = job->scene;
    const struct sim_view *view = &scene->view[job->camera];
    uint32_t x = index % job->tiles_x * SIM_TILE, y = index / job->tiles_x * SIM_TILE;
    uint32_t w = view->width - x < SIM_TILE ? view->width - x : SIM_TILE;
    uint32_t h = view->height - y < SIM_TILE ? view->height - y : SIM_TILE;
    sim_tile_prepare(&scene->subject, view, x, y, w, h, &s->tile);
    for (uint32_t c = 0; c < scene->config.n_channels; c++)
        sim_tile_factors(&s->tile, &scene->response[job->camera], c, -1, s->a[c], s->b[c]);
    memset(s->slots, 0, job->n_slots * sizeof *s->slots);
    for (uint32_t i = 0; i < scene->geometry.n_lights; i++)
        light_tile(job, s, i);
    for (uint32_t p = 0; p < job->n; p++)
        if (job->slot[p] != UINT32_MAX)
            store(job, &s->tile, p, s->slots[job->slot[p]]);
}

static void take_tiles(struct job *job, int report)
{
    LS_CLEANUP_FREE struct scratch *s = malloc(sizeof *s + job->n_slots * sizeof *s->slots);
    uint32_t tile, n = job->tiles_x * job->tiles_y;
    if (!s)
        job->failed = 1;
    while (s && (tile = job->next_tile++) < n) {
        render_tile(job, s, tile);
        if (report && job->progress)
            job->progress(job->user, (double)tile / n);
    }
}

static void *help(void *job)
{
    take_tiles(job, 0);
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

static void run(struct job *job, uint32_t threads)
{
    pthread_t helper;
    int helped = threads > 1 && !pthread_create(&helper, NULL, help, job);
    take_tiles(job, 1);
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
                      .tiles_x = (scene->view[camera].width + SIM_TILE - 1) / SIM_TILE,
                      .tiles_y = (scene->view[camera].height + SIM_TILE - 1) / SIM_TILE};
    enum ls_err err = prepare(&job);
    if (!err)
        run(&job, scene->config.threads);
    finish(&job);
    if (err || job.failed)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory rendering %u conditions", n);
    return LS_OK;
}

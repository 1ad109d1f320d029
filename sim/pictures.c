#include "sim/world.h"

#include <stdlib.h>
#include <string.h>

static uint64_t hash_leds(const struct sim_led *leds, uint32_t n)
{
    uint64_t h = n;
    for (uint32_t k = 0; k < n; k++) {
        uint32_t duty;
        memcpy(&duty, &leds[k].duty, sizeof duty);
        h = sim_hash(h ^ ((uint64_t)leds[k].light << 48 | (uint64_t)leds[k].channel << 32 | duty));
    }
    return h;
}

static int same_leds(const struct sim_picture *p, const struct sim_condition *c)
{
    for (uint32_t k = 0; k < p->n_leds; k++)
        if (p->leds[k].light != c->leds[k].light || p->leds[k].channel != c->leds[k].channel ||
            p->leds[k].duty != c->leds[k].duty)
            return 0;
    return 1;
}

static void picture_destroy(struct sim_picture *picture)
{
    for (int i = 0; picture && i < SIM_MAX_CAMERAS; i++)
        free(picture->half[i]);
    if (picture)
        free(picture->leds);
    free(picture);
}

/* A list under construction: what the scene keeps once the commit has succeeded. */
struct draft {
    struct sim_picture **pictures; /* known ones first */
    uint32_t n_pictures, n_known;
    struct sim_picture **program;
    struct sim_condition *conditions;
    uint32_t n_conditions;
    uint32_t *table; /* open addressing by hash: index + 1 into pictures */
    uint32_t mask;
};

static struct sim_picture *find(const struct draft *d, const struct sim_condition *c, uint64_t hash,
                                uint32_t *slot)
{
    for (*slot = (uint32_t)hash & d->mask; d->table[*slot]; *slot = (*slot + 1) & d->mask) {
        struct sim_picture *p = d->pictures[d->table[*slot] - 1];
        if (p->hash == hash && p->n_leds == c->n_leds && same_leds(p, c))
            return p;
    }
    return NULL;
}

static void index_known(struct draft *d)
{
    for (uint32_t i = 0; i < d->n_known; i++) {
        uint32_t slot = (uint32_t)d->pictures[i]->hash & d->mask;
        while (d->table[slot])
            slot = (slot + 1) & d->mask;
        d->table[slot] = i + 1;
    }
}

static enum ls_err check(const struct sim_scene *scene, const struct sim_condition *c,
                         uint32_t index, struct ls_diag *diag)
{
    for (uint32_t k = 0; k < c->n_leds; k++) {
        const struct sim_led *led = &c->leds[k];
        if (led->light >= scene->geometry.n_lights || led->channel >= scene->config.n_channels)
            return ls_fail(
                diag, LS_ERR_INVALID,
                "condition %u: light %u channel %u: the rig has %u lights of %u channels", index,
                led->light, led->channel, scene->geometry.n_lights, scene->config.n_channels);
        if (!(led->duty >= 0 && led->duty <= 1))
            return ls_fail(diag, LS_ERR_INVALID, "condition %u: duty %g: expected 0 to 1", index,
                           (double)led->duty);
    }
    return LS_OK;
}

static struct sim_led *copy_leds(const struct sim_condition *c)
{
    struct sim_led *leds = calloc(c->n_leds + 1, sizeof *leds);
    if (leds && c->n_leds)
        memcpy(leds, c->leds, c->n_leds * sizeof *leds);
    return leds;
}

static enum ls_err add(struct draft *d, uint32_t index, const struct sim_condition *c, int traced)
{
    d->conditions[index] = (struct sim_condition){c->kind, c->n_leds, copy_leds(c)};
    d->n_conditions = index + 1;
    if (!d->conditions[index].leds)
        return LS_ERR_NOMEM;
    if (!c->n_leds || !traced)
        return LS_OK;
    uint32_t slot;
    uint64_t hash = hash_leds(c->leds, c->n_leds);
    struct sim_picture *p = find(d, c, hash, &slot);
    if (!p) {
        p = calloc(1, sizeof *p);
        if (!p)
            return LS_ERR_NOMEM;
        *p = (struct sim_picture){.hash = hash, .n_leds = c->n_leds, .leds = copy_leds(c)};
        d->pictures[d->n_pictures++] = p;
        d->table[slot] = d->n_pictures;
        if (!p->leds)
            return LS_ERR_NOMEM;
    }
    p->wanted = 1;
    d->program[index] = p;
    return LS_OK;
}

static enum ls_err draft_begin(const struct sim_scene *scene, uint32_t n, struct draft *d)
{
    size_t most = (size_t)scene->n_pictures + n, size = 64;
    while (size < 2 * most)
        size *= 2;
    *d = (struct draft){.n_known = scene->n_pictures, .n_pictures = scene->n_pictures};
    d->mask = (uint32_t)(size - 1);
    d->pictures = calloc(most + 1, sizeof *d->pictures);
    d->program = calloc((size_t)n + 1, sizeof *d->program);
    d->conditions = calloc((size_t)n + 1, sizeof *d->conditions);
    d->table = calloc(size, sizeof *d->table);
    if (!d->pictures || !d->program || !d->conditions || !d->table)
        return LS_ERR_NOMEM;
    if (scene->n_pictures)
        memcpy(d->pictures, scene->pictures, scene->n_pictures * sizeof *d->pictures);
    for (uint32_t i = 0; i < d->n_known; i++)
        d->pictures[i]->wanted = 0;
    index_known(d);
    return LS_OK;
}

static void draft_abandon(struct draft *d)
{
    for (uint32_t i = d->n_known; d->pictures && i < d->n_pictures; i++)
        picture_destroy(d->pictures[i]);
    for (uint32_t i = 0; i < d->n_conditions; i++)
        free(d->conditions[i].leds);
    free(d->pictures);
    free(d->program);
    free(d->conditions);
    free(d->table);
}

static size_t camera_bytes(const struct sim_scene *scene, uint32_t camera)
{
    return 2 * (size_t)scene->view[camera].width * scene->view[camera].height;
}

static size_t picture_bytes(const struct sim_scene *scene)
{
    size_t bytes = 0;
    for (uint32_t i = 0; i < scene->config.n_cameras; i++)
        bytes += camera_bytes(scene, i);
    return bytes;
}

static int allocate(const struct sim_scene *scene, struct sim_picture *p)
{
    for (uint32_t i = 0; i < scene->config.n_cameras; i++)
        if (!p->half[i] && !(p->half[i] = malloc(camera_bytes(scene, i))))
            return 0;
    return 1;
}

static int by_leds(const void *a, const void *b)
{
    const struct sim_picture *const *x = a, *const *y = b;
    return ((*x)->n_leds < (*y)->n_leds) - ((*x)->n_leds > (*y)->n_leds);
}

/* Pictures to render now: the wanted, unrendered ones that fit, many LEDs first. Unwanted known
 * ones make room; the exposures still see the previous program, so they are only marked. */
static uint32_t choose(const struct sim_scene *scene, const struct draft *d,
                       struct sim_picture **list, uint32_t *n_evict)
{
    size_t each = picture_bytes(scene), room = scene->config.memory_bytes / each, used = 0;
    uint32_t n = 0, idle = 0;
    for (uint32_t i = 0; i < d->n_pictures; i++) {
        struct sim_picture *p = d->pictures[i];
        used += p->half[0] != NULL;
        idle += p->half[0] && !p->wanted;
        if (p->wanted && !p->half[0])
            list[n++] = p;
    }
    if (n)
        qsort(list, n, sizeof *list, by_leds);
    size_t over = used + n > room ? used + n - room : 0;
    *n_evict = (uint32_t)(over < idle ? over : idle);
    size_t drop = over - *n_evict;
    return drop < n ? n - (uint32_t)drop : 0;
}

static enum ls_err render(const struct sim_scene *scene, struct sim_picture **list, uint32_t n,
                          sim_scene_progress *progress, void *user, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < n; i++)
        if (!allocate(scene, list[i]))
            return ls_fail(diag, LS_ERR_NOMEM,
                           "out of memory for %u rendered conditions: lower memory_bytes", n);
    for (uint32_t camera = 0; n && camera < scene->config.n_cameras; camera++) {
        enum ls_err err = sim_render(scene, camera, list, n, progress, user, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

static void forget(struct draft *d, uint32_t n)
{
    for (uint32_t i = 0; i < d->n_pictures && n; i++) {
        struct sim_picture *p = d->pictures[i];
        if (p->wanted || !p->half[0])
            continue;
        for (int camera = 0; camera < SIM_MAX_CAMERAS; camera++) {
            free(p->half[camera]);
            p->half[camera] = NULL;
        }
        n--;
    }
}

/* Known pictures that are neither wanted nor rendered are of no use any more. */
static void sweep(struct draft *d)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < d->n_pictures; i++) {
        struct sim_picture *p = d->pictures[i];
        if (p->wanted || p->half[0])
            d->pictures[kept++] = p;
        else
            picture_destroy(p);
    }
    d->n_pictures = kept;
}

static void install(struct sim_scene *scene, struct draft *d, uint32_t n_evict)
{
    pthread_rwlock_wrlock(&scene->lock);
    forget(d, n_evict);
    sweep(d);
    for (uint32_t i = 0; i < scene->n_conditions; i++)
        free(scene->conditions[i].leds);
    free(scene->pictures);
    free(scene->program);
    free(scene->conditions);
    free(d->table);
    scene->pictures = d->pictures;
    scene->n_pictures = d->n_pictures;
    scene->program = d->program;
    scene->conditions = d->conditions;
    scene->n_conditions = d->n_conditions;
    pthread_rwlock_unlock(&scene->lock);
}

enum ls_err sim_scene_commit(struct sim_scene *scene, const struct sim_condition *conditions,
                             uint32_t n, sim_scene_progress *progress, void *user,
                             struct ls_diag *diag)
{
    struct draft d;
    uint32_t n_evict = 0;
    enum ls_err err = draft_begin(scene, n, &d);
    for (uint32_t i = 0; i < n && !err; i++) {
        err = check(scene, &conditions[i], i, diag);
        if (!err)
            err = add(&d, i, &conditions[i], scene->kind != SIM_WORLD_STAMP);
    }
    LS_CLEANUP_FREE struct sim_picture **list = calloc(d.n_pictures + 1, sizeof *list);
    if (!list || err == LS_ERR_NOMEM)
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u conditions", n);
    if (!err)
        err = render(scene, list, choose(scene, &d, list, &n_evict), progress, user, diag);
    if (err) {
        draft_abandon(&d);
        return err;
    }
    install(scene, &d, n_evict);
    return LS_OK;
}

static struct sim_picture *make_work(const struct sim_scene *scene, uint32_t channel)
{
    uint32_t n = scene->geometry.n_lights;
    struct sim_picture *p = calloc(1, sizeof *p);
    if (!p)
        return NULL;
    *p = (struct sim_picture){.n_leds = n, .leds = calloc(n + 1, sizeof *p->leds)};
    for (uint32_t i = 0; p->leds && i < n; i++)
        p->leds[i] = (struct sim_led){(uint16_t)i, (uint16_t)channel, 1};
    if (p->leds && !render(scene, &p, 1, NULL, NULL, NULL))
        return p;
    picture_destroy(p);
    return NULL;
}

const struct sim_picture *sim_work_picture(struct sim_scene *scene, uint32_t channel)
{
    if (channel >= scene->config.n_channels)
        return NULL;
    pthread_mutex_lock(&scene->work_lock);
    if (!scene->work[channel])
        scene->work[channel] = make_work(scene, channel);
    const struct sim_picture *picture = scene->work[channel];
    pthread_mutex_unlock(&scene->work_lock);
    return picture;
}

void sim_pictures_finish(struct sim_scene *scene)
{
    for (uint32_t i = 0; i < SIM_MAX_CHANNELS; i++)
        picture_destroy(scene->work[i]);
    for (uint32_t i = 0; i < scene->n_pictures; i++)
        picture_destroy(scene->pictures[i]);
    for (uint32_t i = 0; i < scene->n_conditions; i++)
        free(scene->conditions[i].leds);
    free(scene->pictures);
    free(scene->program);
    free(scene->conditions);
}

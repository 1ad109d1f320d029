#include "tests/bench/served.h"

#include "daemon/field_maps.h"
#include "daemon/render.h"
#include "tests/bench/bench.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct bench_served {
    struct ls_field_source source;
    struct ls_take_facts facts;
};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err) {
        fprintf(stderr, "%s\n", diag->text);
        exit(1);
    }
}

static void fill_white(struct ls_light_set *set, const struct bench_take *take)
{
    set->n_groups = 1;
    set->group[0] = (struct ls_light_group){.n = take->n_lights, .k = take->k};
    set->n_pictures = set->n_found = take->n_lights;
    set->pictures = take->white;
}

struct bench_served *bench_served_create(struct bench_take *take)
{
    struct bench_served *served = bench_alloc(sizeof *served);
    struct ls_field_source *source = &served->source;
    size_t tiles =
        (size_t)ls_field_tiles_x(&take->field) * ls_field_tiles_y(&take->field) * sizeof(void *);
    memset(served, 0, sizeof *served);
    snprintf(source->storage, sizeof source->storage, "%s",
             getenv("TMPDIR") ? getenv("TMPDIR") : "/var/tmp");
    snprintf(source->take, sizeof source->take, "bench");
    served->facts.n_lights = take->n_lights;
    served->facts.n_channels = take->n_spectra;
    served->facts.cfa = take->field.cfa;
    source->facts = &served->facts;
    source->field = take->field;
    source->width = take->field.width;
    source->height = take->field.height;
    source->calibrated = true;
    source->field.sphere = source->sphere = take->white;
    source->no_tiles = bench_alloc(tiles);
    memset(source->no_tiles, 0, tiles);
    source->duty = (double *)take->field.duty;
    source->vertical = source->horizontal = -1;
    for (uint32_t s = 0; s < take->n_spectra; s++) {
        snprintf(served->facts.channels[s].name, sizeof served->facts.channels[s].name, "%u", s);
        source->channel_of[s] = s;
        source->has_sphere[s] = true;
    }
    fill_white(&source->white, take);
    fill_white(&source->set[0], take);
    struct ls_diag diag = {""};
    must(ls_field_maps_create(&source->promoted, &diag), &diag);
    for (uint32_t s = 1; s < take->n_spectra; s++)
        bench_served_ratio(served, s);
    return served;
}

const float *bench_served_ratio(struct bench_served *served, uint32_t s)
{
    const struct ls_field_map *map = NULL;
    struct ls_diag diag = {""};
    if (s == 0)
        return NULL;
    must(ls_field_maps_get(&served->source, LS_MAP_SPHERE, s, NULL, &map, &diag), &diag);
    return map->values;
}

void bench_relit(void *data)
{
    const struct bench_relit *relit = data;
    struct ls_field_source *source = &relit->served->source;
    struct ls_render_term terms[LS_FIELD_MAX_SPECTRA];
    uint32_t n = source->field.n_spectra;
    struct ls_render *render = NULL;
    struct ls_diag diag = {""};
    for (uint32_t s = 0; s < n; s++)
        terms[s] =
            (struct ls_render_term){.channel = s,
                                    .weights = relit->weights + (size_t)s * source->field.n_lights,
                                    .target = -1};
    const struct ls_render_job job = {.promotion = {.model = LIGHTSTAGE__MODEL__SPHERE},
                                      .terms = terms,
                                      .n_terms = n,
                                      .n_pictures = 1,
                                      .region = {0, 0, source->width, source->height},
                                      .n_threads = relit->n_threads};
    must(ls_render_open(source, &job, &render, &diag), &diag);
    for (bool done = false; !done;) {
        struct ls_demosaic_region band;
        float *pixels = NULL;
        must(ls_render_step(render, &band, &pixels, &done, &diag), &diag);
        if (relit->out)
            memcpy(relit->out + (size_t)band.y * band.width * 3, pixels,
                   (size_t)band.width * band.height * 3 * sizeof *pixels);
        free(pixels);
    }
    ls_render_close(render);
}

void bench_served_destroy(struct bench_served *served)
{
    if (!served)
        return;
    ls_field_maps_destroy(served->source.promoted);
    free(served->source.no_tiles);
    free(served);
}

/* memory: promotion and relighting of a large picture hold a band of it, not all of it. */
#include "core/envlights.h"
#include "core/half.h"
#include "daemon/field_maps.h"
#include "daemon/field_numbers.h"
#include "daemon/render.h"
#include "tests/daemon/store_fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What a band takes depends on the width of the picture, not on its height: 192 rows will do. */
enum {
    WIDTH = 2048,
    HEIGHT = 192,
    LIGHTS = 28,
    SEGMENTS = 14,
    SPECTRA = 6,
    CHANNELS = SPECTRA + 2
};
enum { TILES_X = WIDTH / LS_TILE_SIDE, TILES = TILES_X * HEIGHT / LS_TILE_SIDE };
static const size_t ceiling_bytes = (size_t)256 << 20;

/* A source whose pictures all show the same tile: no picture needs memory. */
struct made {
    struct ls_field_source source;
    struct ls_take_facts facts;
    uint16_t tile[LS_TILE_SIDE * LS_TILE_SIDE];
    const void *tiles[TILES];
    uint32_t n;
};

static struct ls_condition_fact *add(struct made *made, enum ls_fact_kind kind, uint32_t channel,
                                     const char *pattern)
{
    struct ls_picture_map *map = &made->source.maps[made->n];
    struct ls_condition_fact *fact = &made->facts.conditions[made->n++];
    map->base = made->tile;
    map->tiles.tile = (const uint8_t **)made->tiles;
    fact->kind = kind;
    fact->channel = channel;
    fact->duty = 0.5;
    g_strlcpy(fact->pattern, pattern, sizeof fact->pattern);
    return fact;
}

static void light_lights(struct ls_condition_fact *fact, uint32_t first, uint32_t step, uint32_t n)
{
    fact->lights = calloc(n, sizeof *fact->lights);
    fact->n_lights = n;
    for (uint32_t j = 0; j < n; j++)
        fact->lights[j] = first + j * step;
}

static void add_channel(struct made *made, uint32_t channel)
{
    static const char names[] = "WRAGCBVH";
    made->facts.channels[channel].name[0] = names[channel];
    made->facts.channels[channel].polariser = channel >= SPECTRA;
    if (channel == 0 || channel >= SPECTRA)
        for (uint32_t i = 0; i < LIGHTS; i++)
            add(made, LS_FACT_ONE, channel, "")->light = i;
    if (channel >= SPECTRA)
        return;
    add(made, LS_FACT_SPHERE, channel, "sphere");
    light_lights(add(made, LS_FACT_HEADLIGHT, channel, "headlight"), 0, 1, 3);
    for (uint32_t q = 0; q < SEGMENTS; q++)
        light_lights(add(made, LS_FACT_SEGMENT, channel, "segments-14"), q, SEGMENTS,
                     LIGHTS / SEGMENTS);
}

static void fill_facts(struct made *made)
{
    struct ls_take_facts *facts = &made->facts;
    enum { MOST = CHANNELS * (LIGHTS + SEGMENTS + 2) };
    facts->n_lights = LIGHTS;
    facts->n_channels = CHANNELS;
    facts->position_m = calloc(LIGHTS, sizeof *facts->position_m);
    facts->conditions = calloc(MOST, sizeof *facts->conditions);
    made->source.maps = calloc(MOST, sizeof *made->source.maps);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        double z = 1 - 2 * (i + 0.5) / LIGHTS, a = 2.4 * i, r = sqrt(1 - z * z);
        facts->position_m[i][0] = (float)(r * cos(a));
        facts->position_m[i][1] = (float)(r * sin(a));
        facts->position_m[i][2] = (float)z;
    }
    facts->camera_position_m[2] = 3;
    facts->cfa = LS_CFA_RGGB;
    facts->full_scale_dn = 4095;
    facts->electrons_per_dn = 10;
    facts->read_noise_dn = 2;
    facts->reference_exposure_s = facts->exposure_s[0] = 0.01;
    facts->n_exposures = 1;
    for (uint32_t c = 0; c < CHANNELS; c++)
        add_channel(made, c);
    facts->n_conditions = made->n;
}

static void fill_set(struct made *made, struct ls_light_set *set, uint32_t channel)
{
    set->n_pictures = set->n_found = LIGHTS;
    set->pictures = calloc(LIGHTS, sizeof *set->pictures);
    set->n_groups = 1;
    set->group[0] = (struct ls_light_group){.n = LIGHTS, .channel = channel};
    for (uint32_t i = 0; i < LIGHTS; i++)
        set->pictures[i].tiles = made->tiles;
}

static struct made *make(void)
{
    struct made *made = g_new0(struct made, 1);
    struct ls_field_source *source = &made->source;
    source->facts = &made->facts;
    source->width = source->field.width = WIDTH;
    source->height = source->field.height = HEIGHT;
    char *root = new_root();
    g_strlcpy(source->storage, root, sizeof source->storage);
    g_free(root);
    for (int j = 0; j < LS_TILE_SIDE * LS_TILE_SIDE; j++)
        made->tile[j] = ls_half_from_float(0.5f + 0.1f * sinf(0.1f * (float)j));
    for (int t = 0; t < TILES; t++)
        made->tiles[t] = made->tile;
    fill_facts(made);
    source->field.n_lights = LIGHTS;
    source->field.n_channels = 3;
    source->field.cfa = LS_CFA_RGGB;
    source->field.n_spectra = SPECTRA;
    source->vertical = SPECTRA;
    source->horizontal = SPECTRA + 1;
    source->no_tiles = calloc(TILES, sizeof *source->no_tiles);
    source->sphere = calloc(SPECTRA, sizeof *source->sphere);
    for (uint32_t s = 0; s < SPECTRA; s++) {
        source->channel_of[s] = s;
        source->has_sphere[s] = true;
        source->sphere[s].tiles = made->tiles;
    }
    source->field.sphere = source->sphere;
    fill_set(made, &source->white, 0);
    fill_set(made, &source->set[0], 0);
    fill_set(made, &source->set[SPECTRA], SPECTRA);
    fill_set(made, &source->set[SPECTRA + 1], SPECTRA + 1);
    source->field.white = source->white.pictures;
    g_assert_cmpint(ls_field_maps_create(&source->promoted, NULL), ==, LS_OK);
    g_assert_cmpint(ls_field_numbers_fill(source, NULL), ==, LS_OK);
    return made;
}

static void made_free(struct made *made)
{
    struct ls_field_source *source = &made->source;
    ls_field_maps_destroy(source->promoted);
    ls_field_numbers_free(source);
    for (uint32_t c = 0; c < CHANNELS; c++)
        free(source->set[c].pictures);
    free(source->white.pictures);
    free(source->sphere);
    free(source->no_tiles);
    free(source->maps);
    for (uint32_t i = 0; i < made->n; i++)
        free(made->facts.conditions[i].lights);
    free(made->facts.conditions);
    free(made->facts.position_m);
    remove_tree(source->storage);
    g_free(made);
}

/* ---- watching ---- */

static size_t anonymous_bytes(void)
{
    char line[256];
    size_t kib = 0;
    FILE *file = fopen("/proc/self/status", "re");
    while (file && fgets(line, sizeof line, file))
        if (sscanf(line, "RssAnon: %zu kB", &kib) == 1)
            break;
    if (file)
        fclose(file);
    return kib << 10;
}

struct watch {
    int stop; /* atomic */
    size_t most;
};

static gpointer look(gpointer data)
{
    struct watch *watch = data;
    while (!g_atomic_int_get(&watch->stop)) {
        size_t now = anonymous_bytes();
        watch->most = now > watch->most ? now : watch->most;
        g_usleep(500); /* the kernel keeps no peak of anonymous memory: it is sampled */
    }
    return NULL;
}

/* ---- the test ---- */

/* All six spectra with weights of their own for R, G and B: the most sums a relight asks for. (Of
 * fitted ones three: they take a map at a time and a while.) */
static void relight(struct made *made, Lightstage__Model model)
{
    struct ls_render_term terms[3 * SPECTRA];
    struct ls_demosaic_region band;
    struct ls_render *render = NULL;
    struct ls_diag diag = {0};
    double w[LIGHTS];
    uint32_t n = 3 * (model == LIGHTSTAGE__MODEL__LINEAR ? 3 : SPECTRA);
    float *pixels = NULL;
    for (int i = 0; i < LIGHTS; i++)
        w[i] = 0.5 + i;
    for (uint32_t t = 0; t < n; t++)
        terms[t] =
            (struct ls_render_term){.channel = t / 3, .weights = w, .target = (int32_t)(t % 3)};
    const struct ls_render_job job = {.promotion = {.model = model},
                                      .terms = terms,
                                      .n_terms = n,
                                      .n_pictures = 1,
                                      .region = {0, 0, WIDTH, HEIGHT},
                                      .n_threads = 2};
    enum ls_err err = ls_render_open(&made->source, &job, &render, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (bool done = false; !done; free(pixels))
        g_assert_cmpint(ls_render_step(render, &band, &pixels, &done, &diag), ==, LS_OK);
    ls_render_close(render);
}

#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define SHADOWED 1
#endif
#endif

static void a_large_picture_is_promoted_and_relit_in_little_memory(void)
{
    static const char *const names[] = {"measured", "sphere", "headlight", "separated", "linear"};
#ifdef SHADOWED
    g_test_skip("ThreadSanitizer keeps several bytes for each of ours");
    return;
#endif
    for (int model = LIGHTSTAGE__MODEL__SPHERE; model <= LIGHTSTAGE__MODEL__LINEAR; model++) {
        struct made *made = make();
        size_t before = anonymous_bytes();
        struct watch watch = {0};
        GThread *thread = g_thread_new("watch", look, &watch);
        relight(made, (Lightstage__Model)model); /* makes its maps first */
        g_atomic_int_set(&watch.stop, 1);
        g_thread_join(thread);
        g_test_message("%s: %zu MiB of %zu", names[model], (watch.most - before) >> 20,
                       ceiling_bytes >> 20);
        g_assert_cmpuint(watch.most - before, <, ceiling_bytes);
        made_free(made);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/memory/a-large-picture-is-promoted-and-relit-in-little-memory",
                    a_large_picture_is_promoted_and_relit_in_little_memory);
    return g_test_run();
}

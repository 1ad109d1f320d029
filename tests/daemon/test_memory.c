/* memory: promotion and relighting of a large picture hold a band of it, not all of it. */
#include "core/envlights.h"
#include "core/half.h"
#include "daemon/field_maps.h"
#include "daemon/field_numbers.h"
#include "daemon/render.h"
#include "tests/daemon/store_fixture.h"

#include <malloc.h>
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

/* Sanitizers keep several bytes for each of ours, and what was freed. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { SHADOWED = 1 };
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer) || __has_feature(address_sanitizer)
enum { SHADOWED = 1 };
#else
enum { SHADOWED = 0 };
#endif
#else
enum { SHADOWED = 0 };
#endif

struct held {
    size_t anonymous,
        mapped; /* bytes; mapped: pages of files, the storage folder's nameless ones */
};

static struct held held_now(void)
{
    struct held held = {0};
    char line[256];
    size_t kib;
    FILE *file = fopen("/proc/self/status", "re");
    while (file && fgets(line, sizeof line, file)) {
        if (sscanf(line, "RssAnon: %zu kB", &kib) == 1)
            held.anonymous = kib << 10;
        if (sscanf(line, "RssFile: %zu kB", &kib) == 1 ||
            sscanf(line, "RssShmem: %zu kB", &kib) == 1)
            held.mapped += kib << 10;
    }
    if (file)
        fclose(file);
    return held;
}

struct watch {
    int stop; /* atomic */
    struct held most;
    struct held before;
    GThread *thread;
};

static gpointer look(gpointer data)
{
    struct watch *watch = data;
    while (!g_atomic_int_get(&watch->stop)) {
        struct held now = held_now();
        watch->most.anonymous = MAX(watch->most.anonymous, now.anonymous);
        watch->most.mapped = MAX(watch->most.mapped, now.mapped);
        g_usleep(500); /* the kernel keeps no peak of anonymous memory: it is sampled */
    }
    return NULL;
}

static void watch_begin(struct watch *watch)
{
    malloc_trim(0); /* what is free already would hide what is taken */
    *watch = (struct watch){.before = held_now()};
    watch->thread = g_thread_new("watch", look, watch);
}

/* @maps_bytes: what daemon/render.h says the maps take on disk. */
static void watch_end(struct watch *watch, const char *what, size_t maps_bytes)
{
    g_atomic_int_set(&watch->stop, 1);
    g_thread_join(watch->thread);
    size_t anonymous = watch->most.anonymous - MIN(watch->before.anonymous, watch->most.anonymous);
    size_t mapped = watch->most.mapped - MIN(watch->before.mapped, watch->most.mapped);
    g_test_message("%s: %zu MiB of %zu; pages of maps %zu KiB of %zu", what, anonymous >> 20,
                   ceiling_bytes >> 20, mapped >> 10, maps_bytes >> 10);
    g_assert_cmpuint(anonymous, <, ceiling_bytes);
    /* beside them the program's own text, as it is first run */
    g_assert_cmpuint(mapped, <=, maps_bytes + ((size_t)4 << 20));
}

/* ---- the test ---- */

static const char *const names[] = {"measured", "sphere", "headlight", "separated", "linear"};

/* Fitted ones take a map at a time and a while: three. */
static uint32_t spectra_of(Lightstage__Model model)
{
    return model == LIGHTSTAGE__MODEL__LINEAR ? 3 : SPECTRA;
}

/* Of white, photographed light by light, none; those of all other spectra are made together. */
static size_t maps_bytes(Lightstage__Model model)
{
    size_t pixel = model == LIGHTSTAGE__MODEL__LINEAR ? 36 : 12;
    return pixel * WIDTH * HEIGHT * (SPECTRA - 1);
}

/* false: too many pictures at once. */
static bool render(struct made *made, struct ls_render_job *job)
{
    struct ls_demosaic_region band;
    struct ls_render *render = NULL;
    struct ls_diag diag = {0};
    float *pixels = NULL;
    job->region = (struct ls_demosaic_region){0, 0, WIDTH, HEIGHT};
    enum ls_err err = ls_render_open(&made->source, job, &render, &diag);
    if (err == LS_ERR_LIMIT && job->n_pictures > 1)
        return false;
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (bool done = false; !done; free(pixels))
        g_assert_cmpint(ls_render_step(render, &band, &pixels, &done, &diag), ==, LS_OK);
    ls_render_close(render);
    return true;
}

/* Of every spectrum @n pictures, each for @targets colours with weights of their own. */
static bool relight(struct made *made, Lightstage__Model model, uint32_t n, uint32_t targets)
{
    uint32_t spectra = spectra_of(model), n_terms = n * spectra * targets;
    g_autofree struct ls_render_term *terms = g_new0(struct ls_render_term, n_terms);
    double w[LIGHTS];
    for (int i = 0; i < LIGHTS; i++)
        w[i] = 0.5 + i;
    for (uint32_t t = 0; t < n_terms; t++)
        terms[t] = (struct ls_render_term){.channel = t / targets % spectra,
                                           .weights = w,
                                           .target = targets == 1 ? -1 : (int32_t)(t % targets),
                                           .picture = t / targets / spectra};
    struct ls_render_job job = {.promotion = {.model = model},
                                .terms = terms,
                                .n_terms = n_terms,
                                .n_pictures = n,
                                .n_threads = 2};
    return render(made, &job);
}

/* As daemon/fetch_job.c asks for one light of each spectrum, one after the other. */
static void fetch(struct made *made, Lightstage__Model model)
{
    for (uint32_t s = 0; s < spectra_of(model); s++) {
        double w[LIGHTS] = {[LIGHTS / 2] = 1};
        const struct ls_render_term term = {.channel = s, .weights = w, .target = -1};
        struct ls_render_job job = {
            .promotion = {.model = model}, .terms = &term, .n_terms = 1, .n_pictures = 1};
        g_assert_true(render(made, &job));
    }
}

/* Each from a take without maps, which it makes first; a relight with weights of its own for R, G
 * and B: the most sums that one picture asks for. */
static void a_large_picture_is_promoted_and_relit_in_little_memory(void)
{
    for (int model = LIGHTSTAGE__MODEL__SPHERE; model <= LIGHTSTAGE__MODEL__LINEAR; model++)
        for (int k = 0; k < 2; k++) {
            struct made *made = make();
            struct watch watch;
            g_autofree char *what = g_strdup_printf("%s %s", names[model], k ? "fetch" : "relight");
            watch_begin(&watch);
            if (k)
                fetch(made, (Lightstage__Model)model);
            else
                g_assert_true(relight(made, (Lightstage__Model)model, 1, 3));
            watch_end(&watch, what, maps_bytes((Lightstage__Model)model));
            made_free(made);
        }
}

/* As many as a request may ask for, by LS_RENDER_MAX_TERMS or by what they hold. */
static void many_pictures_are_relit_in_little_memory(void)
{
    for (int model = LIGHTSTAGE__MODEL__SPHERE; model <= LIGHTSTAGE__MODEL__LINEAR; model++) {
        struct made *made = make();
        struct watch watch;
        uint32_t n = LS_RENDER_MAX_TERMS / spectra_of((Lightstage__Model)model);
        watch_begin(&watch);
        while (!relight(made, (Lightstage__Model)model, n, 1))
            n--;
        g_autofree char *what = g_strdup_printf("%s, %u pictures", names[model], n);
        watch_end(&watch, what, maps_bytes((Lightstage__Model)model));
        g_assert_cmpuint(n, >, 1);
        made_free(made);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    if (SHADOWED) {
        puts("1..0 # SKIP a sanitizer's memory is not ours; what runs here is run by other tests");
        return 0;
    }
    g_test_add_func("/memory/a-large-picture-is-promoted-and-relit-in-little-memory",
                    a_large_picture_is_promoted_and_relit_in_little_memory);
    g_test_add_func("/memory/many-pictures-are-relit-in-little-memory",
                    many_pictures_are_relit_in_little_memory);
    return g_test_run();
}

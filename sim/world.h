/*
 * world: the inside of a scene, shared by the files that build, light, photograph and judge it.
 * Layer: sim. Threads: as sim/scene.h. Ownership: everything belongs to the struct sim_scene.
 */
#ifndef LS_SIM_WORLD_H
#define LS_SIM_WORLD_H

#include "sim/bounce.h"
#include "sim/response.h"
#include "sim/scene.h"
#include "sim/sensor.h"
#include "sim/shade.h"
#include "sim/stamp_frames.h"
#include "sim/subject.h"
#include "sim/view.h"

#include <pthread.h>

/** A rendered condition: mosaics in half, radiance x sim_picture_scale. */
struct sim_picture {
    uint64_t hash; /* of the LEDs */
    uint32_t n_leds;
    struct sim_led *leds;
    uint16_t *half[SIM_MAX_CAMERAS]; /* NULL: not rendered */
    int wanted;                      /* by the newest program */
};

static const float sim_picture_scale = 256;

enum sim_world_kind {
    SIM_WORLD_TRACED,
    SIM_WORLD_STAMP,
    SIM_WORLD_REPLAY,
};

struct sim_scene {
    struct sim_scene_config config;
    enum sim_world_kind kind;
    struct sim_geometry geometry;
    struct sim_library library;
    struct sim_subject subject;
    struct sim_bounce bounce;
    struct sim_source source[SIM_MAX_CHANNELS];
    double polariser_gain; /* what V and H lose against an ideal polariser */
    float *gain;           /* [channel * n_lights + light] */
    struct ls_spectrum camera[SIM_MAX_CAMERAS][3]; /* sensitivities */
    uint32_t colours[SIM_MAX_CAMERAS];
    struct sim_response response[SIM_MAX_CAMERAS];
    struct sim_view view[SIM_MAX_CAMERAS];
    struct sim_sensor sensor[SIM_MAX_CAMERAS];
    float *replay; /* [light][pixel], radiance */
    struct sim_stamp_frames stamp_frames[SIM_MAX_CAMERAS];
    /* the committed program; lock: held to read by exposures, to write by commit */
    pthread_rwlock_t lock;
    struct sim_picture **pictures; /* every one known */
    uint32_t n_pictures;
    struct sim_picture **program; /* of each condition; NULL = dark */
    struct sim_condition *conditions;
    uint32_t n_conditions;
    /* the work light's pictures at full duty, by channel, made when first seen; lock */
    pthread_mutex_t work_lock;
    struct sim_picture *work[SIM_MAX_CHANNELS];
};

/** Full scale per second of radiance 1. */
double sim_world_rate(const struct sim_view_config *view);

/** LEDs of a condition that are not off. */
uint32_t sim_world_lit(const struct sim_led *leds, uint32_t n_leds);

/** Weight of one LED among @n_lit: duty x gain / droop. */
float sim_world_weight(const struct sim_scene *scene, const struct sim_led *led, uint32_t n_lit);

/** Factors A (material) and B (flat) of sim_tile_shade's terms for a source at every pixel of a
 * tile; @colour: camera channel, or -1 for each pixel's own of the mosaic. */
void sim_tile_factors(const struct sim_tile *tile, const struct sim_response *response,
                      uint32_t source, int colour, float *a, float *b);

/** out[k] += weight x radiance without bounce; @kind and @diffuse of the source. */
void sim_tile_add(const struct sim_terms *terms, enum sim_channel_kind kind, float diffuse,
                  const float *a, const float *b, float weight, float *out);

/** out[k] += bounced radiance, from node values [node * n_colours + colour]. */
void sim_tile_bounce(const struct sim_tile *tile, const float *nodes, uint32_t n_colours,
                     int colour, float *out);

/** The same of three colours at once, to the bit. */
void sim_tile_bounce_rgb(const struct sim_tile *tile, const float *nodes,
                         float out[3][SIM_TILE_PX]);

/** Render pictures of one camera (their half[camera] is allocated). (sim/render.c) */
LS_MUST_CHECK enum ls_err sim_render(const struct sim_scene *scene, uint32_t camera,
                                     struct sim_picture *const *pictures, uint32_t n,
                                     sim_scene_progress *progress, void *user,
                                     struct ls_diag *diag);

/** What the work light of @channel shows at full duty; rendered by the first who asks, who waits
 * for it. (transfer none). NULL: no such channel, or out of memory. (sim/pictures.c) */
const struct sim_picture *sim_work_picture(struct sim_scene *scene, uint32_t channel);

/** Free the program and every picture. (sim/pictures.c) */
void sim_pictures_finish(struct sim_scene *scene);

/** Load a folder's images. (sim/replay.c) */
LS_MUST_CHECK enum ls_err sim_replay_load(struct sim_scene *scene, struct ls_diag *diag);

#endif

/*
 * model_room: a small take that holds every kind of picture, open as the daemon opens it, and what
 * is expected of it. Layer: tests. Threads: one, but red_by any. Ownership: the room's; pictures
 * are g_free'd by whoever asked.
 */
#ifndef LS_TESTS_DAEMON_MODEL_ROOM_H
#define LS_TESTS_DAEMON_MODEL_ROOM_H

#include "daemon/render.h"
#include "tests/daemon/full_take.h"

enum { VALUES = 3 * FULL_PIXELS, MODELS = 4 };

extern const struct ls_demosaic_region whole;

/** All that promote. */
extern const Lightstage__Model models[MODELS];

struct room {
    struct full_take *take;
    struct ls_field_source *source;
};

/** @data: struct full_take_options, or NULL. */
void room_enter(struct room *room, gconstpointer data);
void room_leave(struct room *room, gconstpointer data);

/** Of either sign. */
void fill_weights(double w[FULL_LIGHTS]);

/** [pictures][rows][columns][3] of a region; bands are put together. */
float *rendered(struct room *room, const struct ls_render_job *job);

/** The same; *report as it is at the end. */
float *rendered_with_report(struct room *room, const struct ls_render_job *job,
                            struct ls_render_report *report);

/** R under weights. */
float *red_by(struct room *room, Lightstage__Model model, const double *w);

/** Sum over lights of w k E of a channel, added to [pixels] of the mosaic. */
void add_lights(const struct full_take *take, int channel, const double *w, float *mosaic);

float *demosaiced(const struct room *room, const float *mosaic);

/** The sum over lights of a channel, demosaiced. */
float *summed(const struct room *room, int channel, const double *w);

/** A stored picture of a pattern as the sum of its lights, demosaiced. */
float *scaled(const struct room *room, const float *picture, const char *pattern);

/** g(i,R) for the lights of which @of says so, else 0. */
void strengths(const struct full_take *take, bool (*of)(int i, int q), int q,
               double g[FULL_LIGHTS]);
bool every(int i, int q);

/** g k of white. */
void row_of(const struct full_take *take, const double *g, float row[FULL_LIGHTS]);

/** Sums of eighteen values of at most about 1, in float here and there: 1e-6 of each; ratios and
 * matrices are below 3. So 1e-4 of the largest value expected. */
void assert_close(const struct room *room, const float *got, const float *expected);

#endif

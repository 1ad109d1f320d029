/*
 * paper_take: the stage's samples as pictures of a camera.
 * Layer: tests. Threads: one. Ownership: paper_take_finish; pictures are g_free'd by whoever asked.
 *
 * Every sample is a square of 10 x 10 equal pixels, through a Bayer mosaic or the paper's mono mix,
 * in halves, with strengths that spread: what the product runs on. Demosaicing changes nothing in
 * the middle of a square, nor does the contrast at its border. Without noise, so that errors are
 * those of models.
 */
#ifndef LS_TESTS_SIM_PAPER_TAKE_H
#define LS_TESTS_SIM_PAPER_TAKE_H

#include "core/separated.h"
#include "tests/sim/paper_stage.h"

enum { ACROSS = 6, SQUARE = 10, SIDE = ACROSS * SQUARE, PIXELS = SIDE * SIDE };

_Static_assert((int)ACROSS *ACROSS == (int)SAMPLES && (int)SIDE <= (int)LS_TILE_SIDE,
               "one tile of squares");

enum model { MEASURED, SPHERE, HEAD_LIGHT, SEPARATED, LINEAR, MODELS };

extern const struct ls_demosaic_region paper_whole;

struct paper_take {
    const struct stage *stage;
    int colours;
    samples_of *rgb;    /* [LIGHTS], of the camera */
    uint16_t *halves;   /* [CHANNELS][LIGHTS][PIXELS] */
    const void **tiles; /* [CHANNELS][LIGHTS] */
    struct ls_picture pictures[CHANNELS][LIGHTS];
    double p[CHANNELS][3];
    struct ls_field field;
    struct ls_split split[LIGHTS];
    struct ls_separated_field polarised;
    /* of the model promoted last */
    enum model model;
    float *map[SPECTRA]; /* ratios, matrices, ratios of segments; NULL: as photographed */
    double *phi;         /* mono, LINEAR: [LIGHTS][SEGMENTS] */
};

/** Photographed by a colour camera or a mono one. Finish it before the stage. */
struct paper_take *paper_take_new(const struct stage *stage, bool mono);
void paper_take_finish(struct paper_take *take);

/** Free the maps. */
void paper_take_forget(struct paper_take *take);

/** Which lights. */
typedef bool paper_choice(const struct stage *stage, int light, uint32_t of);
bool paper_every(const struct stage *stage, int light, uint32_t of);
bool paper_segment(const struct stage *stage, int light, uint32_t of);
/** The three nearest to the camera. */
bool paper_head(const struct stage *stage, int light, uint32_t of);

/** F: those lights at once, of spectrum s; [PIXELS][colours]. */
float *paper_take_photograph(const struct paper_take *take, int s, paper_choice *of, uint32_t q);

/** The lights of a channel under w, [PIXELS] of the mosaic. */
float *paper_take_sum(const struct paper_take *take, int channel, const double *w);

/** V: white under the strengths of s (times phi of a segment), [PIXELS][colours]; @row as
 * ls_promote_sigma wants it. */
float *paper_take_white(const struct paper_take *take, int s, paper_choice *of, uint32_t q,
                        const double *phi, float row[LIGHTS]);

float *paper_take_demosaic(const struct paper_take *take, const float *mosaic);

#endif

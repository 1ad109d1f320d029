/*
 * random_segments: random pictures of segments, as core/linear.h takes them, and their fit.
 * Layer: tests. Threads: the test's own. Ownership: random_segments_finish.
 */
#ifndef LS_TESTS_CORE_RANDOM_SEGMENTS_H
#define LS_TESTS_CORE_RANDOM_SEGMENTS_H

#include "core/linear_block.h"

#include <glib.h>

enum { RANDOM_SEGMENTS_MAX = 32 };

/** p of six inputs and of three outputs. */
extern const double random_segments_white[6], random_segments_amber[3];

struct random_segments {
    GRand *rand;
    struct ls_linear_pictures pictures; /* 20 lights per segment, no noise */
    struct ls_linear_options options;
    float *v[RANDOM_SEGMENTS_MAX], *f[RANDOM_SEGMENTS_MAX], *m;
    struct ls_linear_noise noise[RANDOM_SEGMENTS_MAX]; /* of v and f */
};

/** All zero; @seed is printed. */
void random_segments_init(struct random_segments *x, guint32 seed, uint32_t width, uint32_t height,
                          uint32_t segments, uint32_t n_in, uint32_t n_out);
void random_segments_finish(struct random_segments *x);

size_t random_segments_pixels(const struct random_segments *x);

/** V of light that varies in brightness from @darkest to 1 and in colour by a half. */
void random_segments_shade(struct random_segments *x, double darkest);

/** F as any linear map of each pixel makes it; its coefficients in truth[pixels][n_out][n_in]. */
void random_segments_reflect(struct random_segments *x, double *truth);

/** All of it, at its place. With @step the error too. */
struct ls_linear_part random_segments_whole(struct random_segments *x, uint32_t step,
                                            struct ls_linear_error *error);
void random_segments_fit(struct random_segments *x);

#endif

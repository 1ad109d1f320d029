/*
 * render_frames: which frames lightstage-render makes, under which light, and where they go.
 * Layer: clients. Threads: the main thread; read-only afterwards. Ownership: owns its strings.
 */
#ifndef LS_CLIENTS_RENDER_FRAMES_H
#define LS_CLIENTS_RENDER_FRAMES_H

#include <stdbool.h>
#include <stdint.h>

enum { LS_RENDER_MAX_FRAMES = 1000000 };

struct ls_render_frame {
    uint32_t number;
    char *light;     /* environment file */
    double turn_deg; /* it is turned by */
    char *path;      /* of the frame */
};

struct ls_render_frames {
    struct ls_render_frame *items;
    uint32_t n;
};

/** Numbers FIRST, FIRST + STEP .. up to LAST. */
struct ls_frame_range {
    uint32_t first, last, step; /* step 0: not given */
};

/** "7", "1-48", "1-48x2". */
bool ls_frame_range_option(const char *text, struct ls_frame_range *out);

/** "FROM,TO", degrees. */
bool ls_turn_range_option(const char *text, double out[2]);

/**
 * Frames of the environments lights[n]: one with a number in its name (sky.%04d.exr) is one for
 * each of @range; one without is the same for all of it; several are a frame each, numbered from 1
 * or by
 * @range. The environment turns evenly from turn[0] at the first frame to turn[1] at the last.
 * @output: the frames' names, with a number where there are several; no environment is one of
 * them. LS_EXIT_OK or the exit code, said already; finish in any case.
 */
int ls_render_frames_make(const char *const *lights, uint32_t n, const struct ls_frame_range *range,
                          const double turn[2], const char *output, struct ls_render_frames *out);

/** Zeroed is allowed. */
void ls_render_frames_finish(struct ls_render_frames *frames);

#endif

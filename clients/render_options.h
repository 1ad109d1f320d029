/*
 * render_options: the command line of lightstage-render.
 * Layer: clients. Threads: the main thread. Ownership: finish frees; strings are the command
 * line's.
 */
#ifndef LS_CLIENTS_RENDER_OPTIONS_H
#define LS_CLIENTS_RENDER_OPTIONS_H

#include "clients/command.h"
#include "clients/relight_options.h"
#include "clients/render_frames.h"

enum { LS_RENDER_MAX_JOBS = 16 };

struct ls_render_options {
    struct ls_relight_options relight; /* take, and how a picture is made */
    struct ls_render_frames frames;
    uint32_t jobs; /* connections, each with batches of its own */
    bool again;    /* what is there is made anew */
    bool quiet;
};

extern const struct ls_command ls_command_render;

/** LS_EXIT_OK or the exit code, said already. *out: zeroed; finish in any case. */
int ls_render_options_parse(struct ls_command_context *context, int argc, char **argv,
                            struct ls_render_options *out);

/** Zeroed is allowed. */
void ls_render_options_finish(struct ls_render_options *options);

#endif

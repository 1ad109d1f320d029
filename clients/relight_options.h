/*
 * relight_options: the command line of relight, and the pictures it asks for.
 * Layer: clients. Threads: the main thread. Ownership: the lists and row weights; strings are the
 * command line's.
 */
#ifndef LS_CLIENTS_RELIGHT_OPTIONS_H
#define LS_CLIENTS_RELIGHT_OPTIONS_H

#include "clients/command.h"
#include "clients/environment_file.h"
#include "clients/light_weights.h"
#include "core/profile.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_RELIGHT_MAX_TURNS = 1024 };

struct ls_relight_options {
    const char *take;
    const char *exr, *png; /* with a number in it where there are several pictures */
    const char **lights;   /* [n_lights] what it is relit with: environments, or files of weights */
    uint32_t n_lights;
    double *turns; /* [n_turns], degrees: each environment turned by each */
    uint32_t n_turns;
    bool weights;
    bool solved; /* an option of the environment's solve was given */
    bool raw;
    struct ls_light_options solve; /* but for the turn */
    struct ls_row_weights rows;    /* that solve points to, if any */
    const struct ls_profile *profile;
    double exposure, max_error;
    bool exposure_given;
    struct lightstage_promotion promotion;
    enum ls_map_space space;
    uint32_t camera;
    struct lightstage_region region;
    uint32_t level;
};

/** LS_EXIT_OK or the exit code, said already. *out: zeroed; finish in any case. */
int ls_relight_options_parse(struct ls_command_context *context, int argc, char **argv,
                             struct ls_relight_options *out);

/** Zeroed is allowed. */
void ls_relight_options_finish(struct ls_relight_options *options);

/** One for each environment and turn, the turns of an environment together. */
uint32_t ls_relight_pictures(const struct ls_relight_options *options);
const char *ls_relight_light(const struct ls_relight_options *options, uint32_t picture);
double ls_relight_turn(const struct ls_relight_options *options, uint32_t picture);

#endif

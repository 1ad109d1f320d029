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
#include "clients/promotion_option.h"
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

/** Those that say how a picture is made, for a command's table. */
enum {
    LS_RELIGHT_SOLVE = 800,
    LS_RELIGHT_RAW,
    LS_RELIGHT_SPACE,
    LS_RELIGHT_REGION,
    LS_RELIGHT_MAX_ERROR,
    LS_RELIGHT_CAMERA,
    LS_RELIGHT_METHOD,
    LS_RELIGHT_CELLS,
    LS_RELIGHT_PROFILE,
    LS_RELIGHT_TIKHONOV,
    LS_RELIGHT_ROW_WEIGHTS,
    LS_RELIGHT_LEVEL,
};
#define LS_RELIGHT_OPTIONS                                                \
    {"solve", required_argument, NULL, LS_RELIGHT_SOLVE},                 \
        {"raw", no_argument, NULL, LS_RELIGHT_RAW},                       \
        {"space", required_argument, NULL, LS_RELIGHT_SPACE},             \
        {"region", required_argument, NULL, LS_RELIGHT_REGION},           \
        {"max-error", required_argument, NULL, LS_RELIGHT_MAX_ERROR},     \
        {"camera", required_argument, NULL, LS_RELIGHT_CAMERA},           \
        {"method", required_argument, NULL, LS_RELIGHT_METHOD},           \
        {"cells", required_argument, NULL, LS_RELIGHT_CELLS},             \
        {"profile", required_argument, NULL, LS_RELIGHT_PROFILE},         \
        {"tikhonov", required_argument, NULL, LS_RELIGHT_TIKHONOV},       \
        {"row-weights", required_argument, NULL, LS_RELIGHT_ROW_WEIGHTS}, \
        {"level", required_argument, NULL, LS_RELIGHT_LEVEL}, LS_PROMOTION_OPTIONS
/** The lines of a command's usage about how strengths are solved for. */
#define LS_RELIGHT_SOLVE_USAGE                                                                  \
    "         [--solve spectral|tristimulus|shared|per-target] [--method nnls|least-squares]\n" \
    "         [--tikhonov T] [--row-weights FILE.json]\n"                                       \
    "         [--cells nearest|smooth] [--profile paper]\n"

/** The defaults of these. */
void ls_relight_options_init(struct ls_relight_options *out);

/** Take one of these options. LS_EXIT_OK or the exit code, said already. */
int ls_relight_option(struct ls_relight_options *out, int option);

/** What does not go together, and what follows from them. LS_EXIT_OK or the exit code. */
int ls_relight_options_settle(struct ls_relight_options *out);

/** A matrix that was asked for by name takes the place of the calibration's. LS_EXIT_OK or the exit
 * code, said already. */
int ls_relight_use_profile(const struct ls_relight_options *options,
                           struct ls_take_document *document);

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

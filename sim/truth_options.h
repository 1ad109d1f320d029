/*
 * truth_options: the command line of lightstage-sim's questions about the truth.
 * Layer: sim. Threads: one. Ownership: values; strings point into argv.
 */
#ifndef LS_SIM_TRUTH_OPTIONS_H
#define LS_SIM_TRUTH_OPTIONS_H

#include "sim/truth.h"

enum { SIM_MAX_DUTIES = 64 };

enum sim_truth_need {
    SIM_NEED_OUTPUT = 1,
    SIM_NEED_LIGHTS = 2,
    SIM_NEED_CHANNELS = 4,
    SIM_NEED_WEIGHTS = 8,
    SIM_NEED_LOBES = 16,
};

struct sim_truth_options {
    struct sim_region region; /* default: the whole sensor of camera 0 */
    int mosaic;
    const char *output, *weights, *lobes, *pixel_format;
    uint32_t n_lights, lights[SIM_MAX_LIGHTS];
    uint32_t n_channels, channels[SIM_MAX_CHANNELS];
    uint32_t n_duties;
    double duties[SIM_MAX_DUTIES];
};

/**
 * argv[0] is the subcommand; --config FILE is skipped. Errors: LS_ERR_INVALID naming the option.
 * Defaults: a set of usual duties, 1 and the ninetieth that makes a full sphere as bright as one
 * front light among them; the pixel format of the camera's filter at 12 bits.
 */
LS_MUST_CHECK enum ls_err sim_truth_options_parse(const struct sim_scene *scene, int argc,
                                                  char **argv, unsigned needs,
                                                  struct sim_truth_options *out,
                                                  struct ls_diag *diag);

#endif

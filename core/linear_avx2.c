#include "core/linear_lanes.inc"

const struct ls_linear_kernels ls_linear_kernels_avx2 = {fit, predict};

#include "core/separated_lanes.inc"

const struct ls_separated_kernels ls_separated_kernels_avx512 = {widen, split, sigma, conductor,
                                                                 add};

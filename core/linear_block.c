#include "core/linear_lanes.inc"

double ls_linear_trust(double snr)
{
    return trust_of(snr);
}

const struct ls_linear_kernels ls_linear_kernels_c = {fit, predict};

const struct ls_linear_kernels *ls_linear_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_linear_kernels_c, &ls_linear_kernels_avx2,
                       &ls_linear_kernels_avx512);
}

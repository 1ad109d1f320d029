#include "core/demosaic_lanes.h"

#if LANES != 8
#error "compile with the flags of its library"
#endif

static void line(const struct ls_demosaic_line *l)
{
    demosaic_line(l);
}

const struct ls_demosaic_kernels ls_demosaic_kernels_avx2 = {line};

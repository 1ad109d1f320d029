#include "core/merge_lanes.h"

#if LANES != 16
#error "compile with the flags of its library"
#endif

static void run(const struct ls_merge_model *m, const struct ls_merge_lines *l, size_t n)
{
    merge_any(m, l, n);
}

const struct ls_merge_kernels ls_merge_kernels_avx512 = {run};

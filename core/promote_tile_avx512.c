#include "core/promote_tile_lanes.h"

#if LANES != 16
#error "compile with the flags of its library"
#endif

static size_t run(const struct ls_promote_tile *tile)
{
    return promote_tile(tile);
}

const struct ls_promote_tile_kernels ls_promote_tile_kernels_avx512 = {run};

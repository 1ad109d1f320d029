#include "core/promote_tile.h"

#include "core/promote_tile_lanes.h"

static size_t run_c(const struct ls_promote_tile *tile)
{
    return promote_tile(tile);
}

const struct ls_promote_tile_kernels ls_promote_tile_kernels_c = {run_c};

const struct ls_promote_tile_kernels *ls_promote_tile_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_promote_tile_kernels_c, &ls_promote_tile_kernels_avx2,
                       &ls_promote_tile_kernels_avx512);
}

size_t ls_promote_tile(const struct ls_promote_tile *tile)
{
    return ls_promote_tile_kernels(ls_cpu_isa())->run(tile);
}

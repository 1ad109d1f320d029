/*
 * promote_tile_kernels: promote_tile.h, once per instruction set. All return the same bits.
 * Layer: core, inside promote_tile, its tests and benches. Threads: any; pure. Ownership: none.
 */
#ifndef LS_CORE_PROMOTE_TILE_KERNELS_H
#define LS_CORE_PROMOTE_TILE_KERNELS_H

#include "core/cpu.h"
#include "core/promote_tile.h"

struct ls_promote_tile_kernels {
    size_t (*run)(const struct ls_promote_tile *tile); /* as ls_promote_tile */
};

extern const struct ls_promote_tile_kernels ls_promote_tile_kernels_c, ls_promote_tile_kernels_avx2,
    ls_promote_tile_kernels_avx512;

/** (transfer none). RT-safe. */
const struct ls_promote_tile_kernels *ls_promote_tile_kernels(enum ls_isa isa);

#endif

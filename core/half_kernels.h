/*
 * half_kernels: the conversions of half.h, one instance per instruction set. All return the same
 * bits. Layer: core. Threads: any; pure. Users include half.h; this is for the kernels' own files
 * and their tests.
 */
#ifndef LS_CORE_HALF_KERNELS_H
#define LS_CORE_HALF_KERNELS_H

#include "core/cpu.h"

#include <stddef.h>
#include <stdint.h>

struct ls_half_kernels {
    /* as ls_half_from_floats, ls_half_to_floats */
    void (*from_floats)(const float *in, uint16_t *out, size_t n);
    void (*to_floats)(const uint16_t *in, float *out, size_t n);
};

extern const struct ls_half_kernels ls_half_kernels_c, ls_half_kernels_avx2, ls_half_kernels_avx512;

/** (transfer none). RT-safe. */
const struct ls_half_kernels *ls_half_kernels(enum ls_isa isa);

#endif

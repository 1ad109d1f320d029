/*
 * emulated_cpu: what core/cpu.h says in the tests that emulate AVX-512 (avx512_emulated.h): that it
 * is there wherever the emulation runs.
 * Layer: tests. Threads: any; no state of its own. Ownership: nothing to own.
 */
#include "core/cpu.h"

const char *ls_isa_name(enum ls_isa isa)
{
    static const char *const names[LS_ISA_COUNT] = {"avx512", "avx2", "c"};
    return names[isa];
}

bool ls_isa_runs(enum ls_isa isa)
{
    return isa == LS_ISA_C || (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"));
}

enum ls_isa ls_cpu_isa(void)
{
    return ls_isa_runs(LS_ISA_AVX512) ? LS_ISA_AVX512 : LS_ISA_C;
}

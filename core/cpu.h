/*
 * cpu: which instruction sets this processor runs, and how a family of kernels offers one
 * instance for each of them.
 * Layer: core. Threads: any; no state of its own. Ownership: nothing to own.
 *
 * A kernel family is a `const struct` of function pointers with one instance per instruction set,
 * each compiled in a library of its own flags (core/meson.build), and one accessor:
 *
 *     const struct ls_half_kernels *ls_half_kernels(enum ls_isa isa)
 *     {
 *         return LS_ISA_PICK(isa, &ls_half_kernels_c, &ls_half_kernels_avx2,
 *                            &ls_half_kernels_avx512);
 *     }
 *
 * Users ask for ls_half_kernels(ls_cpu_isa()), once per job where they can. Tests walk every
 * instruction set for which ls_isa_runs says true. Instances return the same bits unless their
 * header says otherwise: fused operations only where the C reference writes fmaf.
 */
#ifndef LS_CORE_CPU_H
#define LS_CORE_CPU_H

#include <stdbool.h>

/** Fastest first: the order is the policy. */
enum ls_isa {
    LS_ISA_AVX512, /* AVX-512 F, BW, DQ, VL, and all of AVX2 below */
    LS_ISA_AVX2,   /* AVX2, FMA, F16C */
    LS_ISA_C,      /* whatever the compiler may assume; runs everywhere */
    LS_ISA_COUNT,
};

/** "avx512", "avx2", "c". (transfer none). RT-safe. */
const char *ls_isa_name(enum ls_isa isa);

/** Does this processor have it, and does the operating system keep its registers (XCR0)?
 * A few loads and tests: what the compiler's runtime found before main. RT-safe. */
bool ls_isa_runs(enum ls_isa isa);

/** The fastest that runs. RT-safe. */
enum ls_isa ls_cpu_isa(void);

/** One of three instances. Only @c exists off x86-64 (and with LS_PORTABLE): the others are then
 * not named at all. A family without an instance of its own names the next slower one twice. */
#if defined(__x86_64__) && !defined(LS_PORTABLE)
#define LS_ISA_PICK(isa, c, avx2, avx512) \
    ((isa) == LS_ISA_AVX512 ? (avx512) : (isa) == LS_ISA_AVX2 ? (avx2) : (c))
#else
#define LS_ISA_PICK(isa, c, avx2, avx512) ((void)(isa), (c))
#endif

#endif

#include "core/cpu.h"

const char *ls_isa_name(enum ls_isa isa)
{
    static const char *const names[LS_ISA_COUNT] = {"avx512", "avx2", "c"};
    return names[isa];
}

#if defined(__x86_64__) && !defined(LS_PORTABLE)
/* clang 14 cannot ask for F16C: there FMA stands for it, which no processor has without F16C */
static bool has_f16c(void)
{
#if defined(__clang__)
    return __builtin_cpu_supports("fma");
#else
    return __builtin_cpu_supports("f16c");
#endif
}

static bool has_avx2(void)
{
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && has_f16c();
}

static bool has_avx512(void)
{
    return has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
}
#else
static bool has_avx2(void)
{
    return false;
}

static bool has_avx512(void)
{
    return false;
}
#endif

bool ls_isa_runs(enum ls_isa isa)
{
    return isa == LS_ISA_AVX512 ? has_avx512() : isa == LS_ISA_AVX2 ? has_avx2() : true;
}

enum ls_isa ls_cpu_isa(void)
{
    return has_avx512() ? LS_ISA_AVX512 : has_avx2() ? LS_ISA_AVX2 : LS_ISA_C;
}

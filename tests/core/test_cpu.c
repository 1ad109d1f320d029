#include "core/cpu.h"

#include "tests/core/isas.h"

#include <glib.h>
#include <string.h>

#if defined(__x86_64__)
#include <cpuid.h>

/* What the kernel lists, which has asked both processor and itself. */
static gboolean listed(const char *flag)
{
    g_autofree char *text = NULL;
    g_autofree char *word = g_strdup_printf(" %s ", flag);
    if (!g_file_get_contents("/proc/cpuinfo", &text, NULL, NULL))
        return FALSE;
    for (char *c = text; *c; c++)
        if (*c == '\n')
            *c = ' ';
    return strstr(text, word) != NULL;
}

static void test_the_kernel_agrees(void)
{
    gboolean avx2 = listed("avx2") && listed("fma") && listed("f16c");
    gboolean avx512 =
        avx2 && listed("avx512f") && listed("avx512bw") && listed("avx512dq") && listed("avx512vl");
    if (!listed("sse2")) {
        g_test_skip("/proc/cpuinfo does not list the processor's flags");
        return;
    }
    g_assert_cmpint(ls_isa_runs(LS_ISA_AVX2), ==, avx2);
    g_assert_cmpint(ls_isa_runs(LS_ISA_AVX512), ==, avx512);
}

/* A register that the system does not save is one that must not be used. */
static void test_no_set_outlives_its_registers(void)
{
    unsigned a, b, c = 0, d, low = 0, high;
    g_assert_true(__get_cpuid(1, &a, &b, &c, &d));
    if (c & bit_OSXSAVE)
        __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (ls_isa_runs(LS_ISA_AVX2))
        g_assert_cmphex(low & 0x06, ==, 0x06); /* XMM, YMM */
    if (ls_isa_runs(LS_ISA_AVX512))
        g_assert_cmphex(low & 0xe6, ==, 0xe6); /* and masks, both parts of ZMM */
}
#else
static void test_the_kernel_agrees(void)
{
    g_assert_cmpint(ls_cpu_isa(), ==, LS_ISA_C);
}

static void test_no_set_outlives_its_registers(void)
{
    g_test_skip("this processor is not x86-64");
}
#endif

static void test_the_fastest_that_runs_is_chosen(void)
{
    int isa = 0;
    while (!ls_isa_runs((enum ls_isa)isa))
        isa++;
    g_assert_cmpint(ls_cpu_isa(), ==, isa);
    g_assert_true(ls_isa_runs(LS_ISA_C));
    g_test_message("%s", ls_isa_name(ls_cpu_isa()));
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/cpu/the-kernel-lists-what-runs", test_the_kernel_agrees);
    g_test_add_func("/cpu/no-set-outlives-its-registers", test_no_set_outlives_its_registers);
    g_test_add_func("/cpu/the-fastest-that-runs-is-chosen", test_the_fastest_that_runs_is_chosen);
    return g_test_run();
}

/*
 * isas: one test case per instruction set; what this processor lacks is skipped and says so.
 * Layer: tests. Threads: the test's own. Ownership: nothing to own.
 */
#ifndef LS_TESTS_CORE_ISAS_H
#define LS_TESTS_CORE_ISAS_H

#include "core/cpu.h"

#include <glib.h>

/** The instruction set a case of isas_add is for. */
static inline enum ls_isa isas_of(const void *data)
{
    return (enum ls_isa)GPOINTER_TO_INT(data);
}

static inline void isas_skip(const void *data)
{
    g_autofree char *why =
        g_strdup_printf("this processor does not run %s", ls_isa_name(isas_of(data)));
    g_test_skip(why);
}

/** Adds PATH/avx512, PATH/avx2 and PATH/c; @test gets its set by isas_of. */
static inline void isas_add(const char *path, void (*test)(const void *data))
{
    for (int isa = 0; isa < LS_ISA_COUNT; isa++) {
        g_autofree char *name = g_strdup_printf("%s/%s", path, ls_isa_name((enum ls_isa)isa));
        g_test_add_data_func(name, GINT_TO_POINTER(isa),
                             ls_isa_runs((enum ls_isa)isa) ? test : isas_skip);
    }
}

#endif

/*
 * shared_data: where measured data lies beside the checkout, for tests that can use it.
 * Layer: tests. Threads: any. Ownership: strings are (transfer full), g_free.
 */
#ifndef LS_TESTS_CORE_SHARED_DATA_H
#define LS_TESTS_CORE_SHARED_DATA_H

#include <glib.h>

/** Path of @relative under LS_SHARED_DATA, else <source root>/../shared/data; NULL after skipping
 * the running test with a message if it is not there. */
static inline char *shared_data(const char *relative)
{
    const char *given = g_getenv("LS_SHARED_DATA"), *source = g_getenv("LS_SOURCE_ROOT");
    char *path =
        given ? g_build_filename(given, relative, NULL)
              : g_build_filename(source ? source : ".", "..", "shared", "data", relative, NULL);
    if (g_file_test(path, G_FILE_TEST_EXISTS))
        return path;
    char *why = g_strdup_printf("no %s: set LS_SHARED_DATA", path);
    g_test_skip(why);
    g_free(why);
    g_free(path);
    return NULL;
}

#endif

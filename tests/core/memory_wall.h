/*
 * memory_wall: what readers of hostile files may take. Layer: tests. Threads: before any.
 */
#ifndef LS_TESTS_CORE_MEMORY_WALL_H
#define LS_TESTS_CORE_MEMORY_WALL_H

#include <sys/resource.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define UNDER_CLANG_ASAN
#endif
#endif

/** A reader that believes a hostile header runs into this wall: all that the tests read fits well
 * into 1 GiB of address space. Under AddressSanitizer the shadow alone is larger. */
static inline void memory_wall(void)
{
#if !defined(__SANITIZE_ADDRESS__) && !defined(UNDER_CLANG_ASAN)
    struct rlimit wall = {(rlim_t)1 << 30, (rlim_t)1 << 30};
    setrlimit(RLIMIT_AS, &wall);
#endif
}

#endif

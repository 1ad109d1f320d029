/*
 * fuzz: what the targets of this folder share. A target is a function over a span of bytes; it is
 * linked to libFuzzer where the compiler has it and AddressSanitizer is on, else to replay.c, which
 * gives it the files of its corpus. Threads: one.
 */
#ifndef LS_TESTS_FUZZ_H
#define LS_TESTS_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/** The target. Returns 0. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n);

/** A property that must hold, whatever the bytes say. */
#define HOLDS(condition)                                                                   \
    do {                                                                                   \
        if (!(condition)) {                                                                \
            fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition); \
            abort();                                                                       \
        }                                                                                  \
    } while (0)

/** A refusal has its sentence, which whoever reads it can print. */
#define HOLDS_REFUSED(err, diag)        \
    do {                                \
        HOLDS((err) != LS_ERR_BUG);     \
        HOLDS(!(err) == !*(diag).text); \
    } while (0)

/** The bytes and a NUL. (transfer full) */
char *fuzz_text(const uint8_t *data, size_t n);

/** A folder of this process, in memory where there is /dev/shm; removed at exit. */
const char *fuzz_folder(void);

/** Put a file into it. */
void fuzz_file(const char *name, const void *bytes, size_t n);

/** Bytes that are allocated now; 0 where there is no AddressSanitizer to ask. */
size_t fuzz_allocated(void);

#endif

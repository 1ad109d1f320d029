/*
 * against_copy: rows of kernels that are held against copying as many bytes as they read and write.
 * Layer: tests. Threads: the program's main thread. Ownership: the buffers are freed by the caller.
 */
#ifndef LS_TESTS_BENCH_AGAINST_COPY_H
#define LS_TESTS_BENCH_AGAINST_COPY_H

#include "tests/bench/references.h"

#include <math.h>
#include <stdlib.h>

struct against_copy {
    const char *name;
    void (*run)(void *data);
    void *data;
    double bytes;  /* read and written by one run */
    double error;  /* of its result; NAN: none formed */
    double wanted; /* of the ratio; NAN: nothing asked */
};

/** Both in turn, on one thread. A copy of b bytes moves 2 b: half of @bytes is copied. */
static inline void against_copy_rows(const struct bench *bench, const struct against_copy *rows,
                                     size_t n)
{
    for (size_t k = 0; k < n; k++) {
        size_t half = (size_t)(rows[k].bytes / 2);
        struct reference_bytes copy = {bench_alloc(half), bench_alloc(half), half, 1, 0};
        struct bench_task tasks[] = {
            {.name = "copy of as many bytes", .run = reference_copy, .data = &copy},
            {.name = rows[k].name, .run = rows[k].run, .data = rows[k].data}};
        bench_time(bench, tasks, 2);
        bench_row(bench,
                  &(struct bench_row){.name = rows[k].name,
                                      .unit = "GB/s",
                                      .value = rows[k].bytes / tasks[1].best_s * 1e-9,
                                      .median = rows[k].bytes / tasks[1].median_s * 1e-9,
                                      .error = rows[k].error,
                                      .reference = "copy, 1 thread",
                                      .reference_value = rows[k].bytes / tasks[0].best_s * 1e-9,
                                      .ratio = tasks[0].best_s / tasks[1].best_s,
                                      .wanted = rows[k].wanted});
        free(copy.to);
        free((void *)copy.from);
    }
}

#endif

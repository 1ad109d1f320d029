/* What the machine can do: copy, read, multiply and add. The other benches measure their own
 * references again beside themselves; these rows are for the reader. */
#include "tests/bench/references.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static void print(const struct bench *bench, const char *name, const char *unit, double amount,
                  const struct bench_task *task)
{
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = unit,
                                         .value = amount / task->best_s * 1e-9,
                                         .median = amount / task->median_s * 1e-9,
                                         .error = NAN,
                                         .reference = "none",
                                         .reference_value = NAN,
                                         .ratio = NAN,
                                         .wanted = NAN});
}

static void bytes(const struct bench *bench)
{
    size_t n = bench_size(bench, 256u << 20, 1u << 20);
    void *from = bench_alloc(n), *to = bench_alloc(n);
    struct reference_bytes one = {to, from, n, 1, 0}, two = {to, from, n, 2, 0};
    struct bench_task tasks[] = {{.name = "copy, 1 thread", .run = reference_copy, .data = &one},
                                 {.name = "copy, 2 threads", .run = reference_copy, .data = &two},
                                 {.name = "read, 1 thread", .run = reference_read, .data = &one},
                                 {.name = "read, 2 threads", .run = reference_read, .data = &two}};
    bench_time(bench, tasks, 4);
    print(bench, "copy_1_thread", "GB/s", 2.0 * (double)n, &tasks[0]);
    print(bench, "copy_2_threads", "GB/s", 2.0 * (double)n, &tasks[1]);
    print(bench, "read_1_thread", "GB/s", (double)n, &tasks[2]);
    print(bench, "read_2_threads", "GB/s", (double)n, &tasks[3]);
    free(from);
    free(to);
}

static void multiply_adds(const struct bench *bench, enum ls_isa isa)
{
    struct reference_fma one = {isa, 1, bench_size(bench, 1u << 20, 1u << 10), 0, 0}, two = one;
    char name[64];
    two.n_threads = 2;
    struct bench_task tasks[] = {{.name = "fma, 1 thread", .run = reference_fma, .data = &one},
                                 {.name = "fma, 2 threads", .run = reference_fma, .data = &two}};
    fprintf(stderr, "  %s\n", ls_isa_name(isa));
    bench_time(bench, tasks, 2);
    snprintf(name, sizeof name, "fma_%s_1_thread", ls_isa_name(isa));
    print(bench, name, "GFMA/s", (double)one.done, &tasks[0]);
    snprintf(name, sizeof name, "fma_%s_2_threads", ls_isa_name(isa));
    print(bench, name, "GFMA/s", (double)two.done, &tasks[1]);
}

int main(int argc, char **argv)
{
    struct bench bench;
    bench_init(&bench, argc, argv);
    bytes(&bench);
    for (int isa = 0; isa < LS_ISA_COUNT; isa++)
        if (ls_isa_runs((enum ls_isa)isa))
            multiply_adds(&bench, (enum ls_isa)isa);
    return 0;
}

/*
 * bench: how fast, as a ratio to something measured in the same minute.
 * Layer: tests. Threads: the program's main thread; work is spread by bench_parallel alone.
 * Ownership: the caller's structs; nothing to free but what bench_alloc gave.
 *
 * A bench is a program: it makes its input, lets contestants run in turn (A B C A B C ..., so that
 * a noisy minute is noisy for all), and prints one line of JSON per row; tests/bench/run collects
 * them. Best and median of the rounds are kept: ratios are formed of the best.
 *
 *     int main(int argc, char **argv)
 *     {
 *         struct bench bench;
 *         bench_init(&bench, argc, argv);
 *         struct bench_task tasks[] = {{.name = "copy", .run = copy, .data = &x}, ...};
 *         bench_time(&bench, tasks, 2);
 *         bench_row(&bench, &(struct bench_row){.name = "merge", .unit = "GB/s", ...});
 *         return 0;
 *     }
 */
#ifndef LS_TESTS_BENCH_BENCH_H
#define LS_TESTS_BENCH_BENCH_H

#include "core/cpu.h"

#include <stdbool.h>
#include <stddef.h>

struct bench {
    bool smoke; /* tiny sizes, one round: does it run at all? */
    int rounds; /* at least this many, and at least min_s seconds of each task */
    double min_s;
};

/** --smoke, --rounds N. Anything else ends the program with a usage line. */
void bench_init(struct bench *bench, int argc, char **argv);

/** @full, or @tiny in a smoke run. */
size_t bench_size(const struct bench *bench, size_t full, size_t tiny);

struct bench_task {
    const char *name;
    void (*run)(void *data);
    void *data;
    double best_s, median_s; /* filled by bench_time */
};

/** One round unmeasured, then all in turn. Says on stderr what each took. */
void bench_time(const struct bench *bench, struct bench_task *tasks, size_t n);

/** A line of build/bench.json, and what is wanted of it. */
struct bench_row {
    const char *name, *unit;
    double value;           /* in @unit, of the best round */
    double median;          /* in @unit, of the median round */
    double error;           /* largest error of the result against a reference of higher precision,
                               relative to what the header's bound is relative to; NAN: none formed */
    const char *reference;  /* what it is held against */
    double reference_value; /* in @unit */
    double ratio;           /* value against reference, larger is better, unless at_most */
    double wanted;          /* of the ratio; NAN: nothing asked */
    bool at_most;           /* ratio is to stay at or under @wanted */
};

/** Print it. */
void bench_row(const struct bench *bench, const struct bench_row *row);

/** Run @work(data, thread, n_threads) in n_threads threads and wait for all; 1 = in this one. */
void bench_parallel(unsigned n_threads, void (*work)(void *data, unsigned thread, unsigned n),
                    void *data);

/** @bytes at a page boundary, written once so that they are really there; ends the program where
 * there is no memory. free() it. */
void *bench_alloc(size_t bytes);

/** Highest resident set of this process so far, and of now what is anonymous, in MiB (VmHWM and
 * RssAnon of /proc/self/status); -1 where the system does not tell. */
double bench_peak_mib(void);
double bench_anonymous_mib(void);

#endif

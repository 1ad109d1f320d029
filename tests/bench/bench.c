#include "tests/bench/bench.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { MAX_ROUNDS = 400, MAX_TASKS = 16, MAX_THREADS = 64 };

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

void bench_init(struct bench *bench, int argc, char **argv)
{
    *bench = (struct bench){.rounds = 7, .min_s = 0.2};
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--smoke") == 0) {
            *bench = (struct bench){.smoke = true, .rounds = 1};
        } else if (strcmp(argv[i], "--rounds") == 0 && i + 1 < argc && atoi(argv[i + 1]) > 0) {
            bench->rounds = atoi(argv[++i]);
        } else {
            fprintf(stderr, "usage: %s [--smoke] [--rounds N]\n", argv[0]);
            exit(2);
        }
    }
    setvbuf(stdout, NULL, _IOLBF, 0);
}

size_t bench_size(const struct bench *bench, size_t full, size_t tiny)
{
    return bench->smoke ? tiny : full;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double once(const struct bench_task *task)
{
    double start = now_s();
    task->run(task->data);
    return now_s() - start;
}

void bench_time(const struct bench *bench, struct bench_task *tasks, size_t n)
{
    static double took[MAX_TASKS][MAX_ROUNDS];
    double slowest_total = 0;
    int rounds = 0;
    if (n > MAX_TASKS)
        abort();
    for (size_t t = 0; t < n; t++)
        once(&tasks[t]);
    while (rounds < MAX_ROUNDS && (rounds < bench->rounds || slowest_total < bench->min_s)) {
        double shortest = INFINITY;
        for (size_t t = 0; t < n; t++) {
            took[t][rounds] = once(&tasks[t]);
            shortest = fmin(shortest, took[t][rounds]);
        }
        slowest_total += shortest;
        rounds++;
    }
    for (size_t t = 0; t < n; t++) {
        qsort(took[t], (size_t)rounds, sizeof took[t][0], by_value);
        tasks[t].best_s = took[t][0];
        tasks[t].median_s = took[t][rounds / 2];
        fprintf(stderr, "  %-28s best %9.3f ms, median %9.3f ms of %d\n", tasks[t].name,
                1e3 * tasks[t].best_s, 1e3 * tasks[t].median_s, rounds);
    }
}

static void number(const char *key, double value)
{
    if (isfinite(value))
        printf(", \"%s\": %.6g", key, value);
    else
        printf(", \"%s\": null", key);
}

void bench_row(const struct bench *bench, const struct bench_row *row)
{
    printf("{\"name\": \"%s\", \"unit\": \"%s\"", row->name, row->unit);
    number("value", row->value);
    number("error", row->error);
    printf(", \"reference\": \"%s\"", row->reference);
    number("reference_value", row->reference_value);
    number("ratio", row->ratio);
    number("median", row->median);
    number("wanted", row->wanted);
    printf(", \"at_most\": %s, \"smoke\": %s}\n", row->at_most ? "true" : "false",
           bench->smoke ? "true" : "false");
}

struct part {
    void (*work)(void *data, unsigned thread, unsigned n);
    void *data;
    unsigned thread, n;
};

static void *run_part(void *data)
{
    const struct part *part = data;
    part->work(part->data, part->thread, part->n);
    return NULL;
}

void bench_parallel(unsigned n_threads, void (*work)(void *data, unsigned thread, unsigned n),
                    void *data)
{
    pthread_t thread[MAX_THREADS];
    struct part part[MAX_THREADS];
    if (n_threads < 1 || n_threads > MAX_THREADS)
        abort();
    for (unsigned t = 0; t < n_threads; t++)
        part[t] = (struct part){work, data, t, n_threads};
    for (unsigned t = 1; t < n_threads; t++)
        if (pthread_create(&thread[t], NULL, run_part, &part[t]))
            abort();
    run_part(&part[0]);
    for (unsigned t = 1; t < n_threads; t++)
        pthread_join(thread[t], NULL);
}

void *bench_alloc(size_t bytes)
{
    void *p = NULL;
    if (posix_memalign(&p, 4096, bytes)) {
        fprintf(stderr, "no memory for %zu bytes\n", bytes);
        exit(1);
    }
    memset(p, 0, bytes);
    return p;
}

static double status_mib(const char *key)
{
    char line[256];
    double kib = -1024;
    FILE *status = fopen("/proc/self/status", "r");
    while (status && fgets(line, sizeof line, status))
        if (strncmp(line, key, strlen(key)) == 0)
            kib = atof(line + strlen(key));
    if (status)
        fclose(status);
    return kib / 1024;
}

double bench_peak_mib(void)
{
    return status_mib("VmHWM:");
}

double bench_anonymous_mib(void)
{
    return status_mib("RssAnon:");
}

/* Pictures of 4 megapixels, in halves, brought to the disk as a take does: checksums, OpenEXR,
 * preallocated files, syncs, journal. In TMPDIR; wanted: twice what 72 frames a second of three
 * exposures need. */
#include "daemon/store.h"
#include "daemon/takedir.h"
#include "tests/bench/bench.h"
#include "tests/daemon/store_fixture.h"

#include <math.h>
#include <stdio.h>
#include <sys/resource.h>

enum { PICTURES = 48, THREADS = 2 };

static const double needed_per_s = 72 / 3.0;

struct pile {
    uint32_t side, n;
    uint16_t *half;
    uint8_t *validity;
    char *root;
    struct ls_store *store;
    char ids[PICTURES][16];
    const char *conditions[PICTURES];
    double cpu_s; /* of the process, of the round before */
};

static double cpu_s(void)
{
    struct rusage r;
    getrusage(RUSAGE_SELF, &r);
    return (double)(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
           1e-6 * (double)(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
}

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err) {
        fprintf(stderr, "%s\n", diag->text);
        exit(1);
    }
}

static void publish_some(void *data, unsigned thread, unsigned n)
{
    struct pile *p = data;
    struct ls_diag diag = {{0}};
    for (uint32_t i = thread; i < p->n; i += n) {
        const struct ls_exr_mosaic mosaic = {
            .half = p->half, .validity = p->validity, .width = p->side, .height = p->side};
        const struct ls_store_picture picture = {.condition = p->conditions[i], .mosaic = mosaic};
        must(ls_store_publish(p->store, &picture, &diag), &diag);
    }
}

static void store_all(void *data)
{
    struct pile *p = data;
    struct ls_diag diag = {{0}};
    const struct ls_store_config config = {
        .root = p->root,
        .name = "bench",
        .take_json = "{}",
        .utc_s = 1715947200,
        .n_cameras = 1,
        .n_shots = p->n,
        .conditions = p->conditions,
        .n_conditions = p->n,
        .need_bytes = p->n * ls_exr_mosaic_bytes_max(p->side, p->side, LS_EXR_HALF)};
    double before = cpu_s();
    must(ls_store_create(&config, &p->store, &diag), &diag);
    bench_parallel(THREADS, publish_some, p);
    must(ls_store_flush(p->store, &diag), &diag);
    p->cpu_s = cpu_s() - before;
    char *folder = g_strdup(ls_store_folder(p->store));
    must(ls_store_close(p->store, &diag), &diag);
    remove_tree(folder);
    g_free(folder);
}

int main(int argc, char **argv)
{
    struct bench bench;
    bench_init(&bench, argc, argv);
    struct pile p = {.side = (uint32_t)bench_size(&bench, 2048, 128),
                     .n = (uint32_t)bench_size(&bench, PICTURES, 4),
                     .root = new_root()};
    size_t n_px = (size_t)p.side * p.side;
    p.half = bench_alloc(n_px * sizeof *p.half);
    p.validity = bench_alloc(n_px);
    memset(p.validity, 0, n_px);
    for (size_t k = 0; k < n_px; k++)
        p.half[k] = (uint16_t)(0x2c00 + k * 2654435761u % 4096);
    for (uint32_t i = 0; i < p.n; i++) {
        snprintf(p.ids[i], sizeof p.ids[i], "W-%04u", i);
        p.conditions[i] = p.ids[i];
    }
    struct bench_task task = {.name = "store", .run = store_all, .data = &p};
    bench_time(&bench, &task, 1);
    printf("# %.2f ms of a processor per picture\n", 1e3 * p.cpu_s / p.n);
    bench_row(&bench, &(struct bench_row){.name = "store",
                                          .unit = "pictures/s",
                                          .value = p.n / task.best_s,
                                          .median = p.n / task.median_s,
                                          .error = NAN,
                                          .reference = "72 frames a second, 3 exposures",
                                          .reference_value = needed_per_s,
                                          .ratio = p.n / task.best_s / needed_per_s,
                                          .wanted = 2});
    remove_tree(p.root);
    g_free(p.root);
    free(p.half);
    free(p.validity);
    return 0;
}

/*
 * take: a field whose pictures are OpenEXR files in the page cache, as the daemon maps them.
 * Layer: tests. Threads: made by one, read by any. Ownership: bench_take_destroy.
 */
#ifndef LS_TESTS_BENCH_TAKE_H
#define LS_TESTS_BENCH_TAKE_H

#include "core/exr.h"
#include "core/field.h"

struct bench_take {
    struct ls_field field; /* Bayer; k, g, omega, p, duty and factor of a plausible stage */
    uint32_t n_lights, n_spectra;
    struct bench_file {
        void *map;
        size_t bytes;
        struct ls_exr_tiles tiles;
    } * file; /* [n_lights] */
    struct ls_picture *white;
    double *k, *g, *omega_sr, *p;
    float (*directions)[3];
};

/** Files of @size x @size pixels in a nameless folder under $TMPDIR or /var/tmp, mapped and read
 * once. Values are a smooth pattern with noise, of another brightness for every light. Ends the
 * program where the disk is full. */
struct bench_take *bench_take_create(uint32_t n_lights, uint32_t n_spectra, uint32_t size);

/** NULL is allowed. */
void bench_take_destroy(struct bench_take *take);

/** @n floats in a nameless mapped file of the same folder, as maps of a take lie: not on the heap.
 * munmap by bench_map_free. */
float *bench_map_floats(size_t n);
void bench_map_free(float *map, size_t n);

#endif

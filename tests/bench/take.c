#include "tests/bench/take.h"

#include "core/half.h"
#include "tests/bench/bench.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

static void *must(void *p, const char *what)
{
    if (p && p != MAP_FAILED)
        return p;
    perror(what);
    exit(1);
}

static int nameless_file(void)
{
    const char *folder = getenv("TMPDIR") ? getenv("TMPDIR") : "/var/tmp";
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0) {
        perror(folder);
        exit(1);
    }
    return fd;
}

static void *map_file(int fd, size_t bytes, int protection)
{
    void *map = must(mmap(NULL, bytes, protection, MAP_SHARED, fd, 0), "mmap");
    close(fd);
    return map;
}

float *bench_map_floats(size_t n)
{
    int fd = nameless_file();
    if (ftruncate(fd, (off_t)(n * sizeof(float)))) {
        perror("a file of maps");
        exit(1);
    }
    return map_file(fd, n * sizeof(float), PROT_READ | PROT_WRITE);
}

void bench_map_free(float *map, size_t n)
{
    munmap(map, n * sizeof *map);
}

static void write_all(int fd, const uint8_t *bytes, size_t n)
{
    while (n > 0) {
        ssize_t done = write(fd, bytes, n);
        if (done <= 0) {
            perror("a file of a take");
            exit(1);
        }
        bytes += done;
        n -= (size_t)done;
    }
}

static void fill(uint16_t *half, uint32_t size, uint32_t light)
{
    uint64_t random = 0x9e3779b97f4a7c15u * (light + 1);
    float level = 0.02f + 0.5f * (float)(light * 37 % 101) / 101;
    for (uint32_t y = 0; y < size; y++) {
        float row[4096];
        for (uint32_t x = 0; x < size; x++) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            float noise = (float)(random >> 40) * 0x1p-24f - 0.5f;
            row[x] = level * (1 + (float)(x ^ y) / (float)size) + 1e-3f * noise;
        }
        ls_half_from_floats(row, half + (size_t)y * size, size);
    }
}

static void make_file(struct bench_file *file, uint16_t *half, uint32_t size, uint32_t light)
{
    struct ls_exr_mosaic mosaic = {.width = size, .height = size, .half = half};
    struct ls_diag diag = {""};
    uint8_t *bytes;
    uint64_t sum = 0;
    int fd = nameless_file();
    fill(half, size, light);
    if (ls_exr_write_mosaic(&mosaic, &bytes, &file->bytes, &diag))
        goto failed;
    write_all(fd, bytes, file->bytes);
    free(bytes);
    file->map = map_file(fd, file->bytes, PROT_READ);
    for (size_t at = 0; at < file->bytes; at += 4096)
        sum += ((const volatile uint8_t *)file->map)[at];
    (void)sum;
    if (!ls_exr_map_tiles(file->map, file->bytes, NULL, &file->tiles, &diag))
        return;
failed:
    fprintf(stderr, "%s\n", diag.text);
    exit(1);
}

static void fill_numbers(struct bench_take *take)
{
    uint32_t n = take->n_lights;
    for (uint32_t s = 0; s < take->n_spectra; s++) {
        double strength[1024];
        for (uint32_t i = 0; i < n; i++)
            strength[i] = 1 + 0.05 * sin(1.7 * i + s);
        if (ls_field_normalise_gains(strength, n, take->k + (size_t)s * n, take->g + (size_t)s * n,
                                     NULL))
            abort();
        for (uint32_t c = 0; c < 3; c++)
            take->p[3 * s + c] = s == 0 ? 1 : 0.1 + 0.1 * ((s + c) % 4);
    }
    for (uint32_t i = 0; i < n; i++) {
        take->omega_sr[i] = 4 * M_PI / n;
        take->directions[i][2] = 1;
    }
}

struct bench_take *bench_take_create(uint32_t n_lights, uint32_t n_spectra, uint32_t size)
{
    static const double ones[LS_FIELD_MAX_SPECTRA] = {1, 1, 1, 1, 1, 1, 1, 1,
                                                      1, 1, 1, 1, 1, 1, 1, 1};
    struct bench_take *take = must(calloc(1, sizeof *take), "take");
    uint16_t *half = bench_alloc((size_t)size * size * 2);
    take->n_lights = n_lights;
    take->n_spectra = n_spectra;
    take->file = must(calloc(n_lights, sizeof *take->file), "take");
    take->white = must(calloc(n_lights, sizeof *take->white), "take");
    take->k = must(calloc((size_t)n_spectra * n_lights, sizeof *take->k), "take");
    take->g = must(calloc((size_t)n_spectra * n_lights, sizeof *take->g), "take");
    take->omega_sr = must(calloc(n_lights, sizeof *take->omega_sr), "take");
    take->p = must(calloc((size_t)n_spectra * 3, sizeof *take->p), "take");
    take->directions = must(calloc(n_lights, sizeof *take->directions), "take");
    fill_numbers(take);
    for (uint32_t i = 0; i < n_lights; i++) {
        make_file(&take->file[i], half, size, i);
        take->white[i].tiles = (const void *const *)take->file[i].tiles.tile;
    }
    free(half);
    take->field = (struct ls_field){.n_lights = n_lights,
                                    .n_spectra = n_spectra,
                                    .n_channels = 3,
                                    .width = size,
                                    .height = size,
                                    .cfa = LS_CFA_RGGB,
                                    .scale = 1,
                                    .white = take->white,
                                    .k = take->k,
                                    .g = take->g,
                                    .omega_sr = take->omega_sr,
                                    .directions = (const float(*)[3])take->directions,
                                    .p = take->p,
                                    .duty = ones,
                                    .factor = ones};
    return take;
}

void bench_take_destroy(struct bench_take *take)
{
    if (!take)
        return;
    for (uint32_t i = 0; i < take->n_lights; i++) {
        ls_exr_tiles_finish(&take->file[i].tiles);
        munmap(take->file[i].map, take->file[i].bytes);
    }
    free(take->file);
    free(take->white);
    free(take->k);
    free(take->g);
    free(take->omega_sr);
    free(take->p);
    free(take->directions);
    free(take);
}

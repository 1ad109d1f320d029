/* One white RGB tile and five ratio tiles to five RGB tiles, all in halves: a picture of 4 Mpixel,
 * tile by tile. */
#include "tests/bench/against_copy.h"

#include "core/half.h"
#include "core/promote_tile.h"

#include <string.h>

enum { SPECTRA = 5, TILE = 3 * 64 * 64 };

struct picture {
    size_t n_tiles;
    uint16_t *white, *ratio[SPECTRA], *out[SPECTRA];
};

static void promote(void *data)
{
    struct picture *p = data;
    for (size_t t = 0; t < p->n_tiles; t++) {
        const uint16_t *ratio[SPECTRA];
        uint16_t *out[SPECTRA];
        for (int s = 0; s < SPECTRA; s++) {
            ratio[s] = p->ratio[s] + t * TILE;
            out[s] = p->out[s] + t * TILE;
        }
        struct ls_promote_tile tile = {p->white + t * TILE, SPECTRA, ratio, out, TILE, 1};
        ls_promote_tile(&tile);
    }
}

static uint16_t *samples(size_t n, double step, double offset)
{
    uint16_t *half = bench_alloc(n * sizeof *half);
    for (size_t j = 0; j < n; j++)
        half[j] = ls_half_from_float((float)(offset + 0.5 * sin((double)j * step)));
    return half;
}

/* Largest, relative to the exact product: half an ulp of half at most. */
static double error_of(const struct picture *p)
{
    double largest = 0;
    for (size_t j = 0; j < p->n_tiles * TILE; j += 7)
        for (int s = 0; s < SPECTRA; s++) {
            double exact =
                (double)ls_half_to_float(p->white[j]) * (double)ls_half_to_float(p->ratio[s][j]);
            double got = (double)ls_half_to_float(p->out[s][j]);
            largest = fmax(largest, fabs(got - exact) / exact);
        }
    return largest;
}

int main(int argc, char **argv)
{
    struct bench bench;
    bench_init(&bench, argc, argv);
    struct picture p = {.n_tiles = bench_size(&bench, 1024, 2)};
    size_t n = p.n_tiles * TILE;
    p.white = samples(n, 0.001, 0.6);
    for (int s = 0; s < SPECTRA; s++) {
        p.ratio[s] = samples(n, 0.0001 * (s + 1), 0.9);
        p.out[s] = bench_alloc(n * sizeof *p.out[s]);
    }
    promote(&p);
    const struct against_copy row = {
        .name = "promote_tile",
        .run = promote,
        .data = &p,
        .bytes = (double)n * sizeof(uint16_t) * (1 + 2 * SPECTRA),
        .error = error_of(&p),
        .wanted = 0.5,
    };
    against_copy_rows(&bench, &row, 1);
    free(p.white);
    for (int s = 0; s < SPECTRA; s++) {
        free(p.ratio[s]);
        free(p.out[s]);
    }
    return 0;
}

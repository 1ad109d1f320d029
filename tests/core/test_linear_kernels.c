/* The kernels of the fit, each instruction set against C: any number of inputs, any values, any
 * size, and nothing read or written beside its arrays. */
#include "tests/core/isas.h"
#include "tests/core/random_segments.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { SEED = 29, G = 4, H = 3 };

static const uint32_t widths[] = {1, 2, 63, 64, 65, 131};
static const uint32_t outputs[] = {1, 3}; /* mono and RGB */

enum values { ORDINARY, ODD, HUGE_SCALE, SMALL_SCALE, SCALES, ZERO, N_VALUES };

static float odd_value(GRand *rand)
{
    static const float odd[] = {0,       -0.0f,    FLT_MIN,   -FLT_MIN, 1e-45f,
                                -1e-45f, 3e-39f,   FLT_MAX,   -FLT_MAX, 65504,
                                NAN,     INFINITY, -INFINITY, -1e-20f,  -1};
    return odd[g_rand_int_range(rand, 0, G_N_ELEMENTS(odd))];
}

static float any_value(GRand *rand, enum values values)
{
    float x = (float)g_rand_double_range(rand, -0.05, 1);
    switch (values) {
    case ODD:
        return g_rand_int_range(rand, 0, 12) ? x : odd_value(rand);
    case HUGE_SCALE:
        return x * 1e30f;
    case SMALL_SCALE:
        return x * 1e-36f;
    case SCALES:
        return ldexpf(x, g_rand_int_range(rand, -140, 120));
    case ZERO:
        return 0;
    default:
        return x;
    }
}

static void make(struct random_segments *x, uint32_t width, uint32_t n_in, uint32_t n_out,
                 enum values values)
{
    random_segments_init(x, SEED, width, H, G, n_in, n_out);
    for (uint32_t g = 0; g < G; g++) {
        for (size_t i = 0; i < random_segments_pixels(x) * n_in; i++)
            x->v[g][i] = any_value(x->rand, values);
        for (size_t i = 0; i < random_segments_pixels(x) * n_out; i++)
            x->f[g][i] = any_value(x->rand, values);
        x->noise[g] = (struct ls_linear_noise){1e-5, 1e-4};
    }
    x->pictures.total_noise = (struct ls_linear_noise){4e-5, 1e-4};
}

static void check_same_bits(struct random_segments *x, enum ls_isa isa)
{
    size_t bytes = random_segments_pixels(x) * x->pictures.n_in * x->pictures.n_out * sizeof *x->m;
    g_autofree float *reference = g_malloc(bytes);
    struct ls_linear_error errors[2] = {{0}};
    const struct ls_linear_kernels *kernels[2] = {&ls_linear_kernels_c, ls_linear_kernels(isa)};

    for (int k = 0; k < 2; k++) {
        struct ls_linear_part part = random_segments_whole(x, 1, &errors[k]);
        part.out = k ? x->m : reference;
        g_assert_cmpint(ls_linear_fit_with(kernels[k], &x->pictures, &x->options, &part, NULL), ==,
                        LS_OK);
    }
    g_assert_cmpmem(x->m, bytes, reference, bytes);
    g_assert_cmpmem(&errors[0], sizeof errors[0], &errors[1], sizeof errors[1]);
    for (size_t i = 0; i < bytes / sizeof *x->m; i++)
        g_assert_true(isfinite(x->m[i]));
}

static void test_same_bits(const void *data)
{
    for (uint32_t n_in = 1; n_in <= LS_LINEAR_MAX_INPUTS; n_in++)
        for (size_t c = 0; c < G_N_ELEMENTS(outputs); c++)
            for (size_t w = 0; w < G_N_ELEMENTS(widths); w++)
                for (int values = 0; values < N_VALUES; values++) {
                    struct random_segments x;
                    make(&x, widths[w], n_in, outputs[c], (enum values)values);
                    check_same_bits(&x, isas_of(data));
                    random_segments_finish(&x);
                }
}

/* A page between two that nobody may read or write. */
static float *guarded(size_t page)
{
    char *map = mmap(NULL, 3 * page, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    g_assert_true(map != MAP_FAILED);
    g_assert_cmpint(mprotect(map + page, page, PROT_READ | PROT_WRITE), ==, 0);
    return (float *)(map + page);
}

/* @n floats at the page's beginning or at its end. */
static float *place(float *map, size_t page, bool at_end, size_t n)
{
    g_assert_cmpuint(n * sizeof *map, <=, page);
    return at_end ? map + page / sizeof *map - n : map;
}

static float *put(float *map, size_t page, bool at_end, const float *from, size_t n)
{
    return memcpy(place(map, page, at_end, n), from, n * sizeof *map);
}

enum { MAPS = 2 * G + 5 };

struct guards {
    float *maps[MAPS];
    size_t page;
};

/* The first and last pixel of the span are those of the arrays. */
static void check_guards(const struct guards *guards, bool at_end, uint32_t n_in, uint32_t n_out,
                         uint32_t n, uint32_t stride, const struct ls_linear_kernels *kernels)
{
    struct random_segments x;
    struct ls_linear_sums sums;
    size_t page = guards->page, pixels = (size_t)(n - 1) * stride + 1, size = n * n_in * n_out;
    float *const *map = guards->maps;
    const float *v[G], *f[G];
    make(&x, (uint32_t)pixels, n_in, n_out, ORDINARY);
    x.pictures.height = 1;
    g_assert_cmpint(ls_linear_sums_init(&x.pictures, &x.options, 0, 1, &sums, NULL), ==, LS_OK);
    struct ls_linear_sums beside = {
        .v = put(map[0], page, at_end, sums.v, pixels * n_in),
        .sigma = put(map[1], page, at_end, sums.sigma, pixels * n_in),
        .f = put(map[2], page, at_end, sums.f, pixels * n_out),
        .ratio = put(map[3], page, at_end, sums.ratio, pixels * n_out),
    };
    map += 4;
    struct ls_linear_pictures pictures = x.pictures;
    for (uint32_t g = 0; g < G; g++) {
        v[g] = put(*map++, page, at_end, x.v[g], pixels * n_in);
        f[g] = put(*map++, page, at_end, x.f[g], pixels * n_out);
    }
    pictures.v = v;
    pictures.f = f;
    float *out = place(*map++, page, at_end, size);
    const struct ls_linear_span span = {.n = n, .stride = stride};
    struct ls_linear_pixel_errors errors[2];
    ls_linear_kernels_c.fit(&x.pictures, &x.options, &sums, &span, x.m);
    kernels->fit(&pictures, &x.options, &beside, &span, out);
    g_assert_cmpmem(out, size * sizeof *out, x.m, size * sizeof *out);
    ls_linear_kernels_c.predict(&x.pictures, &x.options, &sums, &span, &errors[0]);
    kernels->predict(&pictures, &x.options, &beside, &span, &errors[1]);
    g_assert_cmpmem(errors[0].difference, n * sizeof(double), errors[1].difference,
                    n * sizeof(double));
    ls_linear_sums_finish(&sums);
    random_segments_finish(&x);
}

static void test_guards(const void *data)
{
    static const uint32_t counts[] = {1, 3, 16, 63, LS_LINEAR_BLOCK};
    const struct ls_linear_kernels *kernels = ls_linear_kernels(isas_of(data));
    struct guards guards = {.page = 4 * (size_t)sysconf(_SC_PAGESIZE)};
    for (int k = 0; k < MAPS; k++)
        guards.maps[k] = guarded(guards.page);
    for (uint32_t n_in = 1; n_in <= LS_LINEAR_MAX_INPUTS; n_in++)
        for (size_t c = 0; c < G_N_ELEMENTS(outputs); c++)
            for (size_t k = 0; k < G_N_ELEMENTS(counts); k++)
                for (uint32_t stride = 1; stride <= 5; stride += 2)
                    for (int at_end = 0; at_end < 2; at_end++)
                        check_guards(&guards, at_end, n_in, outputs[c], counts[k], stride, kernels);
    for (int k = 0; k < MAPS; k++)
        munmap((char *)guards.maps[k] - guards.page, 3 * guards.page);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/linear-kernels/any-inputs-and-values-have-the-bits-of-c", test_same_bits);
    isas_add("/linear-kernels/nothing-beside-the-arrays-is-touched", test_guards);
    return g_test_run();
}

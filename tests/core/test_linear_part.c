#include "tests/core/random_segments.h"
#include "tests/core/isas.h"

#include <math.h>
#include <string.h>

enum { SEED = 3 };

/* Pictures with dark, negative and unreadable values among the others. */
static void roughen(struct random_segments *x)
{
    static const float odd[] = {0, -0.01f, 1e-30f, 3e38f, INFINITY, NAN};
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        for (size_t i = 0; i < random_segments_pixels(x) * 3; i++) {
            x->f[g][i] = x->v[g][i] * (float)g_rand_double_range(x->rand, 0.5, 1);
            if (g_rand_int_range(x->rand, 0, 100) == 0)
                x->v[g][i] = odd[g_rand_int_range(x->rand, 0, G_N_ELEMENTS(odd))];
        }
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        x->noise[g] = (struct ls_linear_noise){1e-5, 1e-4};
    x->pictures.total_noise = (struct ls_linear_noise){1e-4, 1e-4};
    x->pictures.demosaiced = true;
}

static void test_any_band_has_the_bits_of_the_whole(void)
{
    enum { W = 21, H = 67, G = 5 };
    struct random_segments x;
    random_segments_init(&x, SEED, W, H, G, 3, 3);
    x.pictures.demosaiced = true;
    x.pictures.total_noise = (struct ls_linear_noise){1e-2, 1e-2}; /* much of it is not trusted */
    for (int g = 0; g < G; g++)
        x.noise[g] = (struct ls_linear_noise){2e-3, 2e-3};
    random_segments_shade(&x, 0.01);
    for (uint32_t g = 0; g < G; g++)
        for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++)
            x.f[g][i] = x.v[g][i] * (float)g_rand_double_range(x.rand, -0.1, 1);
    random_segments_fit(&x);
    static const uint32_t splits[] = {0, 1, 2, 13, 33, 34, 60, 67};
    for (size_t k = 0; k + 1 < G_N_ELEMENTS(splits); k++) {
        uint32_t y0 = splits[k], y1 = splits[k + 1];
        uint32_t top = y0 > LS_LINEAR_HALO_PX ? y0 - LS_LINEAR_HALO_PX : 0;
        uint32_t end = H - y1 > LS_LINEAR_HALO_PX ? y1 + LS_LINEAR_HALO_PX : H;
        const float *v[G], *f[G];
        for (int g = 0; g < G; g++) {
            v[g] = x.v[g] + (size_t)top * W * 3;
            f[g] = x.f[g] + (size_t)top * W * 3;
        }
        struct ls_linear_pictures band = x.pictures;
        band.height = end - top;
        band.v = v;
        band.f = f;
        float m[W * H * 9];
        const struct ls_linear_part part = {.y = y0 - top, .width = W, .height = y1 - y0, .out = m};
        g_assert_cmpint(ls_linear_fit(&band, &x.options, &part, NULL), ==, LS_OK);
        g_assert_cmpmem(m, (y1 - y0) * W * 9 * sizeof(float), x.m + (size_t)y0 * W * 9,
                        (y1 - y0) * W * 9 * sizeof(float));
    }
    random_segments_finish(&x);
}

static void test_any_rectangle_has_the_bits_of_the_whole(void)
{
    enum { W = 70, H = 60, X = 23, Y = 19, NX = 30, NY = 25, HALO = LS_LINEAR_HALO_PX };
    enum { CW = NX + 2 * HALO, CH = NY + 2 * HALO };
    struct random_segments x, cut;
    random_segments_init(&x, SEED, W, H, 4, 3, 3);
    random_segments_init(&cut, SEED, CW, CH, 4, 3, 3);
    random_segments_shade(&x, 0.01);
    roughen(&x);
    roughen(&cut); /* its noise */
    for (int g = 0; g < 4; g++)
        for (int y = 0; y < CH; y++) {
            size_t from = ((size_t)(Y - HALO + y) * W + X - HALO) * 3, to = (size_t)y * CW * 3;
            memcpy(cut.v[g] + to, x.v[g] + from, CW * 3 * sizeof(float));
            memcpy(cut.f[g] + to, x.f[g] + from, CW * 3 * sizeof(float));
        }
    random_segments_fit(&x);
    enum { STRIDE = NX * 9 + 5 };
    g_autofree float *out = g_new0(float, STRIDE *NY);
    const struct ls_linear_part part = {
        .x = HALO, .y = HALO, .width = NX, .height = NY, .out = out, .out_stride = STRIDE};
    g_assert_cmpint(ls_linear_fit(&cut.pictures, &cut.options, &part, NULL), ==, LS_OK);
    for (int y = 0; y < NY; y++)
        g_assert_cmpmem(out + (size_t)y * STRIDE, NX * 9 * sizeof(float),
                        x.m + ((size_t)(Y + y) * W + X) * 9, NX * 9 * sizeof(float));
    random_segments_finish(&x);
    random_segments_finish(&cut);
}

static void test_every_instruction_set_has_the_same_bits(const void *data)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 131, 24, 5, 3, 3);
    random_segments_shade(&x, 0.01);
    roughen(&x);
    size_t n = random_segments_pixels(&x) * 9;
    g_autofree float *reference = g_new(float, n);
    struct ls_linear_error errors[2] = {{0}};
    const struct ls_linear_kernels *kernels[2] = {&ls_linear_kernels_c,
                                                  ls_linear_kernels(isas_of(data))};
    for (int k = 0; k < 2; k++) {
        const struct ls_linear_part part = {
            .width = 131, .height = 24, .out = k ? x.m : reference, .step = 1, .error = &errors[k]};
        g_assert_cmpint(ls_linear_fit_with(kernels[k], &x.pictures, &x.options, &part, NULL), ==,
                        LS_OK);
    }
    g_assert_cmpmem(x.m, n * sizeof(float), reference, n * sizeof(float));
    g_assert_cmpmem(&errors[0], sizeof errors[0], &errors[1], sizeof errors[1]);
    g_assert_cmpuint(errors[0].pixels, >, 1000);
    random_segments_finish(&x);
}

static void test_the_result_is_finite_whatever_comes(void)
{
    static const float odd[] = {0,     -0.0f, 1,   -1,       1e-45f,    1e-38f, 3e38f,   -3e38f,
                                1e-3f, 65504, NAN, INFINITY, -INFINITY, 1e20f,  -1e-20f, 0.5f};
    guint32 seed = g_test_rand_int_range(1, G_MAXINT);
    g_test_message("seed %u", seed);
    for (uint32_t n_in = 1; n_in <= 4; n_in++)
        for (uint32_t g = 1; g <= 6; g++) {
            struct random_segments x;
            random_segments_init(&x, SEED, 33, 29, g, n_in, 3);
            g_rand_set_seed(x.rand, seed);
            for (uint32_t k = 0; k < g; k++)
                for (size_t i = 0; i < random_segments_pixels(&x); i++) {
                    int kind = (int)(i % 4); /* all odd, few odd, rank 1, all the same */
                    float b = odd[g_rand_int_range(x.rand, 0, G_N_ELEMENTS(odd))];
                    for (uint32_t a = 0; a < n_in + 3; a++) {
                        float *at = a < n_in ? &x.v[k][i * n_in + a] : &x.f[k][i * 3 + a - n_in];
                        float any = odd[g_rand_int_range(x.rand, 0, G_N_ELEMENTS(odd))];
                        bool take =
                            kind == 0 || (kind == 1 && g_rand_int_range(x.rand, 0, 40) == 0);
                        *at = take ? any : kind == 2 ? b * 0.5f : kind == 3 ? 0.25f : 0.1f;
                    }
                }
            for (int noisy = 0; noisy < 2; noisy++) {
                x.pictures.total_noise.shot = noisy * 1e-3;
                x.noise[0].floor = noisy * 1e-4;
                random_segments_fit(&x);
                for (size_t i = 0; i < random_segments_pixels(&x) * n_in * 3; i++)
                    g_assert_true(isfinite(x.m[i]));
                struct ls_linear_error e = {0};
                const struct ls_linear_part whole = random_segments_whole(&x, g > 2, &e);
                g_assert_cmpint(ls_linear_fit(&x.pictures, &x.options, &whole, NULL), ==, LS_OK);
                g_assert_true(isfinite(e.difference) && isfinite(e.total) && isfinite(e.noise) &&
                              isfinite(e.single) && isfinite(ls_linear_estimate(&e)));
            }
            random_segments_finish(&x);
        }
}

static void test_what_is_no_fit_is_refused(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 2, 2, 2, 3, 3);
    struct ls_diag diag = {0};
    static const double bad[3] = {1, NAN, 1};
    for (int k = 0; k < 13; k++) {
        struct ls_linear_pictures p = x.pictures;
        struct ls_linear_options o = x.options;
        uint32_t first = 0, rows = 2;
        switch (k) {
        case 0:
            p.n_in = 0;
            break;
        case 1:
            p.n_in = LS_LINEAR_MAX_INPUTS + 1;
            break;
        case 2:
            p.n_out = 2;
            break;
        case 3:
            p.n_segments = 0;
            break;
        case 4:
            p.inputs[2] = 3;
            break;
        case 5:
            p.p_in = bad;
            break;
        case 6:
            p.p_out = bad;
            break;
        case 7:
            o.ridge = 0;
            break;
        case 8:
            o.row_floor = NAN;
            break;
        case 9:
            o.dielectric_weight = -1;
            break;
        case 10:
            first = 1;
            break;
        case 11:
            p.n_lights = 1;
            break;
        default:
            p.total_noise.floor = NAN;
            break;
        }
        const struct ls_linear_part part = {.y = first, .width = 2, .height = rows, .out = x.m};
        g_assert_cmpint(ls_linear_fit(&p, &o, &part, &diag), ==, LS_ERR_INVALID);
        g_assert_cmpstr(diag.text, !=, "");
    }
    random_segments_finish(&x);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/linear/any-band-has-the-bits-of-the-whole",
                    test_any_band_has_the_bits_of_the_whole);
    g_test_add_func("/linear/any-rectangle-has-the-bits-of-the-whole",
                    test_any_rectangle_has_the_bits_of_the_whole);
    isas_add("/linear/every-instruction-set-has-the-same-bits",
             test_every_instruction_set_has_the_same_bits);
    g_test_add_func("/linear/the-result-is-finite-whatever-comes",
                    test_the_result_is_finite_whatever_comes);
    g_test_add_func("/linear/what-is-no-fit-is-refused", test_what_is_no_fit_is_refused);
    return g_test_run();
}

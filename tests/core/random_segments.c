#include "tests/core/random_segments.h"

#include <math.h>

const double random_segments_white[6] = {0.76, 1, 0.59, 0.8, 0.5, 0.7};
const double random_segments_amber[3] = {0.8, 0.37, 0.02};

size_t random_segments_pixels(const struct random_segments *x)
{
    return (size_t)x->pictures.width * x->pictures.height;
}

void random_segments_init(struct random_segments *x, guint32 seed, uint32_t w, uint32_t h,
                          uint32_t g, uint32_t n_in, uint32_t n_out)
{
    *x = (struct random_segments){.rand = g_rand_new_with_seed(seed)};
    g_test_message("seed %u", seed);
    ls_linear_options_default(&x->options);
    size_t n = (size_t)w * h;
    for (uint32_t k = 0; k < g; k++) {
        x->v[k] = g_new0(float, n *n_in);
        x->f[k] = g_new0(float, n *n_out);
    }
    x->m = g_new0(float, n *n_in *n_out);
    x->pictures = (struct ls_linear_pictures){.width = w,
                                              .height = h,
                                              .n_segments = g,
                                              .n_lights = 20 * g,
                                              .n_in = n_in,
                                              .n_out = n_out,
                                              .v = (const float *const *)x->v,
                                              .f = (const float *const *)x->f,
                                              .v_noise = x->noise,
                                              .f_noise = x->noise,
                                              .p_in = random_segments_white,
                                              .p_out = random_segments_amber};
    for (uint32_t c = 0; c < n_out; c++)
        x->pictures.inputs[c] = c < n_in ? c : 0;
}

void random_segments_finish(struct random_segments *x)
{
    for (int k = 0; k < RANDOM_SEGMENTS_MAX; k++) {
        g_free(x->v[k]);
        g_free(x->f[k]);
    }
    g_free(x->m);
    g_rand_free(x->rand);
}

void random_segments_shade(struct random_segments *x, double darkest)
{
    uint32_t n_in = x->pictures.n_in;
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        for (size_t i = 0; i < random_segments_pixels(x); i++) {
            double b = pow(darkest, g_rand_double(x->rand));
            for (uint32_t a = 0; a < n_in; a++)
                x->v[g][i * n_in + a] = (float)(b * g_rand_double_range(x->rand, 0.5, 1.5));
        }
}

void random_segments_reflect(struct random_segments *x, double *truth)
{
    uint32_t n_in = x->pictures.n_in, n_out = x->pictures.n_out;
    for (size_t i = 0; i < random_segments_pixels(x); i++)
        for (uint32_t c = 0; c < n_out; c++)
            for (uint32_t a = 0; a < n_in; a++)
                truth[(i * n_out + c) * n_in + a] =
                    g_rand_double_range(x->rand, 0, 0.3) + (x->pictures.inputs[c] == a);
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        for (size_t i = 0; i < random_segments_pixels(x) * n_out; i++) {
            double f = 0;
            for (uint32_t a = 0; a < n_in; a++)
                f += truth[i * n_in + a] * (double)x->v[g][i / n_out * n_in + a];
            x->f[g][i] = (float)f;
        }
}

struct ls_linear_part random_segments_whole(struct random_segments *x, uint32_t step,
                                            struct ls_linear_error *error)
{
    return (struct ls_linear_part){.width = x->pictures.width,
                                   .height = x->pictures.height,
                                   .out = x->m,
                                   .step = step,
                                   .error = error};
}

void random_segments_fit(struct random_segments *x)
{
    struct ls_diag diag = {0};
    const struct ls_linear_part whole = random_segments_whole(x, 0, NULL);
    enum ls_err err = ls_linear_fit(&x->pictures, &x->options, &whole, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

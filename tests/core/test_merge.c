#include "tests/core/merge_cases.h"

#include "core/half.h"
#include "tests/core/isas.h"

static const double bracket[] = {0.001, 0.004, 0.016};

/* 4e-6 is the header's bound; a signal of 1e-30 DN may vanish among denormal products. Variances
 * depend on the pooled estimate through the weights and collect a few more roundings: 2e-5. */
static void compare(const struct image *image, size_t *borderline)
{
    for (size_t k = 0; k < image->n; k++) {
        uint16_t x[LS_MERGE_MAX_EXPOSURES] = {0};
        float d[LS_MERGE_MAX_EXPOSURES] = {0};
        for (uint32_t i = 0; i < image->p.n_exposures; i++) {
            x[i] = image->dn[i][k];
            d[i] = image->dark[i][k];
        }
        struct reference r = reference_merge(&image->p, x, d);
        if (r.borderline) {
            ++*borderline;
            continue;
        }
        g_assert_cmpuint(image->validity[k], ==, r.validity);
        g_assert_true(fabsl(image->e[k] - r.e) <= 4e-6L * r.scale + 1e-30L);
        g_assert_true(fabsl(image->variance[k] - r.variance) <= 2e-5L * r.variance);
    }
}

/* Half of the pixels see one radiance in every exposure, the others unrelated samples. */
static void fill_random(struct image *image, struct noise *noise)
{
    double max = ls_pixel_max_dn(image->p.format);

    for (size_t k = 0; k < image->n; k++) {
        double level = exp(noise_uniform(noise) * log(1e9)) * 1e-4;
        for (uint32_t i = 0; i < image->p.n_exposures; i++) {
            double t = image->p.exposure_s[i] / image->p.exposure_s[0];
            double x = k % 2 ? noise_uniform(noise) * (max + 1)
                             : fmin(max, 0.03 * max + max * level * t + 2 * noise_normal(noise));
            image->dn[i][k] = (uint16_t)fmax(0, x);
            image->dark[i][k] = (float)(0.03 * max + 0.5 * noise_normal(noise));
        }
    }
}

static void test_reference(const void *data)
{
    enum { SEED = 21 };
    struct noise noise = {SEED};
    static const uint32_t sizes[][2] = {{1, 1}, {3, 5}, {257, 3}, {511, 2}, {8, 33}};
    size_t borderline = 0, total = 0;

    g_test_message("seed %d", SEED);
    for (size_t f = 0; ls_pixel_at(f); f++)
        for (uint32_t n = 1; n <= LS_MERGE_MAX_EXPOSURES; n++) {
            double t[LS_MERGE_MAX_EXPOSURES];
            const uint32_t *size = sizes[(f + n) % G_N_ELEMENTS(sizes)];
            for (uint32_t i = 0; i < n; i++) /* ratios up to 1e6, in scrambled order */
                t[(i * 3 + f) % n] = 1e-5 * pow(f % 2 ? 4 : n > 1 ? pow(1e6, 1.0 / (n - 1)) : 1, i);
            if (n % 3 == 0)
                for (uint32_t i = 0; i < n; i++)
                    t[i] = 1e-5 * pow(4, i);
            struct ls_merge_params p = params_for(ls_pixel_at(f)->name, size[0], size[1], n, t);
            struct image image;
            image_init(&image, &p);
            image.isa = isas_of(data);
            fill_random(&image, &noise);
            image_merge(&image);
            compare(&image, &borderline);
            total += image.n;
            image_finish(&image);
        }
    g_assert_cmpuint(borderline, <, total / 100);
}

/* One radiance in eight exposures a factor 7.2 apart, 1e6 in all: samples below the noise, in
 * range, one DN from clipping and clipped, in 8 and 16 bits. */
static void test_extremes(const void *data)
{
    static const char *const formats[] = {"Mono8", "BayerRG16", "BayerGB10p", "Mono12Packed"};
    static const double darks[] = {0, 1e-30, 1e-40, 3.5, 250};
    size_t borderline = 0;

    for (size_t f = 0; f < G_N_ELEMENTS(formats); f++)
        for (uint32_t n = 1; n <= LS_MERGE_MAX_EXPOSURES; n++) {
            double t[LS_MERGE_MAX_EXPOSURES];
            struct image image;
            for (uint32_t i = 0; i < n; i++)
                t[i] = 1e-6 * pow(1e6, n > 1 ? i / (n - 1.0) : 0);
            struct ls_merge_params p = params_for(formats[f], 41, 5, n, t);
            p.read_noise_dn = f % 2 ? 0 : 100;
            p.electrons_per_dn = f % 3 ? 1e-6 : 1e9;
            image_init(&image, &p);
            image.isa = isas_of(data);
            uint16_t max = (uint16_t)ls_pixel_max_dn(p.format);
            const uint16_t levels[] = {0,
                                       1,
                                       max,
                                       (uint16_t)(max - 1),
                                       (uint16_t)(max / 2),
                                       (uint16_t)(max / 10),
                                       (uint16_t)(max * 85 / 100)};
            for (size_t k = 0; k < image.n; k++)
                for (uint32_t i = 0; i < n; i++) {
                    image.dn[i][k] = levels[(k + (k / 7) * i) % G_N_ELEMENTS(levels)];
                    image.dark[i][k] = (float)darks[k / p.width];
                }
            image_merge(&image);
            for (size_t k = 0; k < image.n; k++)
                g_assert_true(isfinite(image.e[k]) && isfinite(image.variance[k]));
            compare(&image, &borderline);
            image_finish(&image);
        }
}

static void assert_same_merge(const struct image *a, const struct image *b)
{
    g_assert_cmpmem(a->e, a->n * sizeof *a->e, b->e, b->n * sizeof *b->e);
    g_assert_cmpmem(a->variance, a->n * sizeof *a->e, b->variance, b->n * sizeof *b->e);
    g_assert_cmpmem(a->validity, a->n, b->validity, b->n);
}

/* Every format and count, against the C instance, bit by bit. */
static void test_same_bits(const void *data)
{
    enum { SEED = 22 };
    struct noise noise = {SEED};

    g_test_message("seed %d", SEED);
    for (size_t f = 0; ls_pixel_at(f); f++)
        for (uint32_t n = 1; n <= LS_MERGE_MAX_EXPOSURES; n++) {
            double t[LS_MERGE_MAX_EXPOSURES];
            struct image image, c;
            for (uint32_t i = 0; i < n; i++)
                t[i] = 1e-3 * pow(3, i);
            struct ls_merge_params p = params_for(ls_pixel_at(f)->name, 267 + n, 2, n, t);
            image_init(&image, &p);
            image_init(&c, &p);
            image.isa = isas_of(data);
            c.isa = LS_ISA_C;
            fill_random(&image, &noise);
            for (uint32_t i = 0; i < n; i++) {
                memcpy(c.dn[i], image.dn[i], image.n * sizeof *c.dn[i]);
                memcpy(c.dark[i], image.dark[i], image.n * sizeof *c.dark[i]);
            }
            image_merge(&image);
            image_merge(&c);
            assert_same_merge(&image, &c);
            image_finish(&image);
            image_finish(&c);
        }
}

/* Halves made on the way are those made of E afterwards, with or without E beside them, those
 * beyond the range of half included. */
static void test_halves(const void *data)
{
    enum { SEED = 23 };
    struct noise noise = {SEED};
    static const uint32_t defects[] = {5, 300};
    static const double references[] = {0.004, 1e-12, 1e9};
    struct ls_merge_params p = params_for("BayerRG8", 131, 5, 3, bracket);
    struct image image;

    g_test_message("seed %d", SEED);
    p.defects = defects;
    p.n_defects = G_N_ELEMENTS(defects);
    image_init(&image, &p);
    image.isa = isas_of(data);
    fill_random(&image, &noise);
    image_merge(&image);
    g_autofree uint16_t *after = g_new(uint16_t, image.n), *fused = g_new(uint16_t, image.n);
    g_autofree uint8_t *validity = g_malloc(image.n);
    for (size_t k = 0; k < G_N_ELEMENTS(references); k++) {
        struct ls_merge_spans s = image_spans(&image);
        image.p.reference_exposure_s = references[k];
        s.half = fused;
        s.validity = validity;
        s.variance = NULL;
        s.e = k % 2 ? s.e : NULL;
        memset(fused, 0xee, image.n * sizeof *fused);
        ls_merge_rows_with(ls_merge_kernels(image.isa), &image.p, &s, 0, p.height);
        g_autofree uint8_t *flags = g_memdup2(image.validity, image.n);
        size_t beyond = ls_merge_store_half(image.e, image.n, references[k], after, flags);
        g_assert_cmpmem(fused, image.n * sizeof *fused, after, image.n * sizeof *after);
        g_assert_cmpmem(validity, image.n, flags, image.n);
        g_assert_true((beyond > 0) == (k == 2));
    }
    image_finish(&image);
}

static struct image one_pixel(const char *format, uint32_t n, const double *t, const uint16_t *x,
                              float dark)
{
    struct ls_merge_params p = params_for(format, 1, 1, n, t);
    struct image image;

    image_init(&image, &p);
    for (uint32_t i = 0; i < n; i++) {
        image.dn[i][0] = x[i];
        image.dark[i][0] = dark;
    }
    image_merge(&image);
    return image;
}

static void check_pixel(uint32_t n, const double *t, const uint16_t *x, float dark,
                        enum ls_validity validity, double e_dn_per_s)
{
    struct image image = one_pixel("Mono8", n, t, x, dark);

    g_assert_cmpuint(image.validity[0], ==, validity);
    g_assert_cmpfloat_with_epsilon(image.e[0], e_dn_per_s / 255, 1e-5 * fabs(e_dn_per_s) / 255);
    image_finish(&image);
}

static void test_saturated(void)
{
    check_pixel(3, bracket, (uint16_t[]){255, 255, 255}, 8, LS_VALIDITY_SATURATED, 247 / 0.001);
    check_pixel(3, (double[]){0.016, 0.001, 0.004}, (uint16_t[]){255, 255, 255}, 8,
                LS_VALIDITY_SATURATED, 247 / 0.001);
    check_pixel(1, bracket, (uint16_t[]){240}, 8, LS_VALIDITY_SATURATED, 232 / 0.001);
}

/* 254 is not clipped: it takes part in the pooled estimate, is high by its expected value, and
 * leaves the field to the shorter exposures. */
static void test_one_dn_from_saturated(void)
{
    check_pixel(2, bracket, (uint16_t[]){70, 254}, 8, LS_VALIDITY_OK, 62 / 0.001);
    check_pixel(3, bracket, (uint16_t[]){254, 255, 255}, 8, LS_VALIDITY_SATURATED, 246 / 0.001);
}

static void test_dark(void)
{
    check_pixel(3, bracket, (uint16_t[]){8, 9, 12}, 8, LS_VALIDITY_DARK, 4 / 0.016);
    check_pixel(3, bracket, (uint16_t[]){8, 8, 5}, 8, LS_VALIDITY_DARK, -3 / 0.016);
    check_pixel(3, bracket, (uint16_t[]){0, 0, 0}, 8, LS_VALIDITY_DARK, -8 / 0.016);
    check_pixel(3, (double[]){0.016, 0.001, 0.004}, (uint16_t[]){12, 8, 9}, 8, LS_VALIDITY_DARK,
                4 / 0.016);
}

static void test_gap(void)
{
    static const double wide[] = {0.001, 0.1};
    check_pixel(2, wide, (uint16_t[]){18, 255}, 8, LS_VALIDITY_GAP, 10 / 0.001);
    static const double three[] = {0.0001, 0.001, 0.1};
    check_pixel(3, three, (uint16_t[]){9, 18, 255}, 8, LS_VALIDITY_GAP, 10 / 0.001);
}

static void test_huge_ratio(void)
{
    static const double huge[] = {1e-6, 1};
    check_pixel(2, huge, (uint16_t[]){100, 255}, 8, LS_VALIDITY_OK, 92e6);
    check_pixel(2, huge, (uint16_t[]){8, 100}, 8, LS_VALIDITY_OK, 92);
    check_pixel(2, huge, (uint16_t[]){12, 255}, 8, LS_VALIDITY_GAP, 4e6);
}

static void test_bands(void)
{
    enum { SEED = 5 };
    struct noise noise = {SEED};
    static const uint32_t defects[] = {0, 36, 37, 38, 39, 40, 77, 200, 37 * 20, 37 * 29 + 36};
    struct ls_merge_params p = params_for("BayerGB12Packed", 37, 30, 3, bracket);
    struct image whole, bands;

    g_test_message("seed %d", SEED);
    p.defects = defects;
    p.n_defects = G_N_ELEMENTS(defects);
    image_init(&whole, &p);
    image_init(&bands, &p);
    fill_random(&whole, &noise);
    image_merge(&whole);
    for (int round = 0; round < 30; round++) {
        struct ls_merge_spans s = image_spans(&whole), out = image_spans(&bands);
        s.e = out.e;
        s.validity = out.validity;
        s.variance = out.variance;
        memset(bands.e, 0xff, bands.n * sizeof *bands.e);
        for (uint32_t y = 0, h; y < p.height; y += h) {
            h = 1 + (uint32_t)(noise_bits(&noise) % (p.height - y));
            ls_merge_rows(&p, &s, y, h);
        }
        g_assert_cmpmem(bands.e, bands.n * 4, whole.e, whole.n * 4);
        g_assert_cmpmem(bands.variance, bands.n * 4, whole.variance, whole.n * 4);
        g_assert_cmpmem(bands.validity, bands.n, whole.validity, whole.n);
    }
    image_finish(&whole);
    image_finish(&bands);
}

/* The value of a pixel must not depend on its neighbours in the vector, nor on asking for the
 * variance. */
static void test_places(void)
{
    enum { SEED = 6, N = 300 };
    struct noise noise = {SEED};
    struct ls_merge_params p = params_for("Mono12", N, 1, 3, bracket);
    struct image image;

    g_test_message("seed %d", SEED);
    image_init(&image, &p);
    fill_random(&image, &noise);
    image_merge(&image);
    for (size_t k = 0; k < N; k++) {
        struct ls_merge_params single = p;
        float e, dark[3];
        uint8_t validity;
        single.width = 1;
        struct ls_merge_spans s = {.e = &e, .validity = &validity};
        for (int i = 0; i < 3; i++) {
            dark[i] = image.dark[i][k];
            s.raw[i] = image.raw[i] + 2 * k;
            s.dark[i] = &dark[i];
        }
        ls_merge_rows(&single, &s, 0, 1);
        g_assert_cmpmem(&e, 4, &image.e[k], 4);
        g_assert_cmpuint(validity, ==, image.validity[k]);
    }
    image_finish(&image);
}

static void test_no_dark(void)
{
    struct ls_merge_params p = params_for("Mono8", 5, 1, 3, bracket);
    struct image image;

    image_init(&image, &p);
    for (size_t k = 0; k < image.n; k++)
        for (int i = 0; i < 3; i++)
            image.dn[i][k] = (uint16_t)(3 * (k + 1) << 2 * i);
    image_merge(&image);
    struct ls_merge_spans s = image_spans(&image);
    g_autofree float *with = g_memdup2(image.e, image.n * 4);
    s.dark[0] = s.dark[1] = s.dark[2] = NULL;
    ls_merge_rows(&image.p, &s, 0, 1);
    g_assert_cmpmem(image.e, image.n * 4, with, image.n * 4);
    image_finish(&image);
}

static void test_gaps(void)
{
    double shorter = 0;
    g_assert_cmpuint(ls_merge_bracket_gaps(bracket, 3, 0.10, 0.85, NULL), ==, 0);
    g_assert_cmpuint(ls_merge_bracket_gaps((double[]){1, 8.5}, 2, 0.10, 0.85, NULL), ==, 0);
    g_assert_cmpuint(ls_merge_bracket_gaps((double[]){8.51, 1}, 2, 0.10, 0.85, &shorter), ==, 1);
    g_assert_cmpfloat(shorter, ==, 1);
    g_assert_cmpuint(ls_merge_bracket_gaps((double[]){1000, 1, 10, 2}, 4, 0.10, 0.85, &shorter), ==,
                     1);
    g_assert_cmpfloat(shorter, ==, 10);
    g_assert_cmpuint(ls_merge_bracket_gaps((double[]){3, 3}, 2, 0.10, 0.85, NULL), ==, 0);
    g_assert_cmpuint(ls_merge_bracket_gaps((double[]){3}, 1, 0.10, 0.85, NULL), ==, 0);
}

static void refused(struct ls_merge_params p, const char *word)
{
    struct ls_diag diag = {""};
    g_assert_cmpint(ls_merge_check(&p, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, word));
}

static void test_checks(void)
{
    static const uint32_t beyond[] = {12}, unsorted[] = {3, 3};
    const struct ls_merge_params good = params_for("Mono8", 4, 3, 3, bracket);
    struct ls_merge_params p;

#define REFUSED(change, word) p = good, change, refused(p, word)
    REFUSED(p.format = NULL, "format");
    REFUSED(p.width = 0, "0 x 3");
    REFUSED(p.width = p.height = UINT32_MAX, "pixels");
    REFUSED(p.n_exposures = 0, "exposures");
    REFUSED(p.n_exposures = 9, "exposures");
    REFUSED(p.exposure_s[1] = 0, "exposure 1");
    REFUSED(p.exposure_s[1] = NAN, "exposure 1");
    REFUSED(p.exposure_s[2] = INFINITY, "exposure 2");
    REFUSED(p.full_scale_dn = 256, "full scale");
    REFUSED(p.clip_dn = 0, "clip");
    REFUSED(p.range_low = 0.9, "range");
    REFUSED(p.range_high = NAN, "range");
    REFUSED(p.electrons_per_dn = 0, "electrons");
    REFUSED(p.read_noise_dn = -1, "read noise");
    REFUSED(p.reference_exposure_s = NAN, "reference exposure");
    REFUSED((p.defects = beyond, p.n_defects = 1), "defective");
    REFUSED((p.defects = unsorted, p.n_defects = 2), "defective");
    REFUSED(p.n_defects = 1, "no list");
#undef REFUSED
}

static void test_store(void)
{
    enum { N = 301 };
    static float e[N];
    static uint16_t half[N];
    static uint8_t validity[N];

    for (int i = 0; i < N; i++)
        e[i] = (float)(i - 150) * 1.7f;
    e[3] = 1e30f;
    e[4] = -1e30f;
    e[5] = NAN;
    e[6] = LS_HALF_MAX / 0.25f;
    e[7] = 1e-9f;
    validity[8] = LS_VALIDITY_DARK;
    g_assert_cmpuint(ls_merge_store_half(e, N, 0.25, half, validity), ==, 3);
    for (int i = 0; i < N; i++) {
        if (i >= 3 && i <= 5) {
            g_assert_cmpuint(validity[i], ==, LS_VALIDITY_SATURATED);
            continue;
        }
        g_assert_cmphex(half[i], ==, ls_half_from_float(e[i] * 0.25f));
        g_assert_cmpuint(validity[i], ==, i == 8 ? LS_VALIDITY_DARK : LS_VALIDITY_OK);
    }
    g_assert_cmphex(half[3], ==, 0x7bff);
    g_assert_cmphex(half[4], ==, 0xfbff);
    g_assert_cmphex(half[5], ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/merge/every-format-and-count-agrees-with-the-reference", test_reference);
    isas_add("/merge/extreme-samples-noise-and-exposures-agree-with-the-reference", test_extremes);
    isas_add("/merge/every-instruction-set-gives-the-bits-of-c", test_same_bits);
    isas_add("/merge/halves-on-the-way-are-those-made-afterwards", test_halves);
    g_test_add_func("/merge/all-high-takes-the-shortest-and-says-saturated", test_saturated);
    g_test_add_func("/merge/one-dn-from-saturated-is-not-clipped", test_one_dn_from_saturated);
    g_test_add_func("/merge/all-low-takes-the-longest-signed-and-says-dark", test_dark);
    g_test_add_func("/merge/between-far-exposures-takes-the-longest-not-high-and-says-gap",
                    test_gap);
    g_test_add_func("/merge/an-exposure-ratio-of-a-million-merges", test_huge_ratio);
    g_test_add_func("/merge/any-split-into-bands-gives-the-same-bits", test_bands);
    g_test_add_func("/merge/a-pixel-does-not-depend-on-its-place", test_places);
    g_test_add_func("/merge/a-missing-dark-is-zero", test_no_dark);
    g_test_add_func("/merge/steps-above-the-range-ratio-are-gaps", test_gaps);
    g_test_add_func("/merge/bad-parameters-are-refused-with-a-sentence", test_checks);
    g_test_add_func("/merge/stored-halves-are-finite-and-flagged-beyond-range", test_store);
    return g_test_run();
}

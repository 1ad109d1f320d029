#include "tests/core/merge_cases.h"

static const double bracket[] = {0.001, 0.004, 0.016};

/* A Bayer image whose colours have very different levels, smooth within each. */
static void fill(struct image *image)
{
    for (uint32_t y = 0; y < image->p.height; y++)
        for (uint32_t x = 0; x < image->p.width; x++) {
            unsigned c = ls_cfa_channel(image->p.format->cfa, x, y);
            double level = (c == 0 ? 60 : c == 1 ? 400 : 900) + 2.0 * x + 3.0 * y;
            for (uint32_t i = 0; i < image->p.n_exposures; i++) {
                size_t k = (size_t)y * image->p.width + x;
                double dn = 64 + level * image->p.exposure_s[i] / 0.001;
                image->dn[i][k] = (uint16_t)fmin(4095, floor(dn + 0.5));
                image->dark[i][k] = 64;
            }
        }
}

static void make_hot(struct image *image, const uint32_t *defects, uint32_t n)
{
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t i = 0; i < image->p.n_exposures; i++)
            image->dn[i][defects[k]] = 4095;
}

/* Every phase, inside, at edges and in corners; two of them neighbours of the same colour. */
static void test_hot(void)
{
    static const uint32_t defects[] = {0,          15,          20 * 4 + 6,  20 * 4 + 8,
                                       20 * 7 + 9, 20 * 10 + 3, 20 * 13 + 19};
    for (int f = 0; f < 5; f++) {
        static const char *const formats[] = {"Mono12", "BayerRG12", "BayerGR12p", "BayerGB12",
                                              "BayerBG12Packed"};
        struct ls_merge_params p = params_for(formats[f], 20, 14, 3, bracket);
        struct image clean, hot;
        image_init(&clean, &p);
        fill(&clean);
        image_merge(&clean);
        p.defects = defects;
        p.n_defects = G_N_ELEMENTS(defects);
        image_init(&hot, &p);
        fill(&hot);
        make_hot(&hot, defects, p.n_defects);
        image_merge(&hot);
        for (size_t k = 0; k < clean.n; k++) {
            /* The ramp is 2 DN a column and 3 a row: six pixels away (two defects and a corner,
             * where only far neighbours on one side are left) it is off by 12 DN in 1 ms. */
            double slack = 12 / 0.001 / 4095;
            g_assert_cmpfloat(fabs(hot.e[k] - clean.e[k]), <=, slack);
            g_assert_cmpuint(hot.validity[k], ==, clean.validity[k]);
        }
        image_finish(&clean);
        image_finish(&hot);
    }
}

static void test_edge(void)
{
    static const uint32_t defects[] = {9 * 4 + 4};
    struct ls_merge_params p = params_for("Mono12", 9, 9, 1, bracket);
    struct image image;

    p.defects = defects;
    p.n_defects = 1;
    image_init(&image, &p);
    for (uint32_t k = 0; k < 81; k++) /* a vertical edge through the defect, right side bright */
        image.dn[0][k] = k % 9 < 4 ? 500 : 2500;
    image.dn[0][defects[0]] = 0;
    image_merge(&image);
    g_assert_cmpfloat(image.e[defects[0]], ==, image.e[9 * 3 + 4]);
    g_assert_cmpfloat(image.variance[defects[0]], ==, image.variance[9 * 3 + 4] / 2);
    image_finish(&image);
}

/* One neighbour saturated: its value is a lower bound, and so is the mean made of it. */
static void test_validity(void)
{
    static const uint32_t defects[] = {1};
    struct ls_merge_params p = params_for("Mono12", 3, 1, 1, bracket);
    struct image image;

    p.defects = defects;
    p.n_defects = 1;
    image_init(&image, &p);
    image.dn[0][0] = 2000;
    image.dn[0][2] = 4095;
    image_merge(&image);
    g_assert_cmpuint(image.validity[1], ==, LS_VALIDITY_SATURATED);
    image.dn[0][2] = 5;
    image_merge(&image);
    g_assert_cmpuint(image.validity[1], ==, LS_VALIDITY_DARK);
    image.dn[0][0] = 4095; /* the other side: whichever is looked at last */
    image.dn[0][2] = 2000;
    image_merge(&image);
    g_assert_cmpuint(image.validity[1], ==, LS_VALIDITY_SATURATED);
    image.dn[0][2] = 5; /* nothing is worse than a lower bound */
    image_merge(&image);
    g_assert_cmpuint(image.validity[1], ==, LS_VALIDITY_SATURATED);
    image_finish(&image);
}

static void test_all_defective(void)
{
    uint32_t defects[35];
    struct ls_merge_params p = params_for("BayerRG12", 7, 5, 3, bracket);
    struct image image, plain;

    image_init(&plain, &p);
    fill(&plain);
    image_merge(&plain);
    for (uint32_t k = 0; k < 35; k++)
        defects[k] = k;
    p.defects = defects;
    p.n_defects = 35;
    image_init(&image, &p);
    fill(&image);
    image_merge(&image);
    g_assert_cmpmem(image.e, sizeof(float) * 35, plain.e, sizeof(float) * 35);
    image_finish(&image);
    image_finish(&plain);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/merge/hot-pixels-are-replaced-in-every-phase", test_hot);
    g_test_add_func("/merge/a-defect-on-an-edge-follows-the-edge", test_edge);
    g_test_add_func("/merge/a-replaced-pixel-is-no-more-valid-than-its-sources", test_validity);
    g_test_add_func("/merge/defects-without-good-neighbours-are-counted-and-left",
                    test_all_defective);
    return g_test_run();
}

#include "core/rgbe.h"
#include "tests/core/memory_wall.h"
#include "tests/core/shared_data.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static const size_t limit = 64 << 20;

static GByteArray *start(const char *header)
{
    GByteArray *file = g_byte_array_new();
    return g_byte_array_append(file, (const guint8 *)header, (guint)strlen(header));
}

static enum ls_err read_file(const GByteArray *file, struct ls_image *image, struct ls_diag *diag)
{
    guint8 *copy = g_memdup2(file->data, file->len ? file->len : 1);
    enum ls_err err = ls_rgbe_read(copy, file->len, limit, image, diag);
    g_free(copy);
    return err;
}

/* 3 x 2 flat pixels, each different: red counts 10, 20 ... 60, green 100, blue 0. */
static GByteArray *six_pixels(const char *header)
{
    GByteArray *file = start(header);
    for (int k = 0; k < 6; k++)
        g_byte_array_append(file, (guint8[]){(guint8)(10 * (k + 1)), 100, 0, 129}, 4);
    return file;
}

static double red(int code)
{
    return (code + 0.5) / 128; /* exponent 129: 2^(129 - 128) / 256 */
}

static void assert_reds(const char *header, uint32_t w, uint32_t h, const int *codes, double scale)
{
    GByteArray *file = six_pixels(header);
    struct ls_image image;
    struct ls_diag diag = {0};
    enum ls_err err = read_file(file, &image, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpuint(image.width, ==, w);
    g_assert_cmpuint(image.height, ==, h);
    for (int k = 0; k < 6; k++) {
        g_assert_cmpfloat(image.pixels[3 * k], ==, (float)(red(codes[k]) * scale));
        g_assert_cmpfloat(image.pixels[3 * k + 1], ==, (float)(red(100) * scale));
        g_assert_cmpfloat(image.pixels[3 * k + 2], ==, (float)(red(0) * scale));
    }
    ls_image_finish(&image);
    g_byte_array_unref(file);
}

#define HEAD "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n"

static void test_orientations(void)
{
    /* the file's first scanline holds 10 20 30 (rows) or 10 20 (columns) */
    assert_reds(HEAD "\n-Y 2 +X 3\n", 3, 2, (int[]){10, 20, 30, 40, 50, 60}, 1);
    assert_reds(HEAD "\n-Y 2 -X 3\n", 3, 2, (int[]){30, 20, 10, 60, 50, 40}, 1);
    assert_reds(HEAD "\n+Y 2 +X 3\n", 3, 2, (int[]){40, 50, 60, 10, 20, 30}, 1);
    assert_reds(HEAD "\n+Y 2 -X 3\n", 3, 2, (int[]){60, 50, 40, 30, 20, 10}, 1);
    assert_reds(HEAD "\n+X 3 -Y 2\n", 3, 2, (int[]){10, 30, 50, 20, 40, 60}, 1);
    assert_reds(HEAD "\n+X 3 +Y 2\n", 3, 2, (int[]){20, 40, 60, 10, 30, 50}, 1);
    assert_reds(HEAD "\n-X 3 -Y 2\n", 3, 2, (int[]){50, 30, 10, 60, 40, 20}, 1);
    assert_reds(HEAD "\n-X 3 +Y 2\n", 3, 2, (int[]){60, 40, 20, 50, 30, 10}, 1);
}

static void test_exposure(void)
{
    static const int codes[6] = {10, 20, 30, 40, 50, 60};
    assert_reds(HEAD "EXPOSURE=2\n\n-Y 2 +X 3\n", 3, 2, codes, 0.5);
    assert_reds(HEAD "EXPOSURE= 2.0\nEXPOSURE=4e0\n\n-Y 2 +X 3\n", 3, 2, codes, 0.125);
    assert_reds(HEAD "COLORCORR=2 2 2\n\n-Y 2 +X 3\n", 3, 2, codes, 0.5);
    assert_reds("#?RADIANCE\n#?RADIANCE\n# note\nrpict -vp 1 2 3\nGAMMA=1\n"
                "PRIMARIES=0 0 0 0 0 0 0 0\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n",
                3, 2, codes, 1);
    assert_reds("#?RGBE\r\nPRIMARIES=0.640 0.330 0.300 0.600 0.150 0.060 0.3127 0.329\r\n\r\n"
                "-Y 2 +X 3\r\n",
                3, 2, codes, 1);
}

static void assert_refused(const char *header, enum ls_err expected, const char *word)
{
    GByteArray *file = six_pixels(header);
    struct ls_image image;
    struct ls_diag diag = {0};
    g_assert_cmpint(read_file(file, &image, &diag), ==, expected);
    if (!strstr(diag.text, word))
        g_error("\"%s\" is not in \"%s\"", word, diag.text);
    g_assert_null(image.pixels);
    g_byte_array_unref(file);
}

static void test_refusals(void)
{
    assert_refused("", LS_ERR_INVALID, "not a Radiance");
    assert_refused("P6\n3 2\n", LS_ERR_INVALID, "not a Radiance");
    assert_refused("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 2 +X 3\n", LS_ERR_UNSUPPORTED, "xyze");
    assert_refused(HEAD "GAMMA=2.2\n\n-Y 2 +X 3\n", LS_ERR_UNSUPPORTED, "GAMMA 2.2");
    assert_refused(HEAD "PIXASPECT=0.5\n\n-Y 2 +X 3\n", LS_ERR_UNSUPPORTED, "PIXASPECT");
    assert_refused(HEAD "PRIMARIES=0.68 0.32 0.265 0.69 0.15 0.06 0.3127 0.329\n\n-Y 2 +X 3\n",
                   LS_ERR_UNSUPPORTED, "primaries");
    assert_refused(HEAD "PRIMARIES=1 2 3\n\n-Y 2 +X 3\n", LS_ERR_INVALID, "eight numbers");
    assert_refused(HEAD "EXPOSURE=0\n\n-Y 2 +X 3\n", LS_ERR_INVALID, "positive");
    assert_refused(HEAD "EXPOSURE=nan\n\n-Y 2 +X 3\n", LS_ERR_INVALID, "positive");
    assert_refused(HEAD "EXPOSURE=1e-300\n\n-Y 2 +X 3\n", LS_ERR_INVALID, "brighter");
    assert_refused(HEAD "EXPOSURE=1e-300\nEXPOSURE=1e-300\n\n-Y 2 +X 3\n", LS_ERR_INVALID,
                   "brighter"); /* their product is 0 */
    assert_refused(HEAD "EXPOSURE=x\n\n-Y 2 +X 3\n", LS_ERR_INVALID, "positive");
    assert_refused(HEAD "\n-Y 2 +Y 3\n", LS_ERR_INVALID, "-Y 512 +X 1024");
    assert_refused(HEAD "\n-Y 2\n", LS_ERR_INVALID, "-Y 512 +X 1024");
    assert_refused(HEAD "\n-Y 0 +X 3\n", LS_ERR_INVALID, "-Y 512 +X 1024");
    assert_refused(HEAD "\n-Y -2 +X 3\n", LS_ERR_INVALID, "-Y 512 +X 1024");
    assert_refused(HEAD "\n-Y 3 +X 3\n", LS_ERR_INVALID, "scanline 2");
    assert_refused(HEAD "\n-Y 99999 +X 99999\n", LS_ERR_LIMIT, "limit");
    assert_refused(HEAD "\n-Y 18446744073709551617 +X 3\n", LS_ERR_INVALID, "-Y 512 +X 1024");
}

/* One scanline of 10 pixels by new runs, one by old runs, both saying the same. */
static void test_runs(void)
{
    static const guint8 modern[] = {2, 2, 0, 10, 128 + 10, 7, 3, 1, 2, 3, 128 + 7,  9,  10,
                                    0, 1, 2, 3,  4,        5, 6, 7, 8, 9, 128 + 10, 128};
    static const guint8 old[] = {7, 1,   0, 128, 7, 2,   1, 128, 7, 3,   2, 128, 7, 9,
                                 3, 128, 7, 9,   4, 128, 7, 9,   5, 128, 7, 9,   6, 128,
                                 7, 9,   7, 128, 7, 9,   8, 128, 7, 9,   9, 128};
    static const guint8 repeat[] = {7, 9, 1, 128, 1, 1, 1, 9};
    struct ls_image a, b;
    GByteArray *file = start(HEAD "\n-Y 2 +X 10\n");
    g_byte_array_append(file, modern, sizeof modern);
    g_byte_array_append(file, old, sizeof old);
    g_assert_cmpint(read_file(file, &a, NULL), ==, LS_OK);
    g_assert_cmpmem(a.pixels, 120, a.pixels + 30, 120);
    g_assert_cmpfloat(a.pixels[3 * 4 + 1], ==, 9.5f / 256);
    for (guint cut = file->len; cut-- > 40;) {
        g_byte_array_set_size(file, cut);
        g_assert_cmpint(read_file(file, &b, NULL), !=, LS_OK);
    }
    g_byte_array_unref(file);
    ls_image_finish(&a);
    file = start(HEAD "\n-Y 1 +X 10\n");
    g_byte_array_append(file, repeat, sizeof repeat);
    g_assert_cmpint(read_file(file, &a, NULL), ==, LS_OK);
    for (int k = 0; k < 10; k++)
        g_assert_cmpfloat(a.pixels[3 * k + 2], ==, 1.5f / 256);
    ls_image_finish(&a);
    g_byte_array_unref(file);
    /* 258 pixels: two codes in a row, 1 << 0 and 1 << 8 */
    file = start(HEAD "\n-Y 1 +X 258\n");
    g_byte_array_append(file, (guint8[]){7, 9, 1, 128, 1, 1, 1, 1, 1, 1, 1, 1}, 12);
    g_assert_cmpint(read_file(file, &a, NULL), ==, LS_OK);
    g_assert_cmpfloat(a.pixels[3 * 257], ==, 7.5f / 256);
    ls_image_finish(&a);
    g_byte_array_unref(file);
    /* a repetition of nothing, and one beyond the end */
    file = start(HEAD "\n-Y 1 +X 4\n");
    g_byte_array_append(file, (guint8[]){1, 1, 1, 4}, 4);
    g_assert_cmpint(read_file(file, &a, NULL), ==, LS_ERR_INVALID);
    g_byte_array_unref(file);
}

static void test_random_damage(void)
{
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int k = 0; k < 20000; k++) {
        GByteArray *file = six_pixels(HEAD "EXPOSURE=1\n\n-Y 2 +X 3\n");
        for (int flips = g_rand_int_range(rand, 1, 4); flips; flips--)
            file->data[g_rand_int_range(rand, 2, (gint32)file->len)] = (guint8)g_rand_int(rand);
        struct ls_image image;
        if (read_file(file, &image, NULL) == LS_OK)
            ls_image_finish(&image);
        g_byte_array_unref(file);
    }
    g_rand_free(rand);
}

/* Largest value as the collection's description has it for park; sizes of all. */
static void test_environments(void)
{
    static const char *const names[] = {"lobby", "warehouse", "park"};
    for (size_t k = 0; k < G_N_ELEMENTS(names); k++) {
        char *relative = g_strdup_printf("environments/%s.hdr", names[k]), *contents;
        char *path = shared_data(relative);
        g_free(relative);
        if (!path)
            return;
        gsize n;
        struct ls_image image;
        struct ls_diag diag = {0};
        g_assert_true(g_file_get_contents(path, &contents, &n, NULL));
        enum ls_err err = ls_rgbe_read(contents, n, limit, &image, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        g_assert_cmpuint(image.width, ==, 1024);
        g_assert_cmpuint(image.height, ==, 512);
        float max = 0;
        for (size_t p = 0; p < 1024 * 512 * 3; p++) {
            g_assert_true(isfinite(image.pixels[p]) && image.pixels[p] >= 0);
            max = fmaxf(max, image.pixels[p]);
        }
        g_test_message("%s: largest %g", names[k], (double)max);
        if (k == 2) /* 69120 without the half code that centres the interval: 0.5 / 135 more */
            g_assert_cmpfloat(fabsf(max - 69120), <=, 0.5f * 512);
        ls_image_finish(&image);
        g_free(contents);
        g_free(path);
    }
}

/* A cut file is refused; one with a few other bytes is refused or read, and then it is light. */
static void damage(GRand *rand, const GByteArray *whole)
{
    struct ls_image image;
    struct ls_diag diag = {0};
    GByteArray *file = g_byte_array_new();
    g_byte_array_append(file, whole->data, (guint)g_rand_int_range(rand, 1, (gint32)whole->len));
    g_assert_cmpint(read_file(file, &image, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpstr(diag.text, !=, "");
    g_byte_array_set_size(file, 0);
    g_byte_array_append(file, whole->data, whole->len);
    for (int flips = g_rand_int_range(rand, 1, 4); flips; flips--)
        file->data[g_rand_int_range(rand, 0, (gint32)(flips % 2 ? whole->len : 200))] =
            (guint8)g_rand_int(rand);
    diag = (struct ls_diag){0};
    enum ls_err err = read_file(file, &image, &diag);
    g_assert_true(!err == !*diag.text);
    size_t samples = err ? 0 : (size_t)image.width * image.height * 3;
    for (size_t k = 0; k < samples; k++)
        g_assert_true(isfinite(image.pixels[k]) && image.pixels[k] >= 0);
    if (!err)
        ls_image_finish(&image);
    g_byte_array_unref(file);
}

static void test_damaged_environments(void)
{
    guint32 seed = g_test_rand_int();
    char *path = shared_data("environments/park.hdr"), *contents;
    gsize n;
    if (!path)
        return;
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    g_assert_true(g_file_get_contents(path, &contents, &n, NULL));
    GByteArray *whole = g_byte_array_new_take((guint8 *)contents, n);
    for (int k = 0; k < 20; k++)
        damage(rand, whole);
    g_byte_array_unref(whole);
    g_rand_free(rand);
    g_free(path);
}

int main(int argc, char **argv)
{
    memory_wall();
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/rgbe/eight-orientations-come-out-upright", test_orientations);
    g_test_add_func("/rgbe/exposure-and-known-headers-are-honoured", test_exposure);
    g_test_add_func("/rgbe/everything-else-is-refused-with-a-sentence", test_refusals);
    g_test_add_func("/rgbe/old-and-new-runs-say-the-same", test_runs);
    g_test_add_func("/rgbe/random-damage-never-crashes", test_random_damage);
    g_test_add_func("/rgbe/measured-environments-load", test_environments);
    g_test_add_func("/rgbe/a-measured-environment-cut-or-damaged-is-refused-or-read",
                    test_damaged_environments);
    return g_test_run();
}

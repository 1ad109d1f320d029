#include "core/png.h"
#include "tests/core/shared_data.h"

#include <glib.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

static const size_t limit = 64 << 20;

/* ---- a PNG by hand: signature, IHDR, extra chunk, IDAT of filter-0 rows, IEND ---- */

static void chunk(GByteArray *file, const char *type, const void *data, guint n)
{
    guint32 length = GUINT32_TO_BE(n);
    g_byte_array_append(file, (guint8 *)&length, 4);
    guint at = file->len;
    g_byte_array_append(file, (const guint8 *)type, 4);
    if (n)
        g_byte_array_append(file, data, n);
    guint32 crc = GUINT32_TO_BE((guint32)crc32(0, file->data + at, file->len - at));
    g_byte_array_append(file, (guint8 *)&crc, 4);
}

static GByteArray *by_hand(guint32 w, guint32 h, guint8 depth, guint8 type, const char *extra,
                           const void *extra_data, guint extra_n, const void *rows, guint rows_n)
{
    GByteArray *file = g_byte_array_new();
    guint8 ihdr[13] = {0}, packed[4096];
    uLongf packed_n = sizeof packed;
    g_byte_array_append(file, (const guint8 *)"\x89PNG\r\n\x1a\n", 8);
    ihdr[2] = (guint8)(w >> 8), ihdr[3] = (guint8)w, ihdr[1] = (guint8)(w >> 16);
    ihdr[6] = (guint8)(h >> 8), ihdr[7] = (guint8)h, ihdr[5] = (guint8)(h >> 16);
    ihdr[8] = depth;
    ihdr[9] = type;
    chunk(file, "IHDR", ihdr, sizeof ihdr);
    if (extra)
        chunk(file, extra, extra_data, extra_n);
    g_assert_cmpint(compress(packed, &packed_n, rows, rows_n), ==, Z_OK);
    chunk(file, "IDAT", packed, (guint)packed_n);
    chunk(file, "IEND", NULL, 0);
    return file;
}

static enum ls_err read_png(const GByteArray *file, bool srgb, struct ls_image *image,
                            struct ls_diag *diag)
{
    guint8 *copy = g_memdup2(file->data, file->len ? file->len : 1);
    enum ls_err err = ls_png_read(copy, file->len, srgb, limit, image, diag);
    g_free(copy);
    return err;
}

static void assert_values(GByteArray *file, bool srgb, uint32_t channels, const double *values,
                          int n)
{
    struct ls_image image;
    struct ls_diag diag = {0};
    enum ls_err err = read_png(file, srgb, &image, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpuint(image.n_channels, ==, channels);
    for (int k = 0; k < n; k++)
        g_assert_cmpfloat(fabs(image.pixels[k] - values[k]), <=, 1e-7); /* a float's rounding */
    ls_image_finish(&image);
    g_byte_array_unref(file);
}

static void test_kinds(void)
{
    static const guint8 grey8[] = {0, 0, 51, 255}, grey16[] = {0, 0x80, 0x01, 0xff, 0xff};
    static const guint8 grey1[] = {0, 0xa0}, rgb8[] = {0, 255, 51, 0};
    static const guint8 rgb16[] = {0, 0xff, 0xff, 0x00, 0x01, 0x12, 0x34};
    static const guint8 palette[] = {255, 0, 51, 0, 51, 255}, indices[] = {0, 1, 0};
    assert_values(by_hand(3, 1, 8, 0, NULL, NULL, 0, grey8, 4), false, 1, (double[]){0, 0.2, 1}, 3);
    assert_values(by_hand(2, 1, 16, 0, NULL, NULL, 0, grey16, 5), false, 1,
                  (double[]){0x8001 / 65535.0, 1}, 2);
    assert_values(by_hand(3, 1, 1, 0, NULL, NULL, 0, grey1, 2), false, 1, (double[]){1, 0, 1}, 3);
    assert_values(by_hand(1, 1, 8, 2, NULL, NULL, 0, rgb8, 4), false, 3, (double[]){1, 0.2, 0}, 3);
    assert_values(by_hand(1, 1, 16, 2, NULL, NULL, 0, rgb16, 7), false, 3,
                  (double[]){1, 1 / 65535.0, 0x1234 / 65535.0}, 3);
    assert_values(by_hand(2, 1, 8, 3, "PLTE", palette, 6, indices, 3), false, 3,
                  (double[]){0, 0.2, 1, 1, 0, 0.2}, 6);
}

static void test_srgb(void)
{
    static const guint8 grey8[] = {0, 0, 10, 11, 128, 255};
    /* IEC 61966-2-1: 10/255 is on the line, 11/255 on the curve */
    assert_values(by_hand(5, 1, 8, 0, NULL, NULL, 0, grey8, 6), true, 1,
                  (double[]){0, 10 / 255.0 / 12.92, pow((11 / 255.0 + 0.055) / 1.055, 2.4),
                             pow((128 / 255.0 + 0.055) / 1.055, 2.4), 1},
                  5);
    /* a gAMA chunk changes nothing */
    static const guint8 gamma[] = {0, 0, 0xb1, 0x8f}, grey[] = {0, 51};
    assert_values(by_hand(1, 1, 8, 0, "gAMA", gamma, 4, grey, 2), false, 1, (double[]){0.2}, 1);
}

static void test_refusals(void)
{
    static const guint8 grey_alpha[] = {0, 1, 2}, rgba[] = {0, 1, 2, 3, 4}, grey[] = {0, 1};
    static const guint8 key[] = {0, 1};
    GByteArray *files[] = {by_hand(1, 1, 8, 4, NULL, NULL, 0, grey_alpha, 3),
                           by_hand(1, 1, 8, 6, NULL, NULL, 0, rgba, 5),
                           by_hand(1, 1, 8, 0, "tRNS", key, 2, grey, 2)};
    struct ls_image image;
    for (size_t k = 0; k < G_N_ELEMENTS(files); k++) {
        struct ls_diag diag = {0};
        g_assert_cmpint(read_png(files[k], false, &image, &diag), ==, LS_ERR_UNSUPPORTED);
        g_assert_nonnull(strstr(diag.text, "alpha"));
        g_byte_array_unref(files[k]);
    }
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_png_read("GIF89a  ", 8, false, limit, &image, &diag), ==, LS_ERR_INVALID);
    GByteArray *huge = by_hand(60000, 60000, 8, 0, NULL, NULL, 0, grey, 2);
    g_assert_cmpint(read_png(huge, false, &image, &diag), ==, LS_ERR_LIMIT);
    g_byte_array_unref(huge);
    GByteArray *whole = by_hand(1, 1, 8, 0, NULL, NULL, 0, grey, 2);
    for (guint cut = whole->len; cut-- > 0;) {
        g_byte_array_set_size(whole, cut);
        g_assert_cmpint(read_png(whole, false, &image, &diag), ==, LS_ERR_INVALID);
        g_assert_null(image.pixels);
    }
    g_byte_array_unref(whole);
}

static void test_random_damage(void)
{
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    static const guint8 rows[] = {0, 1, 2, 3, 1, 4, 5, 6};
    g_test_message("seed %u", seed);
    for (int k = 0; k < 5000; k++) {
        GByteArray *file = by_hand(1, 2, 8, 2, NULL, NULL, 0, rows, 8);
        struct ls_image image;
        /* kind and size with a right checksum, so that the damage gets in */
        for (int flips = g_rand_int_range(rand, 1, 3); flips; flips--)
            file->data[g_rand_int_range(rand, 16, 29)] ^=
                (guint8)(1 << g_rand_int_range(rand, 0, 8));
        guint32 crc = GUINT32_TO_BE((guint32)crc32(0, file->data + 12, 17));
        memcpy(file->data + 29, &crc, 4);
        if (read_png(file, k % 2, &image, NULL) == LS_OK)
            ls_image_finish(&image);
        g_byte_array_unref(file);
    }
    g_rand_free(rand);
}

static void test_write(void)
{
    float pixels[6] = {-1, 0, 0.5f, NAN, 1.0f, 1e30f};
    struct ls_image image = {2, 1, 3, pixels}, back;
    uint8_t *bytes;
    size_t n;
    g_assert_cmpint(ls_png_write(&image, 0.5f, &bytes, &n, NULL), ==, LS_OK);
    g_assert_cmpint(ls_png_read(bytes, n, false, limit, &back, NULL), ==, LS_OK);
    /* sRGB(0.25) = 0.5371 -> 137, sRGB(0.5) = 0.7354 -> 188 */
    static const int codes[6] = {0, 0, 137, 0, 188, 255};
    for (int k = 0; k < 6; k++)
        g_assert_cmpfloat(roundf(back.pixels[k] * 255), ==, codes[k]);
    ls_image_finish(&back);
    free(bytes);
    g_assert_cmpint(ls_png_write(&image, 0, &bytes, &n, NULL), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_png_write(&image, NAN, &bytes, &n, NULL), ==, LS_ERR_INVALID);
}

/* Every code survives decode and encode. */
static void test_codes_round_trip(void)
{
    float pixels[256];
    struct ls_image image = {256, 1, 1, pixels}, back;
    uint8_t *bytes;
    size_t n;
    for (int k = 0; k < 256; k++) {
        double v = k / 255.0;
        pixels[k] = (float)(v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4));
    }
    g_assert_cmpint(ls_png_write(&image, 1, &bytes, &n, NULL), ==, LS_OK);
    g_assert_cmpint(ls_png_read(bytes, n, false, limit, &back, NULL), ==, LS_OK);
    for (int k = 0; k < 256; k++)
        g_assert_cmpfloat(roundf(back.pixels[k] * 255), ==, k);
    ls_image_finish(&back);
    g_assert_cmpint(ls_png_read(bytes, n, true, limit, &back, NULL), ==, LS_OK);
    g_assert_cmpmem(back.pixels, sizeof pixels, pixels, sizeof pixels);
    ls_image_finish(&back);
    free(bytes);
}

static void test_photographs(void)
{
    for (int k = 1; k <= 12; k++) {
        char *relative = g_strdup_printf("stacks/psbox/Objects/Image_%02d.png", k), *contents;
        char *path = shared_data(relative);
        g_free(relative);
        if (!path)
            return;
        gsize n;
        struct ls_image image;
        g_assert_true(g_file_get_contents(path, &contents, &n, NULL));
        g_assert_cmpint(ls_png_read(contents, n, true, limit, &image, NULL), ==, LS_OK);
        g_assert_cmpuint(image.width, ==, 430);
        g_assert_cmpuint(image.height, ==, 550);
        g_assert_cmpuint(image.n_channels, ==, 1);
        ls_image_finish(&image);
        g_free(contents);
        g_free(path);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/png/grey-rgb-and-palette-of-all-depths-load", test_kinds);
    g_test_add_func("/png/srgb-is-decoded-on-request-only", test_srgb);
    g_test_add_func("/png/transparency-and-damage-are-refused", test_refusals);
    g_test_add_func("/png/random-damage-never-crashes", test_random_damage);
    g_test_add_func("/png/writing-scales-encodes-and-clamps", test_write);
    g_test_add_func("/png/every-code-survives", test_codes_round_trip);
    g_test_add_func("/png/measured-photographs-load", test_photographs);
    return g_test_run();
}

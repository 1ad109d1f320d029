#include "clients/contact_sheet.h"
#include "core/png.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>

enum { WIDTH = 300, HEIGHT = 200, PICTURES = 7 };

/* Picture k is @k + 1 in green, and twice that in the left half of red. */
static void fill(struct ls_image *image, int k)
{
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            float *pixel = image->pixels + 3 * (y * WIDTH + x);
            pixel[0] = x < WIDTH / 2 ? 2 * (float)(k + 1) : 0;
            pixel[1] = (float)(k + 1);
            pixel[2] = 0;
        }
}

static struct ls_image written(struct ls_contact_sheet *sheet, float *scale)
{
    g_autofree char *folder = g_dir_make_tmp("ls-sheet-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "sheet.png", NULL), *text = NULL;
    gsize n;
    struct ls_image image;
    g_assert_cmpint(ls_contact_sheet_write(sheet, path, scale, NULL), ==, LS_OK);
    g_assert_true(g_file_get_contents(path, &text, &n, NULL));
    g_assert_cmpint(ls_png_read(text, n, true, 1 << 26, &image, NULL), ==, LS_OK);
    g_unlink(path);
    g_rmdir(folder);
    return image;
}

static const float *pixel(const struct ls_contact_sheet *sheet, const struct ls_image *image,
                          uint32_t k, uint32_t x, uint32_t y)
{
    uint32_t left = k % sheet->columns * sheet->cell_width + 4,
             top = k / sheet->columns * sheet->cell_height + 4;
    return image->pixels + 3 * ((top + y) * image->width + left + x);
}

/* A pixel in fourteen has the largest value, 14: that is the 99th percentile. */
static void pictures_stand_in_order_under_one_exposure(void)
{
    struct ls_contact_sheet sheet;
    struct ls_image picture;
    float scale;
    g_assert_cmpint(ls_contact_sheet_begin(&sheet, PICTURES, NULL, NULL), ==, LS_OK);
    g_assert_cmpint(ls_image_init(&picture, WIDTH, HEIGHT, 3, 1 << 26, NULL), ==, LS_OK);
    for (int k = 0; k < PICTURES; k++) {
        fill(&picture, k);
        g_assert_cmpint(ls_contact_sheet_add(&sheet, &picture, (uint32_t)k * 11, NULL), ==, LS_OK);
    }
    g_assert_cmpuint(sheet.bin, ==, 3);
    struct ls_image image = written(&sheet, &scale);
    g_assert_cmpfloat_with_epsilon((double)scale, 0.8 / 14, 1e-6);
    for (uint32_t k = 0; k < PICTURES; k++) {
        const float *left = pixel(&sheet, &image, k, 20, 30),
                    *right = pixel(&sheet, &image, k, 80, 30);
        double green = (double)scale * (k + 1);
        double step = 0.015 * green; /* half of one of 8 bits is 1.5 % at 0.057, less above */
        g_assert_cmpfloat_with_epsilon((double)left[0], 2 * green, 2 * step);
        g_assert_cmpfloat_with_epsilon((double)left[1], green, step);
        g_assert_cmpfloat_with_epsilon((double)right[0], 0, 1e-6);
        g_assert_cmpfloat_with_epsilon((double)right[1], green, step);
    }
    g_assert_cmpint(ls_contact_sheet_add(&sheet, &picture, 0, NULL), ==, LS_ERR_INVALID);
    ls_image_finish(&image);
    ls_image_finish(&picture);
    ls_contact_sheet_finish(&sheet);
}

/* 4 x 4 of 4 x 4 pixels, of one colour: a label is read by its lit pixels. */
static void lights_bear_their_numbers(void)
{
    static const uint32_t lights[2] = {407, 17};
    static const char *const expected[2][7] = {
        {"...#. .###. #####", "..##. #...# ....#", ".#.#. #..## ...#.", "#..#. #.#.# ..#..",
         "##### ##..# .#...", "...#. #...# .#...", "...#. .###. .#..."},
        {"..#.. ##### .....", ".##.. ....# .....", "..#.. ...#. .....", "..#.. ..#.. .....",
         "..#.. .#... .....", "..#.. .#... .....", ".###. .#... ....."}};
    struct ls_contact_sheet sheet;
    float pixels[16 * 3], scale;
    struct ls_image picture = {4, 4, 3, pixels};
    for (int i = 0; i < 16 * 3; i++)
        pixels[i] = 1;
    g_assert_cmpint(ls_contact_sheet_begin(&sheet, 2, NULL, NULL), ==, LS_OK);
    for (int k = 0; k < 2; k++)
        g_assert_cmpint(ls_contact_sheet_add(&sheet, &picture, lights[k], NULL), ==, LS_OK);
    struct ls_image image = written(&sheet, &scale);
    for (uint32_t k = 0; k < 2; k++)
        for (uint32_t y = 0; y < 7; y++)
            for (uint32_t x = 0; x < 17; x++)
                g_assert_cmpint(pixel(&sheet, &image, k, x, 5 + y)[1] > 0.3f, ==,
                                expected[k][y][x] == '#');
    ls_image_finish(&image);
    ls_contact_sheet_finish(&sheet);
}

/* As many lights as a take may have, at full size: 2^24 pixels of pictures and what is between. */
static void a_large_sheet_has_smaller_pictures(void)
{
    struct ls_contact_sheet sheet;
    struct ls_image picture;
    g_assert_cmpint(ls_image_init(&picture, 1024, 1024, 1, 1 << 26, NULL), ==, LS_OK);
    g_assert_cmpint(ls_contact_sheet_begin(&sheet, 4096, NULL, NULL), ==, LS_OK);
    g_assert_cmpint(ls_contact_sheet_add(&sheet, &picture, 0, NULL), ==, LS_OK);
    g_assert_cmpuint(sheet.width, >=, 60);
    g_assert_cmpuint(4096 * sheet.width * sheet.height, <=, 1 << 24);
    g_assert_cmpuint(sheet.columns * sheet.rows, >=, 4096);
    ls_image_finish(&picture);
    ls_contact_sheet_finish(&sheet);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/contact-sheet/pictures-stand-in-order-under-one-exposure",
                    pictures_stand_in_order_under_one_exposure);
    g_test_add_func("/contact-sheet/lights-bear-their-numbers", lights_bear_their_numbers);
    g_test_add_func("/contact-sheet/a-large-sheet-has-smaller-pictures",
                    a_large_sheet_has_smaller_pictures);
    return g_test_run();
}

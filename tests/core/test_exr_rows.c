/* A picture written as its rows come is the file that is written at once. */
#include "core/exr_rows.h"

#include <glib.h>
#include <stdlib.h>
#include <string.h>

/* What was put, and when nothing more is taken. */
struct file {
    uint8_t *bytes;
    size_t n, room, full;
};

static bool put(void *user, const void *bytes, size_t n, uint64_t offset)
{
    struct file *file = user;
    if (offset + n > file->full)
        return false;
    g_assert_cmpuint(offset + n, <=, file->room);
    memcpy(file->bytes + offset, bytes, n);
    file->n = MAX(file->n, offset + n);
    return true;
}

static struct file a_file(size_t full)
{
    return (struct file){.bytes = g_malloc0(1 << 22), .room = 1 << 22, .full = full};
}

static float *some_pixels(size_t n)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    float *pixels = g_new(float, n);
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < n; k++)
        pixels[k] = (float)g_rand_double_range(rand, -1, 1000);
    return pixels;
}

static void check_size(uint32_t width, uint32_t height, uint32_t n_channels, enum ls_exr_type type,
                       uint32_t step)
{
    g_autofree float *pixels = some_pixels((size_t)width * height * n_channels);
    struct ls_exr_attrs attrs = {0};
    struct ls_diag diag = {{0}};
    struct file file = a_file(SIZE_MAX);
    const struct ls_image image = {
        .width = width, .height = height, .n_channels = n_channels, .pixels = pixels};
    uint8_t *expected;
    size_t n;
    ls_exr_attrs_string(&attrs, "lightstage/environment", "sky.0001.exr");
    g_assert_cmpint(ls_exr_write_image(&image, type, &attrs, &expected, &n, &diag), ==, LS_OK);
    const struct ls_exr_rows_of of = {.width = width,
                                      .height = height,
                                      .n_channels = n_channels,
                                      .type = type,
                                      .attrs = &attrs,
                                      .put = put,
                                      .user = &file};
    struct ls_exr_rows *rows;
    g_assert_cmpint(ls_exr_rows_begin(&of, &rows, &diag), ==, LS_OK);
    ls_exr_attrs_finish(&attrs);
    for (uint32_t y = 0; y < height; y += step)
        g_assert_cmpint(ls_exr_rows_add(rows, pixels + (size_t)y * width * n_channels,
                                        MIN(step, height - y), &diag),
                        ==, LS_OK);
    g_assert_cmpint(ls_exr_rows_add(rows, pixels, 1, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_exr_rows_end(rows, &diag), ==, LS_OK);
    ls_exr_rows_destroy(rows);
    g_assert_cmpmem(file.bytes, file.n, expected, n);
    free(expected);
    g_free(file.bytes);
}

static void test_as_at_once(void)
{
    check_size(200, 150, 3, LS_EXR_FLOAT, 7);
    check_size(64, 64, 3, LS_EXR_HALF, 64);
    check_size(65, 129, 1, LS_EXR_FLOAT, 100);
    check_size(1, 1, 3, LS_EXR_FLOAT, 1);
}

static void test_what_is_missing_is_said(void)
{
    const float row[3 * 10] = {0};
    struct ls_diag diag = {{0}};
    struct file file = a_file(SIZE_MAX);
    struct ls_exr_rows *rows;
    struct ls_exr_rows_of of = {
        .width = 10, .height = 3, .n_channels = 3, .type = LS_EXR_FLOAT, .put = put, .user = &file};
    g_assert_cmpint(ls_exr_rows_begin(&of, &rows, &diag), ==, LS_OK);
    g_assert_cmpint(ls_exr_rows_add(rows, row, 1, &diag), ==, LS_OK);
    g_assert_cmpint(ls_exr_rows_end(rows, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "2 of 3 rows are missing"));
    ls_exr_rows_destroy(rows);
    of.n_channels = 2;
    g_assert_cmpint(ls_exr_rows_begin(&of, &rows, &diag), ==, LS_ERR_INVALID);
    of.n_channels = 3;
    of.width = 0;
    g_assert_cmpint(ls_exr_rows_begin(&of, &rows, &diag), ==, LS_ERR_INVALID);
    of.width = 1 << 20;
    g_assert_cmpint(ls_exr_rows_begin(&of, &rows, &diag), ==, LS_ERR_INVALID);
    g_free(file.bytes);
}

/* Wherever the file takes no more, somebody hears of it. */
static void test_a_full_file_is_an_error(void)
{
    const float row[3 * 100] = {0};
    for (size_t full = 0; full < 100 * 130 * 12; full += 4999) {
        struct ls_diag diag = {{0}};
        struct file file = a_file(full);
        const struct ls_exr_rows_of of = {.width = 100,
                                          .height = 130,
                                          .n_channels = 3,
                                          .type = LS_EXR_FLOAT,
                                          .put = put,
                                          .user = &file};
        struct ls_exr_rows *rows = NULL;
        enum ls_err err = ls_exr_rows_begin(&of, &rows, &diag);
        for (uint32_t y = 0; y < of.height && !err; y++)
            err = ls_exr_rows_add(rows, row, 1, &diag);
        if (!err)
            err = ls_exr_rows_end(rows, &diag);
        g_assert_cmpint(err, ==, LS_ERR_INVALID);
        g_assert_cmpstr(diag.text, !=, "");
        ls_exr_rows_destroy(rows);
        g_free(file.bytes);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/exr-rows/as-at-once", test_as_at_once);
    g_test_add_func("/exr-rows/what-is-missing-is-said", test_what_is_missing_is_said);
    g_test_add_func("/exr-rows/a-full-file-is-an-error", test_a_full_file_is_an_error);
    return g_test_run();
}

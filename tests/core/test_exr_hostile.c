#include "core/exr.h"
#include "tests/core/memory_wall.h"
#include "tests/core/shared_data.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Images of up to 1000 x 1000 RGB floats are 12 MB; the rest is for the decoder's buffers. */
static const size_t limit = 64 << 20;

/* Refused or read; either way everything comes back to us, and refusals have their sentence. */
static enum ls_err read_all_ways(const char *name, const void *bytes, size_t n)
{
    struct ls_image image;
    struct ls_exr_attrs attrs = {0};
    struct ls_exr_tiles tiles;
    struct ls_exr_plane plane;
    struct ls_diag diag = {0};
    enum ls_err err = ls_exr_read(bytes, n, NULL, limit, &image, &attrs, &diag);
    g_test_message("%s: %s%s", name, ls_err_name(err), diag.text);
    g_assert_cmpint(err, !=, LS_ERR_BUG);
    g_assert_true(!err || *diag.text);
    g_assert_true(g_str_is_ascii(diag.text)); /* whatever the file is full of */
    if (!err)
        g_assert_nonnull(image.pixels);
    ls_image_finish(&image);
    ls_exr_attrs_finish(&attrs);
    if (!ls_exr_map_tiles(bytes, n, NULL, &tiles, NULL))
        ls_exr_tiles_finish(&tiles);
    if (!ls_exr_read_plane(bytes, n, NULL, limit, &plane, NULL))
        free(plane.samples);
    return err;
}

static size_t each_file(const char *relative, size_t *n_read)
{
    size_t count = 0;
    char *folder = shared_data(relative);
    GDir *dir = folder ? g_dir_open(folder, 0, NULL) : NULL;
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        char *path = g_build_filename(folder, name, NULL), *contents;
        gsize n;
        g_assert_true(g_file_get_contents(path, &contents, &n, NULL));
        clock_t began = clock();
        *n_read += read_all_ways(name, contents, n) == LS_OK;
        /* all of them together take less than a second; a sanitizer costs ten times as much */
        g_assert_cmpfloat((double)(clock() - began) / CLOCKS_PER_SEC, <, 10);
        count++;
        g_free(contents);
        g_free(path);
    }
    if (dir)
        g_dir_close(dir);
    g_free(folder);
    return count;
}

static void test_damaged(void)
{
    size_t n_read = 0, n = each_file("openexr/Damaged", &n_read);
    g_test_message("%zu files, %zu of them readable", n, n_read);
    g_assert_true(n == 0 || n > 100);
}

static void test_valid(void)
{
    static const char *const folders[] = {"openexr/TestImages", "openexr/DisplayWindow",
                                          "openexr/LuminanceChroma"};
    for (size_t k = 0; k < G_N_ELEMENTS(folders); k++) {
        size_t n_read = 0, n = each_file(folders[k], &n_read);
        g_assert_cmpuint(n_read, ==, n);
    }
}

static void test_luminance_chroma(void)
{
    static const char *const names[3] = {"Y", "RY", "BY"};
    float value = 0.5f;
    struct ls_exr_channel channels[3];
    for (int c = 0; c < 3; c++)
        channels[c] =
            (struct ls_exr_channel){names[c], LS_EXR_HALF, LS_EXR_FROM_FLOAT, &value, 4, 4};
    struct ls_exr_part part = {.width = 1, .height = 1, .channels = channels, .n_channels = 3};
    uint8_t *bytes;
    size_t n;
    struct ls_image image;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_exr_write(&part, 1, &bytes, &n, NULL), ==, LS_OK);
    g_assert_cmpint(ls_exr_read(bytes, n, NULL, limit, &image, NULL, &diag), ==,
                    LS_ERR_UNSUPPORTED);
    g_assert_nonnull(strstr(diag.text, "convert to R G B"));
    free(bytes);
}

/* Channels beside the one that is read, whichever unpacking a library would choose by their number
 * and type: OpenEXRCore 3.1.5 itself writes through NULL for half samples B, G, Y. */
static void test_other_channels(void)
{
    static const char *const names[] = {"Y", "A", "B", "G", "Z"};
    float value[5][70];
    struct ls_exr_channel channels[5];
    for (int c = 0; c < 5; c++)
        for (int x = 0; x < 70; x++)
            value[c][x] = (float)(100 * c + x); /* exact in half */
    for (int kind = LS_EXR_HALF; kind <= LS_EXR_FLOAT; kind++)
        for (size_t n = 1; n <= 5; n++) {
            for (size_t c = 0; c < n; c++)
                channels[c] = (struct ls_exr_channel){
                    names[c], (enum ls_exr_type)kind, LS_EXR_FROM_FLOAT, value[c], 4, 0};
            struct ls_exr_part part = {
                .width = 70, .height = 66, .channels = channels, .n_channels = n};
            struct ls_image image;
            uint8_t *bytes;
            size_t n_bytes;
            g_assert_cmpint(ls_exr_write(&part, 1, &bytes, &n_bytes, NULL), ==, LS_OK);
            g_assert_cmpint(ls_exr_read(bytes, n_bytes, NULL, limit, &image, NULL, NULL), ==,
                            LS_OK);
            g_assert_cmpuint(image.n_channels, ==, 1);
            for (int k = 0; k < 70 * 66; k++)
                g_assert_cmpfloat(image.pixels[k], ==, value[0][k % 70]);
            ls_image_finish(&image);
            free(bytes);
        }
}

/* @bytes changed at random, headers and chunk tables preferred, sometimes cut. */
static void mutate(GRand *rand, const void *bytes, size_t n, int rounds)
{
    for (int k = 0; k < rounds; k++) {
        uint8_t *copy = g_memdup2(bytes, n);
        for (int flips = g_rand_int_range(rand, 1, 6); flips; flips--) {
            size_t range = g_rand_int_range(rand, 0, 2) && n > 600 ? 600 : n;
            copy[g_rand_int_range(rand, 8, (gint32)range)] = (uint8_t)g_rand_int(rand);
        }
        size_t cut =
            g_rand_int_range(rand, 0, 8) ? n : (size_t)g_rand_int_range(rand, 1, (gint32)n);
        read_all_ways("mutation", copy, cut);
        g_free(copy);
    }
}

static int rounds(int few)
{
    const char *given = g_getenv("LS_TEST_ROUNDS");
    return given ? atoi(given) : g_getenv("LS_TEST_FULL") ? 50 * few : few;
}

static void test_mutations(void)
{
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    static float pixels[70 * 66 * 3];
    struct ls_image image = {70, 66, 3, pixels};
    uint8_t *bytes;
    size_t n;
    g_test_message("seed %u", seed);
    g_assert_cmpint(ls_exr_write_image(&image, LS_EXR_HALF, NULL, &bytes, &n, NULL), ==, LS_OK);
    mutate(rand, bytes, n, rounds(5000));
    free(bytes);
    g_rand_free(rand);
}

/* The same through every decompressor. */
static void test_compressed_mutations(void)
{
    static const char *const options[] = {"--compression rle",
                                          "--compression zips",
                                          "--compression zip",
                                          "--compression piz",
                                          "--compression pxr24",
                                          "--compression b44",
                                          "--compression b44a",
                                          "--compression piz --tile 32 32",
                                          "-d float --compression pxr24",
                                          "-d float --compression zip --tile 16 48"};
    char *tool = g_find_program_in_path("oiiotool");
    if (!tool)
        return g_test_skip("oiiotool is not installed");
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    char *folder = g_dir_make_tmp("ls-exr-XXXXXX", NULL);
    char *path = g_build_filename(folder, "a.exr", NULL);
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < G_N_ELEMENTS(options); k++) {
        char *command =
            g_strdup_printf("%s --pattern noise 90x50 3 %s -o %s", tool, options[k], path);
        char *contents;
        gsize n;
        int status;
        g_assert_true(g_spawn_command_line_sync(command, NULL, NULL, &status, NULL));
        g_assert_true(g_spawn_check_wait_status(status, NULL));
        g_assert_true(g_file_get_contents(path, &contents, &n, NULL));
        g_assert_cmpint(read_all_ways(options[k], contents, n), ==, LS_OK);
        mutate(rand, contents, n, rounds(150));
        g_free(contents);
        g_free(command);
    }
    g_unlink(path);
    g_rmdir(folder);
    g_free(path);
    g_free(folder);
    g_free(tool);
    g_rand_free(rand);
}

int main(int argc, char **argv)
{
    memory_wall();
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/exr/damaged-files-are-refused-or-read-within-a-gigabyte", test_damaged);
    g_test_add_func("/exr/valid-files-of-the-reference-collection-load", test_valid);
    g_test_add_func("/exr/luminance-chroma-is-refused-with-a-sentence", test_luminance_chroma);
    g_test_add_func("/exr/channels-that-nobody-reads-may-stand-beside", test_other_channels);
    g_test_add_func("/exr/random-damage-never-crashes", test_mutations);
    g_test_add_func("/exr/random-damage-of-compressed-files-never-crashes",
                    test_compressed_mutations);
    return g_test_run();
}

#include "core/exr.h"
#include "tests/core/shared_data.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static const size_t limit = 256 << 20;

static uint16_t *random_halves(guint32 seed, size_t n)
{
    GRand *rand = g_rand_new_with_seed(seed);
    uint16_t *halves = g_new(uint16_t, n);
    for (size_t k = 0; k < n; k++) {
        do
            halves[k] = (uint16_t)g_rand_int(rand);
        while ((halves[k] & 0x7c00) == 0x7c00); /* finite ones */
    }
    g_rand_free(rand);
    return halves;
}

static void set_take_attrs(struct ls_exr_attrs *attrs)
{
    static const float identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    ls_exr_attrs_float(attrs, "expTime", 0.0025f);
    ls_exr_attrs_string(attrs, "capDate", "2024:05:17 12:00:00");
    ls_exr_attrs_float(attrs, "utcOffset", 0);
    ls_exr_attrs_string(attrs, "cameraMake", "Maker");
    ls_exr_attrs_string(attrs, "cameraModel", "Model");
    ls_exr_attrs_string(attrs, "cameraSerialNumber", "0042");
    ls_exr_attrs_string(attrs, "lensModel", "50 mm");
    ls_exr_attrs_float(attrs, "aperture", 5.6f);
    ls_exr_attrs_float(attrs, "isoSpeed", 100);
    ls_exr_attrs_timecode(attrs, "timeCode", 0x01020304, 7);
    ls_exr_attrs_m44f(attrs, "worldToCamera", identity);
    ls_exr_attrs_string(attrs, "lightstage/take", "20240517T120000Z-still-00beef");
    ls_exr_attrs_int(attrs, "lightstage/light", 137);
    ls_exr_attrs_v3f(attrs, "lightstage/direction", (float[3]){0.6f, 0.8f, 0});
    ls_exr_attrs_v3f(attrs, "lightstage/position", (float[3]){0.81f, 1.08f, 0});
    ls_exr_attrs_string(attrs, "lightstage/channel", "W");
    ls_exr_attrs_float(attrs, "lightstage/duty", 1);
    ls_exr_attrs_float(attrs, "lightstage/gain", 1.05f);
    ls_exr_attrs_float(attrs, "lightstage/referenceExposure", 0.01f);
    ls_exr_attrs_string(attrs, "lightstage/cfa", "RGGB");
    ls_exr_attrs_int(attrs, "lightstage/blackSubtracted", 1);
}

/* In memory that held something else, at most as much as was promised. */
static void assert_the_same_in_place(const struct ls_exr_mosaic *mosaic, const uint8_t *bytes,
                                     size_t n)
{
    size_t room = ls_exr_mosaic_room(mosaic), got;
    struct ls_diag diag = {0};
    uint8_t *place = g_malloc(room);
    memset(place, 0xa5, room);
    g_assert_cmpint(ls_exr_write_mosaic_to(mosaic, place, room, &got, &diag), ==, LS_OK);
    g_assert_cmpmem(place, got, bytes, n);
    memset(place, 0xa5, room);
    g_assert_cmpint(ls_exr_write_mosaic_to(mosaic, place, n - 1, &got, &diag), ==, LS_ERR_NOMEM);
    g_assert_cmpint(ls_exr_write_mosaic_to(mosaic, place, 100, &got, &diag), ==, LS_ERR_NOMEM);
    g_assert_cmpuint(place[n - 1], ==, 0xa5);
    g_free(place);
}

static void write_mosaic(uint32_t w, uint32_t h, const uint16_t *half, const uint8_t *validity,
                         uint8_t **bytes, size_t *n)
{
    struct ls_exr_attrs attrs = {0};
    struct ls_diag diag = {0};
    set_take_attrs(&attrs);
    struct ls_exr_mosaic mosaic = {w, h, half, NULL, validity, &attrs};
    enum ls_err err = ls_exr_write_mosaic(&mosaic, bytes, n, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    assert_the_same_in_place(&mosaic, *bytes, *n);
    ls_exr_attrs_finish(&attrs);
}

static void test_mosaic_round_trip(void)
{
    static const uint32_t sizes[][2] = {{1, 1}, {64, 64}, {65, 63}, {200, 130}, {512, 512}};
    guint32 seed = g_test_rand_int();
    g_test_message("seed %u", seed);
    for (size_t s = 0; s < G_N_ELEMENTS(sizes); s++) {
        uint32_t w = sizes[s][0], h = sizes[s][1];
        uint16_t *half = random_halves(seed + s, (size_t)w * h);
        uint8_t *bytes;
        size_t n;
        write_mosaic(w, h, half, NULL, &bytes, &n);
        g_assert_cmpuint(n, <=, ls_exr_mosaic_bytes_max(w, h, LS_EXR_HALF));
        struct ls_exr_plane plane;
        g_assert_cmpint(ls_exr_read_plane(bytes, n, "mosaic", limit, &plane, NULL), ==, LS_OK);
        g_assert_cmpuint(plane.width, ==, w);
        g_assert_cmpuint(plane.height, ==, h);
        g_assert_cmpmem(plane.samples, (size_t)w * h * 2, half, (size_t)w * h * 2);
        free(plane.samples);
        g_assert_cmpint(ls_exr_read_plane(bytes, n, "validity", limit, &plane, NULL), ==,
                        LS_ERR_NOT_FOUND);
        free(bytes);
        g_free(half);
    }
}

static void test_validity_part(void)
{
    enum { W = 150, H = 70 };
    uint16_t *half = random_halves(1, W * H);
    uint8_t validity[W * H] = {0}, *bytes;
    size_t n;
    validity[0] = 1;
    validity[W * H - 1] = 3;
    validity[64 * W + 64] = 2;
    write_mosaic(W, H, half, validity, &bytes, &n);
    struct ls_image image;
    struct ls_exr_attrs attrs;
    g_assert_cmpuint(n, <=, ls_exr_mosaic_bytes_max(W, H, LS_EXR_HALF));
    g_assert_cmpint(ls_exr_read(bytes, n, "validity", limit, &image, &attrs, NULL), ==, LS_OK);
    g_assert_cmpuint(image.n_channels, ==, 1);
    for (size_t k = 0; k < W * H; k++)
        g_assert_cmpfloat(image.pixels[k], ==, validity[k]);
    ls_exr_attrs_finish(&attrs);
    ls_image_finish(&image);
    struct ls_exr_plane plane;
    g_assert_cmpint(ls_exr_read_plane(bytes, n, NULL, limit, &plane, NULL), ==, LS_OK);
    g_assert_cmpmem(plane.samples, W * H * 2, half, W * H * 2);
    free(plane.samples);
    memset(validity, 0, sizeof validity);
    free(bytes);
    write_mosaic(W, H, half, validity, &bytes, &n);
    g_assert_cmpint(ls_exr_read_plane(bytes, n, "validity", limit, &plane, NULL), ==,
                    LS_ERR_NOT_FOUND);
    free(bytes);
    g_free(half);
}

static void test_attributes_round_trip(void)
{
    uint16_t half = 0x3c00;
    uint8_t *bytes;
    size_t n;
    write_mosaic(1, 1, &half, NULL, &bytes, &n);
    struct ls_image image;
    struct ls_exr_attrs want = {0}, got;
    set_take_attrs(&want);
    g_assert_cmpint(ls_exr_read(bytes, n, NULL, limit, &image, &got, NULL), ==, LS_OK);
    g_assert_cmpfloat(image.pixels[0], ==, 1);
    for (size_t k = 0; k < want.n; k++) {
        const struct ls_exr_attr *a = &want.items[k], *b = ls_exr_attrs_find(&got, a->name);
        g_assert_nonnull(b);
        g_assert_cmpint(a->kind, ==, b->kind);
        g_assert_cmpstr(a->text, ==, b->text);
        g_assert_cmpint(a->i, ==, b->i);
        g_assert_cmpmem(a->f, sizeof a->f, b->f, sizeof b->f);
        g_assert_cmpmem(a->tc, sizeof a->tc, b->tc, sizeof b->tc);
    }
    ls_exr_attrs_finish(&want);
    ls_exr_attrs_finish(&got);
    ls_image_finish(&image);
    free(bytes);
}

static void test_bad_attribute_is_an_error(void)
{
    struct ls_exr_attrs attrs = {0};
    struct ls_diag diag = {0};
    uint8_t *bytes;
    size_t n;
    uint16_t half = 0;
    ls_exr_attrs_int(&attrs, "lightstage/a name that is far too long", 1);
    struct ls_exr_mosaic mosaic = {1, 1, &half, NULL, NULL, &attrs};
    g_assert_cmpint(ls_exr_write_mosaic(&mosaic, &bytes, &n, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "far too long"));
    ls_exr_attrs_finish(&attrs);
}

/* Layers out of alphabetical order, float and half together, negative values, a cropped window. */
static void test_layers(void)
{
    enum { W = 70, H = 67 };
    static const char *const names[6] = {"white.R", "white.G", "white.B",
                                         "blue.R",  "blue.G",  "blue.B"};
    float *pixels = g_new(float, W *H * 6);
    struct ls_exr_channel channels[6];
    for (size_t k = 0; k < W * H * 6; k++)
        pixels[k] = (float)(k % 2048) - 1000; /* exact in half */
    for (int c = 0; c < 6; c++)
        channels[c] = (struct ls_exr_channel){
            names[c], c < 3 ? LS_EXR_HALF : LS_EXR_FLOAT, LS_EXR_FROM_FLOAT, pixels + c, 24,
            24 * W};
    struct ls_exr_part part = {.width = W,
                               .height = H,
                               .x = 10,
                               .y = 20,
                               .display_width = 200,
                               .display_height = 100,
                               .channels = channels,
                               .n_channels = 6};
    uint8_t *bytes;
    size_t n;
    g_assert_cmpint(ls_exr_write(&part, 1, &bytes, &n, NULL), ==, LS_OK);
    for (int layer = 0; layer < 2; layer++) {
        struct ls_image image;
        g_assert_cmpint(ls_exr_read(bytes, n, layer ? "blue" : "white", limit, &image, NULL, NULL),
                        ==, LS_OK);
        g_assert_cmpuint(image.n_channels, ==, 3);
        for (size_t k = 0; k < W * H; k++)
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat(image.pixels[3 * k + c], ==, pixels[6 * k + 3 * layer + c]);
        ls_image_finish(&image);
    }
    struct ls_image image;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_exr_read(bytes, n, "green", limit, &image, NULL, &diag), ==,
                    LS_ERR_NOT_FOUND);
    g_assert_nonnull(strstr(diag.text, "green"));
    free(bytes);
    g_free(pixels);
}

static void test_float_to_half(void)
{
    /* value, half bits: the edges of IEEE 754 binary16, ties to even */
    static const struct {
        float value;
        uint16_t bits;
    } cases[] = {
        {0.0f, 0},
        {-0.0f, 0x8000},
        {1.0f, 0x3c00},
        {-2.0f, 0xc000},
        {65504.0f, 0x7bff},
        {65519.996f, 0x7bff},
        {65520.0f, 0x7c00},
        {-1e10f, 0xfc00},
        {0x1p-14f, 0x0400},
        {0x1p-24f, 0x0001},
        {0x1p-25f, 0x0000},        /* tie to even: zero */
        {0x1.8p-24f, 0x0002},      /* tie to even: two */
        {1.0f + 0x1p-11f, 0x3c00}, /* tie to even */
        {1.0f + 0x3p-11f, 0x3c02},
        {1.0f + 0x1.002p-11f, 0x3c01},
    };
    for (size_t k = 0; k < G_N_ELEMENTS(cases); k++) {
        struct ls_image image = {1, 1, 1, (float *)&cases[k].value};
        uint8_t *bytes;
        size_t n;
        g_assert_cmpint(ls_exr_write_image(&image, LS_EXR_HALF, NULL, &bytes, &n, NULL), ==, LS_OK);
        struct ls_exr_plane plane;
        g_assert_cmpint(ls_exr_read_plane(bytes, n, NULL, limit, &plane, NULL), ==, LS_OK);
        g_assert_cmphex(*(uint16_t *)plane.samples, ==, cases[k].bits);
        free(plane.samples);
        free(bytes);
    }
}

static void test_map_tiles(void)
{
    enum { W = 200, H = 130 };
    uint16_t *half = random_halves(7, W * H);
    uint8_t validity[W * H] = {0}, *bytes;
    size_t n;
    validity[5] = 1; /* two parts */
    write_mosaic(W, H, half, validity, &bytes, &n);
    struct ls_exr_tiles tiles;
    g_assert_cmpint(ls_exr_map_tiles(bytes, n, "mosaic", &tiles, NULL), ==, LS_OK);
    g_assert_cmpuint(tiles.n_x, ==, 4);
    g_assert_cmpuint(tiles.n_y, ==, 3);
    g_assert_cmpint(tiles.type, ==, LS_EXR_HALF);
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            uint32_t tx = x / 64, ty = y / 64, tw = ls_exr_tile_width(&tiles, tx);
            const uint8_t *at = tiles.tile[ty * tiles.n_x + tx] + 2 * (y % 64 * tw + x % 64);
            g_assert_cmpmem(at, 2, &half[y * W + x], 2);
        }
    ls_exr_tiles_finish(&tiles);
    for (size_t cut = 0; cut < n; cut += cut < n - 40 ? 97 : 1) {
        uint8_t *copy =
            g_memdup2(bytes, cut ? cut : 1); /* its own block: a checker sees overruns */
        enum ls_err err = ls_exr_map_tiles(copy, cut, "validity", &tiles, NULL);
        g_assert_cmpint(err, !=, LS_OK);
        g_free(copy);
    }
    free(bytes);
    g_free(half);
}

/* Chunk table entries of tile 1 and others made equal to tile 0's, beyond the end, or in between.
 */
static void test_map_refuses_a_lying_chunk_table(void)
{
    uint16_t *half = random_halves(9, 128 * 128);
    uint8_t *bytes;
    size_t n;
    write_mosaic(128, 128, half, NULL, &bytes, &n);
    struct ls_exr_tiles tiles;
    g_assert_cmpint(ls_exr_map_tiles(bytes, n, NULL, &tiles, NULL), ==, LS_OK);
    uint64_t first = (uint64_t)(tiles.tile[0] - bytes) - 20;
    ls_exr_tiles_finish(&tiles);
    uint8_t *table = bytes + first - 4 * 8, *second = table + 8;
    uint64_t entry;
    memcpy(&entry, table, 8);
    g_assert_cmpuint(entry, ==, first);
    const uint64_t lies[] = {0,     first,      first + 1,         n,
                             n - 3, UINT64_MAX, (uint64_t)1 << 63, first - 8};
    for (size_t k = 0; k < G_N_ELEMENTS(lies); k++) {
        uint8_t *copy = g_memdup2(bytes, n);
        memcpy(copy + (second - bytes), &lies[k], 8);
        struct ls_diag diag = {0};
        g_assert_cmpint(ls_exr_map_tiles(copy, n, NULL, &tiles, &diag), ==, LS_ERR_INVALID);
        g_assert_cmpstr(diag.text, !=, "");
        g_free(copy);
    }
    free(bytes);
    g_free(half);
}

static bool have(const char *tool)
{
    char *path = g_find_program_in_path(tool);
    g_free(path);
    return path != NULL;
}

static char *output_of(const char *format, const char *path)
{
    char *command = g_strdup_printf(format, path), *text = NULL;
    int status;
    g_assert_true(g_spawn_command_line_sync(command, &text, NULL, &status, NULL));
    g_assert_true(g_spawn_check_wait_status(status, NULL));
    g_free(command);
    return text;
}

static void assert_has(const char *text, const char *const *words, size_t n)
{
    for (size_t k = 0; k < n; k++)
        if (!strstr(text, words[k]))
            g_error("\"%s\" is not in:\n%s", words[k], text);
}

static void test_debian_tools_read_it(void)
{
    static const char *const names[] = {"expTime",
                                        "capDate",
                                        "utcOffset",
                                        "cameraMake",
                                        "cameraModel",
                                        "cameraSerialNumber",
                                        "lensModel",
                                        "aperture",
                                        "isoSpeed",
                                        "timeCode",
                                        "worldToCamera",
                                        "lightstage/take",
                                        "lightstage/light",
                                        "lightstage/direction",
                                        "lightstage/position",
                                        "lightstage/channel",
                                        "lightstage/duty",
                                        "lightstage/gain",
                                        "lightstage/referenceExposure",
                                        "lightstage/cfa",
                                        "lightstage/blackSubtracted",
                                        "validity"};
    /* names that OpenImageIO gives the standard ones */
    static const char *const oiio[] = {"lightstage/take: \"20240517T120000Z-still-00beef\"",
                                       "lightstage/light: 137",
                                       "lightstage/direction: 0.6, 0.8, 0",
                                       "lightstage/referenceExposure: 0.01",
                                       "DateTime:",
                                       "worldToCamera: 1, 0",
                                       "validity",
                                       "tile size: 64 x 64",
                                       "half"};
    if (!have("exrheader") || !have("oiiotool"))
        return g_test_skip("exrheader or oiiotool is not installed");
    uint16_t *half = random_halves(3, 100 * 90);
    uint8_t *validity = g_new0(uint8_t, 100 * 90), *bytes;
    size_t n;
    char *folder = g_dir_make_tmp("ls-exr-XXXXXX", NULL);
    char *path = g_build_filename(folder, "a.exr", NULL);
    validity[17] = 2;
    write_mosaic(100, 90, half, validity, &bytes, &n);
    g_assert_true(g_file_set_contents(path, (char *)bytes, (gssize)n, NULL));
    char *header = output_of("exrheader %s", path);
    assert_has(header, names, G_N_ELEMENTS(names));
    char *info = output_of("oiiotool --info -v -a %s", path);
    assert_has(info, oiio, G_N_ELEMENTS(oiio));
    g_unlink(path);
    g_rmdir(folder);
    g_free(header);
    g_free(info);
    g_free(path);
    g_free(folder);
    free(bytes);
    g_free(validity);
    g_free(half);
}

/* Every compression, scanlines and tiles, compared with the same picture uncompressed. */
static void test_reads_what_oiiotool_writes(void)
{
    static const struct {
        const char *options;
        double tolerance; /* relative to 1: PXR24 rounds floats to 24 bit, B44 to 6 bits of slope */
        enum ls_err err;
    } cases[] = {
        {"--compression none", 0, LS_OK},
        {"--compression rle", 0, LS_OK},
        {"--compression zips", 0, LS_OK},
        {"--compression zip", 0, LS_OK},
        {"--compression piz", 0, LS_OK},
        {"--compression pxr24", 0, LS_OK},
        {"--compression b44", 0.04, LS_OK},
        {"--compression b44a", 0.04, LS_OK},
        {"--compression zip --tile 48 32", 0, LS_OK},
        {"--compression piz --tile 64 64", 0, LS_OK},
        {"-d float --compression zip", 0.001, LS_OK},
        {"--compression dwaa", 0, LS_ERR_UNSUPPORTED},
        {"--compression dwab", 0, LS_ERR_UNSUPPORTED},
    };
    enum { W = 203, H = 131 };
    if (!have("oiiotool"))
        return g_test_skip("oiiotool is not installed");
    char *folder = g_dir_make_tmp("ls-exr-XXXXXX", NULL);
    char *in = g_build_filename(folder, "in.exr", NULL),
         *out = g_build_filename(folder, "o.exr", NULL);
    struct ls_image image = {W, H, 3, g_new(float, W *H * 3)}, got;
    uint8_t *bytes;
    size_t n;
    for (size_t k = 0; k < W * H * 3; k++) /* smooth, in [0, 1], exact in half */
        image.pixels[k] = (float)(k / 3 % W + k / 3 / W + 100 * (k % 3)) / 1024;
    g_assert_cmpint(ls_exr_write_image(&image, LS_EXR_HALF, NULL, &bytes, &n, NULL), ==, LS_OK);
    g_assert_true(g_file_set_contents(in, (char *)bytes, (gssize)n, NULL));
    free(bytes);
    for (size_t k = 0; k < G_N_ELEMENTS(cases); k++) {
        char *command =
            g_strdup_printf("oiiotool %s --tile 0 0 %s -o %s", in, cases[k].options, out);
        if (strstr(cases[k].options, "--tile")) {
            g_free(command);
            command = g_strdup_printf("oiiotool %s %s -o %s", in, cases[k].options, out);
        }
        int status;
        g_assert_true(g_spawn_command_line_sync(command, NULL, NULL, &status, NULL));
        g_assert_true(g_spawn_check_wait_status(status, NULL));
        char *contents;
        gsize length;
        g_assert_true(g_file_get_contents(out, &contents, &length, NULL));
        struct ls_diag diag = {0};
        enum ls_err err = ls_exr_read(contents, length, NULL, limit, &got, NULL, &diag);
        g_test_message("%s: %s", cases[k].options, diag.text);
        g_assert_cmpint(err, ==, cases[k].err);
        if (err)
            g_assert_nonnull(strstr(diag.text, "convert with oiiotool --compression zip"));
        for (size_t p = 0; !err && p < W * H * 3; p++)
            g_assert_cmpfloat(fabsf(got.pixels[p] - image.pixels[p]), <=, cases[k].tolerance);
        ls_image_finish(&got);
        g_free(contents);
        g_free(command);
    }
    g_unlink(in);
    g_unlink(out);
    g_rmdir(folder);
    g_free(in);
    g_free(out);
    g_free(folder);
    g_free(image.pixels);
}

static void test_limit(void)
{
    uint16_t *half = random_halves(5, 256 * 256);
    uint8_t *bytes;
    size_t n;
    struct ls_image image;
    struct ls_diag diag = {0};
    write_mosaic(256, 256, half, NULL, &bytes, &n);
    static const size_t pixels = 256 * 256 * 4, chunk = 64 * 64 * 2; /* a decoder may hold four */
    g_assert_cmpint(ls_exr_read(bytes, n, NULL, pixels - 1, &image, NULL, &diag), ==, LS_ERR_LIMIT);
    g_assert_null(image.pixels);
    g_assert_cmpint(ls_exr_read(bytes, n, NULL, pixels + 4 * chunk - 1, &image, NULL, &diag), ==,
                    LS_ERR_LIMIT);
    g_assert_null(image.pixels);
    g_assert_cmpint(ls_exr_read(bytes, n, NULL, pixels + 4 * chunk, &image, NULL, &diag), ==,
                    LS_OK);
    ls_image_finish(&image);
    free(bytes);
    g_free(half);
}

/* Three parts of several tiles, none of them whole: colours that vary slowly, halves, any bits. */
static uint8_t *write_three(bool packed, const float *smooth, const uint16_t *halves,
                            const uint32_t *bits, size_t n_parts, size_t *n)
{
    enum { W = 150, H = 131 };
    static const char *const names[3] = {"W.R", "W.G", "W.B"};
    struct ls_exr_channel rgb[3];
    const struct ls_exr_channel half = {"Y", LS_EXR_HALF, LS_EXR_FROM_HALF, halves, 2, 2 * W};
    const struct ls_exr_channel any = {"Y", LS_EXR_FLOAT, LS_EXR_FROM_FLOAT, bits, 4, 4 * W};
    for (int c = 0; c < 3; c++)
        rgb[c] = (struct ls_exr_channel){
            names[c], c ? LS_EXR_FLOAT : LS_EXR_HALF, LS_EXR_FROM_FLOAT, smooth + c, 12, 12 * W};
    const struct ls_exr_part parts[3] = {
        {.name = "W", .width = W, .height = H, .channels = rgb, .n_channels = 3, .packed = packed},
        {.name = "H",
         .width = W,
         .height = H,
         .channels = &half,
         .n_channels = 1,
         .packed = packed},
        {.name = "F",
         .width = W,
         .height = H,
         .channels = &any,
         .n_channels = 1,
         .packed = packed}};
    uint8_t *bytes;
    g_assert_cmpint(ls_exr_write(parts, n_parts, &bytes, n, NULL), ==, LS_OK);
    return bytes;
}

static void assert_plane(const uint8_t *bytes, size_t n, const char *part, const void *samples)
{
    struct ls_exr_plane plane;
    g_assert_cmpint(ls_exr_read_plane(bytes, n, part, limit, &plane, NULL), ==, LS_OK);
    size_t size = (size_t)plane.width * plane.height * (plane.type == LS_EXR_HALF ? 2 : 4);
    g_assert_cmpmem(plane.samples, size, samples, size);
    free(plane.samples);
}

static void assert_no_difference(const uint8_t *plain, size_t n_plain, const uint8_t *packed,
                                 size_t n_packed)
{
    char *folder = g_dir_make_tmp("ls-exr-XXXXXX", NULL);
    char *a = g_build_filename(folder, "a.exr", NULL), *b = g_build_filename(folder, "b.exr", NULL);
    g_assert_true(g_file_set_contents(a, (const char *)plain, (gssize)n_plain, NULL));
    g_assert_true(g_file_set_contents(b, (const char *)packed, (gssize)n_packed, NULL));
    char *format = g_strdup_printf("oiiotool -a --fail 0 --warn 0 --diff %s %%s", a);
    g_free(output_of(format, b));
    g_free(format);
    format = output_of("oiiotool --info -v %s", b);
    assert_has(format, (const char *const[]){"compression: \"zip\"", "tile size: 64 x 64"}, 2);
    g_free(format);
    g_unlink(a);
    g_unlink(b);
    g_rmdir(folder);
    g_free(a);
    g_free(b);
    g_free(folder);
}

static void test_packed(void)
{
    enum { PIXELS = 150 * 131 };
    float *smooth = g_new(float, 3 * PIXELS);
    uint16_t *halves = random_halves(5, PIXELS);
    uint32_t *bits = g_new(uint32_t, PIXELS);
    GRand *rand = g_rand_new_with_seed(6);
    for (size_t k = 0; k < 3 * PIXELS; k++)
        smooth[k] = (float)(k % 450 / 30) / 8 - 0.5f; /* exact in half, negative ones, too */
    for (size_t k = 0; k < PIXELS; k++)
        bits[k] = g_rand_int(rand); /* infinities and NaN of every kind among them */
    size_t n, n_plain, n_packed;
    uint8_t *bytes = write_three(true, smooth, halves, bits, 3, &n);
    struct ls_image image;
    g_assert_cmpint(ls_exr_read(bytes, n, "W", limit, &image, NULL, NULL), ==, LS_OK);
    g_assert_cmpmem(image.pixels, 12 * PIXELS, smooth, 12 * PIXELS);
    assert_plane(bytes, n, "H", halves);
    assert_plane(bytes, n, "F", bits);
    uint8_t *plain = write_three(false, smooth, halves, bits, 2, &n_plain);
    uint8_t *packed = write_three(true, smooth, halves, bits, 2, &n_packed);
    g_assert_cmpuint(n_packed, <, n_plain / 2); /* the halves are a sixth of the plain file */
    if (have("oiiotool"))
        assert_no_difference(plain, n_plain, packed, n_packed);
    else
        g_test_message("oiiotool is not installed: no other program compares them");
    ls_image_finish(&image);
    free(plain);
    free(packed);
    free(bytes);
    g_rand_free(rand);
    g_free(bits);
    g_free(halves);
    g_free(smooth);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/exr/mosaic-comes-back-bit-for-bit", test_mosaic_round_trip);
    g_test_add_func("/exr/validity-is-a-second-part-only-when-needed", test_validity_part);
    g_test_add_func("/exr/attributes-come-back", test_attributes_round_trip);
    g_test_add_func("/exr/bad-attribute-name-is-an-error", test_bad_attribute_is_an_error);
    g_test_add_func("/exr/layers-keep-their-names-and-values", test_layers);
    g_test_add_func("/exr/floats-round-to-the-nearest-half", test_float_to_half);
    g_test_add_func("/exr/tiles-are-mapped-in-place", test_map_tiles);
    g_test_add_func("/exr/mapping-refuses-a-lying-chunk-table",
                    test_map_refuses_a_lying_chunk_table);
    g_test_add_func("/exr/debian-tools-read-what-we-write", test_debian_tools_read_it);
    g_test_add_func("/exr/reads-every-compression-but-dwa", test_reads_what_oiiotool_writes);
    g_test_add_func("/exr/memory-limit-is-kept", test_limit);
    g_test_add_func("/exr/packed-parts-come-back-bit-for-bit", test_packed);
    return g_test_run();
}

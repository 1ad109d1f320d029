#include "core/pixel.h"

#include "tests/core/noise.h"

#include <arv.h>
#include <glib.h>
#include <string.h>

static const struct {
    const char *name;
    uint32_t code;
} known[] = {
    {"Mono8", ARV_PIXEL_FORMAT_MONO_8},
    {"Mono10", ARV_PIXEL_FORMAT_MONO_10},
    {"Mono12", ARV_PIXEL_FORMAT_MONO_12},
    {"Mono16", ARV_PIXEL_FORMAT_MONO_16},
    {"Mono10Packed", ARV_PIXEL_FORMAT_MONO_10_PACKED},
    {"Mono12Packed", ARV_PIXEL_FORMAT_MONO_12_PACKED},
    {"Mono10p", 0x010A0046}, /* PFNC 2.x */
    {"Mono12p", 0x010C0047},
    {"BayerRG8", ARV_PIXEL_FORMAT_BAYER_RG_8},
    {"BayerGR8", ARV_PIXEL_FORMAT_BAYER_GR_8},
    {"BayerGB8", ARV_PIXEL_FORMAT_BAYER_GB_8},
    {"BayerBG8", ARV_PIXEL_FORMAT_BAYER_BG_8},
    {"BayerRG10", ARV_PIXEL_FORMAT_BAYER_RG_10},
    {"BayerGR10", ARV_PIXEL_FORMAT_BAYER_GR_10},
    {"BayerGB10", ARV_PIXEL_FORMAT_BAYER_GB_10},
    {"BayerBG10", ARV_PIXEL_FORMAT_BAYER_BG_10},
    {"BayerRG12", ARV_PIXEL_FORMAT_BAYER_RG_12},
    {"BayerGR12", ARV_PIXEL_FORMAT_BAYER_GR_12},
    {"BayerGB12", ARV_PIXEL_FORMAT_BAYER_GB_12},
    {"BayerBG12", ARV_PIXEL_FORMAT_BAYER_BG_12},
    {"BayerRG16", ARV_PIXEL_FORMAT_BAYER_RG_16},
    {"BayerGR16", ARV_PIXEL_FORMAT_BAYER_GR_16},
    {"BayerGB16", ARV_PIXEL_FORMAT_BAYER_GB_16},
    {"BayerBG16", ARV_PIXEL_FORMAT_BAYER_BG_16},
    {"BayerRG10Packed", ARV_PIXEL_FORMAT_BAYER_RG_10_PACKED},
    {"BayerGR10Packed", ARV_PIXEL_FORMAT_BAYER_GR_10_PACKED},
    {"BayerGB10Packed", ARV_PIXEL_FORMAT_BAYER_GB_10_PACKED},
    {"BayerBG10Packed", ARV_PIXEL_FORMAT_BAYER_BG_10_PACKED},
    {"BayerRG12Packed", ARV_PIXEL_FORMAT_BAYER_RG_12_PACKED},
    {"BayerGR12Packed", ARV_PIXEL_FORMAT_BAYER_GR_12_PACKED},
    {"BayerGB12Packed", ARV_PIXEL_FORMAT_BAYER_GB_12_PACKED},
    {"BayerBG12Packed", ARV_PIXEL_FORMAT_BAYER_BG_12_PACKED},
    {"BayerRG10p", ARV_PIXEL_FORMAT_BAYER_RG_10P},
    {"BayerGR10p", ARV_PIXEL_FORMAT_BAYER_GR_10P},
    {"BayerGB10p", ARV_PIXEL_FORMAT_BAYER_GB_10P},
    {"BayerBG10p", ARV_PIXEL_FORMAT_BAYER_BG_10P},
    {"BayerRG12p", ARV_PIXEL_FORMAT_BAYER_RG_12P},
    {"BayerGR12p", ARV_PIXEL_FORMAT_BAYER_GR_12P},
    {"BayerGB12p", ARV_PIXEL_FORMAT_BAYER_GB_12P},
    {"BayerBG12p", ARV_PIXEL_FORMAT_BAYER_BG_12P},
};

static void test_codes(void)
{
    size_t n = 0;

    while (ls_pixel_at(n))
        n++;
    g_assert_cmpuint(n, ==, G_N_ELEMENTS(known));
    for (size_t i = 0; i < G_N_ELEMENTS(known); i++) {
        const struct ls_pixel_format *f = ls_pixel_by_name(known[i].name);
        g_assert_nonnull(f);
        g_assert_cmphex(f->code, ==, known[i].code);
        g_assert_true(ls_pixel_by_code(known[i].code) == f);
        /* PFNC codes carry the bits on the wire in bits 16..23. */
        g_assert_cmpuint(f->bits_per_pixel, ==, f->code >> 16 & 0xff);
    }
    g_assert_null(ls_pixel_by_name("RGB8"));
    g_assert_null(ls_pixel_by_name(NULL));
    g_assert_null(ls_pixel_by_code(0));
}

/* The two letters of a Bayer name are the first two colours of the first row. */
static void test_cfa_of_names(void)
{
    static const char letters[] = "RGB";

    for (size_t i = 0; ls_pixel_at(i); i++) {
        const struct ls_pixel_format *f = ls_pixel_at(i);
        if (f->cfa == LS_CFA_NONE) {
            g_assert_true(g_str_has_prefix(f->name, "Mono"));
            continue;
        }
        g_assert_cmpint(letters[ls_cfa_channel(f->cfa, 0, 0)], ==, f->name[5]);
        g_assert_cmpint(letters[ls_cfa_channel(f->cfa, 1, 0)], ==, f->name[6]);
    }
}

/* Spelt out, so that swapping red and blue anywhere fails here. */
static void test_cfa_channels(void)
{
    for (int cfa = LS_CFA_RGGB; cfa <= LS_CFA_BGGR; cfa++) {
        const char *name = ls_cfa_name((enum ls_cfa)cfa);
        for (uint32_t y = 0; y < 4; y++)
            for (uint32_t x = 0; x < 4; x++)
                g_assert_cmpint("RGB"[ls_cfa_channel((enum ls_cfa)cfa, x, y)], ==,
                                name[y % 2 * 2 + x % 2]);
    }
    g_assert_cmpuint(ls_cfa_channel(LS_CFA_NONE, 1, 1), ==, 0);
}

static void check_bytes(const char *name, const uint16_t in[2], const uint8_t bytes[3])
{
    const struct ls_pixel_format *f = ls_pixel_by_name(name);
    uint8_t packed[3] = {0};
    uint16_t out[2];

    ls_pixel_pack(f, in, 0, 2, packed);
    g_assert_cmpmem(packed, 3, bytes, 3);
    ls_pixel_unpack(f, bytes, 0, 2, out);
    g_assert_cmpmem(out, sizeof out, in, 2 * sizeof *in);
}

/* Layouts written out by hand from the two standards. */
static void test_worked_bytes(void)
{
    check_bytes("Mono12p", (const uint16_t[]){0xabc, 0x123}, (const uint8_t[]){0xbc, 0x3a, 0x12});
    check_bytes("Mono12Packed", (const uint16_t[]){0xabc, 0x123},
                (const uint8_t[]){0xab, 0x3c, 0x12});
    check_bytes("Mono10Packed", (const uint16_t[]){0x3fe, 0x001},
                (const uint8_t[]){0xff, 0x12, 0x00});
    check_bytes("Mono10p", (const uint16_t[]){0x3fe, 0x001}, (const uint8_t[]){0xfe, 0x07, 0x00});
}

static void round_trip(const struct ls_pixel_format *f, uint32_t width, uint32_t height,
                       struct noise *noise)
{
    size_t n = (size_t)width * height, bytes = ls_pixel_payload_bytes(f, width, height);
    g_autofree uint16_t *in = g_new(uint16_t, n), *out = g_new(uint16_t, n);
    g_autofree uint8_t *payload = g_malloc0(bytes), *pieces = g_malloc0(bytes);

    for (size_t i = 0; i < n; i++)
        in[i] = (uint16_t)noise_bits(noise) & (uint16_t)ls_pixel_max_dn(f);
    ls_pixel_pack(f, in, 0, n, payload);
    ls_pixel_unpack(f, payload, 0, n, out);
    g_assert_cmpmem(out, n * 2, in, n * 2);
    for (uint32_t y = 0; y < height; y++) /* rows packed in any order, read back singly */
        ls_pixel_pack(f, in + (size_t)(height - 1 - y) * width, (size_t)(height - 1 - y) * width,
                      width, pieces);
    g_assert_cmpmem(pieces, bytes, payload, bytes);
    for (size_t i = 0; i < n; i++) {
        ls_pixel_unpack(f, payload, i, 1, out);
        g_assert_cmpuint(out[0], ==, in[i]);
    }
}

static void test_round_trips(void)
{
    enum { SEED = 11 };
    struct noise noise = {SEED};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 3}, {3, 1}, {5, 3}, {64, 2}, {67, 5}, {130, 3}};

    g_test_message("seed %d", SEED);
    for (size_t i = 0; ls_pixel_at(i); i++)
        for (size_t k = 0; k < G_N_ELEMENTS(sizes); k++)
            round_trip(ls_pixel_at(i), sizes[k][0], sizes[k][1], &noise);
}

static void test_payloads(void)
{
    g_assert_cmpuint(ls_pixel_payload_bytes(ls_pixel_by_name("Mono8"), 5, 3), ==, 15);
    g_assert_cmpuint(ls_pixel_payload_bytes(ls_pixel_by_name("Mono12"), 5, 3), ==, 30);
    g_assert_cmpuint(ls_pixel_payload_bytes(ls_pixel_by_name("Mono12p"), 5, 3), ==, 23);
    g_assert_cmpuint(ls_pixel_payload_bytes(ls_pixel_by_name("BayerRG10p"), 5, 3), ==, 19);
    g_assert_cmpuint(ls_pixel_payload_bytes(ls_pixel_by_name("BayerRG12Packed"), 2048, 2048), ==,
                     6291456);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/pixel/names-and-codes-are-those-of-the-standard", test_codes);
    g_test_add_func("/pixel/bayer-names-begin-with-their-first-two-colours", test_cfa_of_names);
    g_test_add_func("/pixel/red-and-blue-are-where-the-cfa-says", test_cfa_channels);
    g_test_add_func("/pixel/packed-bytes-match-worked-examples", test_worked_bytes);
    g_test_add_func("/pixel/every-format-survives-the-round-trip-at-odd-sizes", test_round_trips);
    g_test_add_func("/pixel/payload-sizes-round-up-to-bytes", test_payloads);
    return g_test_run();
}

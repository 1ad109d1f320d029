#include "core/pixel.h"

#include <assert.h>
#include <string.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "samples are read in the byte order of the wire, which is little-endian"
#endif

#define FORMATS(NAME, CFA, c8, c10, c12, c16, c10k, c12k, c10p, c12p)                      \
    {NAME "8", c8, 8, 8, LS_PACKING_8, CFA}, {NAME "10", c10, 10, 16, LS_PACKING_16, CFA}, \
        {NAME "12", c12, 12, 16, LS_PACKING_16, CFA},                                      \
        {NAME "16", c16, 16, 16, LS_PACKING_16, CFA},                                      \
        {NAME "10Packed", c10k, 10, 12, LS_PACKING_GEV, CFA},                              \
        {NAME "12Packed", c12k, 12, 12, LS_PACKING_GEV, CFA},                              \
        {NAME "10p", c10p, 10, 10, LS_PACKING_LSB, CFA},                                   \
    {                                                                                      \
        NAME "12p", c12p, 12, 12, LS_PACKING_LSB, CFA                                      \
    }

static const struct ls_pixel_format formats[] = {
    FORMATS("Mono", LS_CFA_NONE, 0x01080001, 0x01100003, 0x01100005, 0x01100007, 0x010C0004,
            0x010C0006, 0x010A0046, 0x010C0047),
    FORMATS("BayerRG", LS_CFA_RGGB, 0x01080009, 0x0110000D, 0x01100011, 0x0110002F, 0x010C0027,
            0x010C002B, 0x010A0058, 0x010C0059),
    FORMATS("BayerGR", LS_CFA_GRBG, 0x01080008, 0x0110000C, 0x01100010, 0x0110002E, 0x010C0026,
            0x010C002A, 0x010A0056, 0x010C0057),
    FORMATS("BayerGB", LS_CFA_GBRG, 0x0108000A, 0x0110000E, 0x01100012, 0x01100030, 0x010C0028,
            0x010C002C, 0x010A0054, 0x010C0055),
    FORMATS("BayerBG", LS_CFA_BGGR, 0x0108000B, 0x0110000F, 0x01100013, 0x01100031, 0x010C0029,
            0x010C002D, 0x010A0052, 0x010C0053),
};

static const char *const cfa_names[] = {"none", "RGGB", "GRBG", "GBRG", "BGGR"};

/* Column and row of red within the 2 x 2 cell. */
static const uint8_t red_x[] = {0, 0, 1, 0, 1}, red_y[] = {0, 0, 0, 1, 1};

const struct ls_pixel_format *ls_pixel_at(size_t index)
{
    return index < sizeof formats / sizeof *formats ? &formats[index] : NULL;
}

const struct ls_pixel_format *ls_pixel_by_name(const char *name)
{
    for (size_t i = 0; name && i < sizeof formats / sizeof *formats; i++)
        if (!strcmp(formats[i].name, name))
            return &formats[i];
    return NULL;
}

const struct ls_pixel_format *ls_pixel_by_code(uint32_t code)
{
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
        if (formats[i].code == code)
            return &formats[i];
    return NULL;
}

uint32_t ls_pixel_max_dn(const struct ls_pixel_format *format)
{
    return (1u << format->bits) - 1;
}

size_t ls_pixel_payload_bytes(const struct ls_pixel_format *format, uint32_t width, uint32_t height)
{
    size_t pixels = (size_t)width * height;

    /* Whole groups of 8 pixels apart, so that the product cannot overflow. */
    return pixels / 8 * format->bits_per_pixel + (pixels % 8 * format->bits_per_pixel + 7) / 8;
}

/* In runs of a constant length, which compilers turn into vector instructions. */
static void unpack_8(const uint8_t *restrict in, size_t n, uint16_t *restrict out)
{
    size_t i = 0;

    for (; i + 64 <= n; i += 64)
        for (size_t k = 0; k < 64; k++)
            out[i + k] = in[i + k];
    for (; i < n; i++)
        out[i] = in[i];
}

static uint16_t lsb_sample(const uint8_t *in, unsigned bits, size_t k)
{
    const uint8_t *p = in + k * bits / 8;
    return (uint16_t)(((unsigned)p[0] | (unsigned)p[1] << 8) >> k * bits % 8 & ((1u << bits) - 1));
}

/* Four samples, bits / 2 bytes, out of eight bytes that may be read. */
static inline void unpack_four(const uint8_t *in, unsigned bits, uint16_t *out)
{
    uint64_t packed, wide = 0, mask = (1u << bits) - 1;

    memcpy(&packed, in, sizeof packed);
    for (unsigned k = 0; k < 4; k++)
        wide |= (packed & mask << k * bits) << k * (16 - bits);
    memcpy(out, &wide, sizeof wide);
}

/* @bits is a constant wherever this is inlined. */
static inline size_t unpack_fours(const uint8_t *in, unsigned bits, size_t n, uint16_t *out)
{
    size_t i = 0;

    for (; (n - i) * bits >= 64; i += 4)
        unpack_four(in + i * bits / 8, bits, out + i);
    return i;
}

static void unpack_lsb(const uint8_t *in, unsigned bits, size_t first, size_t n, uint16_t *out)
{
    size_t i = 0;

    for (; i < n && (first + i) % 4; i++)
        out[i] = lsb_sample(in, bits, first + i);
    const uint8_t *rest = in + (first + i) * bits / 8;
    i += bits == 12 ? unpack_fours(rest, 12, n - i, out + i)
                    : unpack_fours(rest, 10, n - i, out + i);
    for (; i < n; i++)
        out[i] = lsb_sample(in, bits, first + i);
}

static void pack_lsb(const uint16_t *in, unsigned bits, size_t first, size_t n, uint8_t *out)
{
    for (size_t i = 0; i < n; i++) {
        size_t bit = (first + i) * bits;
        unsigned mask = ((1u << bits) - 1) << bit % 8;
        unsigned value = (unsigned)in[i] << bit % 8 & mask;
        uint8_t *p = out + bit / 8;
        p[0] = (uint8_t)((p[0] & ~mask) | (value & 0xff));
        p[1] = (uint8_t)((p[1] & ~(mask >> 8)) | value >> 8);
    }
}

/* Pixel k lies in the group of three bytes k / 2: its high byte first or last, its low bits in the
 * low or high nibble of the middle one. */
static uint16_t gev_sample(const uint8_t *in, unsigned low, size_t k)
{
    const uint8_t *p = in + k / 2 * 3;
    unsigned odd = k & 1, mask = (1u << low) - 1;

    return (uint16_t)((unsigned)p[2 * odd] << low | (p[1] >> 4 * odd & mask));
}

static void unpack_gev(const uint8_t *in, unsigned bits, size_t first, size_t n, uint16_t *out)
{
    unsigned low = bits - 8, mask = (1u << low) - 1;
    size_t i = 0;

    if (n && first & 1)
        out[i++] = gev_sample(in, low, first);
    for (const uint8_t *p = in + (first + i) / 2 * 3; i + 2 <= n; i += 2, p += 3) {
        out[i] = (uint16_t)((unsigned)p[0] << low | (p[1] & mask));
        out[i + 1] = (uint16_t)((unsigned)p[2] << low | (p[1] >> 4 & mask));
    }
    if (i < n)
        out[i] = gev_sample(in, low, first + i);
}

static void pack_gev(const uint16_t *in, unsigned bits, size_t first, size_t n, uint8_t *out)
{
    unsigned low = bits - 8, mask = (1u << low) - 1;

    for (size_t i = 0; i < n; i++) {
        size_t k = first + i;
        uint8_t *p = out + k / 2 * 3;
        unsigned odd = k & 1;
        p[2 * odd] = (uint8_t)(in[i] >> low);
        p[1] = (uint8_t)((p[1] & ~(0xfu << 4 * odd)) | (in[i] & mask) << 4 * odd);
    }
}

void ls_pixel_unpack(const struct ls_pixel_format *format, const void *payload, size_t first,
                     size_t n, uint16_t *out)
{
    const uint8_t *in = payload;

    switch (format->packing) {
    case LS_PACKING_8:
        unpack_8(in + first, n, out);
        return;
    case LS_PACKING_16:
        memcpy(out, in + 2 * first, 2 * n);
        return;
    case LS_PACKING_LSB:
        unpack_lsb(in, format->bits, first, n, out);
        return;
    case LS_PACKING_GEV:
        unpack_gev(in, format->bits, first, n, out);
        return;
    }
    assert(!"packing");
}

void ls_pixel_pack(const struct ls_pixel_format *format, const uint16_t *in, size_t first, size_t n,
                   void *payload)
{
    uint8_t *out = payload;
    uint16_t mask = (uint16_t)ls_pixel_max_dn(format);

    switch (format->packing) {
    case LS_PACKING_8:
        for (size_t i = 0; i < n; i++)
            out[first + i] = (uint8_t)in[i];
        return;
    case LS_PACKING_16:
        for (size_t i = 0; i < n; i++) {
            uint16_t value = in[i] & mask;
            memcpy(out + 2 * (first + i), &value, sizeof value);
        }
        return;
    case LS_PACKING_LSB:
        pack_lsb(in, format->bits, first, n, out);
        return;
    case LS_PACKING_GEV:
        pack_gev(in, format->bits, first, n, out);
        return;
    }
    assert(!"packing");
}

unsigned ls_cfa_channel(enum ls_cfa cfa, uint32_t x, uint32_t y)
{
    return cfa == LS_CFA_NONE ? 0 : ((x ^ red_x[cfa]) & 1) + ((y ^ red_y[cfa]) & 1);
}

unsigned ls_cfa_period_px(enum ls_cfa cfa)
{
    return cfa == LS_CFA_NONE ? 1 : 2;
}

const char *ls_cfa_name(enum ls_cfa cfa)
{
    return (unsigned)cfa < sizeof cfa_names / sizeof *cfa_names ? cfa_names[cfa] : "unknown";
}

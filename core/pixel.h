/*
 * pixel: the raw pixel formats of cameras, their colour filter arrays, and how rows unpack.
 * Layer: core. Threads: any; every function is pure. Ownership: formats are static constants.
 *
 * Names and codes are those of the GenICam Pixel Format Naming Convention (PFNC) and, for the
 * "Packed" ones, of GigE Vision 1.x. Samples are unsigned, little-endian, low-aligned; a frame is
 * one continuous stream of pixels, rows follow each other without padding, so that a row of a
 * packed format may begin in the middle of a byte when the width is odd.
 *
 *   Mono8 BayerRG8      one byte
 *   Mono10/12/16        two bytes, low-aligned
 *   Mono10p/12p         PFNC: a stream of bits, least significant first
 *   Mono10/12Packed     GigE Vision: two pixels in three bytes:
 *                       [p0 high 8] [p1 low bits << 4 | p0 low bits] [p1 high 8]
 */
#ifndef LS_CORE_PIXEL_H
#define LS_CORE_PIXEL_H

#include <stddef.h>
#include <stdint.h>

/** Colour filter array, named by its first two rows. NONE is monochrome. */
enum ls_cfa {
    LS_CFA_NONE,
    LS_CFA_RGGB,
    LS_CFA_GRBG,
    LS_CFA_GBRG,
    LS_CFA_BGGR,
};

enum ls_packing {
    LS_PACKING_8,   /* a byte per pixel */
    LS_PACKING_16,  /* two bytes per pixel, low-aligned */
    LS_PACKING_LSB, /* PFNC "p" */
    LS_PACKING_GEV, /* GigE Vision "Packed" */
};

struct ls_pixel_format {
    const char *name;       /* GenICam name, e.g. "BayerRG12p" */
    uint32_t code;          /* PFNC, e.g. 0x010C0059 */
    uint8_t bits;           /* significant bits of a sample: 8, 10, 12 or 16 */
    uint8_t bits_per_pixel; /* on the wire: 8, 10, 12 or 16 */
    enum ls_packing packing;
    enum ls_cfa cfa;
};

/** The format of a GenICam name, or NULL if it is unknown (or NULL). (transfer none). RT-safe. */
const struct ls_pixel_format *ls_pixel_by_name(const char *name);

/** The format of a PFNC code, or NULL. (transfer none). RT-safe. */
const struct ls_pixel_format *ls_pixel_by_code(uint32_t code);

/** Every format in turn: index 0, 1, ... until NULL. (transfer none). RT-safe. */
const struct ls_pixel_format *ls_pixel_at(size_t index);

/** Largest sample: 2^bits - 1. RT-safe. */
uint32_t ls_pixel_max_dn(const struct ls_pixel_format *format);

/** Bytes of a frame, ceil(width height bits_per_pixel / 8). RT-safe. */
size_t ls_pixel_payload_bytes(const struct ls_pixel_format *format, uint32_t width,
                              uint32_t height);

/**
 * Unpack @n pixels beginning with pixel @first (= y width + x) of the stream @payload into @out.
 * Reads no byte past the last one that holds a bit of the last pixel. RT-safe.
 */
void ls_pixel_unpack(const struct ls_pixel_format *format, const void *payload, size_t first,
                     size_t n, uint16_t *out);

/**
 * The inverse: write @n pixels beginning with pixel @first into the stream @payload; bits of
 * neighbouring pixels are kept, bits of a sample above the format's are dropped. RT-safe.
 */
void ls_pixel_pack(const struct ls_pixel_format *format, const uint16_t *in, size_t first, size_t n,
                   void *payload);

/** Channel of the pixel at column @x, row @y: 0 red, 1 green, 2 blue; 0 where monochrome.
 * RT-safe. */
unsigned ls_cfa_channel(enum ls_cfa cfa, uint32_t x, uint32_t y);

/** Distance in pixels to the next pixel of the same colour in a row or column: 2, mono 1. */
unsigned ls_cfa_period_px(enum ls_cfa cfa);

/** "none", "RGGB", ... as in the attribute lightstage/cfa. Never NULL. RT-safe. */
const char *ls_cfa_name(enum ls_cfa cfa);

#endif

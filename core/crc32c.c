#include "core/crc32c.h"

#include <string.h>

#if defined(__x86_64__)
#include <nmmintrin.h>
#include <wmmintrin.h>

__attribute__((target("sse4.2"))) static uint32_t crc_sse42(uint32_t crc, const uint8_t *p,
                                                            size_t n)
{
    uint64_t state = ~crc;
    for (; n >= 8; n -= 8, p += 8) {
        uint64_t word;
        memcpy(&word, p, 8);
        state = _mm_crc32_u64(state, word);
    }
    for (; n; n--)
        state = _mm_crc32_u8((uint32_t)state, *p++);
    return ~(uint32_t)state;
}

/* Three stretches at once: one waits three cycles for every word, and the unit takes one a cycle.
 */
enum { STRETCH = 1024 };

/* The state after @bytes zeros: times x^(8 bytes) modulo the polynomial. The product without
 * carries of reflected operands is one place short, and the instruction multiplies by x^32 as it
 * reduces, so
 * @factor = x^(8 bytes - 33), reflected. */
__attribute__((target("sse4.2,pclmul"))) static uint64_t past_zeros(uint64_t state, int factor)
{
    __m128i product =
        _mm_clmulepi64_si128(_mm_cvtsi64_si128((int64_t)state), _mm_cvtsi32_si128(factor), 0);
    return _mm_crc32_u64(0, (uint64_t)_mm_cvtsi128_si64(product));
}

__attribute__((target("sse4.2,pclmul"))) static uint32_t crc_three(uint32_t crc, const uint8_t *p,
                                                                   size_t n)
{
    const int one = 0x170076fa, two = (int)0xa51b6135; /* x^(8 STRETCH - 33), x^(16 STRETCH - 33) */
    uint64_t a = (uint32_t)~crc;
    for (; n >= 3 * STRETCH; n -= 3 * STRETCH, p += 3 * STRETCH) {
        uint64_t b = 0, c = 0, word[3];
        for (size_t k = 0; k < STRETCH; k += 8) {
            memcpy(&word[0], p + k, 8);
            memcpy(&word[1], p + STRETCH + k, 8);
            memcpy(&word[2], p + 2 * STRETCH + k, 8);
            a = _mm_crc32_u64(a, word[0]);
            b = _mm_crc32_u64(b, word[1]);
            c = _mm_crc32_u64(c, word[2]);
        }
        a = past_zeros(a, two) ^ past_zeros(b, one) ^ c;
    }
    return crc_sse42(~(uint32_t)a, p, n);
}
#endif

/* A nibble at a time: the table is sixteen values that can be checked by eye, entry i being i
 * shifted out of the polynomial four times. */
uint32_t ls_crc32c_portable(uint32_t crc, const void *bytes, size_t n)
{
    static const uint32_t table[16] = {
        0x00000000, 0x105ec76f, 0x20bd8ede, 0x30e349b1, 0x417b1dbc, 0x5125dad3,
        0x61c69362, 0x7198540d, 0x82f63b78, 0x92a8fc17, 0xa24bb5a6, 0xb21572c9,
        0xc38d26c4, 0xd3d3e1ab, 0xe330a81a, 0xf36e6f75,
    };
    const uint8_t *p = bytes;
    crc = ~crc;
    for (; n; n--, p++) {
        crc = table[(crc ^ *p) & 15] ^ crc >> 4;
        crc = table[(crc ^ *p >> 4) & 15] ^ crc >> 4;
    }
    return ~crc;
}

uint32_t ls_crc32c(uint32_t crc, const void *bytes, size_t n)
{
#if defined(__x86_64__)
    if (__builtin_cpu_supports("sse4.2"))
        return crc_sse42(crc, bytes, n);
#endif
    return ls_crc32c_portable(crc, bytes, n);
}

/* What a piece brings into the first-level cache is still there for the checksum. */
uint32_t ls_crc32c_copy(uint32_t crc, void *to, const void *from, size_t n)
{
    enum { PIECE = 5 * 3 * 1024 };
    for (size_t at = 0; at < n; at += PIECE) {
        size_t piece = n - at < PIECE ? n - at : PIECE;
        uint8_t *copy = (uint8_t *)to + at;
        memcpy(copy, (const uint8_t *)from + at, piece);
#if defined(__x86_64__)
        if (__builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("pclmul")) {
            crc = crc_three(crc, copy, piece);
            continue;
        }
#endif
        crc = ls_crc32c(crc, copy, piece);
    }
    return crc;
}

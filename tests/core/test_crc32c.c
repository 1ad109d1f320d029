#include "core/crc32c.h"

#include <glib.h>
#include <string.h>

static void test_check_values(void)
{
    uint8_t zeros[32] = {0}, ones[32];
    memset(ones, 0xff, sizeof ones);
    /* RFC 3720, appendix B.4 */
    g_assert_cmphex(ls_crc32c(0, "123456789", 9), ==, 0xe3069283);
    g_assert_cmphex(ls_crc32c(0, zeros, 32), ==, 0x8a9136aa);
    g_assert_cmphex(ls_crc32c(0, ones, 32), ==, 0x62a8ab43);
    g_assert_cmphex(ls_crc32c(0, "", 0), ==, 0);
}

static void test_both_ways_agree(void)
{
    uint8_t bytes[300];
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < sizeof bytes; k++)
        bytes[k] = (uint8_t)g_rand_int(rand);
    for (size_t start = 0; start < 9; start++)
        for (size_t n = 0; start + n <= sizeof bytes; n++) {
            uint32_t whole = ls_crc32c(0, bytes + start, n);
            g_assert_cmphex(whole, ==, ls_crc32c_portable(0, bytes + start, n));
            g_assert_cmphex(
                whole, ==,
                ls_crc32c(ls_crc32c(0, bytes + start, n / 3), bytes + start + n / 3, n - n / 3));
        }
    g_rand_free(rand);
}

/* Lengths around the stretches and pieces it works in. */
static void test_copies(void)
{
    enum { N = 40000 };
    static const size_t lengths[] = {0, 1, 7, 100, 3071, 3072, 3073, 6144, 15359, 15360, 15361, N};
    guint8 *from = g_malloc(N), *to = g_malloc(N + 1);
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < N; k++)
        from[k] = (guint8)g_rand_int(rand);
    for (size_t k = 0; k < G_N_ELEMENTS(lengths); k++) {
        size_t n = lengths[k];
        memset(to, 0x5a, N + 1);
        uint32_t start = g_rand_int(rand);
        g_assert_cmphex(ls_crc32c_copy(start, to, from, n), ==, ls_crc32c_portable(start, from, n));
        g_assert_cmpmem(to, n, from, n);
        g_assert_cmphex(to[n], ==, 0x5a);
    }
    g_rand_free(rand);
    g_free(from);
    g_free(to);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/crc32c/gives-the-values-of-rfc-3720", test_check_values);
    g_test_add_func("/crc32c/table-and-instruction-agree-at-every-length", test_both_ways_agree);
    g_test_add_func("/crc32c/a-copy-is-one-and-has-its-checksum", test_copies);
    return g_test_run();
}

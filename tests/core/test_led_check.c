/* led_check: dead and dim LEDs are named, shading is not. */
#include "core/led_check.h"

#include <glib.h>
#include <math.h>

enum { N = 346, CHANNELS = 3 };

struct dome {
    float directions[N][3], level[CHANNELS * N], share[CHANNELS * N];
    uint8_t verdict[CHANNELS * N];
};

/* A camera on +z before a thing that shades itself; LEDs spread by 5 %, channels differ in colour.
 */
static struct dome *make(unsigned seed, uint32_t channels)
{
    struct dome *d = g_new0(struct dome, 1);
    GRand *rand = g_rand_new_with_seed(seed);
    for (uint32_t i = 0; i < N; i++) {
        double y = 1 - (2 * i + 1.0) / N, r = sqrt(1 - y * y), a = i * 2.399963229728653;
        d->directions[i][0] = (float)(r * cos(a));
        d->directions[i][1] = (float)y;
        d->directions[i][2] = (float)(r * sin(a));
        double z = (double)d->directions[i][2];
        double seen = (1 + z) * (1 + z) / 4 + 0.002;
        for (uint32_t c = 0; c < channels; c++)
            d->level[c * N + i] = (float)(0.01 * (c + 1) * seen * (1 + 0.1 * (c == 1) * z) *
                                          (1 + 0.05 * (2 * g_rand_double(rand) - 1)));
    }
    g_rand_free(rand);
    return d;
}

static void check(struct dome *d, uint32_t channels)
{
    const struct ls_led_levels in = {(const float(*)[3])d->directions, d->level, N, channels, 0.01};
    g_assert_cmpint(ls_led_check(&in, d->verdict, d->share, NULL), ==, LS_OK);
}

static uint32_t count(const struct dome *d, uint32_t channels, enum ls_led_verdict verdict)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < channels * N; i++)
        n += d->verdict[i] == verdict;
    return n;
}

static void test_sound(void)
{
    for (uint32_t channels = 1; channels <= CHANNELS; channels++)
        for (unsigned seed = 0; seed < 5; seed++) {
            struct dome *d = make(seed, channels);
            check(d, channels);
            g_assert_cmpuint(count(d, channels, LS_LED_IS_DEAD), ==, 0);
            g_assert_cmpuint(count(d, channels, LS_LED_IS_DIM), ==, 0);
            /* straight behind the thing: less than a hundredth of the middle light */
            g_assert_cmpuint(count(d, channels, LS_LED_UNSEEN), <, channels * N / 10);
            g_assert_cmpuint(count(d, channels, LS_LED_FINE), >, channels * N * 9 / 10);
            g_free(d);
        }
}

static void test_faulty(void)
{
    for (uint32_t channels = 1; channels <= CHANNELS; channels++) {
        struct dome *d = make(9, channels);
        uint32_t front = 0, side = 0;
        for (uint32_t i = 0; i < N; i++) {
            front = d->directions[i][2] > d->directions[front][2] ? i : front;
            side = fabs(d->directions[i][2]) < fabs(d->directions[side][2]) ? i : side;
        }
        d->level[front] *= 0.45f;                    /* channel 0 of one light */
        d->level[(channels - 1) * N + side] = 1e-6f; /* the last channel of another */
        check(d, channels);
        g_assert_cmpint(d->verdict[front], ==, LS_LED_IS_DIM);
        g_assert_cmpfloat(fabs(d->share[front] - 0.45), <, 0.1);
        g_assert_cmpint(d->verdict[(channels - 1) * N + side], ==, LS_LED_IS_DEAD);
        g_assert_cmpuint(count(d, channels, LS_LED_IS_DIM), ==, 1);
        g_assert_cmpuint(count(d, channels, LS_LED_IS_DEAD), ==, 1);
        g_free(d);
    }
}

/* A light of which nothing works is found by its neighbours. */
static void test_whole_light(void)
{
    struct dome *d = make(11, CHANNELS);
    uint32_t front = 0;
    for (uint32_t i = 0; i < N; i++)
        front = d->directions[i][2] > d->directions[front][2] ? i : front;
    for (uint32_t c = 0; c < CHANNELS; c++)
        d->level[c * N + front] = 0;
    check(d, CHANNELS);
    g_assert_cmpuint(count(d, CHANNELS, LS_LED_IS_DEAD), ==, CHANNELS);
    g_assert_cmpuint(count(d, CHANNELS, LS_LED_IS_DIM), ==, 0);
    for (uint32_t c = 0; c < CHANNELS; c++)
        g_assert_cmpint(d->verdict[c * N + front], ==, LS_LED_IS_DEAD);
    g_free(d);
}

static void test_missing(void)
{
    struct dome *d = make(12, 2);
    for (uint32_t i = 0; i < N; i++)
        d->level[N + i] = i < 2 ? d->level[N + i] : NAN; /* two pictures of a channel */
    d->level[7] = NAN;
    check(d, 2);
    g_assert_cmpint(d->verdict[7], ==, LS_LED_UNKNOWN);
    g_assert_cmpint(d->verdict[N], ==, LS_LED_UNKNOWN);
    g_assert_true(isnan(d->share[7]));
    g_assert_cmpuint(count(d, 2, LS_LED_UNKNOWN), ==, N + 1);
    g_assert_cmpuint(count(d, 2, LS_LED_IS_DIM) + count(d, 2, LS_LED_IS_DEAD), ==, 0);
    g_free(d);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/led-check/a-sound-dome-has-no-faults", test_sound);
    g_test_add_func("/led-check/dim-and-dead-are-told-in-one-channel-or-several", test_faulty);
    g_test_add_func("/led-check/a-whole-light-is-found-by-its-neighbours", test_whole_light);
    g_test_add_func("/led-check/what-was-not-photographed-is-not-judged", test_missing);
    return g_test_run();
}

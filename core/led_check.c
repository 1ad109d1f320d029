#include "core/led_check.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { NEIGHBOURS = 8, LEAST = 3 };

struct check {
    const struct ls_led_levels *in;
    float *relative; /* [c * n_lights + i]: over the channel's median */
    float *whole;    /* [i]: of the light, over its channels; NAN: no picture */
    float *room;
};

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Of what is no NAN in room[0, n). */
static float median(float *room, uint32_t n)
{
    if (!n)
        return NAN;
    qsort(room, n, sizeof *room, ascending);
    return n % 2 ? room[n / 2] : (room[n / 2 - 1] + room[n / 2]) / 2;
}

static void relate(struct check *k)
{
    uint32_t n = k->in->n_lights;
    for (uint32_t c = 0; c < k->in->n_channels; c++) {
        uint32_t known = 0;
        for (uint32_t i = 0; i < n; i++)
            if (!isnan(k->in->level[c * n + i]))
                k->room[known++] = k->in->level[c * n + i];
        float middle = known >= LEAST ? median(k->room, known) : NAN;
        for (uint32_t i = 0; i < n; i++)
            k->relative[c * n + i] = middle > 0 ? k->in->level[c * n + i] / middle : NAN;
    }
}

/* What a light's channels agree on: their median; of two the brighter. */
static void unite(struct check *k)
{
    uint32_t n = k->in->n_lights;
    for (uint32_t i = 0; i < n; i++) {
        uint32_t known = 0;
        for (uint32_t c = 0; c < k->in->n_channels; c++)
            if (!isnan(k->relative[c * n + i]))
                k->room[known++] = k->relative[c * n + i];
        float middle = median(k->room, known);
        k->whole[i] = known == 2 ? k->room[1] : middle;
    }
}

static double cosine(const float a[3], const float b[3])
{
    double ab = 0, aa = 0, bb = 0;
    for (int k = 0; k < 3; k++) {
        ab += (double)a[k] * (double)b[k];
        aa += (double)a[k] * (double)a[k];
        bb += (double)b[k] * (double)b[k];
    }
    return ab / sqrt(aa * bb);
}

/* The second darkest of the nearest eight, and their middle; false where the dome is too sparse. */
static bool look_around(const struct check *k, uint32_t light, float *dark, float *middle)
{
    double near[NEIGHBOURS];
    float level[NEIGHBOURS];
    uint32_t n = 0;
    for (uint32_t i = 0; i < k->in->n_lights; i++) {
        double c = i == light ? -2 : cosine(k->in->directions[i], k->in->directions[light]);
        if (i == light || isnan(k->whole[i]) || (n == NEIGHBOURS && c <= near[n - 1]))
            continue;
        uint32_t at = n < NEIGHBOURS ? n++ : n - 1;
        for (; at > 0 && near[at - 1] < c; at--) {
            near[at] = near[at - 1];
            level[at] = level[at - 1];
        }
        near[at] = c;
        level[at] = k->whole[i];
    }
    if (n < NEIGHBOURS || near[n - 1] < cos(LS_LED_NEAR_DEG * M_PI / 180))
        return false;
    *middle = median(level, n);
    *dark = level[1];
    return true;
}

static enum ls_led_verdict judge(double share)
{
    return share < LS_LED_DEAD ? LS_LED_IS_DEAD : share < LS_LED_DIM ? LS_LED_IS_DIM : LS_LED_FINE;
}

static void judge_light(const struct check *k, uint32_t i, uint8_t *verdict, float *share)
{
    uint32_t n = k->in->n_lights;
    float dark = NAN, middle = NAN, expected = k->whole[i];
    if (look_around(k, i, &dark, &middle) && !(k->whole[i] >= (float)LS_LED_DIM * dark))
        expected = middle;
    for (uint32_t c = 0; c < k->in->n_channels; c++) {
        uint32_t at = c * n + i;
        verdict[at] = LS_LED_UNKNOWN;
        share[at] = NAN;
        if (isnan(k->relative[at]))
            continue;
        share[at] = k->relative[at] / expected;
        bool seen = expected > (float)k->in->floor;
        verdict[at] = seen ? (uint8_t)judge((double)share[at]) : LS_LED_UNSEEN;
        if (!seen)
            share[at] = NAN;
    }
}

enum ls_err ls_led_check(const struct ls_led_levels *in, uint8_t *verdict, float *share,
                         struct ls_diag *diag)
{
    size_t n = (size_t)in->n_lights * in->n_channels;
    LS_CLEANUP_FREE float *relative = calloc(n + 1, sizeof *relative);
    LS_CLEANUP_FREE float *whole = calloc(in->n_lights + 1, sizeof *whole);
    LS_CLEANUP_FREE float *room = calloc(in->n_lights + in->n_channels + 1, sizeof *room);
    if (!relative || !whole || !room)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for judging LEDs");
    struct check k = {in, relative, whole, room};
    relate(&k);
    unite(&k);
    for (uint32_t i = 0; i < in->n_lights; i++)
        judge_light(&k, i, verdict, share);
    return LS_OK;
}

#include "core/hot_pixels.h"

#include "core/sample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NEIGHBOURS = 8 };

struct image {
    const float *mean;
    uint32_t width, height, period;
};

/* One colour period further, mirrored about the border pixel; stays put where there is no room. */
static uint32_t step(uint32_t i, int by, uint32_t period, uint32_t n)
{
    int64_t to = (int64_t)i + (int64_t)by * period;

    if (to < 0 || to >= n)
        to = (int64_t)i - (int64_t)by * period;
    return to < 0 || to >= n ? i : (uint32_t)to;
}

static void neighbours(const struct image *m, uint32_t x, uint32_t y, float out[NEIGHBOURS])
{
    int n = 0;

    for (int dy = -1; dy <= 1; dy++) {
        const float *row = m->mean + (size_t)step(y, dy, m->period, m->height) * m->width;
        for (int dx = -1; dx <= 1; dx++)
            if (dx || dy)
                out[n++] = row[step(x, dx, m->period, m->width)];
    }
}

static float hot_threshold(const struct image *m, float *sample)
{
    size_t n = 0, end = (size_t)m->width * m->height;

    for (size_t p = 0; p < end; p += ls_sample_step(end)) {
        float around[NEIGHBOURS];
        neighbours(m, (uint32_t)(p % m->width), (uint32_t)(p / m->width), around);
        sample[n++] = fabsf(m->mean[p] - ls_median(around, NEIGHBOURS));
    }
    return fmaxf(8 * 1.4826f * ls_median(sample, n), 1);
}

static float noisy_threshold(const float *variance, size_t end, float *sample)
{
    size_t n = 0;

    for (size_t p = 0; p < end; p += ls_sample_step(end))
        sample[n++] = variance[p];
    return fmaxf(36 * ls_median(sample, n), 4);
}

static int is_hot(const struct image *m, uint32_t x, uint32_t y, float threshold)
{
    float around[NEIGHBOURS], limit = m->mean[(size_t)y * m->width + x] - threshold;
    int near = 0;

    neighbours(m, x, y, around);
    for (int k = 0; k < NEIGHBOURS; k++)
        near += around[k] >= limit;
    return near <= 1;
}

static enum ls_err append(struct ls_pixel_list *list, uint32_t index)
{
    if ((list->n & (list->n - 1)) == 0) { /* at powers of two the list is full */
        uint32_t *grown = realloc(list->index, (list->n ? 2 * (size_t)list->n : 1) * sizeof *grown);
        if (!grown)
            return LS_ERR_NOMEM;
        list->index = grown;
    }
    list->index[list->n++] = index;
    return LS_OK;
}

static enum ls_err collect(const struct image *m, const float *variance, float hot, float noisy,
                           struct ls_pixel_list *list)
{
    enum ls_err err = LS_OK;

    for (uint32_t y = 0; y < m->height; y++)
        for (uint32_t x = 0; x < m->width; x++) {
            uint32_t p = y * m->width + x;
            if (!is_hot(m, x, y, hot) && !(variance && variance[p] > noisy))
                continue;
            err = append(list, p);
            if (err)
                return err;
        }
    return err;
}

enum ls_err ls_hot_pixels(const float *mean_dn, const float *variance_dn2, enum ls_cfa cfa,
                          uint32_t width, uint32_t height, struct ls_pixel_list *list)
{
    struct image m = {mean_dn, width, height, ls_cfa_period_px(cfa)};
    LS_CLEANUP_FREE float *sample = malloc(LS_SAMPLES_MAX * sizeof *sample);

    *list = (struct ls_pixel_list){0};
    if (!sample)
        return LS_ERR_NOMEM;
    float hot = hot_threshold(&m, sample);
    float noisy =
        variance_dn2 ? noisy_threshold(variance_dn2, (size_t)width * height, sample) : INFINITY;
    enum ls_err err = collect(&m, variance_dn2, hot, noisy, list);
    if (err)
        ls_pixel_list_finish(list);
    return err;
}

enum ls_err ls_pixel_list_join(struct ls_pixel_list *into, const struct ls_pixel_list *other)
{
    uint32_t *joined = malloc(((size_t)into->n + other->n + 1) * sizeof *joined);
    uint32_t n = 0;

    if (!joined)
        return LS_ERR_NOMEM;
    for (uint32_t i = 0, k = 0; i < into->n || k < other->n;) {
        uint64_t a = i < into->n ? into->index[i] : UINT64_MAX;
        uint64_t b = k < other->n ? other->index[k] : UINT64_MAX;
        joined[n++] = (uint32_t)(a < b ? a : b);
        i += a <= b;
        k += b <= a;
    }
    ls_pixel_list_finish(into);
    *into = (struct ls_pixel_list){n, joined};
    return LS_OK;
}

void ls_pixel_list_finish(struct ls_pixel_list *list)
{
    free(list->index);
    *list = (struct ls_pixel_list){0};
}

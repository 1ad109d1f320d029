#include "sim/blur.h"

#include <math.h>
#include <string.h>

enum {
    PART = 128,    /* pixels of a row at a time */
    TILE_ROW = 16, /* a whole tile's row */
};

void sim_blur_build(double sigma_px, struct sim_blur *out)
{
    double tap[SIM_BLUR_REACH + 1] = {1}, sum = 1;
    *out = (struct sim_blur){.reach = (uint32_t)floor(3 * sigma_px + 0.5)};
    for (uint32_t t = 1; t <= out->reach; t++) {
        tap[t] = exp(-0.5 * t * t / (sigma_px * sigma_px));
        sum += 2 * tap[t];
    }
    for (uint32_t t = 0; t <= out->reach; t++)
        out->tap[t] = (float)(tap[t] / sum);
}

/* @n sums over @step apart, from the middle outwards. */
static inline __attribute__((always_inline)) void weigh(const float *tap, uint32_t reach,
                                                        const float *in, size_t step, uint32_t n,
                                                        float *restrict out)
{
    for (uint32_t x = 0; x < n; x++) {
        float sum = tap[0] * in[x];
        for (uint32_t t = 1; t <= reach; t++)
            sum += tap[t] * (*(in + x - t * step) + in[x + t * step]);
        out[x] = sum;
    }
}

/* The usual reaches are known to the compiler, which unrolls them. */
static void weigh_any(const struct sim_blur *blur, const float *in, size_t step, uint32_t n,
                      float *restrict out)
{
    switch (blur->reach) {
    case 0:
        weigh(blur->tap, 0, in, step, n, out);
        break;
    case 1:
        weigh(blur->tap, 1, in, step, n, out);
        break;
    case 2:
        weigh(blur->tap, 2, in, step, n, out);
        break;
    case 3:
        weigh(blur->tap, 3, in, step, n, out);
        break;
    default:
        weigh(blur->tap, blur->reach, in, step, n, out);
    }
}

static void blur_part(const struct sim_blur *blur, const float *in, size_t stride, uint32_t n,
                      float *restrict out)
{
    float column[PART + 2 * SIM_BLUR_REACH];
    weigh_any(blur, in - blur->reach, stride, n + 2 * blur->reach, column);
    weigh_any(blur, column + blur->reach, 1, n, out);
}

/* @n blurred pixels of the rectangle's row @y, from @x on. */
static void blur_row(const struct sim_blur *blur, const struct sim_planes *planes, uint32_t k,
                     uint32_t x, uint32_t y, uint32_t n, float *out)
{
    size_t row = (size_t)k * planes->height + y + blur->reach;
    blur_part(blur, planes->v + row * planes->width + x + blur->reach, planes->width, n, out);
}

void sim_blur_plane(const struct sim_blur *blur, const struct sim_planes *planes, uint32_t k,
                    float *out)
{
    uint32_t width = planes->width - 2 * blur->reach, height = planes->height - 2 * blur->reach;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x += PART)
            blur_row(blur, planes, k, x, y, width - x < PART ? width - x : PART,
                     out + (size_t)y * width + x);
}

void sim_blur_mosaic(const struct sim_blur *blur, const struct sim_planes *planes, enum ls_cfa cfa,
                     uint32_t x0, uint32_t y0, float *out)
{
    if (planes->n == 1) {
        sim_blur_plane(blur, planes, 0, out);
        return;
    }
    uint32_t width = planes->width - 2 * blur->reach, height = planes->height - 2 * blur->reach;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x += PART) {
            float other[PART];
            uint32_t n = width - x < PART ? width - x : PART;
            float *row = out + (size_t)y * width + x;
            blur_row(blur, planes, (uint32_t)ls_cfa_channel(cfa, x0, y0 + y), x, y, n, row);
            blur_row(blur, planes, (uint32_t)ls_cfa_channel(cfa, x0 + 1, y0 + y), x, y, n, other);
            for (uint32_t i = 1; i < n; i += 2)
                row[i] = other[i];
        }
}

void sim_planes_put(const struct sim_planes *planes, uint32_t k, uint32_t x, uint32_t y,
                    uint32_t width, uint32_t height, const float *restrict value)
{
    float *restrict plane = planes->v + (size_t)k * planes->height * planes->width;
    plane += (size_t)y * planes->width + x;
    for (uint32_t row = 0; row < height; row++, plane += planes->width, value += width)
        if (width == TILE_ROW)
            memcpy(plane, value, TILE_ROW * sizeof *value); /* without a call */
        else
            memcpy(plane, value, width * sizeof *value);
}

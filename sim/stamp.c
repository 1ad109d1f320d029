#include "sim/stamp.h"

#include "core/crc32c.h"

#include <string.h>

enum { GRID = SIM_STAMP_GRID, RECORD_BYTES = 28 };

const float sim_stamp_level[2] = {0.2f, 0.7f};

static void put(uint8_t *at, uint32_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> (8 * i));
}

static uint32_t get(const uint8_t *at, int bytes)
{
    uint32_t value = 0;
    for (int i = 0; i < bytes; i++)
        value |= (uint32_t)at[i] << (8 * i);
    return value;
}

void sim_stamp_encode(const struct sim_stamp *s, uint8_t bytes[SIM_STAMP_BYTES])
{
    put(bytes, s->kind, 2);
    put(bytes + 2, s->n_leds, 2);
    put(bytes + 4, s->light, 2);
    put(bytes + 6, s->channel, 1);
    put(bytes + 7, s->camera, 1);
    put(bytes + 8, s->condition, 4);
    put(bytes + 12, s->step, 4);
    put(bytes + 16, s->exposure_ns_10, 4);
    put(bytes + 20, s->lit_ns_10, 4);
    put(bytes + 24, s->sequence, 4);
    put(bytes + RECORD_BYTES, ls_crc32c(0, bytes, RECORD_BYTES), 4);
}

static void decode(const uint8_t bytes[SIM_STAMP_BYTES], struct sim_stamp *s)
{
    *s = (struct sim_stamp){
        .kind = (uint16_t)get(bytes, 2),
        .n_leds = (uint16_t)get(bytes + 2, 2),
        .light = (uint16_t)get(bytes + 4, 2),
        .channel = bytes[6],
        .camera = bytes[7],
        .condition = get(bytes + 8, 4),
        .step = get(bytes + 12, 4),
        .exposure_ns_10 = get(bytes + 16, 4),
        .lit_ns_10 = get(bytes + 20, 4),
        .sequence = get(bytes + 24, 4),
    };
}

uint32_t sim_stamp_block_px(uint32_t width, uint32_t height)
{
    return (width < height ? width : height) / GRID;
}

static enum ls_err check_size(uint32_t width, uint32_t height, struct ls_diag *diag)
{
    if (sim_stamp_block_px(width, height) >= 2)
        return LS_OK;
    return ls_fail(diag, LS_ERR_INVALID, "a stamp needs 32 x 32 px, the image has %u x %u", width,
                   height);
}

enum ls_err sim_stamp_draw(const struct sim_stamp *stamp, uint32_t width, uint32_t height,
                           float *image, struct ls_diag *diag)
{
    enum ls_err err = check_size(width, height, diag);
    if (err)
        return err;
    uint8_t bytes[SIM_STAMP_BYTES];
    sim_stamp_encode(stamp, bytes);
    uint32_t block = sim_stamp_block_px(width, height);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            uint32_t column = x / block, row = y / block, bit = row * GRID + column;
            int lit = column < GRID && row < GRID && bytes[bit / 8] >> (bit % 8) & 1;
            image[(size_t)y * width + x] = sim_stamp_level[lit];
        }
    return LS_OK;
}

static int read_bit(const uint16_t *dn, uint32_t width, uint32_t block, uint32_t bit,
                    uint32_t full_scale)
{
    uint32_t margin = block / 4, side = block - 2 * margin;
    uint32_t x0 = bit % GRID * block + margin, y0 = bit / GRID * block + margin;
    uint64_t sum = 0;
    for (uint32_t y = y0; y < y0 + side; y++)
        for (uint32_t x = x0; x < x0 + side; x++)
            sum += dn[(size_t)y * width + x];
    return (double)sum > 0.5 * (sim_stamp_level[0] + sim_stamp_level[1]) * full_scale * side * side;
}

enum ls_err sim_stamp_read(const uint16_t *dn, uint32_t width, uint32_t height,
                           uint32_t full_scale_dn, struct sim_stamp *out, struct ls_diag *diag)
{
    enum ls_err err = check_size(width, height, diag);
    if (err)
        return err;
    uint8_t bytes[SIM_STAMP_BYTES] = {0};
    for (uint32_t bit = 0; bit < 8 * SIM_STAMP_BYTES; bit++)
        bytes[bit / 8] |=
            (uint8_t)(read_bit(dn, width, sim_stamp_block_px(width, height), bit, full_scale_dn)
                      << (bit % 8));
    if (get(bytes + RECORD_BYTES, 4) != ls_crc32c(0, bytes, RECORD_BYTES))
        return ls_fail(diag, LS_ERR_MISMATCH, "the image carries no legible stamp");
    decode(bytes, out);
    return LS_OK;
}

#include "sim/stamp_frames.h"

#include "core/pixel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LEVELS = 2, MIN_SIDE_PX = 2 * SIM_STAMP_GRID };

static const struct ls_pixel_format *pixel_of(const struct sim_raw_format *f)
{
    return ls_pixel_by_code(f->pixel_format);
}

static size_t row_bytes(const struct sim_raw_format *f)
{
    return ls_pixel_payload_bytes(pixel_of(f), f->width, 1);
}

bool sim_stamp_frames_fit(const struct sim_raw_format *format)
{
    const struct ls_pixel_format *pixel = pixel_of(format);
    return pixel && pixel->bits_per_pixel % 8 == 0 && format->width >= MIN_SIDE_PX &&
           format->height >= MIN_SIDE_PX;
}

/* ---- frames of one level ---- */

static enum ls_err read_level(const struct sim_sensor *sensor, const struct sim_raw_format *f,
                              const struct sim_readout *readout, float level, uint8_t *raw)
{
    LS_CLEANUP_FREE float *signal = malloc(f->width * sizeof *signal);
    LS_CLEANUP_FREE uint16_t *dn = malloc(f->width * sizeof *dn);
    if (!signal || !dn)
        return LS_ERR_NOMEM;
    for (uint32_t x = 0; x < f->width; x++)
        signal[x] = (float)sensor->full_well_e * level;
    for (uint32_t y = 0; y < f->height; y++) {
        sim_sensor_row(sensor, readout, f->offset_x, f->offset_y + y, f->width, signal, dn);
        ls_pixel_pack(pixel_of(f), dn, (size_t)y * f->width, f->width, raw);
    }
    return LS_OK;
}

static bool is_of(const struct sim_stamp_set *set, const struct sim_raw_format *f, uint32_t n,
                  double exposure_us)
{
    const struct sim_raw_format *g = &set->format;
    return set->raw && set->n == n && g->width == f->width && g->height == f->height &&
           g->offset_x == f->offset_x && g->offset_y == f->offset_y &&
           g->pixel_format == f->pixel_format && g->gain_db == f->gain_db &&
           fabs(set->exposure_us - exposure_us) <= 1e-3 * exposure_us;
}

static enum ls_err fill(struct sim_stamp_set *set, const struct sim_sensor *sensor,
                        const struct sim_readout *readout)
{
    struct sim_readout own = *readout;
    size_t bytes = row_bytes(&set->format) * set->format.height;
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < LEVELS * set->n && !err; i++) {
        own.key = sim_hash(readout->key + i);
        err = read_level(sensor, &set->format, &own, sim_stamp_level[i % LEVELS],
                         set->raw + i * bytes);
    }
    return err;
}

static enum ls_err make(struct sim_stamp_frames *frames, uint32_t n,
                        const struct sim_sensor *sensor, const struct sim_raw_format *format,
                        const struct sim_readout *readout, struct sim_stamp_set **out)
{
    struct sim_stamp_set *set = &frames->sets[frames->next++ % SIM_STAMP_SETS];
    free(set->raw);
    *set =
        (struct sim_stamp_set){.format = *format, .exposure_us = readout->exposure_s * 1e6, .n = n};
    set->raw = malloc((size_t)LEVELS * n * row_bytes(format) * format->height);
    enum ls_err err = set->raw ? fill(set, sensor, readout) : LS_ERR_NOMEM;
    if (err) {
        free(set->raw);
        set->raw = NULL;
    }
    *out = set;
    return err;
}

static enum ls_err find(struct sim_stamp_frames *frames, uint32_t n,
                        const struct sim_sensor *sensor, const struct sim_raw_format *format,
                        const struct sim_readout *readout, struct sim_stamp_set **out)
{
    for (uint32_t i = 0; i < SIM_STAMP_SETS; i++)
        if (is_of(&frames->sets[i], format, n, readout->exposure_s * 1e6)) {
            *out = &frames->sets[i];
            return LS_OK;
        }
    return make(frames, n, sensor, format, readout, out);
}

/* ---- a frame ---- */

static bool is_light(const uint8_t *bits, uint32_t row, uint32_t column)
{
    uint32_t bit = row * SIM_STAMP_GRID + column;
    return row < SIM_STAMP_GRID && column < SIM_STAMP_GRID && bits[bit / 8] >> (bit % 8) & 1;
}

/* One row of blocks' row @y: neighbours of one level are copied together. */
static void cut_row(const struct sim_stamp_set *set, const uint8_t *bits, uint32_t variant,
                    uint32_t y, uint8_t *raw)
{
    const struct sim_raw_format *f = &set->format;
    size_t row = row_bytes(f), frame = row * f->height, pixel = row / f->width;
    uint32_t block = sim_stamp_block_px(f->width, f->height);
    for (uint32_t column = 0, end; column <= SIM_STAMP_GRID; column = end) {
        bool light = is_light(bits, y / block, column);
        for (end = column + 1; end <= SIM_STAMP_GRID && is_light(bits, y / block, end) == light;)
            end++;
        size_t from = column * block * pixel;
        size_t to = end > SIM_STAMP_GRID ? row : end * block * pixel; /* what is left is dark */
        memcpy(raw + y * row + from, set->raw + (variant * LEVELS + light) * frame + y * row + from,
               to - from);
    }
}

enum ls_err sim_stamp_frames_draw(struct sim_stamp_frames *frames, uint32_t n,
                                  const struct sim_sensor *sensor, const struct sim_stamp *stamp,
                                  const struct sim_raw_format *format,
                                  const struct sim_readout *readout, void *raw,
                                  struct ls_diag *diag)
{
    uint8_t bits[SIM_STAMP_BYTES];
    struct sim_stamp_set *set;
    if (find(frames, n, sensor, format, readout, &set))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u frames of stamps", 2 * n);
    sim_stamp_encode(stamp, bits);
    for (uint32_t y = 0; y < format->height; y++)
        cut_row(set, bits, (uint32_t)(sim_hash(readout->key + y) % n), y, raw);
    return LS_OK;
}

void sim_stamp_frames_finish(struct sim_stamp_frames *frames)
{
    for (uint32_t i = 0; i < SIM_STAMP_SETS; i++)
        free(frames->sets[i].raw);
    *frames = (struct sim_stamp_frames){0};
}

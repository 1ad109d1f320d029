#include "core/preview.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { CURVE = 4096 };

/* One pass over the rows; everything of it in one allocation. */
struct pass {
    const struct ls_preview_params *p;
    uint32_t out_width, out_height, green_width;
    unsigned step; /* photosites between greens */
    uint16_t *row;
    uint32_t *sums;   /* [out_width][3] of a row of blocks */
    float *green[3];  /* rows of the green picture, latest last */
    float *energies;  /* of a row of it */
    uint32_t n_green; /* rows seen */
    uint64_t clipped[3], seen[3];
    double energy, total;
    uint64_t n_energy, n_total;
    uint8_t curve[CURVE + 1];
};

uint32_t ls_preview_bin(uint32_t width, uint32_t height, uint32_t most_px)
{
    uint32_t longest = width > height ? width : height, bin = 2;
    while (longest / bin > most_px)
        bin += 2;
    return bin;
}

static double srgb(double v)
{
    return v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
}

static uint8_t code_of(const struct pass *pass, uint32_t sum, float per_dn, float at_zero)
{
    float at = (float)sum * per_dn + at_zero;
    return pass->curve[at <= 0 ? 0 : at >= CURVE ? CURVE : (int)(at + 0.5f)];
}

/* Photosites of a colour in a block: a quarter, of green half. */
static uint32_t in_block(const struct pass *pass, unsigned channel)
{
    uint32_t all = pass->p->bin * pass->p->bin;
    return channel == 1 ? all / 2 : all / 4;
}

static void put_row(struct pass *pass, uint8_t *rgb)
{
    const struct ls_preview_params *p = pass->p;
    bool mono = p->format->cfa == LS_CFA_NONE;
    double range = (p->full_scale_dn - p->black_dn) / CURVE;
    for (unsigned c = 0; c < 3; c++) {
        uint32_t n = mono ? p->bin * p->bin : in_block(pass, c);
        float per_dn = (float)(1 / (n * range)), at_zero = (float)(-p->black_dn / range);
        for (uint32_t x = 0; x < pass->out_width; x++)
            rgb[3 * x + c] = code_of(pass, pass->sums[3 * x + (mono ? 0 : c)], per_dn, at_zero);
    }
    memset(pass->sums, 0, 3 * pass->out_width * sizeof *pass->sums);
}

static void count_clipped(struct pass *pass, const unsigned channel[2])
{
    uint32_t clip = (uint32_t)fmin(ceil(pass->p->full_scale_dn), 65536), n[2] = {0, 0};
    uint32_t width = pass->p->width;
    for (uint32_t x = 0; x + 1 < width; x += 2) {
        n[0] += pass->row[x] >= clip;
        n[1] += pass->row[x + 1] >= clip;
    }
    n[0] += width & 1 && pass->row[width - 1] >= clip;
    for (unsigned i = 0; i < 2; i++) {
        pass->clipped[channel[i]] += n[i];
        pass->seen[channel[i]] += (width + 1 - i) / 2;
    }
}

static void add_row(struct pass *pass, uint32_t y)
{
    enum ls_cfa cfa = pass->p->format->cfa;
    const unsigned channel[2] = {ls_cfa_channel(cfa, 0, y), ls_cfa_channel(cfa, 1, y)};
    uint32_t bin = pass->p->bin;
    count_clipped(pass, channel);
    if (y >= pass->out_height * bin)
        return;
    for (uint32_t block = 0; block < pass->out_width; block++) {
        const uint16_t *from = pass->row + (size_t)block * bin;
        uint32_t sum[2] = {0, 0};
        for (uint32_t x = 0; x < bin; x += 2) {
            sum[0] += from[x];
            sum[1] += from[x + 1];
        }
        pass->sums[3 * block + channel[0]] += sum[0];
        pass->sums[3 * block + channel[1]] += sum[1];
    }
}

static void add_gradients(struct pass *pass)
{
    const float *a = pass->green[0], *b = pass->green[1], *c = pass->green[2];
    uint32_t n = pass->green_width - 2;
    float *energies = pass->energies;
    for (uint32_t x = 0; x < n; x++) {
        float gx = (a[x + 2] - a[x]) + 2 * (b[x + 2] - b[x]) + (c[x + 2] - c[x]);
        float gy = (c[x] - a[x]) + 2 * (c[x + 1] - a[x + 1]) + (c[x + 2] - a[x + 2]);
        energies[x] = gx * gx + gy * gy;
    }
    for (uint32_t x = 0; x < n; x++)
        pass->energy += (double)energies[x] / 64; /* Sobel's weights: a slope of 1 gives 8 */
    pass->n_energy += n;
}

/* The green photosite of each pair of columns in every other row, of a mono camera everything. */
static void add_green(struct pass *pass, uint32_t y)
{
    const struct ls_preview_params *p = pass->p;
    if (y % pass->step)
        return;
    uint32_t first = p->format->cfa != LS_CFA_NONE && ls_cfa_channel(p->format->cfa, 0, y) != 1;
    float *row = pass->green[0];
    pass->green[0] = pass->green[1];
    pass->green[1] = pass->green[2];
    pass->green[2] = row;
    for (uint32_t x = 0; x < pass->green_width; x++) {
        row[x] = (float)(pass->row[x * pass->step + first] - p->black_dn);
        pass->total += (double)row[x];
    }
    pass->n_total += pass->green_width;
    if (++pass->n_green >= 3 && pass->green_width >= 3)
        add_gradients(pass);
}

static double focus_of(const struct pass *pass)
{
    const struct ls_preview_params *p = pass->p;
    double mean = pass->n_total ? pass->total / (double)pass->n_total : 0;
    double variance = p->read_noise_dn * p->read_noise_dn + fmax(mean, 0) / p->electrons_per_dn;
    if (pass->n_energy == 0 || mean <= 2 * sqrt(variance))
        return 0;
    double energy = pass->energy / (double)pass->n_energy - 24.0 / 64 * variance;
    return fmax(energy, 0) / (mean * mean);
}

static enum ls_err begin(struct pass *pass, const struct ls_preview_params *p)
{
    *pass = (struct pass){.p = p,
                          .out_width = ls_preview_size(p->width, p->bin),
                          .out_height = ls_preview_size(p->height, p->bin),
                          .step = ls_cfa_period_px(p->format->cfa)};
    pass->green_width = p->width / pass->step;
    pass->row = malloc(p->width * sizeof *pass->row);
    pass->sums = calloc(3 * pass->out_width, sizeof *pass->sums);
    pass->energies = malloc(pass->green_width * sizeof *pass->energies);
    for (int i = 0; i < 3; i++)
        pass->green[i] = malloc(pass->green_width * sizeof *pass->green[i]);
    for (int i = 0; i <= CURVE; i++)
        pass->curve[i] = (uint8_t)lrint(255 * srgb((double)i / CURVE));
    return pass->row && pass->sums && pass->energies && pass->green[0] && pass->green[1] &&
                   pass->green[2]
               ? LS_OK
               : LS_ERR_NOMEM;
}

static void end(struct pass *pass)
{
    free(pass->row);
    free(pass->sums);
    free(pass->energies);
    for (int i = 0; i < 3; i++)
        free(pass->green[i]);
}

static void fill_figures(const struct pass *pass, struct ls_preview_figures *out)
{
    *out = (struct ls_preview_figures){.n_colours = pass->p->format->cfa == LS_CFA_NONE ? 1 : 3,
                                       .focus = focus_of(pass)};
    for (uint32_t c = 0; c < out->n_colours; c++)
        out->clip[c] = pass->seen[c] ? (double)pass->clipped[c] / (double)pass->seen[c] : 0;
}

enum ls_err ls_preview_make(const struct ls_preview_params *p, const void *raw, uint8_t *rgb,
                            struct ls_preview_figures *figures)
{
    struct pass pass;
    if (!p->format || p->bin == 0 || p->bin % 2 || p->bin > LS_PREVIEW_MOST_BIN ||
        p->width < p->bin || p->height < p->bin || !(p->black_dn < p->full_scale_dn))
        return LS_ERR_INVALID;
    enum ls_err err = begin(&pass, p);
    for (uint32_t y = 0; !err && y < p->height; y++) {
        ls_pixel_unpack(p->format, raw, (size_t)y * p->width, p->width, pass.row);
        add_row(&pass, y);
        add_green(&pass, y);
        if ((y + 1) % p->bin == 0 && y / p->bin < pass.out_height)
            put_row(&pass, rgb + (size_t)(y / p->bin) * pass.out_width * 3);
    }
    if (!err)
        fill_figures(&pass, figures);
    end(&pass);
    return err;
}

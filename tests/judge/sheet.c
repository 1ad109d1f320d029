#include "judge.h"

#include <math.h>

enum { SHEET_LIMIT_BYTES = 256 << 20, BORDER_PX = 4 };

/* Mean of the pixels that fall into one thumbnail pixel. */
static void box(const struct ls_image *in, double x0, double x1, double y0, double y1,
                double rgb[3])
{
    uint32_t left = (uint32_t)x0, right = (uint32_t)fmax(ceil(x1), x0 + 1);
    uint32_t top = (uint32_t)y0, bottom = (uint32_t)fmax(ceil(y1), y0 + 1);
    double n = 0;
    rgb[0] = rgb[1] = rgb[2] = 0;
    for (uint32_t y = top; y < bottom && y < in->height; y++)
        for (uint32_t x = left; x < right && x < in->width; x++, n++)
            for (uint32_t c = 0; c < 3; c++)
                rgb[c] += in->pixels[((size_t)y * in->width + x) * in->n_channels +
                                     (in->n_channels == 3 ? c : 0)];
    for (int c = 0; c < 3; c++)
        rgb[c] /= fmax(n, 1);
}

static void place(const struct judge_thumb *thumb, uint32_t side, uint32_t x0, uint32_t y0,
                  struct ls_image *sheet)
{
    const struct ls_image *in = thumb->image;
    double step = (double)(in->width > in->height ? in->width : in->height) / side;
    for (uint32_t y = 0; y < side && y * step < in->height; y++)
        for (uint32_t x = 0; x < side && x * step < in->width; x++) {
            double raw[3];
            box(in, x * step, (x + 1) * step, y * step, (y + 1) * step, raw);
            float *out = sheet->pixels + 3 * ((size_t)(y0 + y) * sheet->width + x0 + x);
            for (int c = 0; c < 3; c++)
                out[c] = (float)(thumb->gain *
                                 (thumb->m ? thumb->m[3 * c] * raw[0] + thumb->m[3 * c + 1] * raw[1] +
                                                 thumb->m[3 * c + 2] * raw[2]
                                           : raw[c]));
        }
}

enum ls_err judge_contact_sheet(const struct judge_thumb *thumbs, uint32_t n, uint32_t columns,
                                uint32_t side, struct ls_image *image, struct ls_diag *diag)
{
    uint32_t rows = (n + columns - 1) / columns, cell = side + BORDER_PX;
    enum ls_err err = ls_image_init(image, columns * cell + BORDER_PX, rows * cell + BORDER_PX, 3,
                                    SHEET_LIMIT_BYTES, diag);
    for (uint32_t i = 0; i < n && !err; i++)
        place(&thumbs[i], side, BORDER_PX + i % columns * cell, BORDER_PX + i / columns * cell,
              image);
    return err;
}

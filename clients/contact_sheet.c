#include "clients/contact_sheet.h"

#include "clients/picture_file.h"
#include "core/primaries.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    SIDE_PX = 128,
    SHEET_PX = 1 << 24,
    GAP_PX = 4,
    DIGIT_WIDTH_PX = 5,
    DIGIT_HEIGHT_PX = 7,
    DIGITS = 4, /* of a light's number */
};

static const float background = 0.04f, label_white = 0.6f; /* of white, linear */

/* Rows of five pixels, the highest bit on the left. */
static const uint8_t digits[10][DIGIT_HEIGHT_PX] = {
    {14, 17, 19, 21, 25, 17, 14}, {4, 12, 4, 4, 4, 4, 14},  {14, 17, 1, 6, 8, 16, 31},
    {14, 17, 1, 6, 1, 17, 14},    {2, 6, 10, 18, 31, 2, 2}, {31, 16, 30, 1, 1, 17, 14},
    {6, 8, 16, 30, 17, 17, 14},   {31, 1, 2, 4, 8, 8, 8},   {14, 17, 17, 14, 17, 17, 14},
    {14, 17, 17, 15, 1, 2, 12},
};

enum ls_err ls_contact_sheet_begin(struct ls_contact_sheet *sheet, size_t n, const double (*m)[3],
                                   struct ls_diag *diag)
{
    *sheet = (struct ls_contact_sheet){.n = n, .m = m, .lights = calloc(n, sizeof *sheet->lights)};
    return sheet->lights ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

/* How large a digit's pixel is. */
static uint32_t pen(const struct ls_contact_sheet *sheet)
{
    return sheet->width >= 96 ? 2 : 1;
}

static uint32_t at_least(uint32_t value, uint32_t least)
{
    return value > least ? value : least;
}

/* Cells, and a sheet that is about half as wide again as it is high. */
static void lay_out(struct ls_contact_sheet *sheet, const struct ls_image *picture)
{
    uint32_t longest = at_least(picture->width, picture->height);
    uint32_t side = (uint32_t)fmin(SIDE_PX, fmax(1, sqrt((double)SHEET_PX / (double)sheet->n)));
    sheet->bin = (longest + side - 1) / side;
    sheet->width = (picture->width + sheet->bin - 1) / sheet->bin;
    sheet->height = (picture->height + sheet->bin - 1) / sheet->bin;
    uint32_t label_width = DIGITS * (DIGIT_WIDTH_PX + 1) * pen(sheet);
    sheet->cell_width = at_least(sheet->width, label_width) + GAP_PX;
    sheet->cell_height = sheet->height + (DIGIT_HEIGHT_PX + 2) * pen(sheet) + GAP_PX;
    double columns = sqrt(1.5 * (double)sheet->n * sheet->cell_height / sheet->cell_width);
    sheet->columns = (uint32_t)fmin((double)sheet->n, fmax(1, round(columns)));
    sheet->rows = (uint32_t)((sheet->n + sheet->columns - 1) / sheet->columns);
}

/* What is no picture is NaN until the end: neither measured nor shown. */
static enum ls_err make_sheet(struct ls_contact_sheet *sheet, const struct ls_image *picture,
                              struct ls_diag *diag)
{
    lay_out(sheet, picture);
    enum ls_err err = ls_image_init(&sheet->image, sheet->columns * sheet->cell_width + GAP_PX,
                                    sheet->rows * sheet->cell_height + GAP_PX, picture->n_channels,
                                    SIZE_MAX, diag);
    size_t n = (size_t)sheet->image.width * sheet->image.height * picture->n_channels;
    for (size_t i = 0; i < n && !err; i++)
        sheet->image.pixels[i] = NAN;
    return err;
}

static float *cell(const struct ls_contact_sheet *sheet, size_t k, uint32_t x, uint32_t y)
{
    size_t column = k % sheet->columns * sheet->cell_width + GAP_PX + x;
    size_t row = k / sheet->columns * sheet->cell_height + GAP_PX + y;
    return sheet->image.pixels + (row * sheet->image.width + column) * sheet->image.n_channels;
}

/* Of channel @c of the pixels of one bin. */
static float mean(const struct ls_image *in, uint32_t bin, uint32_t x, uint32_t y, uint32_t c)
{
    double sum = 0, n = 0;
    for (uint32_t row = y * bin; row < (y + 1) * bin && row < in->height; row++)
        for (uint32_t column = x * bin; column < (x + 1) * bin && column < in->width; column++, n++)
            sum += (double)in->pixels[((size_t)row * in->width + column) * in->n_channels + c];
    return (float)(sum / n);
}

enum ls_err ls_contact_sheet_add(struct ls_contact_sheet *sheet, const struct ls_image *picture,
                                 uint32_t light, struct ls_diag *diag)
{
    uint32_t n = picture->n_channels;
    enum ls_err err = sheet->added ? LS_OK : make_sheet(sheet, picture, diag);
    if (err)
        return err;
    if (sheet->added == sheet->n || n != sheet->image.n_channels ||
        (picture->width + sheet->bin - 1) / sheet->bin != sheet->width ||
        (picture->height + sheet->bin - 1) / sheet->bin != sheet->height)
        return ls_fail(diag, LS_ERR_INVALID, "the picture of light %u has another size", light);
    for (uint32_t y = 0; y < sheet->height; y++)
        for (uint32_t x = 0; x < sheet->width; x++) {
            float *out = cell(sheet, sheet->added, x, y);
            for (uint32_t c = 0; c < n; c++)
                out[c] = mean(picture, sheet->bin, x, y, c);
            if (sheet->m && n == 3)
                ls_colours_apply(sheet->m, out, 1, out);
        }
    sheet->lights[sheet->added++] = light;
    return LS_OK;
}

static void draw(const struct ls_contact_sheet *sheet, size_t k, uint32_t place,
                 const uint8_t *rows, float value)
{
    uint32_t size = pen(sheet), left = place * (DIGIT_WIDTH_PX + 1) * size;
    for (uint32_t y = 0; y < DIGIT_HEIGHT_PX * size; y++)
        for (uint32_t x = 0; x < DIGIT_WIDTH_PX * size; x++) {
            float *out = cell(sheet, k, left + x, sheet->height + size + y);
            bool on = rows[y / size] >> (DIGIT_WIDTH_PX - 1 - x / size) & 1;
            for (uint32_t c = 0; c < sheet->image.n_channels && on; c++)
                out[c] = value;
        }
}

static void fill_gaps(struct ls_image *image, float value)
{
    for (size_t i = 0; i < (size_t)image->width * image->height * image->n_channels; i++)
        if (isnan(image->pixels[i]))
            image->pixels[i] = value;
}

enum ls_err ls_contact_sheet_write(struct ls_contact_sheet *sheet, const char *path, float *scale,
                                   struct ls_diag *diag)
{
    *scale = ls_picture_scale(&sheet->image);
    fill_gaps(&sheet->image, background / *scale);
    for (size_t k = 0; k < sheet->added; k++) {
        char text[16];
        snprintf(text, sizeof text, "%u", sheet->lights[k]);
        for (uint32_t i = 0; i < DIGITS && text[i]; i++)
            draw(sheet, k, i, digits[text[i] - '0'], label_white / *scale);
    }
    return ls_picture_file_png(path, &sheet->image, *scale, NULL, diag);
}

void ls_contact_sheet_finish(struct ls_contact_sheet *sheet)
{
    free(sheet->lights);
    ls_image_finish(&sheet->image);
    *sheet = (struct ls_contact_sheet){0};
}

#include "core/rgbe.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { LINE_MAX_LENGTH = 512, HEADER_MAX_LINES = 4096, MAX_PX = 1 << 20, NEW_RLE_MAX_PX = 0x7fff };

struct reader {
    const uint8_t *at, *end;
    char line[LINE_MAX_LENGTH]; /* the last header line, cut if longer */
    unsigned line_number;
};

/* Where a scanline's pixels go: base + s * per_scanline + p * per_pixel, in pixels. */
struct header {
    uint32_t n_scanlines, length; /* of a scanline */
    uint32_t width, height;
    ptrdiff_t base, per_scanline, per_pixel;
    double divide[3];
};

static bool next_line(struct reader *reader)
{
    const uint8_t *newline = memchr(reader->at, '\n', (size_t)(reader->end - reader->at));
    if (!newline || ++reader->line_number > HEADER_MAX_LINES)
        return false;
    size_t n = (size_t)(newline - reader->at);
    if (n && reader->at[n - 1] == '\r')
        n--;
    n = n < LINE_MAX_LENGTH - 1 ? n : LINE_MAX_LENGTH - 1;
    for (size_t k = 0; k < n; k++) /* what is not text may yet be quoted in a sentence */
        reader->line[k] = (reader->at[k] < 0x20 && reader->at[k] != '\t') || reader->at[k] > 0x7e
                              ? '?'
                              : (char)reader->at[k];
    reader->line[n] = 0;
    reader->at = newline + 1;
    return true;
}

/* The @n numbers after '='; false if there are fewer or anything else. */
static bool numbers(const char *text, double *values, int n)
{
    for (int k = 0; k < n; k++) {
        char *end;
        values[k] = strtod(text, &end);
        if (end == text || !isfinite(values[k]))
            return false;
        text = end;
    }
    return text[strspn(text, " \t")] == 0;
}

static bool near(const double *a, const double *b, int n)
{
    for (int k = 0; k < n; k++)
        if (fabs(a[k] - b[k]) > 0.0015) /* files carry three or four decimals */
            return false;
    return true;
}

static bool primaries_ok(const double *p)
{
    static const double unset[8] = {0};
    static const double rec709[8] = {0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290};
    static const double radiance[8] = {0.640, 0.330, 0.290, 0.600, 0.150, 0.060, 0.3333, 0.3333};
    return near(p, unset, 8) || near(p, rec709, 8) || near(p, radiance, 8);
}

static enum ls_err malformed(const struct reader *reader, const char *expected,
                             struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_INVALID, "Radiance HDR: line %u \"%.80s\": expected %s",
                   reader->line_number, reader->line, expected);
}

static enum ls_err parse_factor(struct reader *reader, const char *value, int n,
                                struct header *header, struct ls_diag *diag)
{
    double v[3];
    if (!numbers(value, v, n) || v[0] <= 0 || (n == 3 && (v[1] <= 0 || v[2] <= 0)))
        return malformed(reader, n == 1 ? "one positive number" : "three positive numbers", diag);
    for (int c = 0; c < 3; c++)
        header->divide[c] *= v[n == 3 ? c : 0];
    return LS_OK;
}

static enum ls_err parse_unit(struct reader *reader, const char *name, const char *value,
                              struct ls_diag *diag)
{
    double v;
    if (!numbers(value, &v, 1))
        return malformed(reader, "one number", diag);
    if (fabs(v - 1) > 1e-6)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "Radiance HDR: line %u: %s %g is not supported; "
                       "rewrite the picture with %s 1",
                       reader->line_number, name, v, name);
    return LS_OK;
}

static enum ls_err parse_variable(struct reader *reader, struct header *header,
                                  struct ls_diag *diag)
{
    const char *line = reader->line, *equals = strchr(line, '=');
    size_t n = equals ? (size_t)(equals - line) : 0;
    double v[8];
    if (n == 8 && !strncmp(line, "EXPOSURE", n))
        return parse_factor(reader, equals + 1, 1, header, diag);
    if (n == 9 && !strncmp(line, "COLORCORR", n))
        return parse_factor(reader, equals + 1, 3, header, diag);
    if (n == 5 && !strncmp(line, "GAMMA", n))
        return parse_unit(reader, "GAMMA", equals + 1, diag);
    if (n == 9 && !strncmp(line, "PIXASPECT", n))
        return parse_unit(reader, "PIXASPECT", equals + 1, diag);
    if (n == 6 && !strncmp(line, "FORMAT", n) && strcmp(equals + 1, "32-bit_rle_rgbe"))
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "Radiance HDR: line %u: format \"%.60s\": only "
                       "32-bit_rle_rgbe is read",
                       reader->line_number, equals + 1);
    if (n == 9 && !strncmp(line, "PRIMARIES", n)) {
        if (!numbers(equals + 1, v, 8))
            return malformed(reader, "eight numbers", diag);
        if (!primaries_ok(v))
            return ls_fail(diag, LS_ERR_UNSUPPORTED,
                           "Radiance HDR: line %u: primaries other than "
                           "Rec. 709 are not supported; convert the picture first",
                           reader->line_number);
    }
    return LS_OK;
}

static bool parse_axis(const char **text, char *sign, char *axis, uint32_t *n)
{
    char *end;
    *sign = (*text)[0];
    if ((*sign != '+' && *sign != '-') || ((*text)[1] != 'X' && (*text)[1] != 'Y') ||
        (*text)[2] != ' ')
        return false;
    *axis = (*text)[1];
    const char *digits = *text + 3;
    if (*digits < '0' || *digits > '9')
        return false;
    unsigned long value = strtoul(digits, &end, 10);
    if (!value || value > MAX_PX)
        return false;
    *n = (uint32_t)value;
    *text = end + strspn(end, " ");
    return true;
}

/* "-Y 512 +X 1024": the first axis counts scanlines. Up is +Y, right is +X. */
static enum ls_err parse_resolution(struct reader *reader, struct header *header,
                                    struct ls_diag *diag)
{
    static const char expected[] = "a size such as \"-Y 512 +X 1024\"";
    const char *text = reader->line;
    char sign[2], axis[2];
    uint32_t n[2];
    if (!parse_axis(&text, &sign[0], &axis[0], &n[0]) ||
        !parse_axis(&text, &sign[1], &axis[1], &n[1]) || *text || axis[0] == axis[1])
        return malformed(reader, expected, diag);
    header->n_scanlines = n[0];
    header->length = n[1];
    header->width = axis[0] == 'X' ? n[0] : n[1];
    header->height = axis[0] == 'Y' ? n[0] : n[1];
    ptrdiff_t *step[2] = {&header->per_scanline, &header->per_pixel};
    for (int k = 0; k < 2; k++) {
        bool forward = sign[k] == (axis[k] == 'X' ? '+' : '-');
        ptrdiff_t unit = axis[k] == 'X' ? 1 : (ptrdiff_t)header->width;
        *step[k] = forward ? unit : -unit;
        header->base += forward ? 0 : unit * ((ptrdiff_t)n[k] - 1);
    }
    return LS_OK;
}

static enum ls_err parse_header(struct reader *reader, struct header *header, struct ls_diag *diag)
{
    *header = (struct header){.divide = {1, 1, 1}};
    if (!next_line(reader) || strncmp(reader->line, "#?", 2))
        return ls_fail(diag, LS_ERR_INVALID,
                       "not a Radiance HDR file: it does not begin with "
                       "#?RADIANCE");
    while (next_line(reader)) {
        if (!reader->line[0]) {
            if (next_line(reader))
                return parse_resolution(reader, header, diag);
            break;
        }
        enum ls_err err = reader->line[0] == '#' ? LS_OK : parse_variable(reader, header, diag);
        if (err)
            return err;
    }
    return ls_fail(diag, LS_ERR_INVALID, "Radiance HDR: the header does not end (%u lines read)",
                   reader->line_number);
}

/* One of the four component planes of a scanline, byte runs. */
static bool read_plane(struct reader *reader, uint8_t *out, uint32_t n)
{
    for (uint32_t x = 0; x < n;) {
        if (reader->end - reader->at < 2)
            return false;
        uint32_t code = *reader->at++, run = code > 128 ? code - 128 : code;
        if (!run || run > n - x)
            return false;
        if (code > 128) {
            for (uint32_t k = 0; k < run; k++)
                out[4 * (x + k)] = *reader->at;
            reader->at++;
        } else {
            if (reader->end - reader->at < (ptrdiff_t)run)
                return false;
            for (uint32_t k = 0; k < run; k++)
                out[4 * (x + k)] = *reader->at++;
        }
        x += run;
    }
    return true;
}

/* Flat pixels; (1, 1, 1, n) repeats the one before n << 8k times, k counting such codes in a row.
 */
static bool read_old(struct reader *reader, uint8_t *out, uint32_t n)
{
    unsigned shift = 0;
    for (uint32_t x = 0; x < n;) {
        if (reader->end - reader->at < 4)
            return false;
        const uint8_t *pixel = reader->at;
        reader->at += 4;
        if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
            memcpy(out + 4 * x++, pixel, 4);
            shift = 0;
            continue;
        }
        uint64_t run = shift < 32 ? (uint64_t)pixel[3] << shift : n;
        if (!x || run > n - x)
            return false;
        for (; run; run--, x++)
            memcpy(out + 4 * x, out + 4 * (x - 1), 4);
        shift += 8;
    }
    return true;
}

static bool read_scanline(struct reader *reader, uint8_t *out, uint32_t n)
{
    const uint8_t *at = reader->at;
    if (n < 8 || n > NEW_RLE_MAX_PX || reader->end - at < 4 || at[0] != 2 || at[1] != 2 ||
        at[2] & 0x80)
        return read_old(reader, out, n);
    if ((uint32_t)at[2] << 8 != (n & 0xff00) || at[3] != (n & 0xff))
        return false;
    reader->at += 4;
    for (int c = 0; c < 4; c++)
        if (!read_plane(reader, out + c, n))
            return false;
    return true;
}

/* False: a pixel is more than a float holds. */
static bool put_scanline(const struct header *header, const uint8_t *rgbe, uint32_t s,
                         float *pixels)
{
    double most = 0;
    ptrdiff_t at = header->base + (ptrdiff_t)s * header->per_scanline;
    for (uint32_t p = 0; p < header->length; p++, at += header->per_pixel) {
        const uint8_t *in = rgbe + 4 * p;
        if (!in[3])
            continue;
        double scale = ldexp(1.0, in[3] - (128 + 8));
        for (int c = 0; c < 3; c++) {
            double v = (in[c] + 0.5) * scale / header->divide[c];
            most = fmax(most, v);
            pixels[3 * at + c] = (float)fmin(v, FLT_MAX);
        }
    }
    return most <= FLT_MAX;
}

enum ls_err ls_rgbe_read(const void *bytes, size_t n_bytes, size_t limit_bytes,
                         struct ls_image *image, struct ls_diag *diag)
{
    struct reader reader = {.at = bytes, .end = (const uint8_t *)bytes + n_bytes};
    struct header header;
    *image = (struct ls_image){0};
    enum ls_err err = parse_header(&reader, &header, diag);
    if (err)
        return err;
    size_t line_bytes = 4 * (size_t)header.length;
    if (line_bytes > limit_bytes)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "Radiance HDR: %u x %u px are more than the limit of "
                       "%zu bytes",
                       header.width, header.height, limit_bytes);
    err = ls_image_init(image, header.width, header.height, 3, limit_bytes - line_bytes, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE uint8_t *rgbe = malloc(line_bytes);
    if (!rgbe)
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for %zu bytes", line_bytes);
    for (uint32_t s = 0; s < header.n_scanlines && !err; s++) {
        if (!read_scanline(&reader, rgbe, header.length))
            err = ls_fail(diag, LS_ERR_INVALID,
                          "Radiance HDR: scanline %u of %u is truncated or "
                          "malformed",
                          s, header.n_scanlines);
        else if (!put_scanline(&header, rgbe, s, image->pixels))
            err = ls_fail(diag, LS_ERR_INVALID,
                          "Radiance HDR: scanline %u of %u is brighter than a float "
                          "holds: correct EXPOSURE and COLORCORR",
                          s, header.n_scanlines);
    }
    if (err)
        ls_image_finish(image);
    return err;
}

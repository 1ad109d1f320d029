#include "core/png.h"

#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_PX = 65536, WORKING_BYTES = 8 << 20 /* of libpng itself */ };

struct session {
    struct ls_diag *diag;
    const uint8_t *at, *end; /* reading */
    uint8_t *bytes;          /* writing */
    size_t n, capacity;
    size_t limit_bytes; /* of pixels */
    size_t used_bytes;  /* by libpng, of WORKING_BYTES */
    enum ls_err err;
};

static void on_error(png_structp png, png_const_charp message)
{
    struct session *session = png_get_error_ptr(png);
    if (!session->err)
        session->err = ls_fail(session->diag, LS_ERR_INVALID, "PNG: %s", message);
    longjmp(png_jmpbuf(png), 1);
}

static void on_warning(png_structp png, png_const_charp message)
{
}

static void *bounded_malloc(png_structp png, png_alloc_size_t n)
{
    struct session *session = png_get_mem_ptr(png);
    if (n > WORKING_BYTES - session->used_bytes) {
        session->err = ls_fail(session->diag, LS_ERR_LIMIT,
                               "PNG: its chunks need more than %d "
                               "bytes of memory",
                               WORKING_BYTES);
        return NULL;
    }
    void *p = malloc(n);
    if (p)
        session->used_bytes += n;
    return p;
}

/* What was used stays counted: a bound on all that was ever asked for. */
static void bounded_free(png_structp png, void *p)
{
    free(p);
}

static void read_bytes(png_structp png, png_bytep out, size_t n)
{
    struct session *session = png_get_io_ptr(png);
    if (n > (size_t)(session->end - session->at))
        png_error(png, "the file is truncated");
    memcpy(out, session->at, n);
    session->at += n;
}

static void write_bytes(png_structp png, png_bytep in, size_t n)
{
    struct session *session = png_get_io_ptr(png);
    if (session->n + n > session->capacity) {
        size_t capacity = 2 * session->capacity + n + 65536;
        uint8_t *bytes = realloc(session->bytes, capacity);
        if (!bytes) {
            session->err = ls_fail(session->diag, LS_ERR_NOMEM, "PNG: no memory");
            png_error(png, "no memory");
        }
        session->bytes = bytes;
        session->capacity = capacity;
    }
    memcpy(session->bytes + session->n, in, n);
    session->n += n;
}

static void flush_bytes(png_structp png)
{
}

static float linear_from_srgb(double v)
{
    return (float)(v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4));
}

static void convert(const uint8_t *codes, bool wide, bool decode_srgb, struct ls_image *image)
{
    size_t n = (size_t)image->width * image->height * image->n_channels;
    float table[256];
    for (int k = 0; k < 256; k++)
        table[k] = decode_srgb ? linear_from_srgb(k / 255.0) : (float)(k / 255.0);
    for (size_t k = 0; k < n; k++) {
        double v = wide ? (codes[2 * k] << 8 | codes[2 * k + 1]) / 65535.0 : 0;
        image->pixels[k] = !wide ? table[codes[k]] : decode_srgb ? linear_from_srgb(v) : (float)v;
    }
}

/* Header checked, transformations set; the row size is final. */
static bool prepare(png_structp png, png_infop info, struct session *session, uint32_t *channels)
{
    png_read_info(png, info);
    png_byte type = png_get_color_type(png, info);
    if (type & PNG_COLOR_MASK_ALPHA || png_get_valid(png, info, PNG_INFO_tRNS)) {
        session->err = ls_fail(session->diag, LS_ERR_UNSUPPORTED,
                               "PNG: it has transparency; "
                               "remove the alpha channel first");
        return false;
    }
    if (type == PNG_COLOR_TYPE_PALETTE)
        png_set_palette_to_rgb(png);
    if (type == PNG_COLOR_TYPE_GRAY && png_get_bit_depth(png, info) < 8)
        png_set_expand_gray_1_2_4_to_8(png);
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    *channels = png_get_channels(png, info);
    return true;
}

static void cleanup_rows(png_bytep **rows)
{
    free(*rows);
}

/* Everything between setjmp and its end lives in this frame; what is allocated is freed by the
 * caller through @codes and @rows. */
static enum ls_err read_codes(png_structp png, png_infop info, struct session *session,
                              uint8_t **codes, png_bytep **rows, bool *wide, struct ls_image *image)
{
    if (setjmp(png_jmpbuf(png)))
        return session->err;
    uint32_t channels;
    if (!prepare(png, info, session, &channels))
        return session->err;
    uint32_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
    size_t row_bytes = png_get_rowbytes(png, info), n = row_bytes * height;
    session->err =
        ls_image_init(image, width, height, channels, session->limit_bytes / 2, session->diag);
    if (session->err)
        return session->err;
    *codes = malloc(n);
    *rows = malloc(height * sizeof **rows);
    if (!*codes || !*rows)
        return ls_fail(session->diag, LS_ERR_NOMEM, "PNG: no memory for %zu bytes", n);
    for (uint32_t y = 0; y < height; y++)
        (*rows)[y] = *codes + y * row_bytes;
    png_read_image(png, *rows);
    png_read_end(png, NULL);
    *wide = png_get_bit_depth(png, info) == 16;
    return LS_OK;
}

enum ls_err ls_png_read(const void *bytes, size_t n_bytes, bool decode_srgb, size_t limit_bytes,
                        struct ls_image *image, struct ls_diag *diag)
{
    struct session session = {.diag = diag,
                              .at = bytes,
                              .end = (const uint8_t *)bytes + n_bytes,
                              .limit_bytes = limit_bytes};
    *image = (struct ls_image){0};
    if (n_bytes < 8 || png_sig_cmp(bytes, 0, 8))
        return ls_fail(diag, LS_ERR_INVALID, "not a PNG file");
    png_structp png = png_create_read_struct_2(PNG_LIBPNG_VER_STRING, &session, on_error,
                                               on_warning, &session, bounded_malloc, bounded_free);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (!info) {
        png_destroy_read_struct(&png, NULL, NULL);
        return ls_fail(diag, LS_ERR_NOMEM, "PNG: no memory");
    }
    png_set_user_limits(png, MAX_PX, MAX_PX);
    png_set_chunk_malloc_max(png, WORKING_BYTES);
    png_set_read_fn(png, &session, read_bytes);
    LS_CLEANUP_FREE uint8_t *codes = NULL;
    __attribute__((cleanup(cleanup_rows))) png_bytep *rows = NULL;
    bool wide = false;
    enum ls_err err = read_codes(png, info, &session, &codes, &rows, &wide, image);
    png_destroy_read_struct(&png, &info, NULL);
    if (err)
        ls_image_finish(image);
    else
        convert(codes, wide, decode_srgb, image);
    return err;
}

static uint8_t code(float value, float scale)
{
    double v = (double)value * scale;
    if (!(v > 0))
        return 0;
    if (v >= 1)
        return 255;
    double srgb = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
    return (uint8_t)(255 * srgb + 0.5);
}

static enum ls_err write_rows(png_structp png, png_infop info, struct session *session,
                              const struct ls_image *image, float scale, uint8_t *row)
{
    size_t n = (size_t)image->width * image->n_channels;
    if (setjmp(png_jmpbuf(png)))
        return session->err;
    png_set_IHDR(png, info, image->width, image->height, 8,
                 image->n_channels == 3 ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    for (uint32_t y = 0; y < image->height; y++) {
        for (size_t k = 0; k < n; k++)
            row[k] = code(image->pixels[y * n + k], scale);
        png_write_row(png, row);
    }
    png_write_end(png, info);
    return LS_OK;
}

enum ls_err ls_png_write(const struct ls_image *image, float scale, uint8_t **bytes,
                         size_t *n_bytes, struct ls_diag *diag)
{
    struct session session = {.diag = diag};
    if (!image->width || !image->height || image->width > MAX_PX || image->height > MAX_PX ||
        (image->n_channels != 1 && image->n_channels != 3) || !(scale > 0) || !isfinite(scale))
        return ls_fail(diag, LS_ERR_INVALID,
                       "PNG: a picture of %u x %u with %u channels at a "
                       "scale of %g cannot be written",
                       image->width, image->height, image->n_channels, (double)scale);
    LS_CLEANUP_FREE uint8_t *row = malloc((size_t)image->width * image->n_channels);
    png_structp png =
        png_create_write_struct(PNG_LIBPNG_VER_STRING, &session, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (!info || !row) {
        png_destroy_write_struct(&png, NULL);
        return ls_fail(diag, LS_ERR_NOMEM, "PNG: no memory");
    }
    png_set_write_fn(png, &session, write_bytes, flush_bytes);
    enum ls_err err = write_rows(png, info, &session, image, scale, row);
    png_destroy_write_struct(&png, &info);
    if (err) {
        free(session.bytes);
        return err;
    }
    *bytes = session.bytes;
    *n_bytes = session.n;
    return LS_OK;
}

#include "clients/environment_file.h"

#include "clients/command.h"
#include "core/exr.h"
#include "core/rgbe.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const size_t max_file_bytes = (size_t)1 << 30;
static const size_t max_pixel_bytes = (size_t)4 << 30;

enum format { FORMAT_NONE, FORMAT_RGBE, FORMAT_EXR, FORMAT_JSON };

static enum format format_of(const char *path)
{
    const char *dot = strrchr(path, '.');
    if (!dot)
        return FORMAT_NONE;
    if (strcasecmp(dot, ".hdr") == 0 || strcasecmp(dot, ".pic") == 0)
        return FORMAT_RGBE;
    if (strcasecmp(dot, ".exr") == 0)
        return FORMAT_EXR;
    return strcasecmp(dot, ".json") == 0 ? FORMAT_JSON : FORMAT_NONE;
}

/* One channel: the same light in red, green and blue. */
static enum ls_err spread_grey(struct ls_image *image, struct ls_diag *diag)
{
    struct ls_image rgb = {0};
    enum ls_err err =
        ls_image_init(&rgb, image->width, image->height, 3, max_pixel_bytes, diag);
    if (err)
        return err;
    for (size_t i = 0; i < (size_t)image->width * image->height; i++)
        rgb.pixels[3 * i] = rgb.pixels[3 * i + 1] = rgb.pixels[3 * i + 2] = image->pixels[i];
    ls_image_finish(image);
    *image = rgb;
    return LS_OK;
}

/* The map's numbers are Rec. 709, or the camera's own, which no primaries describe. */
static enum ls_err check_primaries(const struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    static const float rec709[8] = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
    const struct ls_exr_attr *attr = ls_exr_attrs_find(attrs, "chromaticities");
    for (int i = 0; attr && i < 8; i++)
        if (attr->kind != LS_EXR_ATTR_CHROMATICITIES || !(fabsf(attr->f[i] - rec709[i]) < 0.0015f))
            return ls_fail(diag, LS_ERR_UNSUPPORTED,
                           "OpenEXR: chromaticities other than Rec. 709: convert the map with "
                           "oiiotool --colorconvert, then --eraseattrib chromaticities");
    return LS_OK;
}

static enum ls_err read_exr(const char *bytes, size_t n, struct ls_image *image,
                            struct ls_diag *diag)
{
    struct ls_exr_attrs attrs = {0};
    enum ls_err err = ls_exr_read(bytes, n, NULL, max_pixel_bytes, image, &attrs, diag);
    if (!err)
        err = check_primaries(&attrs, diag);
    ls_exr_attrs_finish(&attrs);
    return err;
}

static enum ls_err read_bytes(enum format format, const char *bytes, size_t n,
                              struct ls_environment_file *out, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (format == FORMAT_JSON)
        return ls_lobes_parse_json(bytes, n, &out->lobes, diag);
    if (format == FORMAT_RGBE)
        err = ls_rgbe_read(bytes, n, max_pixel_bytes, &out->image, diag);
    else
        err = read_exr(bytes, n, &out->image, diag);
    return !err && out->image.n_channels == 1 ? spread_grey(&out->image, diag) : err;
}

static enum ls_err named(enum ls_err err, const char *path, struct ls_diag *diag)
{
    struct ls_diag inner = *diag;
    return err ? ls_fail(diag, err, "%.200s: %.300s", path, inner.text) : LS_OK;
}

enum ls_err ls_environment_file_read(const char *path, enum ls_map_space space,
                                     struct ls_environment_file *out, struct ls_diag *diag)
{
    enum format format = format_of(path);
    char *bytes = NULL;
    size_t n = 0;
    memset(out, 0, sizeof *out);
    if (format == FORMAT_NONE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "%s: expected a lat-long .hdr or .exr, or spectral lobes as .json", path);
    enum ls_err err = ls_command_read_file(path, max_file_bytes, &bytes, &n, diag);
    if (err)
        return err;
    err = named(read_bytes(format, bytes, n, out, diag), path, diag);
    free(bytes);
    if (err) {
        ls_environment_file_finish(out);
        return err;
    }
    out->map = (struct ls_map){out->image.pixels, out->image.width, out->image.height, space};
    if (!out->lobes && (out->map.width > LS_MAP_MAX_SIDE || out->map.height > LS_MAP_MAX_SIDE))
        return ls_fail(diag, LS_ERR_LIMIT, "%s: at most %d pixels a side", path, LS_MAP_MAX_SIDE);
    return LS_OK;
}

void ls_environment_file_finish(struct ls_environment_file *file)
{
    ls_lobes_destroy(file->lobes);
    ls_image_finish(&file->image);
    memset(file, 0, sizeof *file);
}

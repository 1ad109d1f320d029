#include "clients/environment_file.h"

#include "clients/command.h"
#include "core/exr.h"
#include "core/mirror_ball.h"
#include "core/primaries.h"
#include "core/rgbe.h"

#include <math.h>
#include <stdio.h>
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
    enum ls_err err = ls_image_init(&rgb, image->width, image->height, 3, max_pixel_bytes, diag);
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
    const struct ls_exr_attr *attr = ls_exr_attrs_find(attrs, "chromaticities");
    for (int i = 0; attr && i < 8; i++)
        if (attr->kind != LS_EXR_ATTR_CHROMATICITIES ||
            !(fabs((double)attr->f[i] - ls_primaries_rec709.xy[i / 2][i % 2]) < 0.0015))
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

static enum ls_err read_picture(enum format format, const char *bytes, size_t n,
                                struct ls_image *image, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (format == FORMAT_RGBE)
        err = ls_rgbe_read(bytes, n, max_pixel_bytes, image, diag);
    else
        err = read_exr(bytes, n, image, diag);
    return !err && image->n_channels == 1 ? spread_grey(image, diag) : err;
}

/* ---- a captured environment ---- */

/* The picture that lies beside @json. */
static enum ls_err read_ball(const char *json, const char *name, struct ls_image *image,
                             struct ls_diag *diag)
{
    char path[2 * LS_CAPTURED_PATH_BYTES], *bytes = NULL;
    const char *slash = strrchr(json, '/');
    int folder = slash && name[0] != '/' ? (int)(slash - json + 1) : 0;
    enum format format = format_of(name);
    size_t n = 0;
    if (snprintf(path, sizeof path, "%.*s%s", folder, json, name) >= (int)sizeof path)
        return ls_fail(diag, LS_ERR_LIMIT, "the name of the ball's picture is too long");
    if (format != FORMAT_RGBE && format != FORMAT_EXR)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "%s: expected the ball as .hdr or .exr", path);
    enum ls_err err = ls_command_read_file(path, max_file_bytes, &bytes, &n, diag);
    if (err)
        return err;
    err = read_picture(format, bytes, n, image, diag);
    free(bytes);
    return err;
}

/* texels about as large as the ball's pixels: its radius spans a quarter of the equator and more */
static uint32_t map_height(double radius_px)
{
    double height = ceil(M_PI_2 * radius_px);
    return height < 32 ? 32 : height > 1024 ? 1024 : (uint32_t)height;
}

/* NULL: nobody knows it. */
static const double *reflectivity_of(const struct ls_captured *probe,
                                     const struct ls_environment_ball *known)
{
    const struct ls_calibration *measured = known->calibration;
    if (probe->has_reflectivity)
        return probe->reflectivity;
    if (measured && measured->has_mirror && measured->n_colours == 3)
        return measured->mirror_reflectivity;
    return known->profile ? known->profile->ball_reflectivity : NULL;
}

static enum ls_err unfold_ball(const struct ls_image *picture,
                               const struct ls_environment_ball *known,
                               struct ls_environment_file *out, struct ls_diag *diag)
{
    const struct ls_captured *probe = out->probe;
    const double one[3] = {1, 1, 1}, *reflectivity = reflectivity_of(probe, known);
    struct ls_mirror_ball ball = {.rgb = picture->pixels,
                                  .width = picture->width,
                                  .height = picture->height,
                                  .radius_px = probe->radius_px,
                                  .blind_rad = probe->has_blind
                                                   ? probe->blind_deg * M_PI / 180
                                                   : ls_mirror_ball_blind(probe->radius_px, 2)};
    struct ls_mirror_ball_report report;
    uint32_t height = map_height(probe->radius_px);
    memcpy(ball.centre_px, probe->centre_px, sizeof ball.centre_px);
    memcpy(ball.to_camera, probe->camera_direction, sizeof ball.to_camera);
    memcpy(ball.reflectivity, reflectivity ? reflectivity : one, sizeof ball.reflectivity);
    if (!reflectivity)
        out->warning = "the mirror ball's reflectivity is not known: taken as 1";
    enum ls_err err = ls_image_init(&out->image, 2 * height, height, 3, max_pixel_bytes, diag);
    if (!err)
        err = ls_mirror_ball_map(&ball, 2 * height, height, out->image.pixels, NULL, &report, diag);
    if (!err)
        out->filled_sr = report.filled_sr;
    return err;
}

static enum ls_err read_probe(const char *path, const char *bytes, size_t n,
                              const struct ls_environment_ball *known,
                              struct ls_environment_file *out, struct ls_diag *diag)
{
    struct ls_image picture = {0};
    enum ls_err err = ls_captured_parse_json(bytes, n, &out->probe, diag);
    if (!err)
        err = read_ball(path, out->probe->picture, &picture, diag);
    if (!err)
        err = unfold_ball(&picture, known, out, diag);
    ls_image_finish(&picture);
    return err;
}

static enum ls_err read_bytes(const char *path, const char *bytes, size_t n,
                              const struct ls_environment_ball *known,
                              struct ls_environment_file *out, struct ls_diag *diag)
{
    if (format_of(path) != FORMAT_JSON)
        return read_picture(format_of(path), bytes, n, &out->image, diag);
    if (ls_captured_is(bytes, n))
        return read_probe(path, bytes, n, known, out, diag);
    return ls_lobes_parse_json(bytes, n, &out->lobes, diag);
}

static enum ls_err named(enum ls_err err, const char *path, struct ls_diag *diag)
{
    struct ls_diag inner = *diag;
    return err ? ls_fail(diag, err, "%.200s: %.300s", path, inner.text) : LS_OK;
}

enum ls_err ls_environment_file_read(const char *path, enum ls_map_space space,
                                     const struct ls_environment_ball *known,
                                     struct ls_environment_file *out, struct ls_diag *diag)
{
    char *bytes = NULL;
    size_t n = 0;
    memset(out, 0, sizeof *out);
    if (format_of(path) == FORMAT_NONE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "%s: expected a lat-long .hdr or .exr, or spectral lobes or a mirror ball "
                       "with charts as .json",
                       path);
    enum ls_err err = ls_command_read_file(path, max_file_bytes, &bytes, &n, diag);
    if (err)
        return err;
    err = named(read_bytes(path, bytes, n, known, out, diag), path, diag);
    free(bytes);
    if (err) {
        ls_environment_file_finish(out);
        return err;
    }
    out->map = (struct ls_map){out->image.pixels, out->image.width, out->image.height,
                               out->probe ? LS_MAP_CAMERA_RAW : space};
    if (!out->lobes && (out->map.width > LS_MAP_MAX_SIDE || out->map.height > LS_MAP_MAX_SIDE))
        return ls_fail(diag, LS_ERR_LIMIT, "%s: at most %d pixels a side", path, LS_MAP_MAX_SIDE);
    return LS_OK;
}

void ls_environment_file_finish(struct ls_environment_file *file)
{
    ls_lobes_destroy(file->lobes);
    ls_captured_destroy(file->probe);
    ls_image_finish(&file->image);
    memset(file, 0, sizeof *file);
}

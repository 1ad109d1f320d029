#include "core/exr_decode.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static int find_channel(const exr_attr_chlist_t *channels, const char *layer, const char *name)
{
    char full[256];
    int n = layer ? snprintf(full, sizeof full, "%s.%s", layer, name)
                  : snprintf(full, sizeof full, "%s", name);
    if (n < 0 || (size_t)n >= sizeof full)
        return -1;
    for (int c = 0; c < channels->num_channels; c++)
        if (!strcmp(channels->entries[c].name.str, full))
            return c;
    return -1;
}

/* R G B of the layer, else its Y. */
static bool pick(struct ls_exr_target *target, const char *layer)
{
    static const char *const rgb[3] = {"R", "G", "B"};
    const exr_attr_chlist_t *channels = target->layout.channels;
    for (target->n = 0; target->n < 3; target->n++) {
        target->picked[target->n] = find_channel(channels, layer, rgb[target->n]);
        if (target->picked[target->n] < 0)
            break;
    }
    if (target->n == 3)
        return true;
    target->n = 1;
    target->picked[0] = find_channel(channels, layer, "Y");
    return target->picked[0] >= 0;
}

static bool pick_only(struct ls_exr_target *target)
{
    target->n = 1;
    target->picked[0] = 0;
    return target->layout.channels->num_channels == 1;
}

/* The part and channels that @layer names, see ls_exr_read. */
static enum ls_err choose(const struct ls_exr_source *source, const char *layer,
                          struct ls_exr_target *target, struct ls_diag *diag)
{
    int n_parts = 0, named = layer ? ls_exr_source_part(source, layer) : -1;
    enum ls_err refused = LS_OK;
    exr_result_t r = exr_get_count(source->context, &n_parts);
    if (r)
        return ls_exr_source_fail(source, r, "cannot count the parts", diag);
    for (target->part = 0; target->part < n_parts; target->part++) {
        enum ls_err err = ls_exr_source_layout(source, target->part, &target->layout, diag);
        if (err == LS_ERR_UNSUPPORTED) {
            refused = err;
            continue;
        }
        if (err)
            return err;
        if (pick(target, layer) || (!layer && pick_only(target)) ||
            (target->part == named && (pick(target, NULL) || pick_only(target))))
            return LS_OK;
    }
    if (refused)
        return refused;
    return ls_fail(diag, LS_ERR_NOT_FOUND, "OpenEXR: there is no %s%s with channels R G B or Y",
                   layer ? "layer or part " : "part", layer ? layer : "");
}

static enum ls_err check_supported(const struct ls_exr_target *target, struct ls_diag *diag)
{
    const exr_attr_chlist_t *channels = target->layout.channels;
    if (target->layout.compression == EXR_COMPRESSION_DWAA ||
        target->layout.compression == EXR_COMPRESSION_DWAB)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: DWA compression is not read; convert "
                       "with oiiotool --compression zip");
    if (target->layout.compression > EXR_COMPRESSION_B44A)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: compression %d is not known; convert "
                       "with oiiotool --compression zip",
                       target->layout.compression);
    for (int c = 0; c < channels->num_channels; c++)
        if (channels->entries[c].pixel_type > EXR_PIXEL_FLOAT)
            return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: channel %d of %d: type %d is not known",
                           c + 1, channels->num_channels, channels->entries[c].pixel_type);
    for (int c = 0; c < channels->num_channels; c++)
        if (channels->entries[c].x_sampling != 1 || channels->entries[c].y_sampling != 1)
            return ls_fail(diag, LS_ERR_UNSUPPORTED,
                           "OpenEXR: channel %d of %d is subsampled (luminance and chroma?); "
                           "convert to R G B",
                           c + 1, channels->num_channels);
    if (target->n == 1 &&
        (find_channel(channels, NULL, "RY") >= 0 || find_channel(channels, NULL, "BY") >= 0))
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: luminance and chroma are not read; "
                       "convert to R G B");
    return LS_OK;
}

/* Attributes that turn the picture into something else than its pixels in order. */
static enum ls_err check_meaning(const struct ls_exr_source *source, int part, struct ls_diag *diag)
{
    const exr_attribute_t *attr = NULL;
    if (!exr_get_attribute_by_name(source->context, part, "envmap", &attr) && attr &&
        attr->type == EXR_ATTR_ENVMAP && attr->uc != EXR_ENVMAP_LATLONG)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: a cube map; convert it to "
                       "latitude-longitude with exrenvmap -l");
    attr = NULL;
    if (!exr_get_attribute_by_name(source->context, part, "Orientation", &attr) && attr &&
        attr->type == EXR_ATTR_INT && attr->i != 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: Orientation %d; turn it upright with "
                       "oiiotool --reorient",
                       attr->i);
    return LS_OK;
}

/* Some programs keep a Radiance picture's EXPOSURE, unapplied or applied one cannot know. */
static enum ls_err check_exposure(const struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    for (size_t k = 0; k < attrs->n; k++) {
        const struct ls_exr_attr *attr = &attrs->items[k];
        bool number = attr->kind == LS_EXR_ATTR_FLOAT || attr->kind == LS_EXR_ATTR_INT;
        float value = attr->kind == LS_EXR_ATTR_FLOAT ? attr->f[0] : (float)attr->i;
        if (number && !strcmp(attr->name, "EXPOSURE") && value != 1.0f)
            return ls_fail(diag, LS_ERR_UNSUPPORTED,
                           "OpenEXR: attribute EXPOSURE %g: it is not "
                           "said whether the pixels were multiplied by it; divide by it and "
                           "remove it with oiiotool --eraseattrib EXPOSURE",
                           (double)value);
    }
    return LS_OK;
}

static enum ls_err read_picture(const struct ls_exr_source *source, const char *layer,
                                size_t limit_bytes, struct ls_image *image,
                                struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    struct ls_exr_target target = {.type = EXR_PIXEL_FLOAT, .limit_bytes = limit_bytes};
    enum ls_err err = choose(source, layer, &target, diag);
    if (!err)
        err = check_supported(&target, diag);
    if (!err)
        err = check_meaning(source, target.part, diag);
    if (!err)
        err = ls_exr_source_attrs(source, target.part, attrs, diag);
    if (!err)
        err = check_exposure(attrs, diag);
    if (!err)
        err = ls_image_init(image, target.layout.width, target.layout.height, target.n, limit_bytes,
                            diag);
    if (err)
        return err;
    target.pixels = (uint8_t *)image->pixels;
    target.limit_bytes -= (size_t)image->width * image->height * target.n * 4;
    err = ls_exr_decode(source, &target, diag);
    if (err)
        ls_image_finish(image);
    return err;
}

enum ls_err ls_exr_read(const void *bytes, size_t n_bytes, const char *layer, size_t limit_bytes,
                        struct ls_image *image, struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    struct ls_exr_source source;
    struct ls_exr_attrs found = {0};
    *image = (struct ls_image){0};
    enum ls_err err = ls_exr_source_open(&source, bytes, n_bytes, diag);
    if (err)
        return err;
    err = read_picture(&source, layer, limit_bytes, image, &found, diag);
    ls_exr_source_close(&source);
    if (attrs && !err)
        *attrs = found;
    else
        ls_exr_attrs_finish(&found);
    return err;
}

static enum ls_err read_plane(const struct ls_exr_source *source, int part, size_t limit_bytes,
                              struct ls_exr_plane *plane, struct ls_diag *diag)
{
    struct ls_exr_target target = {.part = part};
    enum ls_err err = ls_exr_source_layout(source, part, &target.layout, diag);
    if (err)
        return err;
    if (!pick_only(&target))
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "OpenEXR: %d channels: expected one",
                       target.layout.channels->num_channels);
    err = check_supported(&target, diag);
    if (err)
        return err;
    target.type = target.layout.channels->entries[0].pixel_type;
    if (target.type == EXR_PIXEL_UINT)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "OpenEXR: integer samples in a plane");
    size_t n =
        (size_t)target.layout.width * target.layout.height * ls_exr_sample_bytes(target.type);
    if (n > limit_bytes)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "OpenEXR: %u x %u px are more than the limit of %zu "
                       "bytes",
                       target.layout.width, target.layout.height, limit_bytes);
    target.limit_bytes = limit_bytes - n;
    target.pixels = malloc(n);
    if (!target.pixels)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for %zu bytes", n);
    err = ls_exr_decode(source, &target, diag);
    if (err) {
        free(target.pixels);
        return err;
    }
    *plane =
        (struct ls_exr_plane){.width = target.layout.width,
                              .height = target.layout.height,
                              .type = target.type == EXR_PIXEL_HALF ? LS_EXR_HALF : LS_EXR_FLOAT,
                              .samples = target.pixels};
    return LS_OK;
}

enum ls_err ls_exr_read_plane(const void *bytes, size_t n_bytes, const char *part,
                              size_t limit_bytes, struct ls_exr_plane *plane, struct ls_diag *diag)
{
    struct ls_exr_source source;
    *plane = (struct ls_exr_plane){0};
    enum ls_err err = ls_exr_source_open(&source, bytes, n_bytes, diag);
    if (err)
        return err;
    int index = part ? ls_exr_source_part(&source, part) : 0;
    if (index < 0)
        err = ls_fail(diag, LS_ERR_NOT_FOUND, "OpenEXR: there is no part \"%s\"", part);
    else
        err = read_plane(&source, index, limit_bytes, plane, diag);
    ls_exr_source_close(&source);
    return err;
}

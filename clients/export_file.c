#include "clients/export_file.h"

#include "clients/command_file.h"
#include "clients/picture_attrs.h"
#include "clients/promotion_report.h"
#include "clients/received_band.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const size_t file_limit = (size_t)8 << 30;
static const char calibrated_units[] =
    "R: radiance under irradiance 1 from the light's direction; a 100 % Lambertian facing a white "
    "light reads 1/pi";

/* ---- which spectra ---- */

/* Does "W,R" name it? */
static bool is_named(const char *list, const char *name)
{
    size_t n = strlen(name);
    for (const char *at = list; at; at = strchr(at, ','), at = at ? at + 1 : NULL)
        if (strncmp(at, name, n) == 0 && (at[n] == ',' || at[n] == '\0'))
            return true;
    return false;
}

static enum ls_err choose_spectra(struct ls_export *export, const char *list)
{
    const struct ls_take_document *d = export->document;
    size_t wanted = list ? 1 : 0;
    for (const char *at = list; at && (at = strchr(at, ',')); at++)
        wanted++;
    for (uint32_t c = 0; c < d->n_channels; c++) {
        bool had = d->channels[c].spectrum && (d->channels[c].each || d->channels[c].sphere ||
                                               d->channels[c].headlight || d->channels[c].segments);
        if (list ? is_named(list, d->channels[c].name) : had)
            export->spectra[export->n_spectra++] =
                (struct ls_export_spectrum){.name = d->channels[c].name,
                                            .photographed = d->channels[c].each,
                                            .duty = d->channels[c].duty};
    }
    if (export->n_spectra && (!list || export->n_spectra == wanted))
        return LS_OK;
    return ls_fail(&export->context->diag, LS_ERR_INVALID,
                   list ? "--channels %s: expected different channels of the take, e.g. W,R"
                        : "the take has no spectra%s",
                   list ? list : "");
}

static void make_recipe(struct ls_export *export)
{
    const struct lightstage_promotion *p = &export->promotion;
    size_t n = (size_t)snprintf(export->recipe, sizeof export->recipe, "%s %u %d%d%d %s%s %s",
                                lightstage_model_name(p->model), export->camera, (int)p->reference,
                                p->ideal_polarisation, p->plain_conductors,
                                export->half ? "half" : "float", export->packed ? " packed" : "",
                                export->space.name);
    for (uint32_t s = 0; s < export->n_spectra && n < sizeof export->recipe; s++)
        n += (size_t)snprintf(export->recipe + n, sizeof export->recipe - n, " %s",
                              export->spectra[s].name);
}

enum ls_err ls_export_begin(struct ls_export *export, const char *list)
{
    enum ls_err err = choose_spectra(export, list);
    if (!err)
        make_recipe(export);
    return err;
}

/* ---- a picture from the daemon ---- */

static void describe(struct ls_export *export, struct ls_export_spectrum *spectrum, uint32_t light,
                     const struct lightstage_band *band)
{
    struct ls_promotion_report report = {0};
    struct ls_exr_attrs *attrs = &spectrum->attrs;
    if (band->report)
        ls_promotion_report_keep(&report, &band->report, 1);
    ls_picture_attrs_take(export->document, band->calibrated, attrs);
    ls_promotion_report_attrs(&report, false, attrs);
    ls_picture_attrs_fetched(export->document, band, spectrum->name, attrs);
    ls_picture_attrs_light(export->document, light, attrs);
    ls_export_space_attrs(&export->space, attrs);
    ls_exr_attrs_string(attrs, "lightstage/cfa", "none");
    if (spectrum->duty > 0)
        ls_exr_attrs_float(attrs, "lightstage/duty", spectrum->duty);
    ls_exr_attrs_string(attrs, "lightstage/units", "R");
    ls_exr_attrs_string(attrs, "lightstage/valueUnits",
                        band->calibrated ? calibrated_units
                                         : "R without calibration: as "
                                           "photographed, full scale in "
                                           "referenceExposure is 1");
    ls_exr_attrs_string(attrs, "lightstage/positionUnits",
                        "m from the stage's centre: x camera-right, y up, z to the camera");
    ls_exr_attrs_string(attrs, "lightstage/export", export->recipe);
}

/* A picture that is being received. */
struct received {
    struct ls_export *export;
    struct ls_export_spectrum *spectrum;
    uint32_t light;
    bool whole;
    enum ls_err err;
};

static int take_band(const struct lightstage_band *band, void *user)
{
    struct received *r = user;
    struct ls_pixel_quality none = {0};
    if (!band->first_row)
        describe(r->export, r->spectrum, r->light, band);
    r->err =
        ls_received_band(&r->spectrum->image, &none, band, &r->whole, &r->export->context->diag);
    return r->err != LS_OK;
}

static void convert(const struct ls_export *export, struct ls_image *image)
{
    if (export->space.primaries)
        ls_colours_apply(export->space.from_camera, image->pixels,
                         (size_t)image->width * image->height, image->pixels);
}

static enum ls_err fetch(struct ls_export *export, struct ls_export_spectrum *spectrum,
                         uint32_t light)
{
    static const struct lightstage_promotion measured = {.size = sizeof measured};
    struct ls_command_context *context = export->context;
    const struct lightstage_fetch wish = {
        .size = sizeof wish,
        .take = export->document->id,
        .channel = spectrum->name,
        .lights = &light,
        .n_lights = 1,
        .promotion = spectrum->photographed ? &measured : &export->promotion,
        .layout = export->document->mono ? LIGHTSTAGE_MONO : LIGHTSTAGE_RGB,
        .sample = export->half && !export->space.primaries ? LIGHTSTAGE_HALF : LIGHTSTAGE_FLOAT,
        .camera = export->camera,
    };
    struct received r = {.export = export, .spectrum = spectrum, .light = light};
    uint32_t number = lightstage_fetch(context->stage, &wish, take_band, &r, &context->error);
    if (r.err)
        return r.err;
    if (number)
        return ls_command_said(context, number);
    if (!r.whole)
        return ls_fail(&context->diag, LS_ERR_INVALID, "the daemon sent less than a picture");
    convert(export, &spectrum->image);
    return LS_OK;
}

/* ---- the file ---- */

static struct ls_exr_part part_of(const struct ls_export *export,
                                  struct ls_export_spectrum *spectrum)
{
    static const char *const rgb[] = {"R", "G", "B"}, *const grey[] = {"Y"};
    const struct ls_image *image = &spectrum->image;
    uint32_t n = image->n_channels;
    bool layers = export->n_spectra > 1;
    for (uint32_t c = 0; c < n; c++) {
        snprintf(spectrum->channel_names[c], sizeof spectrum->channel_names[c], "%s%s%s",
                 layers ? spectrum->name : "", layers ? "." : "", n == 3 ? rgb[c] : grey[c]);
        spectrum->channels[c] =
            (struct ls_exr_channel){.name = spectrum->channel_names[c],
                                    .type = export->half ? LS_EXR_HALF : LS_EXR_FLOAT,
                                    .source = LS_EXR_FROM_FLOAT,
                                    .pixels = image->pixels + c,
                                    .pixel_stride_bytes = n * sizeof(float),
                                    .row_stride_bytes = (size_t)image->width * n * sizeof(float)};
    }
    return (struct ls_exr_part){.name = spectrum->name,
                                .width = image->width,
                                .height = image->height,
                                .channels = spectrum->channels,
                                .n_channels = n,
                                .attrs = &spectrum->attrs,
                                .packed = export->packed};
}

static enum ls_err write_light(struct ls_export *export, uint32_t light, const char *path)
{
    struct ls_diag *diag = &export->context->diag;
    struct ls_exr_part parts[LS_DOCUMENT_CHANNELS];
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum ls_err err = LS_OK;
    for (uint32_t s = 0; s < export->n_spectra && !err; s++) {
        err = fetch(export, &export->spectra[s], light);
        parts[s] = part_of(export, &export->spectra[s]);
    }
    if (!err)
        err = ls_exr_write(parts, export->n_spectra, &bytes, &size, diag);
    if (!err)
        err = ls_command_write_file(path, bytes, size, diag);
    free(bytes);
    return err;
}

static bool says(const struct ls_exr_attrs *attrs, const char *name, const char *text)
{
    const struct ls_exr_attr *attr = ls_exr_attrs_find(attrs, name);
    return attr && attr->kind == LS_EXR_ATTR_STRING && strcmp(attr->text, text) == 0;
}

/* Is every part of the file there, readable, and of this export? Then its pictures are read. */
static bool is_whole(struct ls_export *export, uint32_t light, const char *path)
{
    struct ls_diag diag = {0};
    char *bytes = NULL;
    size_t size = 0;
    bool good = !ls_command_read_file(path, file_limit, &bytes, &size, &diag);
    for (uint32_t s = 0; s < export->n_spectra && good; s++) {
        struct ls_export_spectrum *spectrum = &export->spectra[s];
        good = !ls_exr_read(bytes, size, spectrum->name, file_limit, &spectrum->image,
                            &spectrum->attrs, &diag);
        const struct ls_exr_attr *number = ls_exr_attrs_find(&spectrum->attrs, "lightstage/light");
        good = good && number && number->i == (int32_t)light &&
               says(&spectrum->attrs, "lightstage/take", export->document->id) &&
               says(&spectrum->attrs, "lightstage/export", export->recipe);
    }
    free(bytes);
    return good;
}

enum ls_err ls_export_file(struct ls_export *export, uint32_t light, const char *path,
                           bool *written)
{
    ls_export_forget(export);
    *written = !is_whole(export, light, path);
    if (!*written)
        return LS_OK;
    ls_export_forget(export);
    return write_light(export, light, path);
}

void ls_export_forget(struct ls_export *export)
{
    for (uint32_t s = 0; s < export->n_spectra; s++) {
        ls_image_finish(&export->spectra[s].image);
        ls_exr_attrs_finish(&export->spectra[s].attrs);
    }
}

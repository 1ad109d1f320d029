#include "clients/export_space.h"

#include "clients/picture_attrs.h"

#include <string.h>

static enum ls_err has_matrix(const char *name, const struct ls_take_document *document,
                              struct ls_diag *diag)
{
    if (document->mono)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "--space %s: the camera is mono: its pictures have no colours to convert",
                       name);
    if (!document->calibration || !document->calibration->has_m)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "--space %s: the take's calibration has no matrix M to Rec. 709; calibrate "
                       "with --base FILE that has one, or export --space camera",
                       name);
    return LS_OK;
}

/* The camera's own colours can be shown by the matrix, if there is one, and grey as it is. */
static void begin_camera(struct ls_export_space *space, const struct ls_take_document *document)
{
    struct ls_diag none = {0};
    space->shown = !has_matrix(space->name, document, &none);
    if (space->shown)
        memcpy(space->to_rec709, document->calibration->m, sizeof space->to_rec709);
}

/* To the same space nothing is done, rather than something to 1e-16. */
static void between(const struct ls_primaries *from, const struct ls_primaries *to, double m[3][3])
{
    static const double identity[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    if (from == to)
        memcpy(m, identity, sizeof identity);
    else
        ls_primaries_convert(from, to, m);
}

enum ls_err ls_export_space_begin(struct ls_export_space *space, const char *name,
                                  const struct ls_take_document *document, struct ls_diag *diag)
{
    static const struct {
        const char *name;
        const struct ls_primaries *primaries;
    } spaces[] = {
        {"camera", NULL}, {"rec709", &ls_primaries_rec709}, {"acescg", &ls_primaries_acescg}};
    *space = (struct ls_export_space){0};
    for (int k = 0; k < 3; k++)
        if (strcmp(name, spaces[k].name) == 0) {
            space->name = spaces[k].name;
            space->primaries = spaces[k].primaries;
        }
    if (!space->name)
        return ls_fail(diag, LS_ERR_INVALID, "--space %s: expected camera, rec709 or acescg", name);
    if (!space->primaries)
        return begin_camera(space, document), LS_OK;
    double convert[3][3];
    enum ls_err err = has_matrix(name, document, diag);
    if (err)
        return err;
    between(&ls_primaries_rec709, space->primaries, convert);
    between(space->primaries, &ls_primaries_rec709, space->to_rec709);
    ls_colours_multiply(convert, document->calibration->m, space->from_camera);
    space->shown = true;
    return LS_OK;
}

void ls_export_space_attrs(const struct ls_export_space *space, struct ls_exr_attrs *attrs)
{
    bool rec709 = space->primaries == &ls_primaries_rec709;
    ls_exr_attrs_string(attrs, "lightstage/space",
                        !space->primaries ? "camera-raw"
                        : rec709          ? "rec709-linear"
                                          : "acescg");
    if (!space->primaries)
        return;
    const double *xy = space->primaries->xy[3];
    const float white[2] = {(float)xy[0], (float)xy[1]};
    ls_picture_attrs_primaries(space->primaries, attrs);
    ls_exr_attrs_v2f(attrs, "adoptedNeutral", white);
    ls_exr_attrs_string(attrs, "lightstage/whitePoint",
                        rec709 ? "D65" : "ACES (0.32168, 0.33767), from D65 by Bradford");
}

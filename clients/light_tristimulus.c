#include "clients/light_solver.h"

#include <math.h>
#include <string.h>

/* Spectral radiance x sr of a light's cell. */
static void lobes_spectrum(const struct ls_light_solver *solver, uint32_t light,
                           struct ls_spectrum *out)
{
    const struct ls_lobes *lobes = solver->environment->lobes;
    memset(out, 0, sizeof *out);
    for (size_t l = 0; l < lobes->n; l++)
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            out->v[i] += ls_light_cell(solver, light)[l] * lobes->item[l].spectrum.v[i];
}

static bool invert(const double m[3][3], double out[3][3])
{
    double det = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            out[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }
    for (int i = 0; i < 3; i++)
        det += m[0][i] * out[i][0];
    for (int i = 0; i < 9; i++)
        out[i / 3][i % 3] /= det;
    return isfinite(1 / det) && det != 0;
}

/* Camera-raw of a map's RGB: the matrix from the map's space, or identity. */
static enum ls_err map_to_raw(const struct ls_light_solver *solver, double to_raw[3][3],
                              struct ls_light_weights *out, struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    static const double identity[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    memcpy(to_raw, identity, sizeof identity);
    if (solver->environment->map.space == LS_MAP_CAMERA_RAW)
        return LS_OK;
    if (solver->document->mono) {
        out->after_m = true;
        return LS_OK;
    }
    if (!cal || !cal->has_m) {
        out->warning = "the take has no matrix M: the map's numbers are used as camera-raw";
        return LS_OK;
    }
    if (!invert(cal->m, to_raw))
        return ls_fail(diag, LS_ERR_INVALID, "the calibration's M cannot be inverted");
    return LS_OK;
}

static enum ls_err tristimulus_of_map(struct ls_light_solver *solver, struct ls_light_weights *out,
                                      struct ls_diag *diag)
{
    double to_raw[3][3];
    enum ls_err err = map_to_raw(solver, to_raw, out, diag);
    for (uint32_t i = 0; i < out->n_lights && !err; i++)
        for (uint32_t c = 0; c < 3; c++) {
            const double *rgb = ls_light_cell(solver, i);
            out->rows[(size_t)c * out->n_lights + i] =
                (float)(to_raw[c][0] * rgb[0] + to_raw[c][1] * rgb[1] + to_raw[c][2] * rgb[2]);
        }
    return err;
}

static enum ls_err tristimulus_of_lobes(struct ls_light_solver *solver,
                                        struct ls_light_weights *out, struct ls_diag *diag)
{
    if (!solver->document->calibration)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take has no calibration: a spectral light cannot be brought to its "
                       "camera; relight with an RGB map");
    enum ls_err err = ls_light_sensitivities(solver, diag);
    if (!err)
        err = ls_light_functionals(solver, diag);
    const struct ls_spectrum *channels =
        solver->n_colours == 3 ? solver->sensitivity : solver->functionals;
    out->after_m = solver->n_colours == 1;
    for (uint32_t i = 0; i < out->n_lights && !err; i++) {
        struct ls_spectrum spectrum;
        lobes_spectrum(solver, i, &spectrum);
        for (uint32_t c = 0; c < 3; c++)
            out->rows[(size_t)c * out->n_lights + i] =
                (float)ls_spectrum_dot(&spectrum, &channels[c]);
    }
    return err;
}

enum ls_err ls_light_tristimulus(struct ls_light_solver *solver, struct ls_light_weights *out,
                                 struct ls_diag *diag)
{
    out->mode = LIGHTSTAGE_TRISTIMULUS;
    out->n_names = 0;
    enum ls_err err = ls_light_rows(out, 3, solver->document->n_lights, diag);
    if (err)
        return err;
    return solver->environment->lobes ? tristimulus_of_lobes(solver, out, diag)
                                      : tristimulus_of_map(solver, out, diag);
}

/* ---- grey: a take that knows nothing of colour ---- */

enum ls_err ls_light_grey(struct ls_light_solver *solver, struct ls_light_weights *out,
                          struct ls_diag *diag)
{
    static const double luminance[3] = {0.2126, 0.7152, 0.0722}; /* Rec. 709 */
    out->mode = LIGHTSTAGE_SHARED;
    out->n_names = 1;
    out->after_m = true;
    out->warning = "the take has no calibration: relit in grey, with the map's luminance";
    enum ls_err err = ls_light_rows(out, 1, solver->document->n_lights, diag);
    if (err)
        return err;
    if (solver->environment->lobes)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take has no calibration: a spectral light cannot be brought to its "
                       "camera; relight with an RGB map");
    for (uint32_t i = 0; i < out->n_lights; i++) {
        const double *rgb = ls_light_cell(solver, i);
        out->rows[i] =
            (float)(luminance[0] * rgb[0] + luminance[1] * rgb[1] + luminance[2] * rgb[2]);
    }
    return LS_OK;
}

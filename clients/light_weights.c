#include "clients/light_weights.h"

#include "core/envlights.h"
#include "core/lighting.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Everything the solve of one light needs, made once. */
struct solver {
    const struct ls_take_document *document;
    const struct ls_environment_file *environment;
    double *cells;   /* map: [n_lights][3]; lobes: [n_lights][lobes] */
    size_t n_cells;  /* per light */
    struct ls_spectrum functionals[3]; /* what a map's RGB means */
    struct ls_spectrum sensitivity[3];
    uint32_t n_colours;
    struct ls_spectrum *reflectance; /* [n_patches] */
    struct ls_lighting lighting;
    double *chart; /* [patch][colour][spectrum] */
    double *targets;
    uint32_t columns[LS_DOCUMENT_CHANNELS]; /* calibration channel of each name */
    double energy, missed; /* of the map: sum of norms, sum of what could not be reached */
};

static void solver_finish(struct solver *solver)
{
    free(solver->cells);
    free(solver->reflectance);
    free(solver->chart);
    free(solver->targets);
}

void ls_light_weights_finish(struct ls_light_weights *weights)
{
    free(weights->rows);
    memset(weights, 0, sizeof *weights);
}

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

/* ---- the environment, cell by cell ---- */

static enum ls_err cut_cells(struct solver *solver, double turn_deg, struct ls_diag *diag)
{
    const struct ls_take_document *d = solver->document;
    const struct ls_environment_file *e = solver->environment;
    const float(*directions)[3] = (const float(*)[3])d->direction;
    double rotation[9];
    ls_rotation_y(turn_deg * M_PI / 180, rotation);
    solver->n_cells = e->lobes ? e->lobes->n : 3;
    solver->cells = calloc((size_t)d->n_lights * (solver->n_cells + 1), sizeof(double));
    if (!solver->cells)
        return out_of_memory(diag);
    if (e->lobes)
        return ls_envlights_lobes(directions, d->n_lights, rotation, e->lobes, solver->cells, diag);
    return ls_envlights_map(directions, d->n_lights, rotation, &e->map, solver->cells, diag);
}

static const double *cell(const struct solver *solver, uint32_t light)
{
    return solver->cells + light * solver->n_cells;
}

static bool cell_is_dark(const struct solver *solver, uint32_t light)
{
    for (size_t i = 0; i < solver->n_cells; i++)
        if (cell(solver, light)[i] != 0)
            return false;
    return true;
}

/* Spectral radiance x sr of a light's cell. */
static enum ls_err cell_spectrum(struct solver *solver, uint32_t light, struct ls_spectrum *out,
                                 struct ls_diag *diag)
{
    const struct ls_lobes *lobes = solver->environment->lobes;
    const double *c = cell(solver, light);
    struct ls_smoothest report;
    memset(out, 0, sizeof *out);
    if (lobes) {
        for (size_t l = 0; l < lobes->n; l++)
            for (int i = 0; i < LS_SPECTRUM_N; i++)
                out->v[i] += c[l] * lobes->item[l].spectrum.v[i];
        return LS_OK;
    }
    enum ls_err err = ls_spectrum_smoothest(c, solver->functionals, out, &report, diag);
    double norm = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
    solver->energy += norm;
    if (!err)
        solver->missed += report.reachable ? 0 : report.residual * norm;
    return err;
}

/* ---- the calibration's spectra ---- */

static enum ls_err table_row(const struct ls_spectral_table *table, uint32_t row,
                             struct ls_spectrum *out, struct ls_diag *diag)
{
    double *nm = calloc(table->n, sizeof *nm), *value = calloc(table->n, sizeof *value);
    enum ls_err err = nm && value ? LS_OK : out_of_memory(diag);
    for (uint32_t i = 0; !err && i < table->n; i++) {
        nm[i] = table->start_nm + i * table->step_nm;
        value[i] = (double)table->v[(size_t)row * table->n + i];
    }
    if (!err)
        err = ls_spectrum_resample(nm, value, table->n, out, diag);
    free(nm);
    free(value);
    return err;
}

static enum ls_err read_sensitivities(struct solver *solver, struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    enum ls_err err = LS_OK;
    solver->n_colours = cal->n_colours;
    if (cal->camera.sensitivity.n == 0 || cal->camera.sensitivity.rows < cal->n_colours)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take's calibration has no camera sensitivities: a spectral light needs "
                       "them; relight with an RGB map and --solve tristimulus");
    for (uint32_t c = 0; c < cal->n_colours && !err; c++)
        err = table_row(&cal->camera.sensitivity, c, &solver->sensitivity[c], diag);
    return err;
}

static enum ls_err choose_functionals(struct solver *solver, struct ls_diag *diag)
{
    uint32_t green = solver->n_colours == 3 ? 1 : 0;
    if (!solver->environment->lobes && solver->environment->map.space == LS_MAP_CAMERA_RAW) {
        if (solver->n_colours != 3)
            return ls_fail(diag, LS_ERR_UNSUPPORTED,
                           "a camera-raw map needs a colour camera; this take's is monochrome");
        memcpy(solver->functionals, solver->sensitivity, sizeof solver->functionals);
        return LS_OK;
    }
    return ls_rec709_functionals_for(&solver->sensitivity[green], solver->functionals, diag);
}

/* ---- which spectra ---- */

static void name_channel(struct solver *solver, struct ls_light_weights *out, uint32_t c)
{
    const struct ls_take_document *d = solver->document;
    int column = d->calibration ? ls_calibration_channel(d->calibration, d->channels[c].name) : 0;
    if (column < 0)
        return;
    solver->columns[out->n_names] = (uint32_t)column;
    out->names[out->n_names++] = (char *)d->channels[c].name;
}

/* White first: what was photographed light by light; then what can be promoted to. */
static enum ls_err choose_channels(struct solver *solver, struct ls_light_weights *out,
                                   struct ls_diag *diag)
{
    const struct ls_take_document *d = solver->document;
    uint32_t white = d->n_channels;
    for (uint32_t c = d->n_channels; c-- > 0;)
        if (d->channels[c].each && d->channels[c].spectrum)
            white = c;
    if (white == d->n_channels)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take was not photographed light by light: it cannot be relit");
    name_channel(solver, out, white);
    for (uint32_t c = 0; c < d->n_channels; c++)
        if (c != white && d->channels[c].sphere && d->channels[c].spectrum && d->calibration)
            name_channel(solver, out, c);
    return LS_OK;
}

/* ---- the spectral solve ---- */

static enum ls_err read_chart(struct solver *solver, const struct ls_light_weights *weights,
                              struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    size_t rows = (size_t)cal->n_patches * cal->n_colours, n = weights->n_names;
    enum ls_err err = LS_OK;
    if (cal->n_patches == 0 || !cal->L || cal->reflectance.n == 0)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take's calibration has no chart: the spectral solve needs its "
                       "reflectances and L; use --solve tristimulus");
    solver->reflectance = calloc(cal->n_patches, sizeof *solver->reflectance);
    solver->chart = calloc(rows * n, sizeof(double));
    solver->targets = calloc((size_t)cal->n_patches * 3, sizeof(double));
    if (!solver->reflectance || !solver->chart || !solver->targets)
        return out_of_memory(diag);
    for (uint32_t p = 0; p < cal->n_patches && !err; p++)
        err = table_row(&cal->reflectance, p, &solver->reflectance[p], diag);
    for (size_t r = 0; r < rows; r++)
        for (size_t s = 0; s < n; s++)
            solver->chart[r * n + s] = (double)cal->L[r * cal->n_channels + solver->columns[s]];
    solver->lighting = (struct ls_lighting){.n_patches = cal->n_patches,
                                            .n_channels = cal->n_colours,
                                            .n_spectra = n,
                                            .chart = solver->chart,
                                            .m = cal->has_m && cal->n_colours == 3 ? &cal->m[0][0]
                                                                                   : NULL};
    ls_lighting_defaults(&solver->lighting);
    return err;
}

static enum ls_err solve_light(struct solver *solver, uint32_t light,
                               struct ls_light_weights *out, struct ls_diag *diag)
{
    bool mono = solver->n_colours == 1;
    struct ls_spectrum spectrum;
    struct ls_lighting_solution solution = {0};
    double alpha[3 * LS_DOCUMENT_CHANNELS];
    if (cell_is_dark(solver, light))
        return LS_OK;
    enum ls_err err = cell_spectrum(solver, light, &spectrum, diag);
    if (err)
        return err;
    ls_lighting_targets(solver->reflectance, solver->lighting.n_patches,
                        mono ? solver->functionals : solver->sensitivity, 3, &spectrum,
                        solver->targets);
    err = ls_lighting_solve(&solver->lighting, solver->targets, 3, alpha, &solution, diag);
    for (uint32_t r = 0; r < out->n_rows && !err; r++)
        out->rows[(size_t)r * out->n_lights + light] = (float)alpha[r];
    out->worst_residual = fmax(out->worst_residual, solution.worst.relative);
    return err;
}

static enum ls_err allocate_rows(struct ls_light_weights *out, uint32_t n_rows, uint32_t n_lights,
                                 struct ls_diag *diag)
{
    out->n_rows = n_rows;
    out->n_lights = n_lights;
    out->rows = calloc((size_t)n_rows * n_lights, sizeof(float));
    return out->rows ? LS_OK : out_of_memory(diag);
}

static enum ls_err make_spectral(struct solver *solver, struct ls_light_weights *out,
                                 struct ls_diag *diag)
{
    bool mono = solver->document->calibration->n_colours == 1;
    enum ls_err err = read_sensitivities(solver, diag);
    if (!err)
        err = choose_functionals(solver, diag);
    if (!err)
        err = read_chart(solver, out, diag);
    if (!err)
        err = allocate_rows(out, out->n_names * (mono ? 3 : 1), solver->document->n_lights, diag);
    out->mode = mono ? LIGHTSTAGE__WEIGHT_MODE__PER_TARGET : LIGHTSTAGE__WEIGHT_MODE__SHARED;
    out->after_m = mono;
    for (uint32_t i = 0; i < solver->document->n_lights && !err; i++)
        err = solve_light(solver, i, out, diag);
    out->unreachable = solver->energy > 0 ? solver->missed / solver->energy : 0;
    return err;
}

/* ---- tristimulus ---- */

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
static enum ls_err map_to_raw(const struct solver *solver, double to_raw[3][3],
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

static enum ls_err tristimulus_of_map(struct solver *solver, struct ls_light_weights *out,
                                      struct ls_diag *diag)
{
    double to_raw[3][3];
    enum ls_err err = map_to_raw(solver, to_raw, out, diag);
    for (uint32_t i = 0; i < out->n_lights && !err; i++)
        for (uint32_t c = 0; c < 3; c++) {
            const double *rgb = cell(solver, i);
            out->rows[(size_t)c * out->n_lights + i] = (float)(
                to_raw[c][0] * rgb[0] + to_raw[c][1] * rgb[1] + to_raw[c][2] * rgb[2]);
        }
    return err;
}

static enum ls_err tristimulus_of_lobes(struct solver *solver, struct ls_light_weights *out,
                                        struct ls_diag *diag)
{
    if (!solver->document->calibration)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take has no calibration: a spectral light cannot be brought to its "
                       "camera; relight with an RGB map");
    enum ls_err err = read_sensitivities(solver, diag);
    if (!err)
        err = choose_functionals(solver, diag);
    const struct ls_spectrum *channels =
        solver->n_colours == 3 ? solver->sensitivity : solver->functionals;
    out->after_m = solver->n_colours == 1;
    for (uint32_t i = 0; i < out->n_lights && !err; i++) {
        struct ls_spectrum spectrum;
        err = cell_spectrum(solver, i, &spectrum, diag);
        for (uint32_t c = 0; c < 3; c++)
            out->rows[(size_t)c * out->n_lights + i] =
                (float)ls_spectrum_dot(&spectrum, &channels[c]);
    }
    return err;
}

static enum ls_err make_tristimulus(struct solver *solver, struct ls_light_weights *out,
                                    struct ls_diag *diag)
{
    out->mode = LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS;
    out->n_names = 0;
    enum ls_err err = allocate_rows(out, 3, solver->document->n_lights, diag);
    if (err)
        return err;
    return solver->environment->lobes ? tristimulus_of_lobes(solver, out, diag)
                                      : tristimulus_of_map(solver, out, diag);
}

/* ---- grey: a take that knows nothing of colour ---- */

static enum ls_err make_grey(struct solver *solver, struct ls_light_weights *out,
                             struct ls_diag *diag)
{
    static const double luminance[3] = {0.2126, 0.7152, 0.0722}; /* Rec. 709 */
    out->mode = LIGHTSTAGE__WEIGHT_MODE__SHARED;
    out->n_names = 1;
    out->after_m = true;
    out->warning = "the take has no calibration: relit in grey, with the map's luminance";
    enum ls_err err = allocate_rows(out, 1, solver->document->n_lights, diag);
    if (err)
        return err;
    if (solver->environment->lobes)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take has no calibration: a spectral light cannot be brought to its "
                       "camera; relight with an RGB map");
    for (uint32_t i = 0; i < out->n_lights; i++) {
        const double *rgb = cell(solver, i);
        out->rows[i] =
            (float)(luminance[0] * rgb[0] + luminance[1] * rgb[1] + luminance[2] * rgb[2]);
    }
    return LS_OK;
}

enum ls_err ls_light_weights_make(const struct ls_take_document *document,
                                  const struct ls_environment_file *environment, bool tristimulus,
                                  double turn_deg, struct ls_light_weights *out,
                                  struct ls_diag *diag)
{
    struct solver solver = {.document = document, .environment = environment};
    memset(out, 0, sizeof *out);
    enum ls_err err = choose_channels(&solver, out, diag);
    if (!err)
        err = cut_cells(&solver, turn_deg, diag);
    if (!err && !document->calibration && document->mono)
        err = make_grey(&solver, out, diag);
    else if (!err && (tristimulus || !document->calibration))
        err = make_tristimulus(&solver, out, diag);
    else if (!err)
        err = make_spectral(&solver, out, diag);
    solver_finish(&solver);
    if (err)
        ls_light_weights_finish(out);
    return err;
}

#include "clients/light_weights.h"

#include "core/cell_lighting.h"
#include "core/envlights.h"
#include "core/smooth_cells.h"
#include "proto/models.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool ls_light_solve_option(const char *word, enum ls_light_solve *out)
{
    static const char *const words[] = {"spectral", "tristimulus", "shared", "per-target"};
    for (int i = 0; i < 4; i++)
        if (strcmp(word, words[i]) == 0) {
            *out = (enum ls_light_solve)i;
            return true;
        }
    return false;
}

bool ls_light_method_option(const char *word, enum ls_light_method *out)
{
    bool nnls = strcmp(word, "nnls") == 0;
    *out = nnls ? LS_LIGHT_METHOD_NNLS : LS_LIGHT_METHOD_LEAST_SQUARES;
    return nnls || strcmp(word, "least-squares") == 0;
}

bool ls_light_cells_option(const char *word, bool *smooth)
{
    *smooth = strcmp(word, "smooth") == 0;
    return *smooth || strcmp(word, "nearest") == 0;
}

/* Everything the solve needs, made once. */
struct solver {
    const struct ls_take_document *document;
    const struct ls_environment_file *environment;
    const struct ls_light_options *options;
    double *cells;                     /* map: [n_lights][3]; lobes: [n_lights][lobes] */
    size_t n_cells;                    /* per light */
    struct ls_spectrum functionals[3]; /* what a map's RGB means */
    struct ls_spectrum sensitivity[3];
    uint32_t n_colours;
    struct ls_spectrum *reflectance; /* [n_patches] */
    double *chart;                   /* [patch][colour][spectrum] */
    struct ls_lighting_solver *lighting;
    uint32_t columns[LS_DOCUMENT_CHANNELS]; /* calibration channel of each name */
};

static void solver_finish(struct solver *solver)
{
    free(solver->cells);
    free(solver->reflectance);
    free(solver->chart);
    ls_lighting_solver_destroy(solver->lighting);
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

static enum ls_err cut_cells(struct solver *solver, struct ls_diag *diag)
{
    const struct ls_take_document *d = solver->document;
    const struct ls_environment_file *e = solver->environment;
    const float(*directions)[3] = (const float(*)[3])d->direction;
    double rotation[9];
    ls_rotation_y(solver->options->turn_deg * M_PI / 180, rotation);
    solver->n_cells = e->lobes ? e->lobes->n : 3;
    solver->cells = calloc((size_t)d->n_lights * (solver->n_cells + 1), sizeof(double));
    if (!solver->cells)
        return out_of_memory(diag);
    if (e->lobes)
        return (solver->options->smooth ? ls_smooth_cells_lobes : ls_envlights_lobes)(
            directions, d->n_lights, rotation, e->lobes, solver->cells, diag);
    return (solver->options->smooth ? ls_smooth_cells_map : ls_envlights_map)(
        directions, d->n_lights, rotation, &e->map, solver->cells, diag);
}

static const double *cell(const struct solver *solver, uint32_t light)
{
    return solver->cells + light * solver->n_cells;
}

/* Spectral radiance x sr of a light's cell. */
static void lobes_spectrum(const struct solver *solver, uint32_t light, struct ls_spectrum *out)
{
    const struct ls_lobes *lobes = solver->environment->lobes;
    memset(out, 0, sizeof *out);
    for (size_t l = 0; l < lobes->n; l++)
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            out->v[i] += cell(solver, light)[l] * lobes->item[l].spectrum.v[i];
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

/* Did the plan ask for what the model makes a spectrum's single lights of? */
static bool is_served(const struct ls_take_document *d, uint32_t c, Lightstage__Model model)
{
    switch (model) {
    case LIGHTSTAGE__MODEL__MEASURED:
        return d->channels[c].each;
    case LIGHTSTAGE__MODEL__HEADLIGHT:
        return d->channels[c].headlight || d->channels[c].each;
    case LIGHTSTAGE__MODEL__LINEAR:
        return d->channels[c].segments || d->channels[c].each;
    default:
        return d->channels[c].sphere;
    }
}

static bool is_photographed(const struct ls_take_document *d, uint32_t c)
{
    return d->channels[c].each || d->channels[c].sphere || d->channels[c].headlight ||
           d->channels[c].segments;
}

/* "R A B": photographed, but not as the model needs it. */
static void list_left_out(const struct ls_take_document *d, uint32_t white, Lightstage__Model model,
                          char *out, size_t size)
{
    size_t at = 0;
    out[0] = '\0';
    for (uint32_t c = 0; c < d->n_channels && at < size; c++)
        if (c != white && d->channels[c].spectrum && is_photographed(d, c) &&
            !is_served(d, c, model))
            at += (size_t)snprintf(out + at, size - at, "%s%s", at ? " " : "", d->channels[c].name);
}

static enum ls_err tell_left_out(const struct solver *solver, uint32_t white,
                                 struct ls_light_weights *out, struct ls_diag *diag)
{
    const char *model = ls_model_name(solver->options->model);
    char names[128];
    list_left_out(solver->document, white, solver->options->model, names, sizeof names);
    if (!names[0])
        return LS_OK;
    if (out->n_names == 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take has nothing for model %s but white (of %s it has other pictures): "
                       "choose another --model, or --solve tristimulus",
                       model, names);
    snprintf(out->left_out, sizeof out->left_out,
             "not used, because model %s has no pictures of them it can use: %s", model, names);
    return LS_OK;
}

/* The first spectrum of single lights; where they were photographed behind both polarisers only,
 * whose sum is white, the first spectrum. */
static uint32_t find_white(const struct ls_take_document *d)
{
    uint32_t white = d->n_channels, first = d->n_channels, polarised = 0;
    for (uint32_t c = d->n_channels; c-- > 0;) {
        polarised += d->channels[c].each && !d->channels[c].spectrum;
        if (d->channels[c].spectrum)
            first = c;
        if (d->channels[c].each && d->channels[c].spectrum)
            white = c;
    }
    return white == d->n_channels && polarised >= 2 ? first : white;
}

/* White first: what was photographed light by light; then what the model serves. The baseline is
 * white alone. */
static enum ls_err choose_channels(struct solver *solver, struct ls_light_weights *out,
                                   struct ls_diag *diag)
{
    const struct ls_take_document *d = solver->document;
    uint32_t white = find_white(d);
    if (white == d->n_channels)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take was not photographed light by light: it cannot be relit");
    name_channel(solver, out, white);
    if (!d->calibration || solver->options->solve == LS_LIGHT_TRISTIMULUS)
        return LS_OK;
    for (uint32_t c = 0; c < d->n_channels; c++)
        if (c != white && d->channels[c].spectrum && is_served(d, c, solver->options->model))
            name_channel(solver, out, c);
    return tell_left_out(solver, white, out, diag);
}

/* ---- the spectral solve ---- */

static void choose_solve(const struct solver *solver, struct ls_lighting *lighting)
{
    const struct ls_light_options *options = solver->options;
    ls_lighting_defaults(lighting);
    if (options->solve == LS_LIGHT_SHARED)
        lighting->mode = LS_SOLVE_SHARED;
    if (options->solve == LS_LIGHT_PER_TARGET)
        lighting->mode = LS_SOLVE_PER_TARGET;
    if (options->method == LS_LIGHT_METHOD_NNLS) {
        lighting->method = LS_SOLVE_NNLS;
        lighting->tikhonov = 0;
    }
    if (options->method == LS_LIGHT_METHOD_LEAST_SQUARES)
        lighting->method = LS_SOLVE_LEAST_SQUARES;
    if (lighting->method == LS_SOLVE_LEAST_SQUARES)
        lighting->tikhonov = 1e-3;
}

static enum ls_err read_chart(struct solver *solver, struct ls_light_weights *weights,
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
    if (!solver->reflectance || !solver->chart)
        return out_of_memory(diag);
    for (uint32_t p = 0; p < cal->n_patches && !err; p++)
        err = table_row(&cal->reflectance, p, &solver->reflectance[p], diag);
    for (size_t r = 0; r < rows; r++)
        for (size_t s = 0; s < n; s++)
            solver->chart[r * n + s] = (double)cal->L[r * cal->n_channels + solver->columns[s]];
    return err;
}

static enum ls_err factor_chart(struct solver *solver, struct ls_light_weights *weights,
                                struct ls_diag *diag)
{
    const struct ls_calibration *cal = solver->document->calibration;
    struct ls_lighting lighting = {.n_patches = cal->n_patches,
                                   .n_channels = cal->n_colours,
                                   .n_spectra = weights->n_names,
                                   .chart = solver->chart,
                                   .m = cal->has_m ? &cal->m[0][0] : NULL};
    choose_solve(solver, &lighting);
    if (lighting.mode == LS_SOLVE_SHARED && solver->n_colours == 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "--solve shared: one set of strengths makes no colours of a monochrome "
                       "camera; use --solve per-target");
    /* the daemon weights each camera channel before anything mixes them */
    weights->by_target =
        lighting.mode == LS_SOLVE_PER_TARGET && ls_lighting_space(&lighting) == LS_SOLVE_AFTER_M;
    weights->mode = lighting.mode == LS_SOLVE_SHARED || weights->by_target
                        ? LIGHTSTAGE__WEIGHT_MODE__SHARED
                        : LIGHTSTAGE__WEIGHT_MODE__PER_TARGET;
    return ls_lighting_solver_create(&lighting, 3, &solver->lighting, diag);
}

static enum ls_err allocate_rows(struct ls_light_weights *out, uint32_t n_rows, uint32_t n_lights,
                                 struct ls_diag *diag)
{
    out->n_rows = n_rows;
    out->n_lights = n_lights;
    out->rows = calloc((size_t)n_rows * n_lights, sizeof(float));
    return out->rows ? LS_OK : out_of_memory(diag);
}

/* The direction of a light in the environment, turned by @rotation: its inverse on the light's. */
static void seen_from(const struct solver *solver, uint32_t light, const double rotation[9],
                      double out[3])
{
    const float *d = solver->document->direction[light];
    for (int k = 0; k < 3; k++)
        out[k] = rotation[k] * (double)d[0] + rotation[3 + k] * (double)d[1] +
                 rotation[6 + k] * (double)d[2];
}

/* What a mono camera's pictures are to show: the ball camera's colours, after M if there is one. */
static void after_m(const struct ls_calibration *cal, double *targets, size_t n_patches)
{
    for (size_t p = 0; p < n_patches && cal->has_m; p++) {
        double raw[3];
        memcpy(raw, targets + 3 * p, sizeof raw);
        for (int r = 0; r < 3; r++)
            targets[3 * p + (size_t)r] =
                cal->m[r][0] * raw[0] + cal->m[r][1] * raw[1] + cal->m[r][2] * raw[2];
    }
}

/* A captured environment: its charts did read the light. */
static enum ls_err solve_probe(const struct solver *solver, double *alpha,
                               struct ls_cell_lighting *found, struct ls_diag *diag)
{
    const struct ls_captured *probe = solver->environment->probe;
    const struct ls_calibration *cal = solver->document->calibration;
    size_t n_lights = solver->document->n_lights, values = 3 * probe->n_patches;
    double rotation[9];
    if (probe->n_patches != cal->n_patches)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the environment's charts have %zu patches, the calibration's %u: calibrate "
                       "with the chart that was photographed, or use --solve tristimulus",
                       probe->n_patches, cal->n_patches);
    LS_CLEANUP_FREE double *targets = calloc(n_lights * values, sizeof *targets);
    if (!targets)
        return out_of_memory(diag);
    ls_rotation_y(solver->options->turn_deg * M_PI / 180, rotation);
    for (uint32_t i = 0; i < n_lights; i++) {
        double d[3];
        seen_from(solver, i, rotation, d);
        ls_captured_targets(probe, d, cell(solver, i), targets + i * values);
        if (cal->n_colours == 1)
            after_m(cal, targets + i * values, probe->n_patches);
    }
    return ls_cell_lighting_targets(solver->lighting, targets, values, n_lights, alpha, found,
                                    diag);
}

static enum ls_err solve_cells(const struct solver *solver, double *alpha,
                               struct ls_cell_lighting *found, struct ls_diag *diag)
{
    const struct ls_environment_file *environment = solver->environment;
    size_t n_lights = solver->document->n_lights;
    const struct ls_spectral_chart chart = {.solver = solver->lighting,
                                            .reflectance = solver->reflectance,
                                            .n_patches = solver->document->calibration->n_patches,
                                            .reader = solver->n_colours == 1 ? solver->functionals
                                                                             : solver->sensitivity,
                                            .n_readers = 3};
    if (environment->probe)
        return solve_probe(solver, alpha, found, diag);
    if (environment->lobes)
        return ls_cell_lighting_lobes(&chart, environment->lobes, solver->cells, n_lights, alpha,
                                      found, diag);
    return ls_cell_lighting_map(&chart, solver->functionals, solver->cells, n_lights, alpha, found,
                                diag);
}

static enum ls_err solve_all(struct solver *solver, struct ls_light_weights *out,
                             struct ls_diag *diag)
{
    struct ls_cell_lighting found = {0};
    size_t outputs = ls_lighting_solver_outputs(solver->lighting);
    size_t n_lights = solver->document->n_lights;
    LS_CLEANUP_FREE double *alpha = calloc(n_lights * outputs, sizeof *alpha);
    if (!alpha)
        return out_of_memory(diag);
    enum ls_err err = allocate_rows(out, (uint32_t)outputs, (uint32_t)n_lights, diag);
    if (!err)
        err = solve_cells(solver, alpha, &found, diag);
    if (err)
        return err;
    for (size_t i = 0; i < n_lights; i++)
        for (size_t r = 0; r < outputs; r++)
            out->rows[r * n_lights + i] = (float)alpha[i * outputs + r];
    out->solved = true;
    out->solution = found.worst;
    out->residual = found.residual;
    out->unreachable = found.energy > 0 ? found.missed / found.energy : 0;
    return LS_OK;
}

static enum ls_err make_spectral(struct solver *solver, struct ls_light_weights *out,
                                 struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    solver->n_colours = solver->document->calibration->n_colours;
    if (!solver->environment->probe)
        err = read_sensitivities(solver, diag);
    if (!err && !solver->environment->probe)
        err = choose_functionals(solver, diag);
    if (!err)
        err = read_chart(solver, out, diag);
    if (!err)
        err = factor_chart(solver, out, diag);
    if (!err)
        err = solve_all(solver, out, diag);
    out->after_m = solver->n_colours == 1 || out->by_target;
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
            out->rows[(size_t)c * out->n_lights + i] =
                (float)(to_raw[c][0] * rgb[0] + to_raw[c][1] * rgb[1] + to_raw[c][2] * rgb[2]);
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
        lobes_spectrum(solver, i, &spectrum);
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
                                  const struct ls_environment_file *environment,
                                  const struct ls_light_options *options,
                                  struct ls_light_weights *out, struct ls_diag *diag)
{
    struct solver solver = {.document = document, .environment = environment, .options = options};
    bool tristimulus = options->solve == LS_LIGHT_TRISTIMULUS;
    memset(out, 0, sizeof *out);
    out->warning = environment->warning;
    enum ls_err err = choose_channels(&solver, out, diag);
    if (!err)
        err = cut_cells(&solver, diag);
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

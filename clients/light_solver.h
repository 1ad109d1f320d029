/*
 * light_solver: the parts of ls_light_weights_make. Private to clients/light_*.c.
 * Layer: clients. Threads: the main thread. Ownership: a solver owns its arrays.
 *
 * Errors of all: those of ls_light_weights_make.
 */
#ifndef LS_CLIENTS_LIGHT_SOLVER_H
#define LS_CLIENTS_LIGHT_SOLVER_H

#include "clients/light_weights.h"

/** Everything the solve needs, made once. */
struct ls_light_solver {
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

/** What the environment puts into a light's cell: [n_cells]. */
const double *ls_light_cell(const struct ls_light_solver *solver, uint32_t light);

/** A row of a calibration's table as a spectrum. */
LS_MUST_CHECK enum ls_err ls_light_table_row(const struct ls_spectral_table *table, uint32_t row,
                                             struct ls_spectrum *out, struct ls_diag *diag);

/** n_colours and sensitivity of the take's camera; then, with them, functionals. */
LS_MUST_CHECK enum ls_err ls_light_sensitivities(struct ls_light_solver *solver,
                                                 struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_light_functionals(struct ls_light_solver *solver,
                                               struct ls_diag *diag);

/** Room for the weights. */
LS_MUST_CHECK enum ls_err ls_light_rows(struct ls_light_weights *out, uint32_t n_rows,
                                        uint32_t n_lights, struct ls_diag *diag);

/** Names and columns: white first, what was photographed light by light; then what the model
 * serves. The baseline is white alone. */
LS_MUST_CHECK enum ls_err ls_light_channels(struct ls_light_solver *solver,
                                            struct ls_light_weights *out, struct ls_diag *diag);

/** The weights, from the cells. Grey: of a take that knows nothing of colour. */
LS_MUST_CHECK enum ls_err ls_light_spectral(struct ls_light_solver *solver,
                                            struct ls_light_weights *out, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_light_tristimulus(struct ls_light_solver *solver,
                                               struct ls_light_weights *out, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_light_grey(struct ls_light_solver *solver,
                                        struct ls_light_weights *out, struct ls_diag *diag);

#endif

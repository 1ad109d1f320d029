#include "sim/response.h"

#include "sim/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_FILE_BYTES = 1 << 20 };

static enum ls_err load(const char *directory, const char *name, struct ls_spectra **out,
                        struct ls_diag *diag)
{
    char path[1200];
    snprintf(path, sizeof path, "%s/%s", directory, name);
    LS_CLEANUP_FREE char *text = NULL;
    size_t size = 0;
    enum ls_err err = sim_file_read(path, MAX_FILE_BYTES, &text, &size, diag);
    if (err)
        return err;
    struct ls_diag inner = {{0}};
    err = ls_spectra_parse_csv(text, size, out, &inner);
    return err ? ls_fail(diag, err, "%s: %.400s", path, inner.text) : LS_OK;
}

/* The first @n columns of a file, which must have at least that many. */
static enum ls_err load_columns(const char *directory, const char *name, size_t n,
                                struct ls_spectrum *out, struct ls_diag *diag)
{
    struct ls_spectra *spectra = NULL;
    enum ls_err err = load(directory, name, &spectra, diag);
    if (err)
        return err;
    if (spectra->n < n)
        err = ls_fail(diag, LS_ERR_INVALID, "%s/%s: expected %zu columns, found %zu", directory,
                      name, n, spectra->n);
    for (size_t i = 0; i < n && !err; i++)
        out[i] = spectra->item[i].spectrum;
    ls_spectra_destroy(spectra);
    return err;
}

enum ls_err sim_library_load(const char *directory, struct sim_library *out, struct ls_diag *diag)
{
    memset(out, 0, sizeof *out);
    enum ls_err err = load_columns(directory, "chart.csv", SIM_CHART_PATCHES,
                                   &out->material[SIM_MAT_CHART], diag);
    if (!err)
        err = load_columns(directory, "fabrics.csv", SIM_FABRICS, &out->material[SIM_MAT_FABRIC],
                           diag);
    if (!err)
        err = load_columns(directory, "materials.csv", SIM_MATERIALS - SIM_MAT_GREY33,
                           &out->material[SIM_MAT_GREY33], diag);
    if (!err)
        err = load_columns(directory, "polariser.csv", 1, &out->polariser, diag);
    if (!err)
        err = load_columns(directory, "camera.csv", 4, out->camera, diag);
    if (!err)
        err = load(directory, "leds.csv", &out->leds, diag);
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        out->polariser.v[i] *= 2;
    return err;
}

void sim_library_finish(struct sim_library *library)
{
    ls_spectra_destroy(library->leds);
    library->leds = NULL;
}

static void multiply(struct ls_spectrum *a, const struct ls_spectrum *b)
{
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        a->v[i] *= b->v[i];
}

static void fill_row(float *row, const struct sim_library *library, const struct ls_spectrum *light)
{
    for (int m = 0; m < SIM_MATERIALS; m++)
        row[m] = (float)ls_spectrum_dot(light, &library->material[m]);
}

static void fill_chains(float *row, const struct sim_library *library,
                        const struct sim_subject *subject, const struct ls_spectrum *light)
{
    uint32_t n = subject->n_emitters;
    for (uint32_t a = 0; a < n; a++) {
        struct ls_spectrum once = *light;
        multiply(&once, &library->material[subject->emitter_material[a]]);
        fill_row(row + (size_t)a * SIM_MATERIALS, library, &once);
        for (uint32_t b = 0; b < n; b++) {
            struct ls_spectrum twice = once;
            multiply(&twice, &library->material[subject->emitter_material[b]]);
            fill_row(row + (size_t)(n + a * n + b) * SIM_MATERIALS, library, &twice);
        }
    }
}

enum ls_err sim_response_build(const struct sim_library *library, const struct sim_subject *subject,
                               const struct sim_source *sources, uint32_t n_sources,
                               const struct ls_spectrum *camera, uint32_t n_colours,
                               struct sim_response *out, struct ls_diag *diag)
{
    *out = (struct sim_response){.n_sources = n_sources, .n_colours = n_colours};
    size_t rows = (size_t)n_sources * n_colours;
    out->material = calloc(rows * SIM_MATERIALS, sizeof *out->material);
    out->chain = calloc(rows * SIM_CHAINS * SIM_MATERIALS, sizeof *out->chain);
    if (!out->material || !out->chain) {
        sim_response_finish(out);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for material tables");
    }
    for (uint32_t s = 0; s < n_sources; s++) {
        out->kind[s] = sources[s].kind;
        out->diffuse[s] = sources[s].kind == SIM_CHANNEL_SPECTRUM ? 1 : 0.5f;
        for (uint32_t c = 0; c < n_colours; c++) {
            struct ls_spectrum light = sources[s].spectrum;
            multiply(&light, &camera[c]);
            size_t row = s * n_colours + c;
            fill_row(out->material + row * SIM_MATERIALS, library, &light);
            fill_chains(out->chain + row * SIM_CHAINS * SIM_MATERIALS, library, subject, &light);
        }
    }
    return LS_OK;
}

void sim_response_finish(struct sim_response *response)
{
    free(response->material);
    free(response->chain);
    *response = (struct sim_response){0};
}

#include "tests/sim/measured_spectra.h"

#include "core/profile.h"
#include "tests/core/shared_data.h"

#include <glib/gstdio.h>

static const char *const files[] = {"chart.csv",     "fabrics.csv", "materials.csv",
                                    "polariser.csv", "camera.csv",  "leds.csv"};

struct ls_spectra *measured_table(const char *relative)
{
    g_autofree char *path = shared_data(relative), *text = NULL;
    struct ls_spectra *spectra = NULL;
    struct ls_diag diag = {{0}};
    gsize bytes;
    if (!path)
        return NULL;
    g_assert_true(g_file_get_contents(path, &text, &bytes, NULL));
    int err = ls_spectra_parse_csv(text, bytes, &spectra, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return spectra;
}

static void write_table(const char *folder, const char *file, const struct ls_spectrum *column,
                        const char *const *names, int n)
{
    g_autofree char *path = g_build_filename(folder, file, NULL);
    g_autoptr(GString) text = g_string_new("wavelength_nm");
    for (int c = 0; c < n; c++)
        g_string_append_printf(text, ",%s", names[c]);
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        g_string_append_printf(text, "\n%d", LS_SPECTRUM_FIRST_NM + i * LS_SPECTRUM_STEP_NM);
        for (int c = 0; c < n; c++) {
            char number[G_ASCII_DTOSTR_BUF_SIZE];
            g_string_append_printf(text, ",%s",
                                   g_ascii_dtostr(number, sizeof number, column[c].v[i]));
        }
    }
    g_string_append_c(text, '\n');
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
}

static void copy_own(const char *folder, const char *file)
{
    g_autofree char *from =
        g_build_filename(g_getenv("LS_SOURCE_ROOT"), "sim", "spectra", file, NULL);
    g_autofree char *to = g_build_filename(folder, file, NULL), *text = NULL;
    gsize bytes;
    g_assert_true(g_file_get_contents(from, &text, &bytes, NULL));
    g_assert_true(g_file_set_contents(to, text, (gssize)bytes, NULL));
}

static void write_camera(const char *folder, const struct ls_spectra *camera)
{
    static const char *const names[] = {"red", "green", "blue", "mono"};
    const double *mix = ls_profile_find("paper")->mono_mix;
    struct ls_spectrum column[4] = {{{0}}};
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        for (int c = 0; c < 3; c++) {
            column[c].v[i] = camera->item[c].spectrum.v[i];
            column[3].v[i] += mix[c] * column[c].v[i];
        }
    write_table(folder, "camera.csv", column, names, 4);
}

static void write_leds(const char *folder, const struct ls_spectra *rebel,
                       const struct ls_spectra *white)
{
    static const char *const names[] = {"white", "red", "amber", "green", "cyan", "blue"};
    const struct ls_spectrum column[6] = {
        *ls_spectra_find(white, "PHOS-1"),   *ls_spectra_find(rebel, "peak_632"),
        *ls_spectra_find(rebel, "peak_592"), *ls_spectra_find(rebel, "peak_528"),
        *ls_spectra_find(rebel, "peak_504"), *ls_spectra_find(rebel, "peak_450")};
    write_table(folder, "leds.csv", column, names, 6);
}

static void write_samples(const char *folder, const struct ls_spectra *chart,
                          const struct ls_spectra *objects)
{
    struct ls_spectrum column[24];
    const char *names[24];
    for (int p = 0; p < 24; p++) {
        column[p] = chart->item[p].spectrum;
        names[p] = "patch";
    }
    write_table(folder, "chart.csv", column, names, 24);
    for (int p = 0; p < 12; p++) /* spread over the 170 objects */
        column[p] = objects->item[3 + 14 * p].spectrum;
    write_table(folder, "fabrics.csv", column, names, 12);
}

char *measured_spectra_folder(void)
{
    struct ls_spectra *table[5] = {measured_table("cameras/dslr_5nm.csv"),
                                   measured_table("leds/luxeon_rebel.csv"),
                                   measured_table("leds/nist_white_leds.csv"),
                                   measured_table("reflectances/colorchecker_n_ohta.csv"),
                                   measured_table("reflectances/vrhel_objects.csv")};
    char *folder = NULL;
    if (table[0] && table[1] && table[2] && table[3] && table[4]) {
        folder = g_dir_make_tmp("spectra-XXXXXX", NULL);
        g_assert_nonnull(folder);
        copy_own(folder, "materials.csv");
        copy_own(folder, "polariser.csv");
        write_camera(folder, table[0]);
        write_leds(folder, table[1], table[2]);
        write_samples(folder, table[3], table[4]);
    }
    for (int t = 0; t < 5; t++)
        ls_spectra_destroy(table[t]);
    return folder;
}

void measured_spectra_remove(char *folder)
{
    for (size_t f = 0; folder && f < G_N_ELEMENTS(files); f++) {
        g_autofree char *path = g_build_filename(folder, files[f], NULL);
        g_unlink(path);
    }
    if (folder)
        g_rmdir(folder);
    g_free(folder);
}

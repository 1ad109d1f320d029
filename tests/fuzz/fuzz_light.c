/* light: first byte 'l': lobes, 'c': a captured probe, else spectra. What is read is finite, and
 * its directions are of length 1. */
#include "core/captured.h"
#include "core/environment.h"
#include "core/spectrum.h"
#include "tests/fuzz/fuzz.h"

#include <math.h>
#include <string.h>

static int is_unit(const double d[3])
{
    return fabs(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1) < 1e-9;
}

static int is_finite(const struct ls_spectrum *spectrum)
{
    for (size_t k = 0; k < LS_SPECTRUM_N; k++)
        if (!isfinite(spectrum->v[k]))
            return 0;
    return 1;
}

static enum ls_err read_lobes(const char *text, size_t n, struct ls_diag *diag)
{
    struct ls_lobes *lobes = NULL;
    enum ls_err err = ls_lobes_parse_json(text, n, &lobes, diag);
    for (size_t i = 0; !err && i < lobes->n; i++) {
        const struct ls_lobe *lobe = &lobes->item[i];
        HOLDS(is_unit(lobe->direction) && lobe->sharpness >= 0 && lobe->radiance >= 0);
        HOLDS(isfinite(ls_lobe_radiance(lobe, lobe->direction)) && is_finite(&lobe->spectrum));
    }
    ls_lobes_destroy(lobes);
    return err;
}

static enum ls_err read_captured(const char *text, size_t n, struct ls_diag *diag)
{
    struct ls_captured *probe = NULL;
    enum ls_err err = ls_captured_parse_json(text, n, &probe, diag);
    if (!err) {
        HOLDS(ls_captured_is(text, n) && is_unit(probe->camera_direction));
        HOLDS(probe->radius_px > 0 && isfinite(probe->radius_px));
        HOLDS(memchr(probe->picture, 0, sizeof probe->picture));
    }
    for (size_t i = 0; !err && i < probe->n_charts; i++) {
        HOLDS(is_unit(probe->chart[i].normal));
        for (size_t p = 0; p < probe->n_patches; p++)
            HOLDS(isfinite(probe->chart[i].rgb[p][0]));
    }
    ls_captured_destroy(probe);
    return err;
}

static enum ls_err read_spectra(const char *text, size_t n, struct ls_diag *diag)
{
    struct ls_spectra *spectra = NULL;
    enum ls_err err = ls_spectra_parse_csv(text, n, &spectra, diag);
    for (size_t i = 0; !err && i < spectra->n; i++) {
        HOLDS(is_finite(&spectra->item[i].spectrum));
        HOLDS(ls_spectra_find(spectra, spectra->item[i].name));
    }
    ls_spectra_destroy(spectra);
    return err;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    struct ls_diag diag = {0};
    if (n < 2)
        return 0;
    char *text = malloc(n - 1); /* no NUL after it */
    HOLDS(text);
    memcpy(text, data + 1, n - 1);
    enum ls_err err = data[0] == 'l'   ? read_lobes(text, n - 1, &diag)
                      : data[0] == 'c' ? read_captured(text, n - 1, &diag)
                                       : read_spectra(text, n - 1, &diag);
    free(text);
    HOLDS_REFUSED(err, diag);
    return 0;
}

#include "clients/fetch_factored.h"

#include "core/factored.h"
#include "core/half.h"

#include <stdlib.h>
#include <string.h>

static const size_t most_bytes = (size_t)4 << 30; /* of one picture as floats */

void ls_fetch_factored_finish(struct ls_fetch_factored *f)
{
    for (uint32_t s = 0; s < LS_SPECTRA_SAID; s++)
        free(f->ratios[s]);
    free(f->white);
    free(f->names);
    memset(f, 0, sizeof *f);
}

enum ls_err ls_fetch_factored_init(struct ls_fetch_factored *f, const char *list,
                                   struct ls_diag *diag)
{
    memset(f, 0, sizeof *f);
    f->names = strdup(list);
    if (!f->names)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (char *rest = f->names, *name; (name = strsep(&rest, ","));) {
        if (!*name || f->n == LS_SPECTRA_SAID)
            return ls_fail(diag, LS_ERR_INVALID, "--channel %s: expected 1 to %d names, e.g. R,A,B",
                           list, LS_SPECTRA_SAID);
        f->spectra[f->n++] = name;
    }
    return LS_OK;
}

static size_t values_of(const struct ls_fetch_factored *f)
{
    return (size_t)f->width * f->height * 3;
}

static enum ls_err allocate(struct ls_fetch_factored *f, const struct lightstage_band *band,
                            struct ls_diag *diag)
{
    bool good = true;
    f->width = band->width;
    f->height = band->height;
    if (values_of(f) > most_bytes / sizeof(float))
        return ls_fail(diag, LS_ERR_LIMIT, "%u x %u pixels are more than fit", f->width, f->height);
    for (uint32_t s = 0; s < f->n; s++)
        good &= (f->ratios[s] = calloc(values_of(f), sizeof(uint16_t))) != NULL;
    f->white = calloc(values_of(f), sizeof(uint16_t));
    return good && f->white ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
}

enum ls_err ls_fetch_factored_take(struct ls_fetch_factored *f, const struct lightstage_band *band,
                                   bool *whole, struct ls_diag *diag)
{
    bool ratio = band->factor == LIGHTSTAGE_RATIO;
    enum ls_err err = f->white ? LS_OK : allocate(f, band, diag);
    if (err)
        return err;
    if (band->width != f->width || band->height != f->height || band->components != 3 ||
        band->sample != LIGHTSTAGE_HALF || !(ratio || band->factor == LIGHTSTAGE_WHITE) ||
        (ratio && band->light >= f->n))
        return ls_fail(diag, LS_ERR_INVALID, "the daemon sent rows that do not fit the picture");
    uint16_t *to = ratio ? f->ratios[band->light] : f->white;
    memcpy(to + (size_t)band->first_row * f->width * 3, band->values, band->values_bytes);
    if (ratio && band->report)
        ls_promotion_report_keep(&f->reports[band->light], &band->report, 1);
    *whole = !ratio && band->first_row + band->n_rows == band->height;
    return LS_OK;
}

enum ls_err ls_fetch_factored_expand(const struct ls_fetch_factored *f, uint32_t spectrum,
                                     float gain, struct ls_image *image, struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint16_t *halfs = malloc(values_of(f) * sizeof *halfs + 1);
    enum ls_err err = halfs ? ls_image_init(image, f->width, f->height, 3, most_bytes, diag)
                            : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
    if (err)
        return err;
    ls_factored_expand(f->white, gain, f->ratios[spectrum], values_of(f), halfs);
    ls_half_to_floats(halfs, image->pixels, values_of(f));
    return LS_OK;
}

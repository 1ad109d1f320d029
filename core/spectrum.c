#include "core/spectrum.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static double weight_nm(int i)
{
    return i == 0 || i == LS_SPECTRUM_N - 1 ? 0.5 * LS_SPECTRUM_STEP_NM : LS_SPECTRUM_STEP_NM;
}

double ls_spectrum_integral(const struct ls_spectrum *a)
{
    double sum = 0;
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        sum += weight_nm(i) * a->v[i];
    return sum;
}

double ls_spectrum_dot(const struct ls_spectrum *a, const struct ls_spectrum *b)
{
    double sum = 0;
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        sum += weight_nm(i) * a->v[i] * b->v[i];
    return sum;
}

double ls_spectrum_dot3(const struct ls_spectrum *a, const struct ls_spectrum *b,
                        const struct ls_spectrum *c)
{
    double sum = 0;
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        sum += weight_nm(i) * a->v[i] * b->v[i] * c->v[i];
    return sum;
}

static enum ls_err check_samples(const double *nm, const double *value, size_t n,
                                 struct ls_diag *diag)
{
    if (n < 1)
        return ls_fail(diag, LS_ERR_INVALID, "spectrum: no samples: expected at least one");
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(nm[i]) || !isfinite(value[i]))
            return ls_fail(diag, LS_ERR_INVALID, "spectrum: sample %zu is not a finite number", i);
        if (i > 0 && nm[i] <= nm[i - 1])
            return ls_fail(diag, LS_ERR_INVALID,
                           "spectrum: wavelengths must ascend: %g nm follows %g nm", nm[i],
                           nm[i - 1]);
    }
    return LS_OK;
}

enum ls_err ls_spectrum_resample(const double *wavelength_nm, const double *value, size_t n,
                                 struct ls_spectrum *out, struct ls_diag *diag)
{
    enum ls_err err = check_samples(wavelength_nm, value, n, diag);
    if (err)
        return err;
    size_t k = 0;
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        double nm = LS_SPECTRUM_FIRST_NM + i * LS_SPECTRUM_STEP_NM;
        while (k + 1 < n && wavelength_nm[k + 1] <= nm)
            k++;
        out->v[i] = 0;
        if (nm < wavelength_nm[0] || nm > wavelength_nm[n - 1])
            continue;
        if (nm == wavelength_nm[k]) {
            out->v[i] = value[k];
            continue;
        }
        double t = (nm - wavelength_nm[k]) / (wavelength_nm[k + 1] - wavelength_nm[k]);
        out->v[i] = value[k] * (1 - t) + value[k + 1] * t;
    }
    return LS_OK;
}

/* --- CSV --- */

struct csv {
    const char *at, *end;
    unsigned line;
    locale_t c_locale;
};

struct field {
    const char *text;
    size_t bytes;
    bool last; /* of its line */
};

static bool next_line(struct csv *csv)
{
    while (csv->at < csv->end) {
        csv->line++;
        const char *eol = memchr(csv->at, '\n', (size_t)(csv->end - csv->at));
        size_t bytes = (size_t)((eol ? eol : csv->end) - csv->at);
        bool blank = strspn(csv->at, " \t\r") >= bytes;
        if (bytes > 0 && csv->at[0] != '#' && !blank)
            return true;
        csv->at = eol ? eol + 1 : csv->end;
    }
    return false;
}

static struct field next_field(struct csv *csv)
{
    struct field field = {.text = csv->at};
    while (csv->at < csv->end && *csv->at != ',' && *csv->at != '\n')
        csv->at++;
    field.bytes = (size_t)(csv->at - field.text);
    field.last = csv->at == csv->end || *csv->at == '\n';
    if (csv->at < csv->end)
        csv->at++;
    while (field.bytes > 0 && strchr(" \t\r", field.text[0]))
        field.text++, field.bytes--;
    while (field.bytes > 0 && strchr(" \t\r", field.text[field.bytes - 1]))
        field.bytes--;
    return field;
}

static bool field_number(const struct csv *csv, const struct field *field, double *out)
{
    char text[64], *end;
    if (field->bytes == 0 || field->bytes >= sizeof text || memchr(field->text, 0, field->bytes))
        return false;
    memcpy(text, field->text, field->bytes);
    text[field->bytes] = 0;
    *out = strtod_l(text, &end, csv->c_locale);
    return *end == 0 && isfinite(*out);
}

/** Columns being read: row-major values, NAN where a field is empty. */
struct columns {
    size_t n, rows;
    double *nm, *value;
    char (*name)[LS_SPECTRUM_NAME_BYTES];
};

static enum ls_err read_header(struct csv *csv, struct columns *columns, struct ls_diag *diag)
{
    if (!next_line(csv))
        return ls_fail(diag, LS_ERR_INVALID,
                       "spectra: empty text: expected a header line "
                       "wavelength_nm,name,...");
    struct field field = next_field(csv);
    if (field.bytes != 13 || memcmp(field.text, "wavelength_nm", 13) != 0)
        return ls_fail(diag, LS_ERR_INVALID,
                       "spectra: line %u: expected the header wavelength_nm,name,..., found "
                       "\"%.*s\"",
                       csv->line, (int)(field.bytes < 40 ? field.bytes : 40), field.text);
    while (!field.last) {
        field = next_field(csv);
        if (columns->n == LS_SPECTRA_MAX)
            return ls_fail(diag, LS_ERR_LIMIT, "spectra: more than %d columns", LS_SPECTRA_MAX);
        if (field.bytes == 0 || field.bytes >= LS_SPECTRUM_NAME_BYTES)
            return ls_fail(diag, LS_ERR_INVALID,
                           "spectra: line %u: name of column %zu has %zu bytes: expected 1..%d",
                           csv->line, columns->n + 1, field.bytes, LS_SPECTRUM_NAME_BYTES - 1);
        memcpy(columns->name[columns->n], field.text, field.bytes);
        columns->name[columns->n++][field.bytes] = 0;
    }
    if (columns->n == 0)
        return ls_fail(diag, LS_ERR_INVALID, "spectra: line %u: no column of values", csv->line);
    return LS_OK;
}

static enum ls_err read_row(struct csv *csv, struct columns *columns, struct ls_diag *diag)
{
    if (columns->rows == LS_SPECTRA_MAX_SAMPLES)
        return ls_fail(diag, LS_ERR_LIMIT, "spectra: more than %d lines", LS_SPECTRA_MAX_SAMPLES);
    struct field field = next_field(csv);
    if (!field_number(csv, &field, &columns->nm[columns->rows]))
        return ls_fail(diag, LS_ERR_INVALID, "spectra: line %u: expected a wavelength in nm",
                       csv->line);
    for (size_t c = 0; c < columns->n; c++) {
        double *value = &columns->value[columns->rows * columns->n + c];
        if (field.last)
            return ls_fail(diag, LS_ERR_INVALID,
                           "spectra: line %u: %zu values: expected %zu, as in the header",
                           csv->line, c, columns->n);
        field = next_field(csv);
        *value = NAN;
        if (field.bytes > 0 && !field_number(csv, &field, value))
            return ls_fail(diag, LS_ERR_INVALID,
                           "spectra: line %u: column \"%s\": expected a number or nothing",
                           csv->line, columns->name[c]);
    }
    if (!field.last)
        return ls_fail(diag, LS_ERR_INVALID, "spectra: line %u: more than %zu values", csv->line,
                       columns->n);
    columns->rows++;
    return LS_OK;
}

static enum ls_err resample_column(const struct columns *columns, size_t c, double *scratch,
                                   struct ls_spectrum *out, struct ls_diag *diag)
{
    double *nm = scratch, *value = scratch + columns->rows;
    size_t n = 0;
    for (size_t r = 0; r < columns->rows; r++) {
        if (isnan(columns->value[r * columns->n + c]))
            continue;
        nm[n] = columns->nm[r];
        value[n++] = columns->value[r * columns->n + c];
    }
    return ls_spectrum_resample(nm, value, n, out, diag);
}

static enum ls_err columns_to_spectra(const struct columns *columns, struct ls_spectra *spectra,
                                      struct ls_diag *diag)
{
    LS_CLEANUP_FREE double *scratch = calloc(2 * columns->rows + 1, sizeof *scratch);
    spectra->item = calloc(columns->n, sizeof *spectra->item);
    if (!scratch || !spectra->item)
        return ls_fail(diag, LS_ERR_NOMEM, "spectra: out of memory");
    for (spectra->n = 0; spectra->n < columns->n; spectra->n++) {
        struct ls_named_spectrum *item = &spectra->item[spectra->n];
        struct ls_diag inner = {{0}};
        memcpy(item->name, columns->name[spectra->n], sizeof item->name);
        enum ls_err err = resample_column(columns, spectra->n, scratch, &item->spectrum, &inner);
        if (err)
            return ls_fail(diag, err, "column \"%s\": %.400s", item->name, inner.text);
    }
    return LS_OK;
}

static size_t count_lines(const char *text, size_t bytes)
{
    size_t n = 1;
    for (size_t i = 0; i < bytes; i++)
        n += text[i] == '\n';
    return n < LS_SPECTRA_MAX_SAMPLES ? n : LS_SPECTRA_MAX_SAMPLES;
}

static enum ls_err parse_columns(struct csv *csv, struct columns *columns,
                                 struct ls_spectra *spectra, struct ls_diag *diag)
{
    size_t lines = count_lines(csv->at, (size_t)(csv->end - csv->at));
    columns->name = calloc(LS_SPECTRA_MAX, sizeof *columns->name);
    columns->nm = calloc(lines, sizeof *columns->nm);
    if (!columns->name || !columns->nm)
        return ls_fail(diag, LS_ERR_NOMEM, "spectra: out of memory");
    enum ls_err err = read_header(csv, columns, diag);
    if (err)
        return err;
    columns->value = calloc(lines * columns->n, sizeof *columns->value);
    if (!columns->value)
        return ls_fail(diag, LS_ERR_NOMEM, "spectra: out of memory");
    while (!err && next_line(csv))
        err = read_row(csv, columns, diag);
    return err ? err : columns_to_spectra(columns, spectra, diag);
}

enum ls_err ls_spectra_parse_csv(const char *text, size_t bytes, struct ls_spectra **out,
                                 struct ls_diag *diag)
{
    *out = NULL;
    struct ls_spectra *spectra = calloc(1, sizeof *spectra);
    /* a NUL-terminated copy, so that no scan runs past the caller's bytes */
    LS_CLEANUP_FREE char *copy = malloc(bytes + 1);
    struct csv csv = {
        .at = copy, .end = copy + bytes, .c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0)};
    struct columns columns = {0};
    enum ls_err err = LS_ERR_NOMEM;
    if (spectra && copy && csv.c_locale) {
        memcpy(copy, text, bytes);
        copy[bytes] = 0;
        err = parse_columns(&csv, &columns, spectra, diag);
    }
    if (csv.c_locale)
        freelocale(csv.c_locale);
    free(columns.name);
    free(columns.nm);
    free(columns.value);
    if (err)
        ls_spectra_destroy(spectra);
    else
        *out = spectra;
    return err;
}

const struct ls_spectrum *ls_spectra_find(const struct ls_spectra *spectra, const char *name)
{
    for (size_t i = 0; i < spectra->n; i++)
        if (strcmp(spectra->item[i].name, name) == 0)
            return &spectra->item[i].spectrum;
    return NULL;
}

void ls_spectra_destroy(struct ls_spectra *spectra)
{
    if (!spectra)
        return;
    free(spectra->item);
    free(spectra);
}

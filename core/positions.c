#include "core/positions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct axes {
    int target[3]; /* stage axis of each column */
    float sign[3];
};

static enum ls_err parse_axes(const char *text, struct axes *out, struct ls_diag *diag)
{
    static const struct {
        const char *word;
        int axis;
        float sign;
    } words[] = {{"right", 0, 1}, {"left", 0, -1},   {"up", 1, 1},
                 {"down", 1, -1}, {"towards", 2, 1}, {"away", 2, -1}};
    char copy[64];
    unsigned seen = 0, n = 0;
    snprintf(copy, sizeof copy, "%s", text);
    char *save = NULL;
    for (char *w = strtok_r(copy, ", ", &save); w && n < 3; w = strtok_r(NULL, ", ", &save), n++) {
        for (size_t k = 0; k < sizeof words / sizeof *words; k++) {
            if (strcmp(w, words[k].word))
                continue;
            out->target[n] = words[k].axis;
            out->sign[n] = words[k].sign;
            seen |= 1u << words[k].axis;
        }
    }
    if (seen != 7 || n != 3)
        return ls_fail(diag, LS_ERR_INVALID,
                       "axes \"%s\": expected three of right|left, up|down, towards|away, "
                       "e.g. \"left,up,away\"",
                       text);
    return LS_OK;
}

static float unit_in_m(const char *unit)
{
    return !strcmp(unit, "m")    ? 1.0f
           : !strcmp(unit, "cm") ? 0.01f
           : !strcmp(unit, "mm") ? 0.001f
                                 : 0;
}

/* "x,y,z[,address]": LS_ERR_NOT_FOUND for a line without data. */
static enum ls_err parse_row(char *line, const struct axes *axes, float scale, float xyz_m[3],
                             uint32_t *address)
{
    line[strcspn(line, "#\r\n")] = 0;
    if (line[strspn(line, " \t")] == 0)
        return LS_ERR_NOT_FOUND;
    char *p = line;
    for (int k = 0; k < 3; k++) {
        char *end;
        float v = strtof(p, &end) * scale;
        if (end == p || !isfinite(v))
            return LS_ERR_INVALID;
        xyz_m[axes->target[k]] = axes->sign[k] * v;
        end += strspn(end, " \t");
        if (*end == ',')
            end++;
        else if (k < 2)
            return LS_ERR_INVALID;
        p = end;
    }
    p += strspn(p, " \t");
    if (*p) {
        char *end;
        unsigned long v = strtoul(p, &end, 10);
        if (end == p || end[strspn(end, " \t")] || v > UINT16_MAX)
            return LS_ERR_INVALID;
        *address = (uint32_t)v;
    }
    return hypotf(hypotf(xyz_m[0], xyz_m[1]), xyz_m[2]) > 0 ? LS_OK : LS_ERR_INVALID;
}

static enum ls_err append(struct ls_positions *p, const float xyz_m[3], uint32_t address)
{
    if ((p->n & (p->n - 1)) == 0) { /* grow at powers of two */
        size_t room = p->n ? 2 * (size_t)p->n : 1;
        void *xyz = realloc(p->xyz_m, room * sizeof *p->xyz_m);
        if (xyz)
            p->xyz_m = xyz;
        void *addresses = realloc(p->address, room * sizeof *p->address);
        if (addresses)
            p->address = addresses;
        if (!xyz || !addresses)
            return LS_ERR_NOMEM;
    }
    memcpy(p->xyz_m[p->n], xyz_m, sizeof *p->xyz_m);
    p->address[p->n++] = address;
    return LS_OK;
}

static enum ls_err parse_rows(const char *text, size_t length, const char *name,
                              const struct axes *axes, float scale, uint32_t max,
                              struct ls_positions *out, struct ls_diag *diag)
{
    const char *end = text + length;
    for (unsigned number = 1; text < end; number++) {
        const char *stop = memchr(text, '\n', (size_t)(end - text));
        stop = stop ? stop : end;
        char line[512];
        snprintf(line, sizeof line, "%.*s", (int)(stop - text > 511 ? 511 : stop - text), text);
        text = stop + 1;
        float xyz_m[3];
        uint32_t address = out->n;
        enum ls_err err = parse_row(line, axes, scale, xyz_m, &address);
        if (err == LS_ERR_NOT_FOUND)
            continue;
        if (err)
            return ls_fail(diag, err,
                           "%s:%u: expected x,y,z[,address], finite and not the stage centre", name,
                           number);
        if (out->n == max)
            return ls_fail(diag, LS_ERR_LIMIT, "%s:%u: more than %u lights", name, number, max);
        if (append(out, xyz_m, address))
            return ls_fail(diag, LS_ERR_NOMEM, "out of memory reading %s", name);
    }
    if (!out->n)
        return ls_fail(diag, LS_ERR_INVALID, "%s: no lights in it", name);
    return LS_OK;
}

enum ls_err ls_positions_parse(const char *text, size_t length, const char *name,
                               const char *axes_text, const char *unit, uint32_t max,
                               struct ls_positions *out, struct ls_diag *diag)
{
    struct axes axes;
    enum ls_err err = parse_axes(axes_text, &axes, diag);
    if (err)
        return err;
    float scale = unit_in_m(unit);
    if (scale == 0)
        return ls_fail(diag, LS_ERR_INVALID, "unit \"%s\": expected \"m\", \"cm\" or \"mm\"", unit);
    *out = (struct ls_positions){0};
    err = parse_rows(text, length, name, &axes, scale, max, out, diag);
    if (err)
        ls_positions_finish(out);
    return err;
}

void ls_positions_finish(struct ls_positions *positions)
{
    free(positions->xyz_m);
    free(positions->address);
    *positions = (struct ls_positions){0};
}

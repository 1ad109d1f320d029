#include "clients/region_option.h"

#include "clients/command.h"
#include "core/level.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>

/* A decimal number followed by anything; false if there is none or it is too large. */
static bool next_number(const char **text, uint32_t *out)
{
    char *end = NULL;
    if (!isdigit((unsigned char)**text))
        return false;
    errno = 0;
    unsigned long value = strtoul(*text, &end, 10);
    if (errno || value > UINT32_MAX)
        return false;
    *text = end;
    *out = (uint32_t)value;
    return true;
}

static bool read_region(const char *text, struct lightstage_region *out)
{
    uint32_t *const values[] = {&out->x, &out->y, &out->width, &out->height};
    for (int i = 0; i < 4; i++) {
        if (!next_number(&text, values[i]))
            return false;
        if (i < 3 && *text++ != ',')
            return false;
    }
    return *text == '\0' && out->width > 0 && out->height > 0;
}

int ls_region_option(const char *text, struct lightstage_region *out)
{
    return read_region(text, out)
               ? LS_EXIT_OK
               : ls_command_wrong("--region %s: expected X,Y,WIDTH,HEIGHT", text);
}

/* A number and nothing else. */
static bool read_number(const char *text, uint32_t *out)
{
    return next_number(&text, out) && *text == '\0';
}

int ls_level_option(const char *text, uint32_t *out)
{
    return read_number(text, out) && *out <= LS_LEVEL_MAX
               ? LS_EXIT_OK
               : ls_command_wrong("--level %s: expected 0 (full size), 1 or 2", text);
}

struct ls_picture_place ls_level_place(const struct lightstage_region *region, uint32_t level,
                                       uint32_t width, uint32_t height)
{
    return (struct ls_picture_place){(int32_t)(region->x >> level), (int32_t)(region->y >> level),
                                     ls_level_size(width, level), ls_level_size(height, level)};
}

int ls_camera_option(const char *text, uint32_t *out)
{
    return read_number(text, out)
               ? LS_EXIT_OK
               : ls_command_wrong("--camera %s: expected the number of a camera, from 0", text);
}

static bool add_range(uint32_t first, uint32_t last, uint32_t limit, bool *named, uint32_t *out,
                      size_t *n)
{
    if (first > last || last >= limit)
        return false;
    for (uint32_t i = first; i <= last; i++) {
        if (!named[i])
            out[(*n)++] = i;
        named[i] = true;
    }
    return true;
}

bool ls_lights_option(const char *text, uint32_t limit, uint32_t **out, size_t *n)
{
    uint32_t *lights = calloc(limit, sizeof *lights);
    bool *named = calloc(limit, sizeof *named);
    bool ok = lights && named;
    *n = 0;
    for (bool more = true; ok && more;) {
        uint32_t first, last;
        ok = next_number(&text, &first);
        last = first;
        if (ok && *text == '-')
            ok = next_number((text++, &text), &last);
        ok = ok && add_range(first, last, limit, named, lights, n);
        more = *text == ',';
        text += more;
    }
    free(named);
    if (!ok || *text != '\0') {
        free(lights);
        return false;
    }
    *out = lights;
    return true;
}

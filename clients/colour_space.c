#include "clients/colour_space.h"

#include <string.h>

static const struct {
    const char *name;
    const struct ls_primaries *primaries;
} spaces[] = {
    [LS_SPACE_CAMERA] = {"camera", NULL},
    [LS_SPACE_REC709] = {"rec709", &ls_primaries_rec709},
    [LS_SPACE_ACESCG] = {"acescg", &ls_primaries_acescg},
};

const char *ls_colour_space_name(enum ls_colour_space space)
{
    return spaces[space].name;
}

bool ls_colour_space_option(const char *text, enum ls_colour_space *out)
{
    for (size_t i = 0; i < sizeof spaces / sizeof *spaces; i++)
        if (strcmp(text, spaces[i].name) == 0) {
            *out = (enum ls_colour_space)i;
            return true;
        }
    return false;
}

const struct ls_primaries *ls_colour_space_primaries(enum ls_colour_space space)
{
    return spaces[space].primaries;
}

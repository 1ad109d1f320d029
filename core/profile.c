#include "core/profile.h"

#include <stddef.h>
#include <string.h>

static const struct ls_profile paper = {
    .name = "paper",
    .m = {{1.768, -0.187, -0.329}, {-0.461, 1.780, -0.525}, {-0.139, -0.845, 2.882}},
    .ball_reflectivity = {0.607, 0.616, 0.634},
    .mono_mix = {0.986, 0.368, 0.578},
};

const struct ls_profile *ls_profile_find(const char *name)
{
    return strcmp(name, paper.name) == 0 ? &paper : NULL;
}

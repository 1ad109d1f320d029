#include "core/merge_group.h"

#include <string.h>

void ls_merge_group_load(const struct ls_merge_work *work, struct ls_merge_group *group,
                         size_t first, size_t n, size_t at)
{
    const struct ls_merge_spans *s = work->spans;

    for (uint32_t i = 0; i < work->model->n; i++) {
        uint32_t k = work->model->order[i];
        ls_pixel_unpack(work->params->format, s->raw[k], first, n, &group->x[i][at]);
        if (s->dark[k])
            memcpy(&group->dark[i][at], s->dark[k] + first, n * sizeof(float));
    }
}

void ls_merge_group_run(const struct ls_merge_work *work, struct ls_merge_group *group)
{
    struct ls_merge_model model = *work->model;
    struct ls_merge_lines lines = {.e = group->e,
                                   .variance = group->variance,
                                   .half = group->half,
                                   .validity = group->validity};

    model.wide = true;
    for (uint32_t i = 0; i < model.n; i++) {
        lines.x[i] = group->x[i];
        lines.dark[i] = group->dark[i];
    }
    work->kernels->run(&model, &lines, LS_MERGE_GROUP);
}

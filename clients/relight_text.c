#include "clients/relight_text.h"

#include "clients/command.h"
#include "clients/numbered_name.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

char *ls_relight_name(const char *name, uint32_t picture)
{
    return name ? ls_name_numbered(name, picture + 1) : NULL;
}

/* What the solve of the strengths was, and how well it went; NULL where there was none. */
static json_t *solve_json(const struct ls_light_weights *weights)
{
    const struct ls_lighting_solution *solution = &weights->solution;
    if (!weights->solved)
        return NULL;
    json_t *json = json_pack(
        "{ss ss sf sf sf si}", "mode", solution->mode == LS_SOLVE_SHARED ? "shared" : "per-target",
        "space", solution->space == LS_SOLVE_AFTER_M ? "after-M" : "camera-raw", "tikhonov",
        weights->tikhonov, "residual", weights->residual, "worst_residual",
        solution->worst.relative, "rank", (int)solution->worst.rank);
    if (isfinite(solution->worst.condition))
        json_object_set_new(json, "condition", json_real(solution->worst.condition));
    return json;
}

/* Of one picture, into @json. */
static void add_picture(const struct ls_relight_told *told, uint32_t picture, json_t *json)
{
    const struct ls_light_weights *weights = &told->weights[picture];
    char *exr = ls_relight_name(told->options->exr, picture),
         *png = ls_relight_name(told->options->png, picture);
    json_t *own = json_pack("{sf sf so* ss* ss*}", "solve_residual",
                            weights->solution.worst.relative, "unreachable", weights->unreachable,
                            "solve", solve_json(weights), "output", exr, "png", png);
    json_object_update(json, own);
    json_decref(own);
    free(exr);
    free(png);
}

static json_t *pictures_json(const struct ls_relight_told *told)
{
    json_t *list = json_array();
    for (uint32_t k = 0; k < told->n; k++) {
        json_t *json = json_pack("{ss sf}", "environment", ls_relight_light(told->options, k),
                                 "rotation", ls_relight_turn(told->options, k));
        add_picture(told, k, json);
        json_array_append_new(list, json);
    }
    return list;
}

static void print_warnings(const struct ls_relight_told *told)
{
    for (uint32_t k = 0; k < told->n; k += told->options->n_turns) {
        const struct ls_light_weights *weights = &told->weights[k];
        if (weights->warning)
            fprintf(stderr, "lightstagectl: warning: %s\n", weights->warning);
        if (weights->left_out[0] && k == 0)
            fprintf(stderr, "lightstagectl: warning: %s\n", weights->left_out);
        if (weights->unreachable > 0.001)
            fprintf(stderr,
                    "lightstagectl: warning: %.1f %% of the map's light has colours no light can "
                    "have; the nearest were taken\n",
                    weights->unreachable * 100);
    }
}

void ls_relight_print(const struct ls_relight_told *told, bool json)
{
    const struct ls_relit *result = told->result;
    print_warnings(told);
    if (!json) {
        if (told->n > 1)
            printf("%u pictures in %u %s over the take: ", told->n, result->passes,
                   result->passes == 1 ? "pass" : "passes");
        printf("%u lights used, %u skipped, error bound %.3g, %.2f s\n", result->lights_used,
               result->lights_skipped, result->bound, result->seconds);
        ls_promotion_report_print(&result->report);
        return;
    }
    json_t *object = json_pack(
        "{si si sI sf sf si sb so}", "lights_used", (int)result->lights_used, "lights_skipped",
        (int)result->lights_skipped, "tiles_skipped", (json_int_t)result->tiles_skipped,
        "error_bound", result->bound, "seconds", result->seconds, "passes", (int)result->passes,
        "calibrated", result->calibrated, "spectra", ls_promotion_report_json(&result->report));
    if (told->n == 1)
        add_picture(told, 0, object);
    else
        json_object_set_new(object, "pictures", pictures_json(told));
    ls_command_print_json(object);
}

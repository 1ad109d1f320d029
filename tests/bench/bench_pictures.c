/* How many pictures a take needs for how small an error of its field: promotion models on the still
 * life, RGB at every pixel, 346 lights, R A G C B. */
#include "tests/bench/bench.h"
#include "tests/core/still_life_study.h"

#include <math.h>
#include <stdio.h>

static const struct still_life_inputs white = {1, {0}}, every = {6, {0, 1, 2, 3, 4, 5}};

static const struct point {
    const char *name;
    enum still_life_model model;
    const struct still_life_inputs *inputs;
    uint32_t segments;
} points[] = {
    {"headlight", STILL_LIFE_HEAD, &white, 1},    {"sphere", STILL_LIFE_LINEAR, &white, 1},
    {"linear_6", STILL_LIFE_LINEAR, &white, 6},   {"linear_14", STILL_LIFE_LINEAR, &white, 14},
    {"linear_26", STILL_LIFE_LINEAR, &white, 26}, {"measured", STILL_LIFE_LINEAR, &every, 1}};

enum { POINTS = sizeof points / sizeof *points, SPHERE = 1, LINEAR_14 = 3 };

static void print(const struct bench *bench, const char *prefix, const struct point *at,
                  double error)
{
    char name[64];
    double pictures = still_life_pictures(at->inputs, at->segments);
    double all = still_life_pictures(&every, 1);
    snprintf(name, sizeof name, "%s_%s", prefix, at->name);
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "pictures",
                                         .value = pictures,
                                         .median = pictures,
                                         .error = error,
                                         .reference = "every light under every spectrum",
                                         .reference_value = all,
                                         .ratio = all / pictures,
                                         .wanted = NAN});
}

/* What the fit is required to leave of Eq. 1's errors. */
static void print_left(const struct bench *bench, const char *name, double error, double eq1,
                       double wanted)
{
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "%",
                                         .value = error,
                                         .median = error,
                                         .error = error / 100,
                                         .reference = "Eq. 1, promotion alone",
                                         .reference_value = eq1,
                                         .ratio = error / eq1,
                                         .wanted = wanted,
                                         .at_most = true});
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct still_life world;
    struct still_life_study study;
    struct still_life_row row[POINTS];
    bench_init(&bench, argc, argv);
    still_life_load(&world, (uint32_t)bench_size(&bench, 64, 16), "RG", 0);
    still_life_study_init(&study, &world, true, false, true);
    for (int k = 0; k < POINTS; k++) {
        const struct point *at = &points[k];
        fprintf(stderr, "  %s\n", at->name);
        row[k] = still_life_judge(&study, at->model, at->inputs, at->segments);
        print(&bench, "served", at, still_life_percent(&row[k].served.field) / 100);
        if (at->inputs != &every)
            print(&bench, "promotion", at, still_life_percent(&row[k].promotion.field) / 100);
    }
    const struct still_life_errors *a = &row[SPHERE].promotion, *b = &row[LINEAR_14].promotion;
    print_left(&bench, "linear_14_field", still_life_percent(&b->field),
               still_life_percent(&a->field), 0.4);
    print_left(&bench, "linear_14_interreflection", still_life_percent(&b->inter),
               still_life_percent(&a->inter), 0.5);
    print_left(&bench, "linear_14_highlight", still_life_percent(&b->highlight),
               still_life_percent(&a->highlight), 0.2);
    still_life_study_finish(&study);
    still_life_free(&world);
    return 0;
}

#include "clients/calibrate_report.h"

#include <stdio.h>

static const struct {
    uint8_t flag;
    const char *name;
} flag_names[] = {
    {LS_LIGHT_ONE_SIDED, "one-sided"}, {LS_LIGHT_DEAD, "dead"}, {LS_LIGHT_UNCERTAIN, "uncertain"}};

enum { N_FLAGS = sizeof flag_names / sizeof *flag_names };

static uint32_t count_flag(const struct ls_calibration *c, uint8_t flag)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->n_lights; i++)
        n += !!(c->flags[i] & flag);
    return n;
}

static const char *verdict(const struct ls_calibrate_remarks *remarks)
{
    return remarks->n ? "usable, with remarks" : "good";
}

void ls_calibrate_print(const struct ls_calibration *c, const struct ls_calibrate_remarks *remarks)
{
    for (uint32_t i = 0; i < c->n_residuals; i++)
        printf("  %-48s %10.4g %s\n", c->residuals[i].name, c->residuals[i].value,
               c->residuals[i].unit);
    for (uint32_t i = 0; i < c->n_patterns; i++) {
        const struct ls_calibration_pattern *p = &c->patterns[i];
        printf("  factor of %-11s in %-8s at duty %.5f     %10.4f +- %.4f\n", p->pattern,
               c->channels[p->channel].name, p->duty, p->factor, p->sigma);
    }
    if (c->has_mirror)
        printf("  %-48s %10.4f %.4f %.4f\n", "mirror reflectivity", c->mirror_reflectivity[0],
               c->mirror_reflectivity[1], c->mirror_reflectivity[2]);
    for (int i = 0; i < N_FLAGS; i++)
        printf("  lights flagged %-33s %10u\n", flag_names[i].name,
               count_flag(c, flag_names[i].flag));
    for (uint32_t i = 0; i < remarks->n; i++)
        printf("remark: %s\n", remarks->text[i]);
    printf("verdict: %s\n", verdict(remarks));
}

json_t *ls_calibrate_json(const struct ls_calibration *c,
                          const struct ls_calibrate_remarks *remarks, const char *file)
{
    json_t *residuals = json_object(), *flags = json_object(), *sentences = json_array();
    json_t *factors = json_array();
    for (uint32_t i = 0; i < c->n_residuals; i++)
        json_object_set_new(residuals, c->residuals[i].name, json_real(c->residuals[i].value));
    for (int i = 0; i < N_FLAGS; i++)
        json_object_set_new(flags, flag_names[i].name,
                            json_integer(count_flag(c, flag_names[i].flag)));
    for (uint32_t i = 0; i < remarks->n; i++)
        json_array_append_new(sentences, json_string(remarks->text[i]));
    for (uint32_t i = 0; i < c->n_patterns; i++)
        json_array_append_new(
            factors,
            json_pack("{ss ss sf sf sf}", "channel", c->channels[c->patterns[i].channel].name,
                      "pattern", c->patterns[i].pattern, "duty", c->patterns[i].duty, "factor",
                      c->patterns[i].factor, "sigma", c->patterns[i].sigma));
    return json_pack("{ss ss so so so so}", "file", file, "verdict", verdict(remarks), "residuals",
                     residuals, "factors", factors, "flags", flags, "remarks", sentences);
}

#include "core/linear.h"

#include <math.h>

static double sum_of(const float *v, uint32_t n)
{
    double sum = 0;
    for (uint32_t k = 0; k < n; k++)
        sum += (double)v[k];
    return sum;
}

void ls_linear_error_add(struct ls_linear_error *sum, const struct ls_linear_error *part)
{
    sum->difference += part->difference;
    sum->noise += part->noise;
    sum->single += part->single;
    sum->total += part->total;
    sum->pixels += part->pixels;
}

double ls_linear_estimate(const struct ls_linear_error *e)
{
    return e->total > 0 ? sqrt((fmax(e->difference - e->noise, 0) + e->single) / e->total) : 0;
}

void ls_linear_check_light(const struct ls_linear_light *light, struct ls_linear_error *all,
                           struct ls_linear_error *highlights)
{
    for (size_t i = 0; i < light->n; i++) {
        const float *v = light->v + i * light->n_in, *f = light->f + i * light->n_out;
        const float *m = light->m + i * light->n_out * light->n_in;
        double difference = 0, total = 0;
        for (uint32_t c = 0; c < light->n_out; c++) {
            double predicted = 0;
            for (uint32_t a = 0; a < light->n_in; a++)
                predicted += (double)m[c * light->n_in + a] * (double)v[a];
            difference += (predicted - (double)f[c]) * (predicted - (double)f[c]);
            total += (double)f[c] * (double)f[c];
        }
        if (!isfinite(difference) || !isfinite(total))
            continue;
        double share = light->strength * sum_of(v, light->n_in) * light->n_lights;
        bool highlight = share > 16 * sum_of(light->v_total + i * light->n_in, light->n_in);
        struct ls_linear_error *to[2] = {all, highlight ? highlights : NULL};
        for (int k = 0; k < 2 && to[k]; k++) {
            to[k]->difference += difference;
            to[k]->total += total;
            to[k]->pixels++;
        }
    }
}

#include "daemon/plan_patterns.h"

#include "core/bases.h"
#include "core/segments.h"
#include "core/smooth_order.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { USUAL_HEADLIGHTS = 3 };

static const char *channel_name(const struct ls_plan_entry *e)
{
    return e->builder->config->channels[e->channel].name;
}

static float (*directions_of(const struct ls_plan_entry *e))[3]
{
    float(*out)[3] = calloc(e->n_lights, sizeof *out);
    for (uint32_t i = 0; out && i < e->n_lights; i++)
        memcpy(out[i], e->builder->config->lights[e->lights[i]].position_m, sizeof out[i]);
    return out;
}

static void add_segment(struct ls_conf *c, const struct ls_plan_entry *e, const uint32_t *segment,
                        uint32_t part, uint32_t parts, double *weights)
{
    for (uint32_t i = 0; i < e->n_lights; i++)
        weights[i] = segment[i] == part;
    struct ls_plan_condition *cond = ls_plan_add_pattern(c, e, weights);
    if (!cond)
        return;
    cond->part = (uint16_t)part;
    cond->parts = (uint16_t)parts;
    snprintf(cond->id, sizeof cond->id, "segment-%s-%02u", channel_name(e), part);
    snprintf(cond->pattern, sizeof cond->pattern, "segments-%u", parts);
}

/* Segments in an order in which neighbours follow each other, by the mean of their directions; the
 * first light's where they cancel. */
static enum ls_err put_in_order(const float (*directions)[3], const uint32_t *segment, uint32_t n,
                                uint32_t count, uint32_t *order, struct ls_diag *diag)
{
    LS_CLEANUP_FREE float(*middle)[3] = calloc(count, sizeof *middle);
    if (!middle)
        return LS_ERR_NOMEM;
    for (uint32_t i = n; i-- > 0;) {
        const float *d = directions[i];
        float *m = middle[segment[i]], length = sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        for (int k = 0; k < 3; k++)
            m[k] += d[k] / length;
        if (fabsf(m[0]) + fabsf(m[1]) + fabsf(m[2]) < 1e-6F)
            memcpy(m, d, sizeof middle[0]);
    }
    return ls_smooth_order((const float(*)[3])middle, count, order, diag);
}

void ls_plan_add_segments(struct ls_conf *c, const struct ls_plan_entry *e, uint32_t count)
{
    LS_CLEANUP_FREE float(*directions)[3] = directions_of(e);
    LS_CLEANUP_FREE uint32_t *segment = calloc(e->n_lights, sizeof *segment);
    LS_CLEANUP_FREE uint32_t *order = calloc(count, sizeof *order);
    LS_CLEANUP_FREE double *weights = calloc(e->n_lights, sizeof *weights);
    struct ls_diag diag = {0};
    if (!directions || !segment || !order || !weights) {
        c->err = LS_ERR_NOMEM;
        return;
    }
    const float(*d)[3] = (const float(*)[3])directions;
    if (ls_segments_partition(d, e->n_lights, count, segment, &diag) ||
        put_in_order(d, segment, e->n_lights, count, order, &diag))
        ls_conf_error(c, "count", "%s", diag.text);
    for (uint32_t g = 0; g < count && !c->err; g++)
        add_segment(c, e, segment, order[e->backwards ? count - 1 - g : g], count, weights);
}

static void fill(double *weights, uint32_t n, double value)
{
    for (uint32_t i = 0; i < n; i++)
        weights[i] = value;
}

void ls_plan_add_headlight(struct ls_conf *c, const struct ls_plan_entry *e)
{
    LS_CLEANUP_FREE double *weights = calloc(e->n_lights, sizeof *weights);
    if (!weights) {
        c->err = LS_ERR_NOMEM;
        return;
    }
    fill(weights, e->n_lights, 1);
    struct ls_plan_condition *cond = ls_plan_add_pattern(c, e, weights);
    if (!cond)
        return;
    snprintf(cond->id, sizeof cond->id, "headlight-%s", channel_name(e));
    if (e->n_lights == USUAL_HEADLIGHTS)
        snprintf(cond->pattern, sizeof cond->pattern, "headlight");
    else
        snprintf(cond->pattern, sizeof cond->pattern, "headlight-%u", e->n_lights);
}

void ls_plan_add_multiplex(struct ls_conf *c, const struct ls_plan_entry *e)
{
    uint32_t order = ls_multiplex_order(e->n_lights);
    LS_CLEANUP_FREE uint8_t *on = calloc(order, 1);
    LS_CLEANUP_FREE double *weights = calloc(e->n_lights, sizeof *weights);
    if (!on || !weights)
        c->err = LS_ERR_NOMEM;
    for (uint32_t row = 0; row < order && !c->err; row++) {
        ls_multiplex_row(order, row, on);
        for (uint32_t i = 0; i < e->n_lights; i++)
            weights[i] = on[i];
        struct ls_plan_condition *cond = ls_plan_add_pattern(c, e, weights);
        if (!cond)
            return;
        cond->part = (uint16_t)row;
        cond->parts = (uint16_t)order;
        snprintf(cond->id, sizeof cond->id, "multiplex-%s-%04u", channel_name(e), row);
        snprintf(cond->pattern, sizeof cond->pattern, "multiplex");
    }
}

static bool any(const double *weights, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        if (weights[i] > 0)
            return true;
    return false;
}

static void add_harmonic(struct ls_conf *c, const struct ls_plan_entry *e, uint32_t index,
                         const char *suffix, const double *weights)
{
    if (!any(weights, e->n_lights))
        return; /* nothing to photograph: the constant has no negative half */
    struct ls_plan_condition *cond = ls_plan_add_pattern(c, e, weights);
    if (!cond)
        return;
    cond->part = (uint16_t)index;
    snprintf(cond->id, sizeof cond->id, "harmonic-%s-%02u%s", channel_name(e), index, suffix);
    snprintf(cond->pattern, sizeof cond->pattern, "harmonic-%02u%s", index, suffix);
}

void ls_plan_add_harmonics(struct ls_conf *c, const struct ls_plan_entry *e, uint32_t degree,
                           bool pairs)
{
    static const struct {
        enum ls_basis_form form;
        const char *suffix;
    } forms[] = {{LS_BASIS_BIASED, ""}, {LS_BASIS_POSITIVE, "p"}, {LS_BASIS_NEGATIVE, "n"}};
    LS_CLEANUP_FREE float(*directions)[3] = directions_of(e);
    LS_CLEANUP_FREE double *weights = calloc(e->n_lights, sizeof *weights);
    if (!directions || !weights)
        c->err = LS_ERR_NOMEM;
    uint32_t first = e->builder->plan->n_conditions, n = (degree + 1) * (degree + 1);
    for (uint32_t i = 0; i < n && !c->err; i++)
        for (unsigned f = pairs; f <= (pairs ? 2u : 0u) && !c->err; f++) {
            ls_harmonic_weights(i, forms[f].form, (const float(*)[3])directions, e->n_lights,
                                weights);
            add_harmonic(c, e, i, forms[f].suffix, weights);
        }
    for (uint32_t i = first; i < e->builder->plan->n_conditions; i++)
        e->builder->plan->conditions[i].parts = (uint16_t)n;
}

void ls_plan_add_gradients(struct ls_conf *c, const struct ls_plan_entry *e)
{
    static const char *const names[] = {"x", "y", "z", "full"};
    LS_CLEANUP_FREE float(*directions)[3] = directions_of(e);
    LS_CLEANUP_FREE double *weights = calloc(e->n_lights, sizeof *weights);
    if (!directions || !weights)
        c->err = LS_ERR_NOMEM;
    for (unsigned axis = 0; axis < 4 && !c->err; axis++) {
        if (axis < 3)
            ls_gradient_weights(axis, (const float(*)[3])directions, e->n_lights, weights);
        else
            fill(weights, e->n_lights, 1);
        struct ls_plan_condition *cond = ls_plan_add_pattern(c, e, weights);
        if (!cond)
            return;
        cond->part = (uint16_t)axis;
        cond->parts = 4;
        snprintf(cond->id, sizeof cond->id, "gradient-%s-%s", channel_name(e), names[axis]);
        snprintf(cond->pattern, sizeof cond->pattern, "gradient-%s", names[axis]);
    }
}

/* Cosine between light and camera, from the centre of the stage. */
static double nearness(const struct ls_config *config, uint32_t light)
{
    const float *l = config->lights[light].position_m, *c = config->cameras[0].position_m;
    double dot = 0, length = 0;
    for (int k = 0; k < 3; k++) {
        dot += (double)l[k] * c[k];
        length += (double)l[k] * l[k];
    }
    return dot / sqrt(length);
}

void ls_plan_lights_near_camera(const struct ls_config *config, uint16_t *lights, uint32_t n)
{
    for (uint32_t k = 0; k < n; k++) {
        double best = -INFINITY;
        for (uint32_t i = 0; i < config->n_lights; i++) {
            bool taken = false;
            for (uint32_t j = 0; j < k; j++)
                taken |= lights[j] == i;
            double near = taken ? -INFINITY : nearness(config, i);
            if (near > best) {
                best = near;
                lights[k] = (uint16_t)i;
            }
        }
    }
}

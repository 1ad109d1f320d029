#include "sim/bounce.h"

#include <stdlib.h>

struct node {
    struct sim_vec x, n; /* x lifted off the surface */
    float area;
    int emitter;
};

struct transport {
    uint32_t n_nodes, n_senders;
    struct node *nodes;
    uint32_t *sender;  /* node of each sender, sorted by emitter */
    uint32_t first[5]; /* senders of emitter k: [first[k], first[k + 1]) */
    float *factor;     /* [node][sender] */
};

static void place_nodes(const struct sim_subject *s, struct node *nodes, uint16_t *surface)
{
    for (uint32_t i = 0; i < s->n_surfaces; i++) {
        const struct sim_surface *f = &s->surface[i];
        double du = (f->u1 - f->u0) / (f->nodes_u ? f->nodes_u : 1);
        double dv = (f->v1 - f->v0) / (f->nodes_v ? f->nodes_v : 1);
        for (uint32_t k = 0; k < (uint32_t)f->nodes_u * f->nodes_v; k++) {
            struct node *node = &nodes[f->first_node + k];
            double u = f->u0 + du * (k % f->nodes_u), v = f->v0 + dv * (k / f->nodes_u);
            const struct sim_body *body = &s->body[f->body];
            sim_body_point(body, f->part, u + du / 2, v + dv / 2, &node->x, &node->n);
            node->x = sim_along(node->x, node->n, 2e-4f);
            node->area = (float)sim_body_area(body, v, du, dv);
            node->emitter = f->emitter;
            surface[f->first_node + k] = (uint16_t)i;
        }
    }
}

static void list_senders(const struct sim_subject *s, struct transport *t)
{
    for (uint32_t k = 0; k < s->n_emitters; k++) {
        t->first[k] = t->n_senders;
        for (uint32_t i = 0; i < t->n_nodes; i++)
            if (t->nodes[i].emitter == (int)k)
                t->sender[t->n_senders++] = i;
    }
    t->first[s->n_emitters] = t->n_senders;
}

static float form_factor(const struct sim_subject *s, const struct node *to,
                         const struct node *from)
{
    struct sim_vec d = sim_sub(from->x, to->x);
    float d2 = sim_dot(d, d);
    float a = sim_dot(to->n, d), b = -sim_dot(from->n, d);
    if (d2 < 1e-8f || a <= 0 || b <= 0 || !sim_subject_visible(s, to->x, from->x))
        return 0;
    return a * b / d2 * from->area / ((float)M_PI * d2 + from->area);
}

static void fill_factors(const struct sim_subject *s, struct transport *t)
{
    for (uint32_t r = 0; r < t->n_nodes; r++) {
        float *row = t->factor + (size_t)r * t->n_senders, sum = 0;
        for (uint32_t j = 0; j < t->n_senders; j++)
            sum += row[j] = form_factor(s, &t->nodes[r], &t->nodes[t->sender[j]]);
        for (uint32_t j = 0; j < t->n_senders && sum > 1; j++)
            row[j] /= sum;
    }
}

float sim_irradiance(const struct sim_geometry *g, uint32_t light, struct sim_vec x,
                     struct sim_vec n)
{
    struct sim_vec at = sim_vec_of(g->position_m[light]), axis = sim_vec_of(g->direction[light]);
    struct sim_vec to = sim_sub(at, x);
    float d2 = sim_dot(to, to), incidence = sim_dot(n, to), emission = sim_dot(axis, to);
    if (incidence <= 0 || emission <= 0)
        return 0;
    return sim_dot(at, at) * incidence * emission / (d2 * d2);
}

static void gather(const struct transport *t, uint32_t row, uint32_t n_emitters,
                   const float *irradiance, float *out)
{
    const float *f = t->factor + (size_t)row * t->n_senders;
    for (uint32_t k = 0; k < n_emitters; k++) {
        float sum = 0;
        for (uint32_t j = t->first[k]; j < t->first[k + 1]; j++)
            sum += f[j] * irradiance[j];
        out[k] = sum;
    }
}

/* @work: 1 + n_emitters rows of n_senders. */
static void bounce_light(const struct sim_subject *s, const struct sim_geometry *g, uint32_t light,
                         const struct transport *t, float *work, float *coef)
{
    uint32_t n = s->n_emitters;
    float once[4];
    for (uint32_t j = 0; j < t->n_senders; j++) {
        const struct node *node = &t->nodes[t->sender[j]];
        float e = sim_irradiance(g, light, node->x, node->n);
        if (e > 0 && !sim_subject_visible(s, node->x, sim_vec_of(g->position_m[light])))
            e = 0;
        work[j] = e;
    }
    for (uint32_t j = 0; j < t->n_senders; j++) {
        gather(t, t->sender[j], n, work, once);
        for (uint32_t a = 0; a < n; a++)
            work[(1 + a) * t->n_senders + j] = once[a];
    }
    for (uint32_t r = 0; r < t->n_nodes; r++) {
        float *c = coef + (size_t)r * SIM_CHAINS;
        for (uint32_t a = 0; a <= n; a++)
            gather(t, r, n, work + a * t->n_senders, c + a * n);
        for (int k = 0; k < SIM_CHAINS; k++)
            c[k] *= (float)(1 / M_PI);
    }
}

static void transport_finish(struct transport *t)
{
    free(t->nodes);
    free(t->sender);
    free(t->factor);
}

static enum ls_err build(const struct sim_subject *s, const struct sim_geometry *g,
                         struct transport *t, struct sim_bounce *out)
{
    t->nodes = calloc(s->n_nodes, sizeof *t->nodes);
    t->sender = calloc(s->n_nodes, sizeof *t->sender);
    out->surface = calloc(s->n_nodes, sizeof *out->surface);
    if (!t->nodes || !t->sender || !out->surface)
        return LS_ERR_NOMEM;
    place_nodes(s, t->nodes, out->surface);
    list_senders(s, t);
    t->factor = calloc((size_t)s->n_nodes * t->n_senders, sizeof *t->factor);
    out->coef = calloc((size_t)g->n_lights * s->n_nodes * SIM_CHAINS, sizeof *out->coef);
    LS_CLEANUP_FREE float *work = calloc((size_t)(1 + s->n_emitters) * t->n_senders, sizeof *work);
    if (!t->factor || !out->coef || !work)
        return LS_ERR_NOMEM;
    fill_factors(s, t);
    for (uint32_t i = 0; i < g->n_lights; i++)
        bounce_light(s, g, i, t, work, out->coef + (size_t)i * s->n_nodes * SIM_CHAINS);
    return LS_OK;
}

enum ls_err sim_bounce_build(const struct sim_subject *s, const struct sim_geometry *g,
                             struct sim_bounce *out, struct ls_diag *diag)
{
    *out = (struct sim_bounce){.n_lights = g->n_lights, .n_nodes = s->n_nodes};
    if (!s->n_nodes)
        return LS_OK;
    struct transport t = {.n_nodes = s->n_nodes};
    enum ls_err err = build(s, g, &t, out);
    transport_finish(&t);
    if (err) {
        sim_bounce_finish(out);
        return ls_fail(diag, err, "out of memory for bounced light at %u nodes", s->n_nodes);
    }
    return LS_OK;
}

void sim_bounce_finish(struct sim_bounce *bounce)
{
    free(bounce->coef);
    free(bounce->surface);
    *bounce = (struct sim_bounce){0};
}

void sim_bounce_add(const struct sim_bounce *b, const struct sim_subject *s,
                    const struct sim_response *response, uint32_t light, uint32_t source,
                    float weight, float *acc)
{
    uint32_t colours = response->n_colours;
    weight *= response->diffuse[source];
    for (uint32_t node = 0; node < b->n_nodes; node++) {
        const float *coef = b->coef + ((size_t)light * b->n_nodes + node) * SIM_CHAINS;
        uint32_t material = s->surface[b->surface[node]].material;
        for (uint32_t c = 0; c < colours; c++) {
            const float *chain = response->chain +
                                 (size_t)(source * colours + c) * SIM_CHAINS * SIM_MATERIALS +
                                 material;
            float sum = 0;
            for (int k = 0; k < SIM_CHAINS; k++)
                sum += coef[k] * chain[(size_t)k * SIM_MATERIALS];
            acc[node * colours + c] += weight * sum;
        }
    }
}

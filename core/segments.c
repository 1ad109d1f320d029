#include "core/segments.h"

#include "core/vec3.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum {
    AXIS_STEPS = 64,   /* of the power iteration */
    MAX_ROUNDS = 1000, /* each lowers the cost; a handful suffices */
};

struct partition {
    const double (*d)[3]; /* unit directions */
    uint32_t n, n_groups;
    uint32_t *group;
    double (*sum)[3]; /* [n_groups], of each group's directions */
    uint32_t *size;
};

static enum ls_err unit(const float v[3], uint32_t light, double out[3], struct ls_diag *diag)
{
    double d[3] = {(double)v[0], (double)v[1], (double)v[2]};
    double length = sqrt(ls_dot3(d, d));
    if (!(length > 0) || !isfinite(length))
        return ls_fail(diag, LS_ERR_INVALID,
                       "direction of light %u is (%g, %g, %g): expected finite and not zero", light,
                       d[0], d[1], d[2]);
    for (int k = 0; k < 3; k++)
        out[k] = d[k] / length;
    return LS_OK;
}

static enum ls_err unit_directions(const float (*directions)[3], uint32_t n, double (**out)[3],
                                   struct ls_diag *diag)
{
    *out = calloc(n, sizeof **out);
    if (!*out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u directions", n);
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < n && !err; i++)
        err = unit(directions[i], i, (*out)[i], diag);
    return err;
}

/* The direction in which the members of a set differ most; any unit vector if they do not. */
static void principal_axis(const struct partition *p, const uint32_t *member, uint32_t n,
                           double axis[3])
{
    double mean[3] = {0}, cov[3][3] = {{0}};
    for (uint32_t j = 0; j < n; j++)
        for (int k = 0; k < 3; k++)
            mean[k] += p->d[member[j]][k] / n;
    for (uint32_t j = 0; j < n; j++)
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                cov[a][b] += (p->d[member[j]][a] - mean[a]) * (p->d[member[j]][b] - mean[b]);
    double v[3] = {0.48, 0.64, 0.6}; /* no axis of symmetry of a rig */
    for (int step = 0; step < AXIS_STEPS; step++) {
        double next[3] = {ls_dot3(cov[0], v), ls_dot3(cov[1], v), ls_dot3(cov[2], v)};
        double length = sqrt(ls_dot3(next, next));
        for (int k = 0; k < 3 && length > 0; k++)
            v[k] = next[k] / length;
    }
    memcpy(axis, v, sizeof v);
}

struct key {
    double along;
    uint32_t light;
};

static int by_key(const void *a, const void *b)
{
    const struct key *x = a, *y = b;
    if (x->along != y->along)
        return x->along < y->along ? -1 : 1;
    return x->light < y->light ? -1 : x->light > y->light;
}

/* Groups [first, first + n_groups) for n members, the larger groups first. */
static void halve(struct partition *p, uint32_t *member, uint32_t n, uint32_t first,
                  uint32_t n_groups, struct key *room)
{
    if (n_groups == 1) {
        for (uint32_t j = 0; j < n; j++)
            p->group[member[j]] = first;
        return;
    }
    double axis[3];
    principal_axis(p, member, n, axis);
    for (uint32_t j = 0; j < n; j++)
        room[j] = (struct key){ls_dot3(p->d[member[j]], axis), member[j]};
    qsort(room, n, sizeof *room, by_key);
    for (uint32_t j = 0; j < n; j++)
        member[j] = room[j].light;
    uint32_t low_groups = n_groups / 2, small = n / n_groups, larger = n % n_groups;
    uint32_t low = low_groups * small + (larger < low_groups ? larger : low_groups);
    halve(p, member, low, first, low_groups, room);
    halve(p, member + low, n - low, first + low_groups, n_groups - low_groups, room);
}

static void sum_groups(struct partition *p)
{
    memset(p->sum, 0, p->n_groups * sizeof *p->sum);
    memset(p->size, 0, p->n_groups * sizeof *p->size);
    for (uint32_t i = 0; i < p->n; i++) {
        p->size[p->group[i]]++;
        for (int k = 0; k < 3; k++)
            p->sum[p->group[i]][k] += p->d[i][k];
    }
}

/*
 * Is the sum over groups of |sum of directions|^2 / size larger with i and j exchanged? That is n
 * less the squared distances to the groups' centres. By more than rounding, or it would not end.
 */
static bool better_exchanged(const struct partition *p, uint32_t i, uint32_t j)
{
    uint32_t a = p->group[i], b = p->group[j];
    double step[3];
    for (int k = 0; k < 3; k++)
        step[k] = p->d[j][k] - p->d[i][k];
    double square = ls_dot3(step, step);
    double gain = (2 * ls_dot3(p->sum[a], step) + square) / p->size[a] +
                  (square - 2 * ls_dot3(p->sum[b], step)) / p->size[b];
    return gain > 1e-9;
}

static void exchange(struct partition *p, uint32_t i, uint32_t j)
{
    uint32_t a = p->group[i], b = p->group[j];
    for (int k = 0; k < 3; k++) {
        double step = p->d[j][k] - p->d[i][k];
        p->sum[a][k] += step;
        p->sum[b][k] -= step;
    }
    p->group[i] = b;
    p->group[j] = a;
}

static void refine(struct partition *p)
{
    bool changed = true;
    for (int round = 0; changed && round < MAX_ROUNDS; round++) {
        changed = false;
        sum_groups(p);
        for (uint32_t i = 0; i < p->n; i++)
            for (uint32_t j = i + 1; j < p->n; j++)
                if (p->group[i] != p->group[j] && better_exchanged(p, i, j)) {
                    exchange(p, i, j);
                    changed = true;
                }
    }
}

static enum ls_err partition(struct partition *p, struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint32_t *member = calloc(p->n, sizeof *member);
    LS_CLEANUP_FREE struct key *room = calloc(p->n, sizeof *room);
    LS_CLEANUP_FREE double(*sum)[3] = calloc(p->n_groups, sizeof *sum);
    LS_CLEANUP_FREE uint32_t *size = calloc(p->n_groups, sizeof *size);
    if (!member || !room || !sum || !size)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", p->n_groups);
    p->sum = sum;
    p->size = size;
    for (uint32_t i = 0; i < p->n; i++)
        member[i] = i;
    halve(p, member, p->n, 0, p->n_groups, room);
    refine(p);
    return LS_OK;
}

enum ls_err ls_segments_partition(const float (*directions)[3], uint32_t n_lights,
                                  uint32_t n_segments, uint32_t *segment, struct ls_diag *diag)
{
    if (n_lights > LS_SEGMENTS_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_LIMIT, "segments of %u lights: expected at most %d", n_lights,
                       LS_SEGMENTS_MAX_LIGHTS);
    if (n_segments < 1 || n_segments > n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "%u segments of %u lights: expected 1 to %u",
                       n_segments, n_lights, n_lights);
    LS_CLEANUP_FREE double(*d)[3] = NULL;
    enum ls_err err = unit_directions(directions, n_lights, &d, diag);
    if (err)
        return err;
    struct partition p = {
        .d = (const double(*)[3])d, .n = n_lights, .n_groups = n_segments, .group = segment};
    return partition(&p, diag);
}

enum ls_err ls_segments_centres(const float (*directions)[3], uint32_t n_lights,
                                const uint32_t *segment, uint32_t n_segments, double (*centre)[3],
                                struct ls_diag *diag)
{
    LS_CLEANUP_FREE double(*first)[3] = calloc(n_segments, sizeof *first);
    if (!first)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", n_segments);
    memset(centre, 0, n_segments * sizeof *centre);
    for (uint32_t i = 0; i < n_lights; i++) {
        double d[3] = {0};
        if (segment[i] >= n_segments)
            return ls_fail(diag, LS_ERR_INVALID, "light %u is in segment %u: expected less than %u",
                           i, segment[i], n_segments);
        enum ls_err err = unit(directions[i], i, d, diag);
        if (err)
            return err;
        double *start = first[segment[i]];
        if (ls_dot3(start, start) == 0)
            memcpy(start, d, sizeof d);
        for (int k = 0; k < 3; k++)
            centre[segment[i]][k] += d[k];
    }
    for (uint32_t g = 0; g < n_segments; g++) {
        if (ls_dot3(first[g], first[g]) == 0)
            return ls_fail(diag, LS_ERR_INVALID, "segment %u has no light", g);
        double length = sqrt(ls_dot3(centre[g], centre[g]));
        for (int k = 0; k < 3; k++)
            centre[g][k] = length > 1e-6 ? centre[g][k] / length : first[g][k];
    }
    return LS_OK;
}

#include "core/sphere_mesh.h"

#include "core/vec3.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_POINTS = 16390, ATTEMPTS = 8, NONE = UINT32_MAX };
static const double lift = 1e-10;

/** A triangle, counterclockwise from outside; beside[k] lies across the edge opposite vertex k. */
struct face {
    uint32_t vertex[3], beside[3];
    double normal[3], offset; /* of its plane, from lifted points */
    bool alive, visible;
};

/** The dual basis of a triangle: d . dual[k] is the coordinate of vertex k. */
struct triangle {
    uint32_t vertex[3], beside[3];
    double dual[3][3];
};

struct ls_sphere_mesh {
    uint32_t n_faces;
    struct triangle *face;
};

struct hull {
    size_t n;
    double (*p)[3]; /* lifted */
    struct face *face;
    uint32_t n_faces, capacity, *unused, n_unused;
    uint32_t *leaving; /* [n]: new face whose horizon edge leaves this vertex */
};

static void subtract(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] - b[k];
}

/* a number in [-1, 1) of its own for every point and attempt */
static double noise(uint32_t point, uint32_t attempt)
{
    uint32_t x = point * 0x9e3779b9u + attempt * 0x85ebca6bu + 1;
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x / 2147483648.0 - 1;
}

static void hull_finish(struct hull *hull)
{
    free(hull->p);
    free(hull->face);
    free(hull->unused);
    free(hull->leaving);
}

static enum ls_err hull_init(struct hull *hull, const double (*d)[3], size_t n, uint32_t attempt,
                             struct ls_diag *diag)
{
    *hull = (struct hull){.n = n, .capacity = (uint32_t)(4 * n)};
    hull->p = malloc(n * sizeof *hull->p);
    hull->face = calloc(hull->capacity, sizeof *hull->face);
    hull->unused = malloc(hull->capacity * sizeof *hull->unused);
    hull->leaving = malloc(n * sizeof *hull->leaving);
    if (!hull->p || !hull->face || !hull->unused || !hull->leaving)
        return ls_fail(diag, LS_ERR_NOMEM, "triangulation: out of memory");
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            hull->p[i][k] = d[i][k] * (1 + lift * noise((uint32_t)i, attempt));
    return LS_OK;
}

static uint32_t new_face(struct hull *hull, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t f = hull->n_unused > 0 ? hull->unused[--hull->n_unused] : hull->n_faces++;
    double ab[3], ac[3];
    struct face *face = &hull->face[f];
    *face = (struct face){.vertex = {a, b, c}, .beside = {NONE, NONE, NONE}, .alive = true};
    subtract(hull->p[b], hull->p[a], ab);
    subtract(hull->p[c], hull->p[a], ac);
    ls_cross3(ab, ac, face->normal);
    face->offset = ls_dot3(face->normal, hull->p[a]);
    return f;
}

static void join(struct hull *hull, uint32_t f, uint32_t g)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const struct face *a = &hull->face[f], *b = &hull->face[g];
            if (a->vertex[(i + 1) % 3] == b->vertex[(j + 2) % 3] &&
                a->vertex[(i + 2) % 3] == b->vertex[(j + 1) % 3]) {
                hull->face[f].beside[i] = g;
                hull->face[g].beside[j] = f;
            }
        }
}

/* the point for which @measure, given what was chosen so far, is largest in size */
static double volume(const struct hull *hull, const uint32_t *v, int chosen, size_t i)
{
    double a[3], b[3], c[3], n[3];
    subtract(hull->p[i], hull->p[v[0]], a);
    if (chosen == 1)
        return ls_dot3(a, a);
    subtract(hull->p[v[1]], hull->p[v[0]], b);
    ls_cross3(b, a, n);
    if (chosen == 2)
        return ls_dot3(n, n);
    subtract(hull->p[v[2]], hull->p[v[0]], c);
    ls_cross3(b, c, n);
    return ls_dot3(n, a);
}

static bool begin_tetrahedron(struct hull *hull, uint32_t v[4])
{
    v[0] = 0;
    for (int chosen = 1; chosen < 4; chosen++) {
        v[chosen] = 0;
        for (size_t i = 0; i < hull->n; i++)
            if (fabs(volume(hull, v, chosen, i)) > fabs(volume(hull, v, chosen, v[chosen])))
                v[chosen] = (uint32_t)i;
    }
    double size = volume(hull, v, 3, v[3]);
    if (!(fabs(size) > 1e-9))
        return false;
    if (size > 0) { /* v[3] must lie behind (v0, v1, v2) */
        uint32_t swap = v[1];
        v[1] = v[2];
        v[2] = swap;
    }
    uint32_t f[4] = {new_face(hull, v[0], v[1], v[2]), new_face(hull, v[0], v[3], v[1]),
                     new_face(hull, v[1], v[3], v[2]), new_face(hull, v[2], v[3], v[0])};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++)
            join(hull, f[i], f[j]);
    return true;
}

static uint32_t mark_visible(struct hull *hull, uint32_t point)
{
    uint32_t n = 0;
    for (uint32_t f = 0; f < hull->n_faces; f++) {
        struct face *face = &hull->face[f];
        face->visible = face->alive && ls_dot3(face->normal, hull->p[point]) - face->offset > 0;
        n += face->visible;
    }
    return n;
}

/* a face over every edge between what the point sees and what it does not */
static bool cover_horizon(struct hull *hull, uint32_t point, uint32_t *first, uint32_t *n_new)
{
    uint32_t n_faces = hull->n_faces;
    *n_new = 0;
    for (uint32_t f = 0; f < n_faces; f++) {
        for (int k = 0; k < 3 && hull->face[f].visible; k++) {
            uint32_t beyond = hull->face[f].beside[k];
            if (hull->face[beyond].visible)
                continue;
            uint32_t u = hull->face[f].vertex[(k + 1) % 3], v = hull->face[f].vertex[(k + 2) % 3];
            if ((hull->n_unused == 0 && hull->n_faces == hull->capacity) ||
                hull->leaving[u] != NONE)
                return false;
            uint32_t g = new_face(hull, u, v, point);
            join(hull, g, beyond);
            hull->leaving[u] = g;
            *first = u;
            ++*n_new;
        }
    }
    return true;
}

/* the new faces form one ring around the point */
static bool close_ring(struct hull *hull, uint32_t first, uint32_t n_new)
{
    uint32_t u = first, n = 0;
    do {
        uint32_t f = hull->leaving[u];
        if (f == NONE || n++ > n_new)
            return false;
        uint32_t v = hull->face[f].vertex[1], g = hull->leaving[v];
        if (g == NONE)
            return false;
        hull->face[f].beside[0] = g; /* across (v, point) */
        hull->face[g].beside[1] = f;
        u = v;
    } while (u != first);
    return n == n_new;
}

static bool add_point(struct hull *hull, uint32_t point)
{
    uint32_t first = NONE, n_new;
    if (mark_visible(hull, point) == 0)
        return false;
    for (size_t i = 0; i < hull->n; i++)
        hull->leaving[i] = NONE;
    bool good = cover_horizon(hull, point, &first, &n_new) && first != NONE &&
                close_ring(hull, first, n_new);
    for (uint32_t f = 0; f < hull->n_faces; f++)
        if (hull->face[f].visible) {
            hull->face[f].alive = hull->face[f].visible = false;
            hull->unused[hull->n_unused++] = f;
        }
    return good;
}

static void compact(struct hull *hull)
{
    hull->n_unused = 0;
    uint32_t to = 0;
    for (uint32_t f = 0; f < hull->n_faces; f++) {
        if (!hull->face[f].alive)
            continue;
        hull->unused[f] = to; /* where it goes */
        to++;
    }
    for (uint32_t f = 0; f < hull->n_faces; f++) {
        if (!hull->face[f].alive)
            continue;
        struct face face = hull->face[f];
        for (int k = 0; k < 3; k++)
            face.beside[k] = hull->unused[face.beside[k]];
        hull->face[hull->unused[f]] = face;
    }
    for (uint32_t f = to; f < hull->n_faces; f++)
        hull->face[f].alive = false;
    hull->n_faces = to;
}

/* every point a corner, every edge shared: Euler's count */
static bool build(struct hull *hull)
{
    uint32_t v[4];
    if (!begin_tetrahedron(hull, v))
        return false;
    for (uint32_t i = 0; i < hull->n; i++) {
        if (i == v[0] || i == v[1] || i == v[2] || i == v[3])
            continue;
        if (!add_point(hull, i))
            return false;
    }
    compact(hull);
    return hull->n_faces == 2 * hull->n - 4;
}

static bool dual_basis(const double (*d)[3], struct triangle *face)
{
    const double *a = d[face->vertex[0]], *b = d[face->vertex[1]], *c = d[face->vertex[2]];
    ls_cross3(b, c, face->dual[0]);
    ls_cross3(c, a, face->dual[1]);
    ls_cross3(a, b, face->dual[2]);
    double size = ls_dot3(a, face->dual[0]);
    for (int k = 0; k < 9; k++)
        face->dual[k / 3][k % 3] /= size;
    return size > 0;
}

static enum ls_err take_faces(const struct hull *hull, const double (*d)[3],
                              struct ls_sphere_mesh *mesh, struct ls_diag *diag)
{
    mesh->face = calloc(hull->n_faces, sizeof *mesh->face);
    if (!mesh->face)
        return ls_fail(diag, LS_ERR_NOMEM, "triangulation: out of memory");
    mesh->n_faces = hull->n_faces;
    for (uint32_t f = 0; f < hull->n_faces; f++) {
        memcpy(mesh->face[f].vertex, hull->face[f].vertex, sizeof mesh->face[f].vertex);
        memcpy(mesh->face[f].beside, hull->face[f].beside, sizeof mesh->face[f].beside);
        if (!dual_basis(d, &mesh->face[f]))
            return ls_fail(diag, LS_ERR_INVALID,
                           "triangulation: the origin is not inside the points' hull");
    }
    return LS_OK;
}

void ls_sphere_mesh_destroy(struct ls_sphere_mesh *mesh)
{
    if (!mesh)
        return;
    free(mesh->face);
    free(mesh);
}

enum ls_err ls_sphere_mesh_create(const double (*d)[3], size_t n, struct ls_sphere_mesh **out,
                                  struct ls_diag *diag)
{
    bool built = false;
    *out = NULL;
    if (n < 4 || n > MAX_POINTS)
        return ls_fail(diag, LS_ERR_INVALID, "triangulation: %zu points: expected 4..%d", n,
                       MAX_POINTS);
    struct ls_sphere_mesh *mesh = calloc(1, sizeof *mesh);
    enum ls_err err = mesh ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "triangulation: out of memory");
    for (uint32_t attempt = 0; !err && !built && attempt < ATTEMPTS; attempt++) {
        struct hull hull;
        err = hull_init(&hull, d, n, attempt, diag);
        built = !err && build(&hull);
        if (built)
            err = take_faces(&hull, d, mesh, diag);
        hull_finish(&hull);
    }
    if (!err && !built)
        err = ls_fail(diag, LS_ERR_BUG, "triangulation: no hull holds all %zu points", n);
    if (err)
        ls_sphere_mesh_destroy(mesh);
    else
        *out = mesh;
    return err;
}

/* the coordinates' least, and whose it is */
static int least(const struct triangle *face, const double d[3], double share[3])
{
    int k = 0;
    for (int i = 0; i < 3; i++) {
        share[i] = ls_dot3(d, face->dual[i]);
        k = share[i] < share[k] ? i : k;
    }
    return k;
}

static uint32_t search_all(const struct ls_sphere_mesh *mesh, const double d[3])
{
    uint32_t best = 0;
    double most = -INFINITY, share[3];
    for (uint32_t f = 0; f < mesh->n_faces; f++) {
        double low = share[least(&mesh->face[f], d, share)];
        if (low > most) {
            most = low;
            best = f;
        }
    }
    return best;
}

void ls_sphere_mesh_locate(const struct ls_sphere_mesh *mesh, const double d[3], uint32_t *face,
                           uint32_t vertex[3], double share[3])
{
    uint32_t f = *face < mesh->n_faces ? *face : 0, steps = 0;
    int k;
    while (k = least(&mesh->face[f], d, share), share[k] < 0 && steps++ < mesh->n_faces)
        f = mesh->face[f].beside[k];
    if (share[k] < 0) { /* between two triangles that disagree by a rounding */
        f = search_all(mesh, d);
        least(&mesh->face[f], d, share);
    }
    double sum = 0;
    for (int i = 0; i < 3; i++)
        sum += share[i] = fmax(share[i], 0);
    for (int i = 0; i < 3; i++)
        share[i] /= sum;
    memcpy(vertex, mesh->face[f].vertex, sizeof mesh->face[f].vertex);
    *face = f;
}

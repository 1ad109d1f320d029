/*
 * sphere_mesh: the spherical Delaunay triangulation of directions, and a direction's barycentric
 * coordinates in it.
 * Layer: core. Threads: any; read-only once made. Ownership: owns everything; see destroy.
 *
 * The triangulation is the convex hull of the points, built point by point, on copies lifted by up
 * to 1e-10 so that lights on a ring are in general position. The lift decides only which of several
 * equal triangulations is taken; coordinates are those of the points as given.
 */
#ifndef LS_CORE_SPHERE_MESH_H
#define LS_CORE_SPHERE_MESH_H

#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

struct ls_sphere_mesh;

/**
 * Triangulate @n unit vectors, 4 to 16390, no two closer than 1e-4, the origin strictly inside
 * their hull. (transfer full). Errors: LS_ERR_INVALID (n, all in one plane), LS_ERR_NOMEM,
 * LS_ERR_BUG (no hull that holds every point).
 */
LS_MUST_CHECK enum ls_err ls_sphere_mesh_create(const double (*d)[3], size_t n,
                                                struct ls_sphere_mesh **out, struct ls_diag *diag);

/** NULL is allowed. */
void ls_sphere_mesh_destroy(struct ls_sphere_mesh *mesh);

/**
 * The triangle that holds direction @d: its @vertex numbers and shares >= 0 of sum 1. *@face is
 * where the search begins (0 at first) and where it ended: neighbours are found at once. RT-safe.
 */
void ls_sphere_mesh_locate(const struct ls_sphere_mesh *mesh, const double d[3], uint32_t *face,
                           uint32_t vertex[3], double share[3]);

#endif

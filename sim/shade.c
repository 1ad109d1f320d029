#include "sim/shade.h"

#include <string.h>

enum { NOT_REACHED = SIM_MAX_BODIES + 1 };

static const float coat_index = 1.5f;
static const float lift_m = 1e-4f; /* shadow rays start this far off the surface */

struct fresnel {
    float s, p; /* signed amplitudes */
};

static struct fresnel dielectric(float cosine)
{
    float t = sqrtf(1 - (1 - cosine * cosine) / (coat_index * coat_index));
    return (struct fresnel){(cosine - coat_index * t) / (cosine + coat_index * t),
                            (coat_index * cosine - t) / (coat_index * cosine + t)};
}

/* Transmission of a coat for unpolarised light, over that at normal incidence (0.96). */
static float transmission(float cosine)
{
    struct fresnel f = dielectric(cosine);
    return (1 - 0.5f * (f.s * f.s + f.p * f.p)) / 0.96f;
}

static void find_nodes(const struct sim_surface *surface, const struct sim_pixel *pixel,
                       uint32_t node[4], float share[4])
{
    memset(node, 0, 4 * sizeof *node);
    memset(share, 0, 4 * sizeof *share);
    if (!surface->nodes_u)
        return;
    float u = sim_max(0, sim_min(pixel->u * surface->nodes_u - 0.5f, (float)surface->nodes_u - 1));
    float v = sim_max(0, sim_min(pixel->v * surface->nodes_v - 0.5f, (float)surface->nodes_v - 1));
    uint32_t i = (uint32_t)u, j = (uint32_t)v;
    uint32_t right = i + 1 < surface->nodes_u, up = j + 1 < surface->nodes_v;
    float fu = u - (float)i, fv = v - (float)j;
    uint32_t corner = surface->first_node + j * surface->nodes_u + i;
    for (uint32_t k = 0; k < 4; k++) {
        node[k] = corner + (k & 1) * right + (k >> 1) * up * surface->nodes_u;
        share[k] = (k & 1 ? fu : 1 - fu) * (k & 2 ? fv : 1 - fv);
    }
}

static void bound_points(struct sim_tile *tile)
{
    struct sim_vec lo = sim_vec(1e9, 1e9, 1e9), hi = sim_vec(-1e9, -1e9, -1e9);
    for (uint32_t k = 0; k < tile->n; k++) {
        if (tile->surface[k] == SIM_NO_SURFACE)
            continue;
        struct sim_vec p = tile->point[k];
        lo = (struct sim_vec){sim_min(lo.x, p.x), sim_min(lo.y, p.y), sim_min(lo.z, p.z)};
        hi = (struct sim_vec){sim_max(hi.x, p.x), sim_max(hi.y, p.y), sim_max(hi.z, p.z)};
    }
    tile->centre = sim_mul(sim_add(lo, hi), 0.5f);
    tile->radius = 0.5f * sim_length(sim_sub(hi, lo)) + 2 * lift_m;
}

static void prepare_pixel(const struct sim_subject *subject, const struct sim_view *view,
                          const struct sim_pixel *pixel, struct sim_tile *tile, uint32_t k)
{
    tile->surface[k] = pixel->surface;
    tile->weave[k] = 0;
    memset(tile->node[k], 0, sizeof tile->node[k]);
    memset(tile->share[k], 0, sizeof tile->share[k]);
    if (pixel->surface == SIM_NO_SURFACE)
        return;
    const struct sim_surface *surface = &subject->surface[pixel->surface];
    tile->n_seen++;
    tile->material[k] = surface->material;
    tile->body[k] = surface->body;
    tile->has_specular |= surface->finish != SIM_MATTE;
    tile->point[k] = pixel->x;
    tile->normal[k] = pixel->normal;
    tile->view[k] = sim_unit(sim_sub(view->eye, pixel->x));
    tile->weave[k] = pixel->weave;
    float cosine = sim_max(1e-3f, sim_dot(pixel->normal, tile->view[k]));
    tile->coat_out[k] = surface->finish == SIM_COATED ? transmission(cosine) : 1;
    find_nodes(surface, pixel, tile->node[k], tile->share[k]);
}

void sim_tile_prepare(const struct sim_subject *subject, const struct sim_view *view, int32_t x,
                      int32_t y, uint32_t width, uint32_t height, struct sim_tile *tile)
{
    tile->x = x;
    tile->y = y;
    tile->width = width;
    tile->height = height;
    tile->n = width * height;
    tile->n_seen = 0;
    tile->has_specular = 0;
    tile->camera_up = view->up;
    memset(tile->material, 0, sizeof tile->material);
    for (uint32_t k = 0; k < tile->n; k++) {
        int32_t px = x + (int32_t)(k % width), py = y + (int32_t)(k / width);
        tile->colour[k] = (uint8_t)ls_cfa_channel(view->cfa, (uint32_t)px, (uint32_t)py);
        prepare_pixel(subject, view, sim_view_pixel(view, px, py), tile, k);
    }
    if (tile->n_seen)
        bound_points(tile);
}

/* Squared distance of @p from the segment @a to @b. */
static float segment_distance2(struct sim_vec p, struct sim_vec a, struct sim_vec b)
{
    struct sim_vec ab = sim_sub(b, a), ap = sim_sub(p, a);
    float t = sim_dot(ap, ab) / sim_dot(ab, ab);
    t = sim_max(0, sim_min(1, t));
    struct sim_vec d = sim_along(ap, ab, -t);
    return sim_dot(d, d);
}

enum shadow { SHADOW_NONE, SHADOW_SOME, SHADOW_ALL };

/*
 * Does a rectangle stand between the light and the points of the tile? With the tile in a sphere
 * of radius r around c, its plane at a distance of h from c and, on the other side, g from the
 * light L, the ray from c crosses the plane at c + t (L - c), t = h / (h + g); the ray from c + e,
 * |e| <= r, no farther from there than r + |t' - t| |L - c|, t' the same for h - r or h + r.
 */
static enum shadow quad_shadow(const struct sim_body *quad, const struct sim_tile *tile,
                               struct sim_vec light)
{
    struct sim_vec way = sim_sub(light, tile->centre);
    float g = sim_dot(quad->normal, sim_sub(light, quad->origin));
    float h = sim_dot(quad->normal, sim_sub(tile->centre, quad->origin)), r = tile->radius;
    float side = g > 0 ? -1 : 1; /* of the plane on which the tile must be */
    h *= side;
    g *= -side;
    if (h < -r)
        return SHADOW_NONE;
    if (h <= r || g <= 0)
        return SHADOW_SOME;
    float t = h / (h + g), spread = (h + r) / (h + r + g) - t, other = t - (h - r) / (h - r + g);
    float reach = r + sim_max(spread, other) * sim_length(way);
    struct sim_vec p = sim_sub(sim_along(tile->centre, way, t), quad->origin);
    float u = sim_dot(p, quad->u), v = sim_dot(p, quad->v);
    float margin_u = reach * sqrtf(quad->u2), margin_v = reach * sqrtf(quad->v2);
    if (u < -margin_u || u > quad->u2 + margin_u || v < -margin_v || v > quad->v2 + margin_v)
        return SHADOW_NONE;
    int within = u > margin_u && u < quad->u2 - margin_u && v > margin_v && v < quad->v2 - margin_v;
    return within ? SHADOW_ALL : SHADOW_SOME;
}

/* Bodies that could stand between some point of the tile and the light; NOT_REACHED if one stands
 * between all of them and it. */
static uint32_t candidates(const struct sim_subject *subject, const struct sim_tile *tile,
                           struct sim_vec light, uint16_t *list)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < subject->n_bodies; i++) {
        const struct sim_body *body = &subject->body[i];
        float reach = body->bound + tile->radius;
        if (segment_distance2(body->centre, tile->centre, light) > reach * reach)
            continue;
        enum shadow shadow = body->shape == SIM_QUAD ? quad_shadow(body, tile, light) : SHADOW_SOME;
        if (shadow == SHADOW_ALL)
            return NOT_REACHED;
        if (shadow == SHADOW_NONE)
            continue;
        list[n++] = (uint16_t)i;
    }
    return n;
}

static int shadowed(const struct sim_subject *subject, const uint16_t *list, uint32_t n,
                    const struct sim_tile *tile, uint32_t k, struct sim_vec d, float distance)
{
    struct sim_vec o = sim_along(tile->point[k], tile->normal[k], lift_m);
    for (uint32_t i = 0; i < n; i++) {
        const struct sim_body *body = &subject->body[list[i]];
        if (list[i] == tile->body[k] && body->shape != SIM_TUBE)
            continue; /* convex or flat: a lit side never shades itself */
        if (sim_body_blocks(body, o, d, lift_m, distance))
            return 1;
    }
    return 0;
}

struct lamp {
    struct sim_vec at, axis;
    struct sim_vec upright; /* the vertical polariser's axis */
    float r2;
};

static float microfacet(const struct sim_surface *surface, float nl, float nv, float nh)
{
    float a2 = surface->alpha * surface->alpha;
    float q = nh * nh * (a2 - 1) + 1;
    float d = a2 / ((float)M_PI * q * q);
    float v = nv * sqrtf(nl * nl * (1 - a2) + a2) + nl * sqrtf(nv * nv * (1 - a2) + a2);
    return d * 0.5f / v;
}

/* Power through the analyser of light polarised along @e, reflected with amplitudes @f. */
static float analysed(struct sim_vec e, struct sim_vec a, struct sim_vec s, struct sim_vec p_in,
                      struct sim_vec p_out, struct fresnel f)
{
    float amplitude =
        f.s * sim_dot(e, s) * sim_dot(s, a) + f.p * sim_dot(e, p_in) * sim_dot(p_out, a);
    return amplitude * amplitude;
}

static void reflect(const struct sim_surface *surface, const struct lamp *lamp,
                    const struct sim_tile *tile, uint32_t k, struct sim_vec l, float nl,
                    float power, struct sim_terms *terms)
{
    struct sim_vec v = tile->view[k], h = sim_unit(sim_add(l, v));
    float nv = sim_max(1e-3f, sim_dot(tile->normal[k], v));
    float vh = sim_max(0, sim_dot(v, h));
    power *= nl * microfacet(surface, nl, nv, sim_dot(tile->normal[k], h));
    struct fresnel f = {-1, 1};
    if (surface->finish == SIM_COATED)
        f = dielectric(vh);
    struct sim_vec in = sim_mul(l, -1), s = sim_cross(in, h);
    float across = sim_length(s);
    s = across > 1e-4f ? sim_mul(s, 1 / across) : sim_upright(l, lamp->upright);
    struct sim_vec p_in = sim_cross(in, s), p_out = sim_cross(v, s);
    struct sim_vec vertical = sim_upright(l, lamp->upright),
                   analyser = sim_upright(v, tile->camera_up);
    float pv = power * analysed(vertical, analyser, s, p_in, p_out, f);
    float ph = power * analysed(sim_cross(l, vertical), analyser, s, p_in, p_out, f);
    float grazing = 1 - vh;
    terms->specular[SIM_CHANNEL_SPECTRUM][k] = pv + ph;
    terms->specular[SIM_CHANNEL_VERTICAL][k] = pv;
    terms->specular[SIM_CHANNEL_HORIZONTAL][k] = ph;
    terms->flat[k] =
        surface->finish == SIM_COATED ? 1 : grazing * grazing * grazing * grazing * grazing;
}

static int shade_pixel(const struct sim_subject *subject, const struct lamp *lamp,
                       const uint16_t *list, uint32_t n, const struct sim_tile *tile, uint32_t k,
                       struct sim_terms *terms)
{
    if (tile->surface[k] == SIM_NO_SURFACE)
        return 0;
    struct sim_vec l = sim_sub(lamp->at, tile->point[k]);
    float nl = sim_dot(tile->normal[k], l), emission = sim_dot(lamp->axis, l);
    if (nl <= 0 || emission <= 0)
        return 0;
    float d2 = sim_dot(l, l), distance = sqrtf(d2);
    l = sim_mul(l, 1 / distance);
    if (shadowed(subject, list, n, tile, k, l, distance))
        return 0;
    nl /= distance;
    float power = lamp->r2 * emission / (d2 * distance);
    const struct sim_surface *surface = &subject->surface[tile->surface[k]];
    if (surface->finish != SIM_METAL)
        terms->diffuse[k] = power * nl * tile->weave[k] * (float)(1 / M_PI);
    if (surface->finish == SIM_COATED)
        terms->diffuse[k] *= tile->coat_out[k] * transmission(nl);
    if (surface->finish != SIM_MATTE)
        reflect(surface, lamp, tile, k, l, nl, power, terms);
    return 1;
}

int sim_tile_shade(const struct sim_subject *subject, const struct sim_geometry *geometry,
                   const struct sim_tile *tile, uint32_t light, struct sim_terms *terms)
{
    uint16_t list[SIM_MAX_BODIES];
    struct lamp lamp = {.at = sim_vec_of(geometry->position_m[light]),
                        .axis = sim_vec_of(geometry->direction[light])};
    lamp.upright = sim_upright(lamp.axis, sim_vec(0, 1, 0));
    lamp.r2 = sim_dot(lamp.at, lamp.at);
    uint32_t n = candidates(subject, tile, lamp.at, list);
    memset(terms->diffuse, 0, sizeof terms->diffuse);
    memset(terms->specular, 0, sizeof terms->specular);
    memset(terms->flat, 0, sizeof terms->flat);
    if (n == NOT_REACHED)
        return 0;
    int reached = 0;
    for (uint32_t k = 0; k < tile->n; k++)
        reached |= shade_pixel(subject, &lamp, list, n, tile, k, terms);
    return reached;
}

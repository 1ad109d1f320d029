/*
 * shade: the geometry of light reflected towards a camera, one light and one tile of pixels at a
 * time, split into the few terms that spectra are multiplied with later.
 * Layer: sim. Threads: any; tiles are the caller's. Ownership: values.
 *
 * Diffuse: Lambert, under a coat times the transmission in and out (normalised at the normal, so
 * that a reflectance is what one sees face on). Specular: GGX microfacets with height-correlated
 * Smith masking (Walter et al., "Microfacet models for refraction through rough surfaces", 2007;
 * Heitz, JCGT 3(2), 2014), Fresnel exact for coats, Schlick's for metals. Polarisation: the field
 * of each light's polariser is split at the microfacet into s and p, reflected with the signed
 * amplitudes, and analysed by the camera's vertical polariser; what is diffuse has lost it.
 * Unpolarised light is the sum of both polarisers. The camera's analyser costs every depolarised
 * radiance one half, which the unit of radiance already contains.
 */
#ifndef LS_SIM_SHADE_H
#define LS_SIM_SHADE_H

#include "sim/geometry.h"
#include "sim/subject.h"
#include "sim/view.h"

#include <stdint.h>

enum { SIM_TILE = 16, SIM_TILE_PX = SIM_TILE * SIM_TILE };

/** A tile of at most 16 x 16 pixels, in arrays by pixel; pixels beyond its edge see nothing. */
struct sim_tile {
    int32_t x, y; /* on the sensor, or in the margin that view.h has */
    uint32_t width, height;
    uint32_t n;      /* width * height; pixel k is (x + k % width, y + k / width) */
    uint32_t n_seen; /* pixels that see a surface */
    int has_specular;
    uint16_t surface[SIM_TILE_PX], material[SIM_TILE_PX], body[SIM_TILE_PX];
    uint8_t colour[SIM_TILE_PX]; /* the camera channel of the mosaic's pixel */
    struct sim_vec point[SIM_TILE_PX], normal[SIM_TILE_PX], view[SIM_TILE_PX];
    float weave[SIM_TILE_PX], coat_out[SIM_TILE_PX];
    uint32_t node[SIM_TILE_PX][4]; /* bounce nodes around the pixel ... */
    float share[SIM_TILE_PX][4];   /* ... and their weights, 0 without nodes */
    struct sim_vec centre;         /* sphere around the points */
    float radius;
    struct sim_vec camera_up;
};

/** Coefficients per unit strength. Radiance of source s and colour c (R: sim_response_of):
 * diffuse * diffuse factor * R(material) + specular * (flat * R(flat) + (1 - flat) * R(material))
 */
struct sim_terms {
    float diffuse[SIM_TILE_PX];
    float specular[3][SIM_TILE_PX]; /* by enum sim_channel_kind: unpolarised, V, H */
    float flat[SIM_TILE_PX];        /* spectrally flat share of the specular: 1 for coats */
};

void sim_tile_prepare(const struct sim_subject *subject, const struct sim_view *view, int32_t x,
                      int32_t y, uint32_t width, uint32_t height, struct sim_tile *tile);

/** Fill @terms for a light; 0 where it does not reach. Returns 0 if it reaches no pixel. */
int sim_tile_shade(const struct sim_subject *subject, const struct sim_geometry *geometry,
                   const struct sim_tile *tile, uint32_t light, struct sim_terms *terms);

#endif

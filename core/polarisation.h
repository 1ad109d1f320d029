/*
 * polarisation: how much of a highlight a polarised light sends through the camera's polariser.
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 * The camera looks through a vertical polariser; every light has a vertical and a horizontal one.
 * With V and H the pictures under them and W = V + H under both, all scaled so that a depolariser
 * (matte) reads W/2 under each, a pixel with diffuse part D and specular part S is
 *
 *     V = a_V S + D/2,   H = a_H S + D/2,   a_V + a_H = 1.
 *
 * The paper's V - H is S, and 2 H is D, where a = (1, 0): a reflection that leaves vertical light
 * vertical. That holds near the camera's equator only. A light above or below it is reflected in a
 * plane that is tilted against its axis, and the two polarisations across and in that plane are
 * reflected unequally; so a is a number of its own for every light.
 *
 * From the half vector. Light comes from l, leaves towards the camera along v (unit vectors, both
 * away from the surface), so the reflecting facet faces h = (l + v)/|l + v| at incidence theta,
 * cos theta = |l + v|/2, whatever the roughness. With s a unit vector along l x v, the amplitude
 * Fresnel coefficients r_s, r_p (Born and Wolf, Principles of Optics, 1.5.2, the sign of r_p such
 * that r_p = -r_s at normal incidence), and M e = e - 2 (e.h) h the mirror image of the field e, a
 * field leaves as
 *
 *     e' = -r_p M e + (r_s + r_p) (e.s) s
 *
 * (M keeps the part along s and turns the part in the plane of incidence over, hence the sign).
 * Through an analyser along a it has the power (a.e')^2 = A^2:
 *
 *     A = -r_p (a.e - 2 (e.h)(a.h)) + (r_s + r_p) (e.s)(a.s)
 *
 * At normal incidence r_s + r_p = 0 and s, undefined, is not needed. a_V = A_V^2 / (A_V^2 + A_H^2).
 * A vertical polariser's sheet lies across the light's aim at the stage's centre; its axis is the
 * vertical (+y) projected into the sheet, "as vertical as the light allows". A light straight above
 * or below has no such direction, and there the axis points away from the camera (-z). The
 * horizontal one's axis is across both. A ray that leaves the sheet at an angle is polarised along
 * the axis projected across the ray; so is the analyser's axis, the camera's up.
 *
 * Where on the subject? Lights stand 1 to 2 m away, so l, v and the axes turn by degrees from one
 * point of a subject to another, and a_H, which is small, by a good part of itself: at the centre
 * and 0.1 m beside it 0.06 and 0.04 are usual for a light 40 degrees up. A rounded subject shows a
 * light's highlight where its surface faces h, as a sphere of its size would:
 * ls_polarisation_highlight finds that point. Nobody knows the subject's shape, so one a serves all
 * pixels of a light, and what is off puts 2 |a_H' - a_H| / |a_V - a_H| of a highlight into D. Its
 * mean over the separable of 346 lights at 1.35 m, camera at 1.6 m, and how many of them exceed 20
 * %:
 *
 *     a taken from            subject's radius  0       0.05 m     0.1 m      0.15 m
 *     the stage's centre                        0       7 %, 22    14 %, 42   19 %, 58
 *     a sphere of 0.075 m                       9 %, 34  3 %, 8     3 %, 8     8 %, 32
 *     a sphere of 0.1 m                        13 %, 42  8 %, 20    0          7 %, 16
 *     a = (1, 0), the paper's                  18 %, 76 15 %, 64   11 %, 44    8 %, 28
 *
 * Where nothing is measured, 0.075 m is taken: over all these subjects its worst is the least.
 * Those are at the centre; beside it by 0.1 m, of 0.05 m, it leaves 7 to 11 % (the centre's a: 10
 * to 14 %).
 *
 * Conductors reflect both polarisations nearly alike, so their own a differs from a dielectric's.
 * That does no harm where their diffuse and specular parts are promoted by the same ratio, as
 * core/conductor.h does: D + S = V + H whatever a is.
 */
#ifndef LS_CORE_POLARISATION_H
#define LS_CORE_POLARISATION_H

#include "core/error.h"
#include "core/field.h"

#include <stdbool.h>
#include <stdint.h>

/** a_V and a_H of one light. Made by this file they are >= 0 and sum to 1; measured ones may lie
 * outside [0, 1] by their noise. */
struct ls_polarisation {
    double v, h;
};

/** Below this |a_V - a_H| a light is inseparable: noise would be amplified more than fivefold. */
#define LS_POLARISATION_LEAST 0.2

/** The refractive index of glass, wax, skin and most coats, within 0.1. */
#define LS_POLARISATION_INDEX 1.5

/** a = (1, 0). RT-safe. */
struct ls_polarisation ls_polarisation_ideal(void);

/** Are V and H of such a light good for a separation? False for NaN. RT-safe. */
bool ls_polarisation_separable(struct ls_polarisation a);

/** Where a light and the camera stand, stage frame, m: origin at the centre, y up. */
struct ls_polarisation_path {
    double light[3];     /* position; it aims at the centre */
    double camera[3];    /* position */
    double camera_up[3]; /* the analyser's axis, any vector not along the view */
};

/**
 * The point of a sphere of @radius_m around the centre whose normal halves light and camera, within
 * 1e-9 m. @point = the centre for radius 0, and where the sphere hides the light from the camera or
 * shows it within 1e-3 of grazing. Errors: LS_ERR_INVALID (a position that is null, not finite, or
 * within twice the radius).
 */
LS_MUST_CHECK enum ls_err ls_polarisation_highlight(const struct ls_polarisation_path *path,
                                                    double radius_m, double point[3],
                                                    struct ls_diag *diag);

/**
 * a of a facet at @point (NULL: the centre) that mirrors the light into the camera. @index: of the
 * dielectric, > 1. Where the camera's polariser stops both reflections (power below 1e-6, as at the
 * Brewster angle straight above) there is no highlight to speak of: a = (1/2, 1/2), which is
 * inseparable. Accuracy: 1e-12 against exact arithmetic, away from that case. Errors:
 * LS_ERR_INVALID (a position that is at the point or not finite, a light at the centre, an axis
 * along the view, an index not in (1, 100)).
 */
LS_MUST_CHECK enum ls_err ls_polarisation_reflect(const struct ls_polarisation_path *path,
                                                  const double point[3], double index,
                                                  struct ls_polarisation *out,
                                                  struct ls_diag *diag);

/** Half a middling subject, m. */
#define LS_POLARISATION_SUBJECT_M 0.075

/** a where a sphere of LS_POLARISATION_SUBJECT_M shows the light, of LS_POLARISATION_INDEX: for
 * subjects nobody knows, where it was not measured. Errors: those of both above. */
LS_MUST_CHECK enum ls_err ls_polarisation_assume(const struct ls_polarisation_path *path,
                                                 struct ls_polarisation *out, struct ls_diag *diag);

/** Pictures of a black glossy sphere under one light, spans of width x height samples of one
 * channel, or mosaics; gained, so that a depolariser reads V = H. */
struct ls_polarisation_probe {
    const float *v, *h;
    const float *w;         /* unpolarised, in the scale of V + H; or NULL */
    const uint8_t *on_ball; /* 1 where the sphere is, or NULL: everywhere */
    uint32_t width, height;
    struct ls_field_noise noise; /* of a sample of V or H; what all lights share is left out */
};

struct ls_polarisation_measured {
    struct ls_polarisation a;
    double sigma;    /* standard error of a_V, and of a_H, from the noise given */
    double closure;  /* (V + H) / W of the highlight; 0 without W */
    double x, y;     /* the highlight's centre of gravity, px, middle of the first pixel 0.5 */
    uint32_t n_used; /* samples of the highlight */
};

/**
 * a_V = sum (V - V0) / sum (V + H - V0 - H0) over the highlight. Its middle is the brightest 3 x 3
 * mean of V + H; with rho the radius of a disc as large as what exceeds half of that, it is all
 * samples within 3 rho, and V0, H0 are the means of those from 4 to 7 rho around it. What little a
 * black ball scatters is the same there and goes; the highlight's own tail there has the same a, so
 * that its loss does not bias the quotient. Samples that are off the ball or not finite are left
 * out. Errors: LS_ERR_INVALID (sizes, noise), LS_ERR_NOT_FOUND (no 3 x 3 mean of 10 sigma, a
 * highlight below 10 sigma, or one without a ring of 8 samples: take a from the half vector).
 */
LS_MUST_CHECK enum ls_err ls_polarisation_measure(const struct ls_polarisation_probe *probe,
                                                  struct ls_polarisation_measured *out,
                                                  struct ls_diag *diag);

#endif

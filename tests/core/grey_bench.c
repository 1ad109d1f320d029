#include "tests/core/grey_bench.h"

#include "core/pixel.h"
#include "core/vec3.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static void look(struct grey_bench *b, uint32_t camera, const struct ls_sphere *sphere)
{
    struct ls_diag diag = {{0}};
    ls_sphere_view_destroy(b->view[camera]);
    enum ls_err err = ls_sphere_view_create(
        &b->rig->camera[camera], strcmp(b->rig->options.cfa, "mono") ? LS_CFA_RGGB : LS_CFA_NONE,
        sphere, NULL, 0, &b->view[camera], &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

void grey_bench_fit(struct grey_bench *b, uint32_t camera, uint32_t channel, uint32_t light,
                    const double position[3], struct ls_shading *out)
{
    struct ls_diag diag = {{0}};
    grey_rig_picture(b->rig, camera, grey_rig_light(b->rig, channel, light), b->e, b->validity);
    for (uint32_t p = 0; b->tint && p < b->rig->n_pixels; p++) {
        uint32_t x = p % b->rig->options.size_px, y = p / b->rig->options.size_px;
        b->e[p] *= (float)b->tint[light][ls_cfa_channel(LS_CFA_RGGB, x, y)];
    }
    enum ls_err err = ls_shading_fit(b->view[camera], position, b->e, b->validity, out, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

/* Move the sphere to where the shading under every fifth light says it is. */
static void refine(struct grey_bench *b, uint32_t camera, struct ls_sphere *sphere)
{
    uint32_t n = b->rig->n_lights;
    struct ls_shading *fits = g_new0(struct ls_shading, n);
    for (uint32_t i = 0; i < n; i += 5) {
        double position[3];
        grey_rig_position(b->rig, i, position);
        grey_bench_fit(b, camera, 0, i, position, &fits[i]);
    }
    double step[3], sigma[3];
    g_assert_cmpint(ls_centre_step(fits, n, step, sigma, NULL), ==, LS_OK);
    for (int k = 0; k < 3; k++)
        sphere->centre_m[k] += step[k];
    g_test_message("shading: off by %.3f %.3f %.3f mm (sigma %.3f %.3f %.3f)",
                   sphere->centre_m[0] * 1e3, sphere->centre_m[1] * 1e3, sphere->centre_m[2] * 1e3,
                   sigma[0] * 1e3, sigma[1] * 1e3, sigma[2] * 1e3);
    look(b, camera, sphere);
    g_free(fits);
}

/* From a guess two centimetres off to the place the shading says. */
static void find_sphere(struct grey_bench *b, uint32_t camera)
{
    struct ls_diag diag = {{0}};
    struct ls_sphere guess = b->rig->sphere, found;
    struct ls_outline outline;
    guess.centre_m[0] += 0.015;
    guess.centre_m[1] -= 0.012;
    grey_rig_picture(b->rig, camera, grey_rig_full(b->rig, 0), b->e, b->validity);
    enum ls_err err =
        ls_sphere_locate(&b->rig->camera[camera], b->e, &guess, &found, &outline, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_test_message("camera %u: outline off by %.2f %.2f %.2f mm, rms %.2f px of %u points", camera,
                   found.centre_m[0] * 1e3, found.centre_m[1] * 1e3, found.centre_m[2] * 1e3,
                   outline.rms_px, outline.n_used);
    look(b, camera, &found);
    for (int round = 0; round < 2; round++)
        refine(b, camera, &found);
}

struct grey_bench *grey_bench_new(const struct grey_rig_options *options)
{
    return grey_bench_new_with(options, 0.011, 14, 0.1);
}

struct grey_bench *grey_bench_new_with(const struct grey_rig_options *options, double sphere_duty,
                                       uint32_t n_groups, double group_duty)
{
    struct grey_bench *b = g_new0(struct grey_bench, 1);
    b->rig = grey_rig_create(options, sphere_duty, n_groups, group_duty);
    b->e = g_new(float, b->rig->n_pixels);
    b->validity = g_new(uint8_t, b->rig->n_pixels);
    for (uint32_t k = 0; k < options->n_cameras; k++)
        find_sphere(b, k);
    return b;
}

void grey_bench_free(struct grey_bench *b)
{
    for (uint32_t k = 0; k < SIM_MAX_CAMERAS; k++)
        ls_sphere_view_destroy(b->view[k]);
    g_free(b->e);
    g_free(b->validity);
    grey_rig_destroy(b->rig);
    g_free(b);
}

static void measured_init(struct grey_measured *m, const struct grey_bench *b)
{
    uint32_t n = b->rig->n_lights, cameras = b->rig->options.n_cameras;
    *m = (struct grey_measured){.fits = g_new0(struct ls_shading, n * cameras),
                                .strength = g_new0(double, n *cameras * 3),
                                .sigma = g_new0(double, n *cameras * 3),
                                .lit = g_new0(double, n *cameras),
                                .one_sided = g_new0(uint8_t, n)};
    m->gains.g = g_new0(double, n);
    m->gains.k = g_new0(double, n);
    m->gains.sigma_k = g_new0(double, n);
    m->gains.colour = g_new0(double, n * 3);
    m->gains.flags = g_new0(uint8_t, n);
}

void grey_measured_finish(struct grey_measured *m)
{
    g_free(m->fits);
    g_free(m->strength);
    g_free(m->sigma);
    g_free(m->lit);
    g_free(m->one_sided);
    g_free(m->gains.g);
    g_free(m->gains.k);
    g_free(m->gains.sigma_k);
    g_free(m->gains.colour);
    g_free(m->gains.flags);
}

void grey_bench_believed(const struct grey_bench *b, uint32_t light, double position[3])
{
    double d[3], e1[3], e2[3], angle = light * 2.399963, turn = b->misplaced_deg * M_PI / 180;
    grey_rig_position(b->rig, light, d);
    double distance = ls_unit3(d);
    ls_tangents(d, e1, e2);
    ls_along3(d, e1, turn * cos(angle), d);
    ls_along3(d, e2, turn * sin(angle), d);
    ls_unit3(d);
    for (int k = 0; k < 3; k++)
        position[k] = distance * d[k];
}

/* Arrays as ls_gains_solve takes them. */
static void lay_out(const struct grey_bench *b, struct grey_measured *m)
{
    uint32_t cameras = b->rig->options.n_cameras, colours = b->view[0]->n_colours;
    for (uint32_t k = 0; k < b->rig->n_lights * cameras; k++) {
        m->lit[k] = m->fits[k].lit;
        for (uint32_t c = 0; c < colours; c++) {
            m->strength[k * colours + c] = m->fits[k].strength[c];
            m->sigma[k * colours + c] = m->fits[k].sigma[c];
        }
    }
}

void grey_measure(struct grey_bench *b, uint32_t channel, struct grey_measured *m)
{
    struct ls_diag diag = {{0}};
    struct ls_shading_settled settled;
    uint32_t n = b->rig->n_lights, cameras = b->rig->options.n_cameras;
    uint32_t colours = b->view[0]->n_colours;
    measured_init(m, b);
    for (uint32_t i = 0; i < n; i++) {
        double position[3];
        grey_bench_believed(b, i, position);
        for (uint32_t k = 0; k < cameras; k++)
            grey_bench_fit(b, k, channel, i, position, &m->fits[i * cameras + k]);
        m->one_sided[i] =
            ls_gains_one_sided(position, (const double(*)[3])b->rig->camera_m, cameras);
    }
    g_assert_cmpint(ls_shading_settle(m->fits, n * cameras, &settled, NULL), ==, LS_OK);
    b->moved = settled.moved;
    g_test_message("lights stand %.3f degrees off, chi2 %.2f", settled.spread_deg, settled.chi2);
    lay_out(b, m);
    struct ls_gains_input in = {n, cameras, colours, m->strength, m->sigma, m->lit, m->one_sided};
    enum ls_err err = ls_gains_solve(&in, &m->gains, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

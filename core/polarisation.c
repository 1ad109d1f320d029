#include "core/polarisation.h"

#include <math.h>
#include <stdlib.h>

struct vec {
    double x, y, z;
};

static double dot(struct vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static struct vec cross(struct vec a, struct vec b)
{
    return (struct vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static struct vec scaled(struct vec a, double s)
{
    return (struct vec){a.x * s, a.y * s, a.z * s};
}

/* From @from (NULL: the origin) towards @to. */
static bool towards(const double to[3], const double from[3], struct vec *out)
{
    struct vec a = {to[0] - (from ? from[0] : 0), to[1] - (from ? from[1] : 0),
                    to[2] - (from ? from[2] : 0)};
    double most = fmax(fabs(a.x), fmax(fabs(a.y), fabs(a.z)));
    if (!isfinite(a.x + a.y + a.z) || !(most > 1e-100))
        return false;
    a = scaled(a, 1 / most);
    *out = scaled(a, 1 / sqrt(dot(a, a)));
    return true;
}

/* The unit vector across @ray nearest to @up; false where they coincide. */
static bool across(struct vec up, struct vec ray, struct vec *out)
{
    double along = dot(up, ray);
    struct vec a = {up.x - along * ray.x, up.y - along * ray.y, up.z - along * ray.z};
    double length = sqrt(dot(a, a));
    if (!(length > 1e-6))
        return false;
    *out = scaled(a, 1 / length);
    return true;
}

struct facet {
    struct vec l, v, analyser;
    double rs, rp;
};

static void fresnel(struct facet *facet, double index)
{
    struct vec sum = {facet->l.x + facet->v.x, facet->l.y + facet->v.y, facet->l.z + facet->v.z};
    double cosine = 0.5 * sqrt(dot(sum, sum));
    double inside = sqrt(1 - (1 - fmin(1, cosine * cosine)) / (index * index));
    facet->rs = (cosine - index * inside) / (cosine + index * inside);
    facet->rp = (index * cosine - inside) / (index * cosine + inside);
}

/* A of the header for light polarised along @e. With c = |l + v|^2 = 2 (1 + l.v) the half vector's
 * products are those of l + v over sqrt(c), and s = l x v over its length squared, 1 - (l.v)^2. */
static double amplitude(const struct facet *facet, struct vec e)
{
    struct vec l = facet->l, v = facet->v, a = facet->analyser,
               sum = {l.x + v.x, l.y + v.y, l.z + v.z};
    struct vec s = cross(l, v);
    double c = dot(sum, sum), sine2 = dot(s, s);
    double mirrored = dot(a, e);
    if (c > 1e-20) /* else grazing: the light goes straight on */
        mirrored -= 2 * dot(e, sum) * dot(a, sum) / c;
    double out = -facet->rp * mirrored;
    if (sine2 > 1e-20)
        out += (facet->rs + facet->rp) * dot(e, s) * dot(a, s) / sine2;
    return out;
}

struct ls_polarisation ls_polarisation_ideal(void)
{
    return (struct ls_polarisation){1, 0};
}

bool ls_polarisation_separable(struct ls_polarisation a)
{
    return fabs(a.v - a.h) >= LS_POLARISATION_LEAST;
}

/* Cosine of incidence at a point of a sphere around the centre, from @at. */
static double lit(const double point[3], const double at[3])
{
    struct vec n, d;
    return towards(point, NULL, &n) && towards(at, point, &d) ? dot(n, d) : 0;
}

/* The point of a sphere at @angle from @v towards @beside, which is across it. */
static void place(struct vec v, struct vec beside, double angle, double radius, double point[3])
{
    double c = radius * cos(angle), s = radius * sin(angle);
    point[0] = c * v.x + s * beside.x;
    point[1] = c * v.y + s * beside.y;
    point[2] = c * v.z + s * beside.z;
}

/* The normal turns in the plane of light, centre and camera from the camera to the light, and the
 * one's cosine falls while the other's rises. */
enum ls_err ls_polarisation_highlight(const struct ls_polarisation_path *path, double radius_m,
                                      double point[3], struct ls_diag *diag)
{
    struct vec l, v;
    point[0] = point[1] = point[2] = 0;
    double near = fmin(hypot(hypot(path->light[0], path->light[1]), path->light[2]),
                       hypot(hypot(path->camera[0], path->camera[1]), path->camera[2]));
    if (!towards(path->light, NULL, &l) || !towards(path->camera, NULL, &v) || !(radius_m >= 0) ||
        !(2 * radius_m < near))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: a sphere of %g m, light or camera at %g m: expected both at "
                       "least twice as far",
                       radius_m, near);
    double cosine = fmax(-1, fmin(1, dot(l, v))), low = 0, high = acos(cosine);
    struct vec beside = {0, 0, 0};
    if (!across(l, v, &beside)) /* in front or behind: no plane to search, n = v */
        high = 0;
    for (int k = 0; k < 60; k++) {
        double middle = 0.5 * (low + high);
        place(v, beside, middle, radius_m, point);
        if (lit(point, path->camera) > lit(point, path->light))
            low = middle;
        else
            high = middle;
    }
    if (radius_m > 0 && !(lit(point, path->light) > 1e-3))
        point[0] = point[1] = point[2] = 0;
    return LS_OK;
}

static bool facet_make(const struct ls_polarisation_path *path, const double point[3],
                       struct facet *out)
{
    struct vec up;
    return towards(path->light, point, &out->l) && towards(path->camera, point, &out->v) &&
           towards(path->camera_up, NULL, &up) && across(up, out->v, &out->analyser);
}

/* The vertical sheet's axis, in the sheet. */
static bool sheet_axis(const struct ls_polarisation_path *path, struct vec *out)
{
    struct vec aim;
    return towards(path->light, NULL, &aim) &&
           (across((struct vec){0, 1, 0}, aim, out) || across((struct vec){0, 0, -1}, aim, out));
}

enum ls_err ls_polarisation_reflect(const struct ls_polarisation_path *path, const double point[3],
                                    double index, struct ls_polarisation *out, struct ls_diag *diag)
{
    struct facet facet;
    struct vec axis, vertical;
    if (!facet_make(path, point, &facet) || !sheet_axis(path, &axis) ||
        !across(axis, facet.l, &vertical))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: light at (%g, %g, %g), camera at (%g, %g, %g): expected both "
                       "away from the centre and from the point, and the camera's up across its "
                       "view",
                       path->light[0], path->light[1], path->light[2], path->camera[0],
                       path->camera[1], path->camera[2]);
    if (!(index > 1 && index < 100))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: refractive index %g: expected within (1, 100)", index);
    fresnel(&facet, index);
    double v = amplitude(&facet, vertical), h = amplitude(&facet, cross(facet.l, vertical));
    double power = v * v + h * h;
    *out = power < 1e-6 ? (struct ls_polarisation){0.5, 0.5}
                        : (struct ls_polarisation){v * v / power, h * h / power};
    return LS_OK;
}

enum ls_err ls_polarisation_assume(const struct ls_polarisation_path *path,
                                   struct ls_polarisation *out, struct ls_diag *diag)
{
    double point[3];
    enum ls_err err = ls_polarisation_highlight(path, LS_POLARISATION_SUBJECT_M, point, diag);
    return err ? err : ls_polarisation_reflect(path, point, LS_POLARISATION_INDEX, out, diag);
}

/* A highlight: a patch, a ring around it, and what was found there. */
struct highlight {
    double x, y, radius; /* px */
    double mean;         /* of V + H over its brightest 3 x 3 samples */
};

/* Sums of V, H and W over some samples. */
struct tally {
    double v, h, w, variance_v, variance_h, x, y;
    uint32_t n;
};

static bool usable(const struct ls_polarisation_probe *probe, size_t k)
{
    return (!probe->on_ball || probe->on_ball[k]) && isfinite(probe->v[k]) &&
           isfinite(probe->h[k]) && (!probe->w || isfinite(probe->w[k]));
}

static double variance(const struct ls_polarisation_probe *probe, float e)
{
    return probe->noise.read_variance + probe->noise.shot * fmax((double)e, 0);
}

static void count(const struct ls_polarisation_probe *probe, size_t k, struct tally *t)
{
    double v = (double)probe->v[k], h = (double)probe->h[k];
    t->v += v;
    t->h += h;
    t->w += probe->w ? (double)probe->w[k] : 0;
    t->variance_v += variance(probe, probe->v[k]);
    t->variance_h += variance(probe, probe->h[k]);
    t->x += (v + h) * ((double)(k % probe->width) + 0.5);
    t->y += (v + h) * ((double)(k / probe->width) + 0.5);
    t->n++;
}

/* V + H over the 3 x 3 samples around one; 0 unless all nine are usable. */
static double patch_mean(const struct ls_polarisation_probe *probe, uint32_t x, uint32_t y)
{
    double sum = 0;
    for (uint32_t j = y - 1; j <= y + 1; j++)
        for (uint32_t i = x - 1; i <= x + 1; i++) {
            size_t k = (size_t)j * probe->width + i;
            if (!usable(probe, k))
                return 0;
            sum += (double)probe->v[k] + (double)probe->h[k];
        }
    return sum / 9;
}

/* The brightest 3 x 3 patch, and as radius the half width of what exceeds half of it around. */
static bool find_peak(const struct ls_polarisation_probe *probe, struct highlight *out)
{
    double best = 0;
    for (uint32_t y = 1; y + 1 < probe->height; y++)
        for (uint32_t x = 1; x + 1 < probe->width; x++) {
            double mean = patch_mean(probe, x, y);
            if (mean > best) {
                best = mean;
                *out = (struct highlight){x + 0.5, y + 0.5, 0, mean};
            }
        }
    uint32_t wide = 0;
    for (uint32_t y = 1; best > 0 && y + 1 < probe->height; y++)
        for (uint32_t x = 1; x + 1 < probe->width; x++)
            wide += patch_mean(probe, x, y) > best / 2;
    out->radius = fmax(1.5, sqrt(wide / M_PI));
    return best > 0;
}

/* Samples whose distance from the middle lies within [from, to) radii. */
static struct tally sum_ring(const struct ls_polarisation_probe *probe, const struct highlight *at,
                             double from, double to)
{
    struct tally t = {0};
    double inner = from * at->radius, outer = to * at->radius;
    for (uint32_t y = 0; y < probe->height; y++)
        for (uint32_t x = 0; x < probe->width; x++) {
            size_t k = (size_t)y * probe->width + x;
            double distance = hypot(x + 0.5 - at->x, y + 0.5 - at->y);
            if (distance >= inner && distance < outer && usable(probe, k))
                count(probe, k, &t);
        }
    return t;
}

enum ls_err ls_polarisation_measure(const struct ls_polarisation_probe *probe,
                                    struct ls_polarisation_measured *out, struct ls_diag *diag)
{
    struct highlight at = {0};
    if (!probe->width || !probe->height || probe->width > 1u << 20 || probe->height > 1u << 20 ||
        !(probe->noise.read_variance >= 0) || !(probe->noise.shot >= 0))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: a picture of %u x %u, noise %g and %g: expected a size, and "
                       "variances of at least 0",
                       probe->width, probe->height, probe->noise.read_variance, probe->noise.shot);
    if (!find_peak(probe, &at))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "polarisation: no light on the ball");
    struct tally in = sum_ring(probe, &at, 0, 3);
    struct tally ring = sum_ring(probe, &at, 4, 7);
    if (ring.n < 8)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "polarisation: the highlight at (%.0f, %.0f) lies at the edge of the ball",
                       at.x, at.y);
    double share = (double)in.n / ring.n, lost = share * share;
    double v = in.v - share * ring.v, h = in.h - share * ring.h, w = in.w - share * ring.w;
    double total = v + h, a = v / total;
    double variance_v = in.variance_v + lost * ring.variance_v;
    double variance_h = in.variance_h + lost * ring.variance_h;
    double dark = (ring.v + ring.h) / ring.n;
    double of_patch = sqrt((2 * probe->noise.read_variance + probe->noise.shot * at.mean) / 9);
    if (!(at.mean - dark > 10 * of_patch) || !(total > 10 * sqrt(variance_v + variance_h)))
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "polarisation: the highlight at (%.0f, %.0f) is lost in the noise", at.x,
                       at.y);
    *out = (struct ls_polarisation_measured){
        .a = {a, 1 - a},
        .sigma = sqrt((1 - a) * (1 - a) * variance_v + a * a * variance_h) / total,
        .closure = probe->w ? total / w : 0,
        .x = in.x / (in.v + in.h),
        .y = in.y / (in.v + in.h),
        .n_used = in.n};
    return LS_OK;
}

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

static bool unit(const double v[3], struct vec *out)
{
    double most = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!isfinite(v[0]) || !isfinite(v[1]) || !isfinite(v[2]) || !(most > 0))
        return false;
    struct vec a = {v[0] / most, v[1] / most, v[2] / most};
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

struct path {
    struct vec l, v, analyser;
    double rs, rp;
};

static void fresnel(struct path *path, double index)
{
    struct vec sum = {path->l.x + path->v.x, path->l.y + path->v.y, path->l.z + path->v.z};
    double cosine = 0.5 * sqrt(dot(sum, sum));
    double inside = sqrt(1 - (1 - fmin(1, cosine * cosine)) / (index * index));
    path->rs = (cosine - index * inside) / (cosine + index * inside);
    path->rp = (index * cosine - inside) / (index * cosine + inside);
}

/* A of the header for light polarised along @e. With c = |l + v|^2 = 2 (1 + l.v) the half vector's
 * products are those of l + v over sqrt(c), and s = l x v over its length squared, 1 - (l.v)^2. */
static double amplitude(const struct path *path, struct vec e)
{
    struct vec l = path->l, v = path->v, a = path->analyser,
               sum = {l.x + v.x, l.y + v.y, l.z + v.z};
    struct vec s = cross(l, v);
    double c = dot(sum, sum), sine2 = dot(s, s);
    double mirrored = dot(a, e);
    if (c > 1e-20) /* else grazing: the light goes straight on */
        mirrored -= 2 * dot(e, sum) * dot(a, sum) / c;
    double out = -path->rp * mirrored;
    if (sine2 > 1e-20)
        out += (path->rs + path->rp) * dot(e, s) * dot(a, s) / sine2;
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

enum ls_err ls_polarisation_reflect(const double to_light[3], const double to_camera[3],
                                    const double camera_up[3], double index,
                                    struct ls_polarisation *out, struct ls_diag *diag)
{
    struct path path;
    struct vec up, vertical;
    if (!unit(to_light, &path.l) || !unit(to_camera, &path.v) || !unit(camera_up, &up))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: the directions of light, camera and camera's up: expected "
                       "three vectors that are finite and not null");
    if (!across(up, path.v, &path.analyser))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: the camera's up lies along its view: expected it across");
    if (!(index > 1) || !(index < 100))
        return ls_fail(diag, LS_ERR_INVALID,
                       "polarisation: refractive index %g: expected within (1, 100)", index);
    if (!across((struct vec){0, 1, 0}, path.l, &vertical))
        across((struct vec){0, 0, -1}, path.l, &vertical);
    fresnel(&path, index);
    double v = amplitude(&path, vertical), h = amplitude(&path, cross(path.l, vertical));
    double power = v * v + h * h;
    *out = power < 1e-6 ? (struct ls_polarisation){0.5, 0.5}
                        : (struct ls_polarisation){v * v / power, h * h / power};
    return LS_OK;
}

/* A highlight: a patch, a ring around it, and what was found there. */
struct highlight {
    double x, y, radius; /* px */
    double level;        /* least V + H of the patch */
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
                *out = (struct highlight){x + 0.5, y + 0.5, 0, mean / 4};
            }
        }
    uint32_t wide = 0;
    for (uint32_t y = 1; best > 0 && y + 1 < probe->height; y++)
        for (uint32_t x = 1; x + 1 < probe->width; x++)
            wide += patch_mean(probe, x, y) > best / 2;
    out->radius = fmax(1.5, sqrt(wide / M_PI));
    return best > 0;
}

/* Samples whose distance from the middle lies within [from, to) radii, brighter than @least. */
static struct tally sum_ring(const struct ls_polarisation_probe *probe, const struct highlight *at,
                             double from, double to, double least)
{
    struct tally t = {0};
    double inner = from * at->radius, outer = to * at->radius;
    for (uint32_t y = 0; y < probe->height; y++)
        for (uint32_t x = 0; x < probe->width; x++) {
            size_t k = (size_t)y * probe->width + x;
            double distance = hypot(x + 0.5 - at->x, y + 0.5 - at->y);
            if (distance >= inner && distance < outer && usable(probe, k) &&
                (double)probe->v[k] + (double)probe->h[k] >= least)
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
    struct tally in = sum_ring(probe, &at, 0, 3, at.level);
    struct tally ring = sum_ring(probe, &at, 4, 7, -INFINITY);
    if (ring.n < 8)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "polarisation: the highlight at (%.0f, %.0f) lies at the edge of the ball",
                       at.x, at.y);
    double share = (double)in.n / ring.n, lost = share * share;
    double v = in.v - share * ring.v, h = in.h - share * ring.h, w = in.w - share * ring.w;
    double total = v + h, a = v / total;
    double variance_v = in.variance_v + lost * ring.variance_v;
    double variance_h = in.variance_h + lost * ring.variance_h;
    if (!(total > 10 * sqrt(variance_v + variance_h)))
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

#include "sim/subject.h"

#include <string.h>

enum {
    CHART_COLUMNS = 6,
    CHART_ROWS = 4,
    FABRIC_COLUMNS = 4,
    FABRIC_ROWS = 3,
};

static const struct sim_surface matte = {
    .finish = SIM_MATTE, .u1 = 1, .v1 = 1, .emitter = -1, .nodes_u = 2, .nodes_v = 2};

static uint16_t add_surface(struct sim_subject *s, struct sim_surface surface, uint16_t material)
{
    surface.material = material;
    surface.body = (uint16_t)s->n_bodies;
    s->surface[s->n_surfaces] = surface;
    return (uint16_t)s->n_surfaces++;
}

/* The body's surfaces must have been added just before, back first if it has one of its own. */
static struct sim_dress *add_body(struct sim_subject *s, struct sim_body body, uint16_t front)
{
    s->body[s->n_bodies] = body;
    struct sim_dress *dress = &s->dress[s->n_bodies++];
    *dress = (struct sim_dress){.front = front, .back = front};
    return dress;
}

static void add_plain(struct sim_subject *s, struct sim_body body, struct sim_surface surface,
                      uint16_t material)
{
    add_body(s, body, add_surface(s, surface, material));
}

/* A card: bouncing front, plain back. */
static void add_card(struct sim_subject *s, struct sim_body body, uint16_t material, int nodes_u,
                     int nodes_v)
{
    struct sim_surface front = matte, back = matte;
    back.part = 1;
    back.nodes_u = back.nodes_v = 0;
    front.nodes_u = (uint16_t)nodes_u;
    front.nodes_v = (uint16_t)nodes_v;
    uint16_t f = add_surface(s, front, material);
    uint16_t b = add_surface(s, back, material);
    add_body(s, body, f)->back = b;
}

/* A board with a grid of samples, first cell top left. */
static uint16_t add_grid(struct sim_subject *s, struct sim_body body, int columns, int rows,
                         float fill, uint16_t first_material, struct sim_surface sample)
{
    struct sim_surface frame = matte;
    frame.nodes_u = frame.nodes_v = 0;
    uint16_t frame_surface = add_surface(s, frame, SIM_MAT_BOARD);
    uint16_t first = (uint16_t)s->n_surfaces;
    for (int k = 0; k < columns * rows; k++) {
        float u = (float)(k % columns), v = (float)(rows - 1 - k / columns);
        float margin = 0.5f * (1 - fill);
        sample.u0 = (u + margin) / (float)columns;
        sample.u1 = (u + 1 - margin) / (float)columns;
        sample.v0 = (v + margin) / (float)rows;
        sample.v1 = (v + 1 - margin) / (float)rows;
        add_surface(s, sample, (uint16_t)(first_material + k));
    }
    struct sim_dress *dress = add_body(s, body, frame_surface);
    dress->first_patch = first;
    dress->columns = (uint16_t)columns;
    dress->rows = (uint16_t)rows;
    dress->fill = fill;
    return first;
}

/* Rectangle of @width x @height, its middle at @centre, leaning back by @tilt, turned by @turn
 * about y (positive: towards +x); radians. */
static struct sim_body board(struct sim_vec centre, double width, double height, double tilt,
                             double turn)
{
    struct sim_vec u = sim_vec(cos(turn), 0, -sin(turn));
    struct sim_vec out = sim_vec(sin(turn), 0, cos(turn));
    struct sim_vec v = sim_sub(sim_vec(0, cos(tilt), 0), sim_mul(out, (float)sin(tilt)));
    u = sim_mul(u, (float)width);
    v = sim_mul(v, (float)height);
    return sim_quad(sim_along(sim_along(centre, u, -0.5f), v, -0.5f), u, v);
}

static void add_box(struct sim_subject *s, struct sim_vec bottom, double half, double height,
                    double turn, struct sim_surface surface, uint16_t material)
{
    for (int k = 0; k < 4; k++) {
        double a = turn + k * M_PI / 2;
        struct sim_vec out = sim_vec(sin(a), 0, cos(a));
        struct sim_vec middle =
            sim_add(sim_along(bottom, out, (float)half), sim_vec(0, height / 2, 0));
        add_plain(s, board(middle, 2 * half, height, 0, a), surface, material);
    }
    struct sim_vec u = sim_vec(2 * half * cos(turn), 0, -2 * half * sin(turn));
    struct sim_vec v = sim_vec(-2 * half * sin(turn), 0, -2 * half * cos(turn));
    struct sim_vec top = sim_add(bottom, sim_vec(0, height, 0));
    add_plain(s, sim_quad(sim_along(sim_along(top, u, -0.5f), v, -0.5f), u, v), surface, material);
}

static void add_sphere(struct sim_subject *s, struct sim_vec centre, double radius,
                       enum sim_finish finish, float alpha, uint16_t material)
{
    struct sim_surface surface = matte;
    surface.finish = finish;
    surface.alpha = alpha;
    surface.nodes_u = finish == SIM_METAL ? 0 : 12;
    surface.nodes_v = finish == SIM_METAL ? 0 : 6;
    add_plain(s, sim_sphere(centre, radius), surface, material);
}

static void add_cup(struct sim_subject *s, struct sim_vec bottom, double radius, double height)
{
    struct sim_surface outside = matte, inside = matte;
    outside.nodes_u = 16;
    outside.nodes_v = 6;
    inside.part = 1;
    inside.nodes_u = 12;
    inside.nodes_v = 5;
    uint16_t front = add_surface(s, outside, SIM_MAT_CUP);
    uint16_t back = add_surface(s, inside, SIM_MAT_CUP);
    add_body(s, sim_tube(bottom, radius, height), front)->back = back;
}

static void build_stilllife(struct sim_subject *s)
{
    const double floor_y = -0.22;
    struct sim_surface coat = matte;
    coat.finish = SIM_COATED;
    coat.alpha = 0.30f;
    struct sim_surface cloth = coat;
    cloth.alpha = 0.45f;
    cloth.weave = 0.08f;
    cloth.weave_u = cloth.weave_v = 8;
    struct sim_surface wax = coat;
    wax.alpha = 0.12f;
    wax.bend = 0.30f;
    struct sim_surface top = matte;
    top.nodes_u = 12;
    top.nodes_v = 10;
    struct sim_surface wall = matte;
    wall.nodes_u = 8;
    wall.nodes_v = 5;

    add_plain(s, sim_quad(sim_vec(-0.46, floor_y, 0.70), sim_vec(0.92, 0, 0), sim_vec(0, 0, -1.10)),
              top, SIM_MAT_TABLE);
    add_plain(s, board(sim_vec(0, -0.07, -0.40), 0.92, 0.30, 0, 0), wall, SIM_MAT_TABLE);
    s->chart = add_grid(s, board(sim_vec(-0.205, 0.19, -0.31), 0.355, 0.240, 0.10, 0),
                        CHART_COLUMNS, CHART_ROWS, 0.84f, SIM_MAT_CHART, coat);
    s->fabrics = add_grid(s, board(sim_vec(0.205, 0.19, -0.31), 0.335, 0.252, 0.10, 0),
                          FABRIC_COLUMNS, FABRIC_ROWS, 0.90f, SIM_MAT_FABRIC, cloth);
    s->velvet = (uint16_t)s->n_surfaces;
    add_plain(s, board(sim_vec(0.0, -0.01, -0.25), 0.13, 0.10, 0.05, 0), matte, SIM_MAT_VELVET);
    add_sphere(s, sim_vec(-0.27, floor_y + 0.085, 0.0), 0.085, SIM_MATTE, 0, SIM_MAT_OCHRE);
    add_sphere(s, sim_vec(0.26, floor_y + 0.08, 0.02), 0.08, SIM_METAL, 0.30f, SIM_MAT_RED_METAL);
    add_sphere(s, sim_vec(0.155, floor_y + 0.03, 0.22), 0.03, SIM_METAL, 0.25f, SIM_MAT_GOLD);
    add_card(s, board(sim_vec(-0.105, floor_y + 0.075, 0.02), 0.17, 0.15, 0, 0.95),
             SIM_MAT_RED_FELT, 6, 6);
    add_card(s, board(sim_vec(0.105, floor_y + 0.075, 0.02), 0.17, 0.15, 0, -0.95),
             SIM_MAT_GREEN_FELT, 6, 6);
    add_cup(s, sim_vec(0, floor_y, 0.06), 0.045, 0.105);
    add_box(s, sim_vec(-0.17, floor_y, 0.20), 0.03, 0.085, 0.45, wax, SIM_MAT_WAX);
}

/* Materials whose highlights differ, side by side. */
static void build_highlights(struct sim_subject *s)
{
    add_sphere(s, sim_vec(-0.055, 0.055, 0), 0.05, SIM_COATED, 0.20f, SIM_MAT_RED_WAX);
    add_sphere(s, sim_vec(0.055, 0.055, 0), 0.05, SIM_MATTE, 0, SIM_MAT_OCHRE);
    add_sphere(s, sim_vec(-0.055, -0.055, 0), 0.05, SIM_METAL, 0.25f, SIM_MAT_GOLD);
    add_sphere(s, sim_vec(0.055, -0.055, 0), 0.05, SIM_METAL, 0.25f, SIM_MAT_CHROME);
}

static void number_nodes(struct sim_subject *s)
{
    for (uint32_t i = 0; i < s->n_surfaces; i++) {
        s->surface[i].first_node = s->n_nodes;
        s->n_nodes += (uint32_t)s->surface[i].nodes_u * s->surface[i].nodes_v;
    }
}

static void choose_emitters(struct sim_subject *s)
{
    static const uint16_t bouncing[] = {SIM_MAT_TABLE, SIM_MAT_CUP, SIM_MAT_RED_FELT,
                                        SIM_MAT_GREEN_FELT};
    for (int k = 0; k < 4; k++) {
        s->emitter_material[k] = bouncing[k];
        for (uint32_t i = 0; i < s->n_surfaces; i++)
            if (s->surface[i].material == bouncing[k] && s->surface[i].nodes_u)
                s->surface[i].emitter = (int16_t)k;
    }
    s->n_emitters = 4;
}

void sim_subject_build(const char *scene, double r, struct sim_subject *s)
{
    memset(s, 0, sizeof *s);
    s->chart = s->fabrics = s->velvet = SIM_NO_SURFACE;
    struct sim_vec centre = sim_vec(0, 0, 0);
    if (!strcmp(scene, "stilllife")) {
        build_stilllife(s);
        choose_emitters(s);
        number_nodes(s);
    } else if (!strcmp(scene, "grey"))
        add_sphere(s, centre, r, SIM_MATTE, 0, SIM_MAT_GREY33);
    else if (!strcmp(scene, "chrome"))
        add_sphere(s, centre, r, SIM_METAL, 0.05f, SIM_MAT_CHROME);
    else if (!strcmp(scene, "gloss"))
        add_sphere(s, centre, r, SIM_COATED, 0.08f, SIM_MAT_BLACK_GLASS);
    else if (!strcmp(scene, "highlights"))
        build_highlights(s);
}

static uint16_t grid_surface(const struct sim_dress *dress, float *u, float *v)
{
    float x = *u * dress->columns, y = *v * dress->rows;
    int column = (int)fminf(floorf(x), (float)dress->columns - 1);
    int row = (int)fminf(floorf(y), (float)dress->rows - 1);
    float lo = 0.5f * (1 - dress->fill);
    float cu = (x - (float)column - lo) / dress->fill, cv = (y - (float)row - lo) / dress->fill;
    if (cu < 0 || cu > 1 || cv < 0 || cv > 1)
        return dress->front;
    *u = cu;
    *v = cv;
    return (uint16_t)(dress->first_patch + (dress->rows - 1 - row) * dress->columns + column);
}

uint16_t sim_subject_surface(const struct sim_subject *s, uint32_t body, int part, float u, float v,
                             float *su, float *sv)
{
    const struct sim_dress *dress = &s->dress[body];
    *su = u;
    *sv = v;
    if (part)
        return dress->back;
    return dress->columns ? grid_surface(dress, su, sv) : dress->front;
}

uint16_t sim_subject_trace(const struct sim_subject *s, struct sim_vec o, struct sim_vec d,
                           struct sim_hit *hit)
{
    uint32_t found = SIM_MAX_BODIES;
    hit->t = 1e9f;
    for (uint32_t i = 0; i < s->n_bodies; i++)
        if (sim_body_hit(&s->body[i], o, d, 1e-4f, hit->t, hit))
            found = i;
    if (found == SIM_MAX_BODIES)
        return SIM_NO_SURFACE;
    return sim_subject_surface(s, found, hit->part, hit->u, hit->v, &hit->u, &hit->v);
}

int sim_subject_visible(const struct sim_subject *s, struct sim_vec x, struct sim_vec y)
{
    struct sim_vec d = sim_sub(y, x);
    float length = sim_length(d);
    d = sim_mul(d, 1 / length);
    for (uint32_t i = 0; i < s->n_bodies; i++)
        if (sim_body_blocks(&s->body[i], x, d, 1e-4f, length - 1e-4f))
            return 0;
    return 1;
}

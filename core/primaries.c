#include "core/primaries.h"

#include "core/vec3.h"

const struct ls_primaries ls_primaries_rec709 = {
    {{0.640, 0.330}, {0.300, 0.600}, {0.150, 0.060}, {0.3127, 0.3290}}};
const struct ls_primaries ls_primaries_acescg = {
    {{0.713, 0.293}, {0.165, 0.830}, {0.128, 0.044}, {0.32168, 0.33767}}};

static const double bradford[3][3] = {
    {0.8951, 0.2664, -0.1614}, {-0.7502, 1.7135, 0.0367}, {0.0389, -0.0685, 1.0296}};

static void xyz_of_xy(const double xy[2], double xyz[3])
{
    xyz[0] = xy[0] / xy[1];
    xyz[1] = 1;
    xyz[2] = (1 - xy[0] - xy[1]) / xy[1];
}

/* Of columns: the rows of the inverse are their cross products over the determinant. */
static void invert(const double columns[3][3], double rows[3][3])
{
    for (int c = 0; c < 3; c++) {
        ls_cross3(columns[(c + 1) % 3], columns[(c + 2) % 3], rows[c]);
        double s = ls_dot3(rows[c], columns[c]);
        for (int k = 0; k < 3; k++)
            rows[c][k] /= s;
    }
}

/* The columns of to_xyz: primaries in the amounts that make white. */
static void scaled(const struct ls_primaries *primaries, double columns[3][3])
{
    double rows[3][3], white[3];
    for (int c = 0; c < 3; c++)
        xyz_of_xy(primaries->xy[c], columns[c]);
    xyz_of_xy(primaries->xy[3], white);
    invert(columns, rows);
    for (int c = 0; c < 3; c++) {
        double amount = ls_dot3(rows[c], white);
        for (int k = 0; k < 3; k++)
            columns[c][k] *= amount;
    }
}

static void transpose(const double in[3][3], double out[3][3])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[r][c] = in[c][r];
}

void ls_primaries_to_xyz(const struct ls_primaries *primaries, double m[3][3])
{
    double columns[3][3];
    scaled(primaries, columns);
    transpose(columns, m);
}

void ls_primaries_from_xyz(const struct ls_primaries *primaries, double m[3][3])
{
    double columns[3][3];
    scaled(primaries, columns);
    invert(columns, m);
}

/* XYZ under one white to XYZ under another. */
static void adapt(const double from_xy[2], const double to_xy[2], double m[3][3])
{
    double from[3], to[3], columns[3][3], back[3][3], scaled_cones[3][3];
    xyz_of_xy(from_xy, from);
    xyz_of_xy(to_xy, to);
    for (int r = 0; r < 3; r++) {
        double ratio = ls_dot3(bradford[r], to) / ls_dot3(bradford[r], from);
        for (int c = 0; c < 3; c++)
            scaled_cones[r][c] = ratio * bradford[r][c];
    }
    transpose(bradford, columns);
    invert(columns, back);
    ls_colours_multiply(back, scaled_cones, m);
}

void ls_primaries_convert(const struct ls_primaries *from, const struct ls_primaries *to,
                          double m[3][3])
{
    double in[3][3], white[3][3], out[3][3], adapted[3][3];
    ls_primaries_to_xyz(from, in);
    adapt(from->xy[3], to->xy[3], white);
    ls_primaries_from_xyz(to, out);
    ls_colours_multiply(white, in, adapted);
    ls_colours_multiply(out, adapted, m);
}

void ls_colours_multiply(const double a[3][3], const double b[3][3], double out[3][3])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[r][c] = a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c];
}

void ls_colours_apply(const double m[3][3], const float *rgb, size_t n, float *out)
{
    for (size_t i = 0; i < n; i++, rgb += 3, out += 3) {
        const double v[3] = {(double)rgb[0], (double)rgb[1], (double)rgb[2]};
        for (int r = 0; r < 3; r++)
            out[r] = (float)ls_dot3(m[r], v);
    }
}

#include "core/view.h"

#include <math.h>
#include <string.h>

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double normalise(double v[3])
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3 && length > 0; i++)
        v[i] /= length;
    return length;
}

void ls_world_to_camera(const float position_m[3], const float look_at_m[3], float matrix[16])
{
    double axes[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    double up[3] = {0, 1, 0}, back[3] = {0, 0, -1};
    for (int i = 0; i < 3; i++)
        axes[2][i] = (double)position_m[i] - look_at_m[i];
    if (normalise(axes[2]) == 0)
        axes[2][2] = 1;
    cross(up, axes[2], axes[0]);
    if (normalise(axes[0]) < 1e-9) {
        cross(back, axes[2], axes[0]);
        normalise(axes[0]);
    }
    cross(axes[2], axes[0], axes[1]);
    memset(matrix, 0, 16 * sizeof *matrix);
    for (int column = 0; column < 3; column++) {
        double offset = 0;
        for (int row = 0; row < 3; row++) {
            matrix[4 * row + column] = (float)axes[column][row];
            offset -= position_m[row] * axes[column][row];
        }
        matrix[12 + column] = (float)offset;
    }
    matrix[15] = 1;
}

/* positions: what is read is finite, at most as many as asked for, and the same after it was
 * printed and read again. */
#include "core/positions.h"
#include "tests/fuzz/fuzz.h"

#include <math.h>
#include <string.h>

enum { MAX = 64 };

static void print(const struct ls_positions *positions, char *text, size_t size)
{
    size_t used = 0;
    for (uint32_t i = 0; i < positions->n; i++)
        used += (size_t)snprintf(text + used, size - used, "%.9g,%.9g,%.9g,%u\n",
                                 (double)positions->xyz_m[i][0], (double)positions->xyz_m[i][1],
                                 (double)positions->xyz_m[i][2], positions->address[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    static const char *const units[] = {"m", "cm", "mm"};
    static const char *const axes[] = {"right,up,towards", "left,down,away", "towards,right,up",
                                       "right,right,up"};
    struct ls_positions first = {0}, again = {0};
    struct ls_diag diag = {0};
    char text[MAX * 64];
    if (n < 1)
        return 0;
    uint8_t *copy = malloc(n); /* no NUL after it */
    HOLDS(copy);
    memcpy(copy, data, n);
    enum ls_err err = ls_positions_parse((const char *)copy + 1, n - 1, "a.csv", axes[data[0] & 3],
                                         units[(data[0] >> 2) % 3], MAX, &first, &diag);
    free(copy);
    HOLDS_REFUSED(err, diag);
    if (err)
        return 0;
    HOLDS(first.n >= 1 && first.n <= MAX);
    for (uint32_t i = 0; i < first.n; i++)
        HOLDS(isfinite(first.xyz_m[i][0]) && isfinite(first.xyz_m[i][1]) &&
              isfinite(first.xyz_m[i][2]));
    print(&first, text, sizeof text);
    HOLDS(!ls_positions_parse(text, strlen(text), "b.csv", axes[0], "m", MAX, &again, NULL));
    HOLDS(again.n == first.n);
    HOLDS(!memcmp(again.xyz_m, first.xyz_m, first.n * sizeof *first.xyz_m));
    HOLDS(!memcmp(again.address, first.address, first.n * sizeof *first.address));
    ls_positions_finish(&first);
    ls_positions_finish(&again);
    return 0;
}

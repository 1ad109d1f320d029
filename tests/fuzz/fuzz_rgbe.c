/* rgbe: what is read is light: finite and not negative; within its limit of memory. */
#include "core/rgbe.h"
#include "tests/fuzz/fuzz.h"

#include <math.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    static const size_t limit = 8 << 20;
    struct ls_image image = {0};
    struct ls_diag diag = {0};
    enum ls_err err = ls_rgbe_read(data, n, limit, &image, &diag);
    HOLDS_REFUSED(err, diag);
    if (!err) {
        size_t samples = (size_t)image.width * image.height * 3;
        HOLDS(image.n_channels == 3 && samples && samples * sizeof(float) <= limit);
        for (size_t k = 0; k < samples; k++)
            HOLDS(isfinite(image.pixels[k]) && image.pixels[k] >= 0);
    }
    ls_image_finish(&image);
    return 0;
}

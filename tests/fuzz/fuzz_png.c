/* png: what is read lies in [0, 1], and is there again, to the codes of eight bits, after it was
 * written. */
#include "core/png.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    static const size_t limit = 8 << 20;
    struct ls_image image = {0}, back = {0};
    struct ls_diag diag = {0};
    enum ls_err err = ls_png_read(data, n, true, limit, &image, &diag);
    HOLDS_REFUSED(err, diag);
    if (err)
        return 0;
    size_t samples = (size_t)image.width * image.height * image.n_channels;
    HOLDS(samples && samples * sizeof(float) <= limit);
    for (size_t k = 0; k < samples; k++)
        HOLDS(image.pixels[k] >= 0 && image.pixels[k] <= 1);
    if (samples < 1 << 16) {
        uint8_t *first = NULL, *second = NULL;
        size_t n_first, n_second;
        HOLDS(!ls_png_write(&image, 1, &first, &n_first, NULL));
        HOLDS(!ls_png_read(first, n_first, true, limit, &back, NULL));
        HOLDS(back.width == image.width && back.height == image.height &&
              back.n_channels == image.n_channels);
        HOLDS(!ls_png_write(&back, 1, &second, &n_second, NULL));
        HOLDS(n_first == n_second && !memcmp(first, second, n_first));
        free(first);
        free(second);
        ls_image_finish(&back);
    }
    ls_image_finish(&image);
    return 0;
}

/* calibration: what is read is the same after it was written and read again. */
#include "core/calibration.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    struct ls_calibration *first = NULL, *second = NULL;
    struct ls_diag diag = {0};
    char *text, *again;
    char *copy = fuzz_text(data, n);
    enum ls_err err = ls_calibration_parse(copy, n, &first, &diag);
    free(copy);
    HOLDS_REFUSED(err, diag);
    if (err)
        return 0;
    HOLDS(first->n_lights && first->n_lights <= LS_CALIBRATION_MAX_LIGHTS);
    HOLDS(first->n_channels && first->n_channels <= LS_CALIBRATION_MAX_CHANNELS);
    HOLDS(!ls_calibration_write(first, &text, &diag));
    err = ls_calibration_parse(text, strlen(text), &second, &diag);
    if (err)
        fprintf(stderr, "%s\n", diag.text);
    HOLDS(!err);
    HOLDS(!ls_calibration_write(second, &again, NULL));
    HOLDS(!strcmp(text, again));
    ls_calibration_destroy(first);
    ls_calibration_destroy(second);
    free(text);
    free(again);
    return 0;
}

/* slate: what is read could be written down, and is the same after it was. A damaged slate is
 * replaced by the next one. */
#include "daemon/slate.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

static int same(const struct ls_slate *a, const struct ls_slate *b)
{
    return !strcmp(a->slate, b->slate) && !strcmp(a->scene, b->scene) && a->take == b->take &&
           a->circled == b->circled && !strcmp(a->timecode, b->timecode) &&
           !strcmp(a->notes, b->notes);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    struct ls_slate first, now, back;
    struct ls_diag diag = {0};
    bool damaged;
    fuzz_file("slate.json", data, n);
    enum ls_err err = ls_slate_read(fuzz_folder(), &first, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(!err || err == LS_ERR_INVALID);
    if (!err)
        HOLDS(!ls_slate_check(&first, NULL));
    now = err ? (struct ls_slate){.slate = "12A", .take = 3} : first;
    HOLDS(!ls_slate_change(fuzz_folder(), LS_SLATE_ALL, &now, &damaged, NULL));
    HOLDS(damaged == !!err);
    HOLDS(!ls_slate_read(fuzz_folder(), &back, NULL));
    HOLDS(same(&back, &now));
    return 0;
}

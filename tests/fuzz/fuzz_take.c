/* take: take.json of anybody's making. What serving takes from it names lights and channels that
 * are there; what the store takes from it is the same after it was written and read again. */
#include "daemon/store.h"
#include "daemon/take_facts.h"
#include "daemon/take_head.h"
#include "daemon/take_json.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/fuzz_rig.h"

#include <math.h>
#include <string.h>

static void check_condition(const struct ls_condition_fact *c, const struct ls_take_facts *facts)
{
    HOLDS(memchr(c->id, 0, sizeof c->id) && memchr(c->pattern, 0, sizeof c->pattern));
    if (c->kind == LS_FACT_OTHER || c->kind == LS_FACT_DARK)
        return;
    HOLDS(c->channel < facts->n_channels && c->duty > 0 && c->duty <= 1);
    HOLDS(c->kind != LS_FACT_ONE || c->light < facts->n_lights);
    HOLDS(c->n_lights <= facts->n_lights);
    for (uint32_t k = 0; k < c->n_lights; k++)
        HOLDS(c->lights[k] < facts->n_lights && (!k || c->lights[k] > c->lights[k - 1]));
}

static void check_facts(const char *text)
{
    for (uint32_t camera = 0; camera < 2; camera++) {
        struct ls_take_facts *facts = NULL;
        struct ls_diag diag = {0};
        enum ls_err err = ls_take_facts_read(text, camera, &facts, &diag);
        HOLDS_REFUSED(err, diag);
        HOLDS(!err == !!facts);
        for (uint32_t i = 0; facts && i < facts->n_conditions; i++)
            check_condition(&facts->conditions[i], facts);
        for (uint32_t i = 0; facts && i < facts->n_exposures; i++)
            HOLDS(facts->exposure_s[i] > 0 && isfinite(facts->exposure_s[i]));
        HOLDS(!facts || (facts->n_lights >= 1 && facts->n_channels <= LS_MAX_CHANNELS));
        ls_take_facts_destroy(facts);
    }
}

static void check_head(const char *text, size_t n)
{
    struct ls_take_head first = {0}, again = {0};
    struct ls_diag diag = {0};
    char *written = NULL;
    enum ls_err err = ls_take_head_parse(text, n, &first, &diag);
    HOLDS_REFUSED(err, diag);
    if (!err) {
        HOLDS(!ls_take_head_write(&first, "{}", NULL, 0, NULL, &written, NULL));
        HOLDS(!ls_take_head_parse(written, strlen(written), &again, NULL));
        HOLDS(first.state == again.state && !strcmp(first.name, again.name) &&
              !strcmp(first.utc, again.utc) && first.n_cameras == again.n_cameras &&
              first.n_shots == again.n_shots && first.n_conditions == again.n_conditions &&
              first.keep_raw == again.keep_raw);
        for (uint32_t i = 0; i < first.n_conditions; i++)
            HOLDS(!strcmp(first.conditions[i], again.conditions[i]));
    }
    free(written);
    ls_take_head_finish(&first);
    ls_take_head_finish(&again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    static const struct ls_lights_info lights;
    static const struct ls_camera_info camera;
    const struct ls_camera_info *cameras[] = {&camera};
    struct ls_config config = *fuzz_rig(); /* offsets are written into it */
    struct ls_take_document document = {.config = &config, .lights = &lights, .cameras = cameras};
    struct ls_diag diag = {0};
    char *text = fuzz_text(data, n), *plan = NULL;
    check_head(text, n);
    check_facts(text);
    enum ls_err err = ls_take_json_plan(text, &plan, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(!err == !!plan);
    diag = (struct ls_diag){0};
    err = ls_take_json_same_rig(text, &document, &diag);
    HOLDS_REFUSED(err, diag);
    diag = (struct ls_diag){0};
    err = ls_take_json_offsets(text, &config, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(err || isfinite(config.cameras[0].exposure_offset_us));
    free(plan);
    free(text);
    return 0;
}

/* take_facts: take.json as older and newer daemons wrote it, and as somebody who means harm would.
 */
#include "daemon/field_segments.h"
#include "daemon/take_facts.h"
#include "tests/daemon/take_fixture.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

static json_t *conditions_of(json_t *doc)
{
    return json_object_get(json_object_get(doc, "plan"), "conditions");
}

static json_t *a_document(void)
{
    g_autofree char *text = take_json_text(NULL, 1);
    json_t *doc = json_loads(text, 0, NULL);
    g_assert_nonnull(doc);
    return doc;
}

/* *facts: NULL if refused. Takes @doc. */
static enum ls_err read_facts(json_t *doc, struct ls_take_facts **facts, struct ls_diag *diag)
{
    char *text = json_dumps(doc, JSON_REAL_PRECISION(17));
    *facts = NULL;
    enum ls_err err = ls_take_facts_read(text, 0, facts, diag);
    free(text);
    json_decref(doc);
    return err;
}

static const struct ls_condition_fact *find(const struct ls_take_facts *facts, const char *id)
{
    for (uint32_t i = 0; i < facts->n_conditions; i++)
        if (!strcmp(facts->conditions[i].id, id))
            return &facts->conditions[i];
    return NULL;
}

/* Takes made before plans named their patterns. */
static void patterns_that_are_not_named_are_known_by_their_kind(void)
{
    struct ls_take_facts *facts;
    json_t *doc = a_document();
    json_array_append_new(conditions_of(doc),
                          json_pack("{ss ss ss si s[iii]}", "id", "segment0-R", "kind", "segment",
                                    "channel", "R", "level", 65535, "lights", 3, 1, 2));
    g_assert_cmpint(read_facts(doc, &facts, NULL), ==, LS_OK);
    g_assert_cmpint(find(facts, "sphere-R")->kind, ==, LS_FACT_SPHERE);
    g_assert_cmpstr(find(facts, "sphere-R")->pattern, ==, "sphere");
    g_assert_cmpint(find(facts, "segment0-R")->kind, ==, LS_FACT_SEGMENT);
    g_assert_cmpstr(find(facts, "segment0-R")->pattern, ==, "lights-3");
    g_assert_cmpuint(find(facts, "segment0-R")->lights[0], ==, 1);
    ls_take_facts_destroy(facts);
}

/* The plan's `lights` of a head light may be any number: the pattern says how many. */
static void a_head_light_of_any_number_of_lights_is_one(void)
{
    static const char *const patterns[] = {"headlight", "headlight-2", "headlight-5"};
    for (size_t i = 0; i < G_N_ELEMENTS(patterns); i++) {
        struct ls_take_facts *facts;
        json_t *doc = a_document();
        json_array_append_new(conditions_of(doc),
                              json_pack("{ss ss ss ss si s[ii]}", "id", "headlight-R", "kind",
                                        "segment", "pattern", patterns[i], "channel", "R", "level",
                                        30000, "lights", 0, 1));
        g_assert_cmpint(read_facts(doc, &facts, NULL), ==, LS_OK);
        g_assert_cmpint(find(facts, "headlight-R")->kind, ==, LS_FACT_HEADLIGHT);
        ls_take_facts_destroy(facts);
    }
}

static void wrong_conditions_are_refused_by_key(void)
{
    static const struct {
        const char *item, *sentence;
    } cases[] = {
        {"{\"id\":\"x\",\"kind\":\"one\",\"channel\":\"W\",\"level\":65535,\"light\":\"1\"}",
         "plan.conditions.light"},
        {"{\"id\":\"x\",\"kind\":\"one\",\"channel\":\"W\",\"level\":65535}",
         "plan.conditions.light"},
        {"{\"id\":\"x\",\"kind\":\"one\",\"channel\":\"W\",\"level\":65535,\"light\":1e9}",
         "plan.conditions.light"},
        {"{\"id\":\"x\",\"kind\":\"one\",\"channel\":\"W\",\"level\":65535,\"light\":-1}",
         "plan.conditions.light"},
        {"{\"id\":\"x\",\"kind\":\"one\",\"channel\":\"W\",\"level\":1000000000,\"light\":1}",
         "level"},
        {"{\"id\":\"x\",\"kind\":\"sphere\",\"channel\":\"W\",\"level\":0}", "level"},
        {"{\"id\":\"x\",\"kind\":\"sphere\",\"channel\":\"Q\",\"level\":1}", "channel"},
        {"{\"id\":\"x\",\"kind\":\"segment\",\"channel\":\"R\",\"level\":9,\"lights\":1000000000}",
         "plan.conditions.lights"},
        {"{\"id\":\"x\",\"kind\":\"segment\",\"channel\":\"R\",\"level\":9,\"lights\":[]}",
         "plan.conditions.lights"},
        {"{\"id\":\"x\",\"kind\":\"segment\",\"channel\":\"R\",\"level\":9,\"lights\":[1,1]}",
         "each light once"},
        {"{\"id\":\"x\",\"kind\":\"segment\",\"channel\":\"R\",\"level\":9,\"lights\":[4294967296]"
         "}",
         "plan.conditions.lights"},
        {"{\"id\":\"x\",\"kind\":\"segment\",\"channel\":\"R\",\"level\":9,\"lights\":[0],"
         "\"pattern\":\"lights-89012345678901234567890\"}",
         "plan.conditions.pattern"},
        {"{\"kind\":\"sphere\",\"channel\":\"W\",\"level\":1}", "plan.conditions.id"},
        {"7", "plan.conditions"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct ls_take_facts *facts;
        struct ls_diag diag = {0};
        json_t *doc = a_document();
        json_t *item = json_loads(cases[i].item, JSON_DECODE_ANY, NULL);
        g_assert_nonnull(item);
        json_array_append_new(conditions_of(doc), item);
        g_assert_cmpint(read_facts(doc, &facts, &diag), ==, LS_ERR_INVALID);
        if (!strstr(diag.text, cases[i].sentence))
            g_error("\"%s\" said \"%s\", expected \"%s\"", cases[i].item, diag.text,
                    cases[i].sentence);
    }
}

/* ---- divisions of the dome ---- */

enum { MANY = 300 };

/* Memory grows with the segments: a division of hundreds is refused in words, not by what it takes.
 */
static void a_division_too_fine_to_fit_is_refused(void)
{
    static uint32_t rows[MANY];
    static struct ls_condition_fact conditions[MANY];
    static struct ls_picture_map maps[MANY];
    static const void *tiles[1];
    struct ls_take_facts facts = {
        .n_lights = MANY, .n_channels = 1, .n_conditions = MANY, .conditions = conditions};
    struct ls_field_source *source = g_new0(struct ls_field_source, 1);
    struct ls_field_segments *segments = g_new0(struct ls_field_segments, 1);
    struct ls_diag diag = {0};
    source->facts = &facts;
    source->maps = maps;
    g_strlcpy(facts.channels[0].name, "R", sizeof facts.channels[0].name);
    for (uint32_t i = 0; i < MANY; i++) {
        rows[i] = i;
        conditions[i] =
            (struct ls_condition_fact){.kind = LS_FACT_SEGMENT, .duty = 1, .n_lights = 1};
        conditions[i].lights = &rows[i];
        g_snprintf(conditions[i].pattern, sizeof conditions[i].pattern, "segments-%d", MANY);
        maps[i].base = tiles;
        maps[i].tiles.tile = (void *)tiles;
    }
    g_assert_cmpint(ls_field_segments_find(source, 0, segments, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "segments of R"));
    facts.n_conditions = facts.n_lights = LS_FIELD_MAX_SEGMENTS;
    g_assert_cmpint(ls_field_segments_find(source, 0, segments, &diag), ==, LS_OK);
    g_assert_cmpuint(segments->n, ==, LS_FIELD_MAX_SEGMENTS);
    g_free(segments);
    g_free(source);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/take-facts/patterns-that-are-not-named-are-known-by-their-kind",
                    patterns_that_are_not_named_are_known_by_their_kind);
    g_test_add_func("/take-facts/a-head-light-of-any-number-of-lights-is-one",
                    a_head_light_of_any_number_of_lights_is_one);
    g_test_add_func("/take-facts/wrong-conditions-are-refused-by-key",
                    wrong_conditions_are_refused_by_key);
    g_test_add_func("/take-facts/a-division-too-fine-to-fit-is-refused",
                    a_division_too_fine_to_fit_is_refused);
    return g_test_run();
}

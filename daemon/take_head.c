#include "daemon/take_head.h"

#include "daemon/takedir.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CONDITIONS = 1 << 20, MAX_CAMERAS = 64 };

static const char *const state_names[] = {
    [LS_STORE_OPEN] = "open",
    [LS_STORE_COMPLETE] = "complete",
    [LS_STORE_INCOMPLETE] = "incomplete",
    [LS_STORE_ABORTED] = "aborted",
    [LS_STORE_FAILED] = "failed",
};

const char *ls_store_state_name(enum ls_store_state state)
{
    return (unsigned)state < sizeof state_names / sizeof *state_names ? state_names[state]
                                                                      : "unknown";
}

static json_t *string_array(const char *const *strings, size_t n)
{
    json_t *array = json_array();
    for (size_t k = 0; array && k < n; k++)
        if (json_array_append_new(array, json_string(strings[k]))) {
            json_decref(array);
            return NULL;
        }
    return array;
}

static enum ls_err load(const char *text, size_t n, const char *what, json_t **out,
                        struct ls_diag *diag)
{
    json_error_t error;
    *out = json_loadb(text, n, JSON_REJECT_DUPLICATES, &error);
    if (!*out)
        return ls_fail(diag, LS_ERR_INVALID, "%s: line %d: %s", what, error.line, error.text);
    return LS_OK;
}

static int put_head(json_t *document, const struct ls_take_head *head, json_t *missing,
                    json_t *skips)
{
    json_t *conditions = string_array((const char *const *)head->conditions, head->n_conditions);
    json_t *planned = json_pack("{s:I, s:I, s:o}", "shots", (json_int_t)head->n_shots, "cameras",
                                (json_int_t)head->n_cameras, "conditions", conditions);
    int bad = json_object_set_new(document, "format", json_integer(LS_TAKE_FORMAT));
    bad |= json_object_set_new(document, "state", json_string(ls_store_state_name(head->state)));
    bad |= json_object_set_new(document, "name", json_string(head->name));
    bad |= json_object_set_new(document, "utc", json_string(head->utc));
    bad |= json_object_set_new(document, "keep_raw", json_boolean(head->keep_raw));
    bad |= json_object_set_new(document, "planned", planned);
    bad |= json_object_set_new(document, "missing", missing);
    bad |= json_object_set_new(document, "skips", skips);
    return bad;
}

enum ls_err ls_take_head_write(const struct ls_take_head *head, const char *text_in,
                               const char *const *missing, size_t n_missing, const char *skips_json,
                               char **text, struct ls_diag *diag)
{
    json_t *document = NULL, *skips = NULL;
    enum ls_err err = load(text_in, strlen(text_in), "the take's document", &document, diag);
    if (!err && !json_is_object(document))
        err = ls_fail(diag, LS_ERR_INVALID, "the take's document is not a JSON object");
    if (!err)
        err = load(skips_json ? skips_json : "[]", skips_json ? strlen(skips_json) : 2,
                   "the take's skips", &skips, diag);
    if (!err && !json_is_array(skips)) {
        json_decref(skips);
        err = ls_fail(diag, LS_ERR_INVALID, "the take's skips are not a JSON array");
    }
    if (!err) {
        int bad = put_head(document, head, string_array(missing, n_missing), skips);
        *text = bad ? NULL : json_dumps(document, JSON_INDENT(1));
        if (!*text)
            err = ls_fail(diag, LS_ERR_NOMEM, "no memory for take.json");
    }
    json_decref(document);
    return err;
}

static enum ls_err parse_conditions(const json_t *array, struct ls_take_head *head,
                                    struct ls_diag *diag)
{
    size_t n = json_array_size(array);
    if (!json_is_array(array) || n > MAX_CONDITIONS)
        return ls_fail(diag, LS_ERR_INVALID,
                       "take.json: planned.conditions: expected an array of "
                       "at most %d ids",
                       MAX_CONDITIONS);
    head->conditions = calloc(n ? n : 1, sizeof *head->conditions);
    for (size_t k = 0; head->conditions && k < n; k++) {
        const char *id = json_string_value(json_array_get(array, k));
        if (!id || !ls_takedir_name_ok(id, 63))
            return ls_fail(diag, LS_ERR_INVALID, "take.json: planned.conditions[%zu] is no id", k);
        head->conditions[k] = strdup(id);
        if (!head->conditions[k])
            return ls_fail(diag, LS_ERR_NOMEM, "no memory for take.json");
        head->n_conditions++;
    }
    return head->conditions ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "no memory for take.json");
}

static enum ls_err parse_state(const char *text, struct ls_take_head *head, struct ls_diag *diag)
{
    for (unsigned k = 0; k < sizeof state_names / sizeof *state_names; k++)
        if (!strcmp(state_names[k], text)) {
            head->state = (enum ls_store_state)k;
            return LS_OK;
        }
    return ls_fail(diag, LS_ERR_INVALID, "take.json: state \"%.40s\" is not known", text);
}

static enum ls_err parse(const json_t *document, struct ls_take_head *head, struct ls_diag *diag)
{
    json_int_t format = -1, shots = -1, cameras = -1;
    const char *state, *name, *utc;
    int keep_raw;
    json_t *conditions;
    json_error_t error;
    if (json_unpack_ex((json_t *)document, &error, 0,
                       "{s:I, s:s, s:s, s:s, s:b, s:{s:I, s:I, s:o}}", "format", &format, "state",
                       &state, "name", &name, "utc", &utc, "keep_raw", &keep_raw, "planned",
                       "shots", &shots, "cameras", &cameras, "conditions", &conditions))
        return ls_fail(diag, LS_ERR_INVALID, "take.json: %s", error.text);
    if (format != LS_TAKE_FORMAT)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "take.json: format %lld: this program reads "
                       "format %d",
                       (long long)format, LS_TAKE_FORMAT);
    if (shots < 0 || shots > UINT32_MAX || cameras < 1 || cameras > MAX_CAMERAS ||
        !ls_takedir_name_ok(name, 64) || strlen(utc) >= sizeof head->utc)
        return ls_fail(diag, LS_ERR_INVALID,
                       "take.json: name, utc, shots or cameras are out of "
                       "range");
    head->n_shots = (uint32_t)shots;
    head->n_cameras = (uint32_t)cameras;
    head->keep_raw = keep_raw;
    strcpy(head->name, name);
    strcpy(head->utc, utc);
    enum ls_err err = parse_state(state, head, diag);
    return err ? err : parse_conditions(conditions, head, diag);
}

enum ls_err ls_take_head_parse(const char *text, size_t n, struct ls_take_head *head,
                               struct ls_diag *diag)
{
    json_t *document;
    *head = (struct ls_take_head){0};
    enum ls_err err = load(text, n, "take.json", &document, diag);
    if (err)
        return err;
    err = parse(document, head, diag);
    json_decref(document);
    if (err)
        ls_take_head_finish(head);
    return err;
}

void ls_take_head_finish(struct ls_take_head *head)
{
    for (uint32_t k = 0; head->conditions && k < head->n_conditions; k++)
        free(head->conditions[k]);
    free(head->conditions);
    *head = (struct ls_take_head){0};
}

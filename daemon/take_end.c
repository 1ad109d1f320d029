#include "daemon/take_end.h"

#include "daemon/findings.h"
#include "daemon/led_record.h"
#include "daemon/takedir.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void free_names(char **names, size_t n)
{
    for (size_t i = 0; i < n; i++)
        free(names[i]);
    free(names);
}

/* "cam0/W-0137" of everything not published; NULL-terminated, (transfer full). NULL: no memory for
 * all of them; what is missing and has no name would make the take look complete. */
static char **list_missing(const struct ls_take_end *in, const struct ls_takedir *dir, size_t *n)
{
    uint32_t n_cameras = in->config->n_cameras;
    char **out = calloc((size_t)in->plan->n_conditions * n_cameras + 1, sizeof *out);
    bool named = true;
    *n = 0;
    for (uint32_t i = 0; out && named && i < in->plan->n_conditions; i++)
        for (uint32_t k = 0; named && k < n_cameras; k++)
            if (!ls_takedir_find(dir, in->plan->conditions[i].id, k)) {
                named = asprintf(&out[*n], "cam%u/%s", k, in->plan->conditions[i].id) > 0;
                *n += named;
            }
    if (out && named)
        return out;
    free_names(out, *n);
    *n = 0;
    return NULL;
}

static enum ls_take_state end_state(enum ls_err err, size_t n_missing)
{
    if (err == LS_ERR_ABORTED)
        return LS_TAKE_ABORTED;
    if (err)
        return LS_TAKE_FAILED;
    return n_missing ? LS_TAKE_INCOMPLETE : LS_TAKE_COMPLETE;
}

static enum ls_store_state store_state(enum ls_take_state state)
{
    switch (state) {
    case LS_TAKE_COMPLETE:
        return LS_STORE_COMPLETE;
    case LS_TAKE_INCOMPLETE:
        return LS_STORE_INCOMPLETE;
    case LS_TAKE_ABORTED:
        return LS_STORE_ABORTED;
    default:
        return LS_STORE_FAILED;
    }
}

/* A sweep is made for its warnings: they go to the journal and into the take's message. */
static enum ls_err say_warnings(const struct ls_take_end *in, const json_t *checks,
                                struct ls_take_ending *out, struct ls_diag *diag)
{
    const json_t *warnings = json_object_get(checks, "warnings");
    enum ls_err err = LS_OK;
    snprintf(out->said, sizeof out->said, "; nothing wrong was found");
    for (size_t i = 0; i < json_array_size(warnings) && !err; i++) {
        const char *text = json_string_value(json_array_get(warnings, i));
        size_t used = i ? strlen(out->said) : 0;
        snprintf(out->said + used, sizeof out->said - used, "; %s", text);
        err = ls_store_alarm(in->store, text, diag);
    }
    ls_events_alarm(in->events, LS_ALARM_SWEEP, json_array_size(warnings) > 0,
                    ls_store_id(in->store), out->said + 2);
    return err;
}

/* For the takes to come. A disk that does not take it is no fault of this one. */
static enum ls_err keep_record(const struct ls_take_end *in, const json_t *checks,
                               struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    if (!ls_led_record_write(in->config->storage, ls_store_id(in->store), checks, &why))
        return LS_OK;
    return ls_store_alarm(in->store, why.text, diag);
}

static enum ls_err put_findings(const struct ls_take_end *in, const char *take_json,
                                struct ls_take_ending *out, char **text, struct ls_diag *diag)
{
    struct ls_findings findings;
    LS_CLEANUP_FREE char *found = NULL;
    json_t *checks = NULL;
    ls_capture_findings(in->capture, &findings);
    enum ls_err err = ls_findings_put(&findings, take_json, &found, diag);
    if (!err)
        err = ls_checks_conclude(in->checks, &findings, &checks, diag);
    if (!err && checks && in->plan->sweep)
        err = say_warnings(in, checks, out, diag);
    if (!err && checks && in->plan->sweep && out->state == LS_TAKE_COMPLETE)
        err = keep_record(in, checks, diag);
    if (!err)
        err = ls_checks_put(in->checks, checks, found, text, diag);
    json_decref(checks);
    return err;
}

enum ls_err ls_take_end(const struct ls_take_end *in, struct ls_take_ending *out,
                        struct ls_diag *diag)
{
    struct ls_takedir *dir = NULL;
    size_t n_missing = 0;
    *out = (struct ls_take_ending){.state = LS_TAKE_FAILED};
    enum ls_err err = ls_store_flush(in->store, diag);
    if (!err)
        err = ls_takedir_open(ls_store_folder(in->store), &dir, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE char *take_json = NULL;
    char **missing = list_missing(in, dir, &n_missing);
    out->state = end_state(in->ran, n_missing);
    snprintf(out->missing, sizeof out->missing, "%zu of them, first %s", n_missing,
             n_missing ? missing[0] : "-");
    err = missing ? put_findings(in, dir->take_json, out, &take_json, diag)
                  : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    const struct ls_store_end end = {.state = store_state(out->state),
                                     .take_json = take_json,
                                     .missing = (const char *const *)missing,
                                     .n_missing = n_missing};
    if (!err)
        err = ls_store_set_state(in->store, &end, diag);
    free_names(missing, n_missing);
    ls_takedir_close(dir);
    return err;
}

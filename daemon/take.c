#include "daemon/take_private.h"

#include "daemon/take_end.h"

#include <stdio.h>
#include <stdlib.h>

const char *ls_take_id(const struct ls_take *take)
{
    return ls_store_id(take->store);
}

/* *written: the take's folder says how it ended. */
static enum ls_take_state run(struct ls_take *take, struct ls_capture_report *report,
                              struct ls_diag *message, bool *written)
{
    struct ls_diag why = {0}, books = {0};
    struct ls_take_ending ending;
    *report = (struct ls_capture_report){0};
    enum ls_err err = ls_capture_run(take->capture, report, &why);
    const struct ls_take_end end = {
        .config = take->context->config,
        .plan = take->plan,
        .capture = take->capture,
        .store = take->store,
        .checks = take->checks,
        .events = take->context->events,
        .ran = err,
    };
    enum ls_err closed = ls_take_end(&end, &ending, &books);
    if (!closed)
        closed = ls_store_close(take->store, &books);
    else
        ls_store_close(take->store, NULL);
    take->store = NULL;
    *written = !closed;
    ls_rig_close(&take->rig); /* one that is gone takes seconds: not the main loop's */
    if (closed && !err) {
        ls_fail(message, closed, "the take could not be written: %.400s", books.text);
        return LS_TAKE_FAILED;
    }
    if (err && closed)
        ls_fail(message, err, "%.250s; and the take could not be written: %.200s", why.text,
                books.text);
    else if (err)
        ls_fail(message, err, "%s", why.text);
    else if (ending.state == LS_TAKE_INCOMPLETE)
        ls_fail(message, LS_OK, "conditions missing after every repair: %s; resume to try again",
                ending.missing);
    else
        ls_fail(message, LS_OK, "%s%s%s", report->repaired[0] ? "complete; repaired: " : "complete",
                report->repaired, ending.said);
    return ending.state;
}

enum ls_take_state ls_take_run(struct ls_take *take, struct ls_capture_report *report,
                               struct ls_diag *message)
{
    char id[128];
    bool written = true;
    snprintf(id, sizeof id, "%s", ls_take_id(take));
    enum ls_take_state state = run(take, report, message, &written);
    ls_events_alarm(take->context->events, LS_ALARM_HOT, false, id, ""); /* it pauses no more */
    if (!written)
        ls_events_alarm(take->context->events, LS_ALARM_DISK, true, id, message->text);
    else if (state == LS_TAKE_FAILED || state == LS_TAKE_INCOMPLETE)
        ls_events_alarm(take->context->events, LS_ALARM_FAULT, true, id, message->text);
    return state;
}

void ls_take_abort(struct ls_take *take)
{
    ls_capture_abort(take->capture);
}

void ls_take_blank(struct ls_take *take)
{
    ls_capture_blank(take->capture);
}

void ls_take_progress(const struct ls_take *take, struct ls_capture_progress *out)
{
    ls_capture_progress(take->capture, out);
}

void ls_take_destroy(struct ls_take *take)
{
    if (!take)
        return;
    ls_capture_destroy(take->capture);
    ls_checks_destroy(take->checks);
    json_decref(take->led_record);
    ls_store_close(take->store, NULL);
    ls_rig_close(&take->rig);
    ls_resumed_finish(&take->resumed);
    ls_plan_destroy(take->plan);
    free(take);
}

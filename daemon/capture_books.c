#include "daemon/capture_private.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static void append(char *text, size_t size, const char *id, uint32_t shots)
{
    size_t used = strlen(text);
    char item[64];
    int n = snprintf(item, sizeof item, "%s%s (%u shot%s)", used ? ", " : "", id, shots,
                     shots == 1 ? "" : "s");
    if (n > 0 && used + (size_t)n + 6 < size)
        memcpy(text + used, item, (size_t)n + 1);
    else if (used + 6 < size && (used < 3 || strcmp(text + used - 3, "...")))
        strcpy(text + used, ", ...");
}

static uint32_t count_missing(const struct ls_capture *c)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->setup.plan->n_conditions; i++) {
        bool missing = false;
        for (uint32_t k = 0; k < c->n_cameras; k++)
            missing |= !ls_merge_stage_has(c->merge, i, k);
        n += missing;
    }
    return n;
}

static enum ls_err name_missing(struct ls_capture *c, struct ls_diag *diag)
{
    const struct ls_plan *plan = c->setup.plan;
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        for (uint32_t k = 0; k < c->n_cameras; k++) {
            char text[160];
            if (ls_merge_stage_has(c->merge, i, k))
                continue;
            snprintf(text, sizeof text, "missing: cam%u/%s after %u passes", k,
                     plan->conditions[i].id, c->setup.config->retries + 1);
            enum ls_err err = ls_store_alarm(c->setup.store, text, diag);
            if (err)
                return err;
        }
    return LS_OK;
}

static void list_repaired(const struct ls_capture *c, char *text, size_t size)
{
    text[0] = 0;
    for (uint32_t i = 0; i < c->setup.plan->n_conditions; i++)
        if (ls_merge_stage_repaired(c->merge, i))
            append(text, size, c->setup.plan->conditions[i].id,
                   ls_merge_stage_repaired(c->merge, i));
}

static enum ls_err name_heat(struct ls_capture *c, struct ls_diag *diag)
{
    char text[160];
    if (c->sequencer.cooled_seconds <= 0)
        return LS_OK;
    snprintf(text, sizeof text, "paused for %.1f s until the dome had cooled: it was at %d C",
             c->sequencer.cooled_seconds, c->sequencer.hottest_c);
    return ls_store_alarm(c->setup.store, text, diag);
}

/* What was made good on the way, by another shot or by the network. */
static enum ls_err name_repaired(struct ls_capture *c, struct ls_diag *diag)
{
    char repaired[256], text[320];
    enum ls_err err = LS_OK;
    list_repaired(c, repaired, sizeof repaired);
    if (repaired[0]) {
        snprintf(text, sizeof text, "repaired: %s", repaired);
        err = ls_store_alarm(c->setup.store, text, diag);
    }
    for (uint32_t i = 0; i < c->n_cameras && !err; i++) {
        if (!c->stats[i].resent_packets)
            continue;
        snprintf(text, sizeof text, "camera %.64s: %llu packets were lost and sent again",
                 ls_capture_camera(c, i)->name, (unsigned long long)c->stats[i].resent_packets);
        err = ls_store_alarm(c->setup.store, text, diag);
    }
    return err;
}

void ls_capture_fill_report(struct ls_capture *c, struct ls_capture_report *report)
{
    double squares = 0;
    uint64_t n = 0;
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        if (!c->threads[i])
            continue;
        struct ls_camera_residuals r = ls_camera_thread_residuals(c->threads[i]);
        report->residual_max_us = fmax(report->residual_max_us, r.max_us);
        squares += r.sum_squares_us2;
        n += r.n;
    }
    report->missing_conditions = count_missing(c);
    report->residual_rms_us = n ? sqrt(squares / (double)n) : 0;
    list_repaired(c, report->repaired, sizeof report->repaired);
    ls_capture_progress(c, &report->final);
    struct ls_merge_stage_counts counts;
    ls_merge_stage_counts(c->merge, &counts);
    const struct ls_sequencer *s = &c->sequencer;
    report->seconds = s->fired ? (double)(s->last_us - s->first_us) * 1e-6 : 0;
    report->frames_per_second = report->seconds > 0 ? counts.shots / report->seconds : 0;
}

/* The sentence of the stage that failed first. */
enum ls_err ls_capture_explain(struct ls_capture *c, enum ls_err err, struct ls_diag *diag)
{
    const char *leds = c->sequencer.maybe_lit ? "LEDs may be lit until the heartbeat blanks them"
                       : c->working           ? "the work light is on"
                                              : "LEDs are dark";
    if (err == LS_ERR_ABORTED)
        return ls_fail(diag, err, "aborted: %s, everything complete is stored", leds);
    if (err != LS_ERR_STATE) {
        size_t used = strlen(diag->text);
        if (c->working)
            snprintf(diag->text + used, sizeof diag->text - used, "; %s", leds);
        return err;
    }
    enum ls_err merge = (enum ls_err)atomic_load(c->sequencer.failure);
    if (merge) {
        struct ls_diag why = {{0}};
        ls_merge_stage_explain(c->merge, &why);
        return ls_fail(diag, merge, "%s", why.text);
    }
    for (uint32_t i = 0; i < c->n_cameras; i++) {
        struct ls_camera_counts counts = {0};
        if (c->threads[i])
            ls_camera_thread_counts(c->threads[i], &counts);
        if (counts.failure)
            return ls_fail(diag, counts.failure,
                           "camera %s: %s: %s, everything complete is stored; check its cable and "
                           "power, then resume the take",
                           ls_capture_camera(c, i)->name, ls_err_name(counts.failure), leds);
    }
    return err;
}

enum ls_err ls_capture_close_books(struct ls_capture *c, enum ls_err err, struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    enum ls_err closing = name_heat(c, &why);
    if (!closing && !err)
        closing = name_missing(c, &why);
    if (!closing && !err)
        closing = name_repaired(c, &why);
    if (!closing)
        closing = ls_store_flush(c->setup.store, &why);
    if (!err && closing)
        return ls_fail(diag, closing, "%s", why.text);
    return err;
}

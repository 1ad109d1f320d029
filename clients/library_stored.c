/* Takes that are on disk: the list, whether they are sound, and what people wrote about them. */
#include "clients/library.h"

struct list_call {
    lightstage_on_take *callback;
    void *user;
};

static struct lightstage_take_summary summary_of(const Lightstage__TakeSummary *s)
{
    return (struct lightstage_take_summary){
        .id = s->id,
        .name = s->name,
        .state = s->state,
        .problem = s->problem,
        .conditions_planned = s->conditions_planned,
        .conditions_published = s->conditions_published,
        .width = s->width,
        .height = s->height,
        .n_lights = s->n_lights,
    };
}

static uint32_t take_list(const struct ls_reply *reply, void *user, struct lightstage_error *error)
{
    const Lightstage__TakeListReply *r = (const Lightstage__TakeListReply *)reply->message;
    const struct list_call *call = user;
    for (size_t i = 0; i < r->n_takes; i++) {
        const struct lightstage_take_summary summary = summary_of(r->takes[i]);
        if (call->callback(&summary, call->user))
            return ls_library_stopped(1, error);
    }
    return 0;
}

uint32_t lightstage_take_list(struct lightstage *stage, lightstage_on_take *callback, void *user,
                              struct lightstage_error *error)
{
    Lightstage__TakeList body = LIGHTSTAGE__TAKE_LIST__INIT;
    const struct list_call call = {callback, user};
    return ls_library_call(stage, LS_MESSAGE_TAKE_LIST, &body.base, NULL, 0, take_list, &call,
                           sizeof call, error);
}

static void *make_summary(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__TakeShowReply *r = (const Lightstage__TakeShowReply *)reply->message;
    if (!r->summary) {
        ls_library_fail(error, LIGHTSTAGE_STRANGE, "the daemon answered without a summary");
        return NULL;
    }
    struct lightstage_take_summary *summary = ls_library_keep(reply, sizeof *summary, error);
    if (summary)
        *summary = summary_of(r->summary);
    return summary;
}

uint32_t lightstage_take_summary(struct lightstage *stage, const char *take,
                                 struct lightstage_take_summary **out,
                                 struct lightstage_error *error)
{
    Lightstage__TakeShow body = LIGHTSTAGE__TAKE_SHOW__INIT;
    body.take = (char *)take;
    return ls_library_ask(stage, LS_MESSAGE_TAKE_SHOW, &body.base, NULL, 0, make_summary, out,
                          error);
}

void lightstage_take_summary_free(struct lightstage_take_summary *summary)
{
    ls_library_release(summary);
}

static void *make_verified(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__TakeVerifyReply *r = (const Lightstage__TakeVerifyReply *)reply->message;
    struct lightstage_verified *verified = ls_library_keep(reply, sizeof *verified, error);
    if (verified)
        *verified = (struct lightstage_verified){
            .conditions_checked = r->conditions_checked,
            .conditions_missing = r->conditions_missing,
            .conditions_damaged = r->conditions_damaged,
            .shots_planned = r->shots_planned,
            .shots_ticketed = r->shots_ticketed,
            .n_findings = r->n_findings,
            .findings = (const char *const *)r->findings,
            .findings_left_out = r->findings_left_out,
        };
    return verified;
}

uint32_t lightstage_take_verify(struct lightstage *stage, const char *take,
                                struct lightstage_verified **out, struct lightstage_error *error)
{
    Lightstage__TakeVerify body = LIGHTSTAGE__TAKE_VERIFY__INIT;
    body.take = (char *)take;
    return ls_library_ask(stage, LS_MESSAGE_TAKE_VERIFY, &body.base, NULL, 0, make_verified, out,
                          error);
}

void lightstage_verified_free(struct lightstage_verified *verified)
{
    ls_library_release(verified);
}

/* ---- slate ---- */

static void *make_slate(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__TakeSlateReply *r = (const Lightstage__TakeSlateReply *)reply->message;
    if (!r->slate) {
        ls_library_fail(error, LIGHTSTAGE_STRANGE, "the daemon answered without a slate");
        return NULL;
    }
    struct lightstage_slate *slate = ls_library_keep(reply, sizeof *slate, error);
    if (slate)
        *slate = (struct lightstage_slate){
            .size = sizeof *slate,
            .slate = r->slate->slate,
            .scene = r->slate->scene,
            .timecode = r->slate->timecode,
            .notes = r->slate->notes,
            .take = r->slate->take,
            .circled = r->slate->circled,
            .damaged = r->damaged,
        };
    return slate;
}

static uint32_t ask_slate(struct lightstage *stage, const Lightstage__TakeSlate *body,
                          struct lightstage_slate **out, struct lightstage_error *error)
{
    return ls_library_ask(stage, LS_MESSAGE_TAKE_SLATE, &body->base, NULL, 0, make_slate, out,
                          error);
}

uint32_t lightstage_take_slate(struct lightstage *stage, const char *take,
                               struct lightstage_slate **out, struct lightstage_error *error)
{
    Lightstage__TakeSlate body = LIGHTSTAGE__TAKE_SLATE__INIT;
    body.take = (char *)take;
    return ask_slate(stage, &body, out, error);
}

uint32_t lightstage_take_slate_write(struct lightstage *stage, const char *take,
                                     const struct lightstage_slate *write, uint32_t fields,
                                     struct lightstage_slate **out, struct lightstage_error *error)
{
    Lightstage__TakeSlate body = LIGHTSTAGE__TAKE_SLATE__INIT;
    Lightstage__Slate slate = LIGHTSTAGE__SLATE__INIT;
    struct lightstage_slate w;
    uint32_t numbers[6];
    uint32_t number = ls_library_take_in(&w, sizeof w, write, error);
    if (number)
        return number;
    if (!fields || fields >> 6)
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT,
                               "name the fields to write by enum lightstage_slate_field");
    for (uint32_t i = 0; i < 6; i++)
        if (fields >> i & 1)
            numbers[body.n_fields++] = i + 1; /* as the protocol numbers them */
    slate.slate = (char *)(w.slate ? w.slate : "");
    slate.scene = (char *)(w.scene ? w.scene : "");
    slate.timecode = (char *)(w.timecode ? w.timecode : "");
    slate.notes = (char *)(w.notes ? w.notes : "");
    slate.take = w.take;
    slate.circled = w.circled != 0;
    body.take = (char *)take;
    body.fields = numbers;
    body.write = &slate;
    return ask_slate(stage, &body, out, error);
}

void lightstage_slate_free(struct lightstage_slate *slate)
{
    ls_library_release(slate);
}

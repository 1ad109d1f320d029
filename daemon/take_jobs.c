#include "daemon/take_jobs.h"

#include "daemon/slate.h"
#include "daemon/take_facts.h"
#include "daemon/takedir.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TAKES_PER_FRAME = 64, MAX_FINDINGS = 64, MAX_FINDING_BYTES = 512 };

struct take_job {
    struct ls_job job;
    const char *storage;
    char take[128];
    struct ls_take_summary *list;
    size_t n_list, next;
};

static void take_job_destroy(struct ls_job *job)
{
    struct take_job *self = (struct take_job *)job;
    free(self->list);
    g_free(self);
}

static void init(struct take_job *self, const struct ls_job_ops *ops, uint32_t request,
                 const char *storage, const char *take)
{
    self->job.ops = ops;
    self->job.request = request;
    self->storage = storage;
    snprintf(self->take, sizeof self->take, "%s", take);
}

static struct ls_job *make(const struct ls_job_ops *ops, uint32_t request, const char *storage,
                           const char *take)
{
    struct take_job *self = g_new0(struct take_job, 1);
    init(self, ops, request, storage, take);
    return &self->job;
}

static enum ls_err reply(const struct take_job *self, uint16_t type, const ProtobufCMessage *body,
                         bool last, struct ls_chunk *chunk, struct ls_diag *diag)
{
    return ls_message_frame(type | LS_MESSAGE_REPLY, self->job.request, last ? LS_FRAME_LAST : 0,
                            body, chunk->payload_bytes, &chunk->head, &chunk->head_bytes, diag);
}

enum { PATH_BYTES = 4096 };

static enum ls_err folder_of(const struct take_job *self, char folder[PATH_BYTES],
                             struct ls_diag *diag)
{
    if (!ls_takedir_id_ok(self->take))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "\"%.64s\" is not the name of a take", self->take);
    if (snprintf(folder, PATH_BYTES, "%s/%s", self->storage, self->take) >= PATH_BYTES)
        return ls_fail(diag, LS_ERR_LIMIT, "%s: the path is too long", self->storage);
    return LS_OK;
}

static enum ls_err open_take(const struct take_job *self, struct ls_takedir **take,
                             struct ls_diag *diag)
{
    char folder[PATH_BYTES];
    enum ls_err err = folder_of(self, folder, diag);
    return err ? err : ls_takedir_open(folder, take, diag);
}

/* ---- list ---- */

static void fill_line(Lightstage__TakeSummary *out, struct ls_take_summary *in)
{
    lightstage__take_summary__init(out);
    out->id = in->id;
    out->name = in->name;
    out->state = (char *)(in->damage[0] ? "damaged" : ls_store_state_name(in->state));
    out->conditions_planned = in->conditions_planned;
    out->problem = in->damage;
}

static enum ls_err list_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                             struct ls_diag *diag)
{
    struct take_job *self = (struct take_job *)job;
    Lightstage__TakeSummary lines[TAKES_PER_FRAME], *pointers[TAKES_PER_FRAME];
    Lightstage__TakeListReply body = LIGHTSTAGE__TAKE_LIST_REPLY__INIT;
    enum ls_err err = LS_OK;
    if (!self->list)
        err = ls_takedir_list(self->storage, &self->list, &self->n_list, diag);
    if (err)
        return err;
    for (; self->next < self->n_list && body.n_takes < TAKES_PER_FRAME; self->next++) {
        pointers[body.n_takes] = &lines[body.n_takes];
        fill_line(&lines[body.n_takes++], &self->list[self->next]);
    }
    body.takes = pointers;
    *last = self->next == self->n_list;
    return reply(self, LS_MESSAGE_TAKE_LIST, &body.base, *last, chunk, diag);
}

struct ls_job *ls_take_list_job(uint32_t request, const char *storage)
{
    static const struct ls_job_ops ops = {"list", list_step, take_job_destroy};
    return make(&ops, request, storage, "");
}

/* ---- show ---- */

static void fill_summary(Lightstage__TakeSummary *out, struct ls_takedir *take)
{
    struct ls_take_facts *facts = NULL;
    lightstage__take_summary__init(out);
    out->id = take->id;
    out->name = take->name;
    out->state = (char *)ls_store_state_name(take->state);
    out->conditions_planned = take->n_conditions * take->n_cameras;
    out->conditions_published = (uint32_t)take->n_published;
    if (take->n_published > 0) {
        out->width = take->published[0].width;
        out->height = take->published[0].height;
    }
    if (ls_take_facts_read(take->take_json, 0, &facts, NULL) == LS_OK)
        out->n_lights = facts->n_lights;
    ls_take_facts_destroy(facts);
}

static enum ls_err show_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                             struct ls_diag *diag)
{
    struct take_job *self = (struct take_job *)job;
    struct ls_takedir *take = NULL;
    Lightstage__TakeSummary summary;
    Lightstage__TakeShowReply body = LIGHTSTAGE__TAKE_SHOW_REPLY__INIT;
    enum ls_err err = open_take(self, &take, diag);
    if (err)
        return err;
    fill_summary(&summary, take);
    body.summary = &summary;
    chunk->payload = (uint8_t *)strdup(take->take_json);
    chunk->payload_bytes = strlen(take->take_json);
    *last = true;
    err = chunk->payload ? reply(self, LS_MESSAGE_TAKE_SHOW, &body.base, true, chunk, diag)
                         : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    ls_takedir_close(take);
    return err;
}

struct ls_job *ls_take_show_job(uint32_t request, const char *storage, const char *take)
{
    static const struct ls_job_ops ops = {"show", show_step, take_job_destroy};
    return make(&ops, request, storage, take);
}

/* ---- verify ---- */

/* Cut the report into its lines, in place; long ones are shortened and say so. How many there are:
 * beyond MAX_FINDINGS they are counted only. */
static size_t cut_lines(char *text, char *lines[MAX_FINDINGS])
{
    static const char more[] = " ...";
    size_t n = 0;
    char *rest = NULL;
    for (char *line = strtok_r(text, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest), n++) {
        if (strlen(line) > MAX_FINDING_BYTES)
            memcpy(line + MAX_FINDING_BYTES - strlen(more), more, sizeof more);
        if (n < MAX_FINDINGS)
            lines[n] = line;
    }
    return n;
}

static enum ls_err verify_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                               struct ls_diag *diag)
{
    struct take_job *self = (struct take_job *)job;
    struct ls_takedir *take = NULL;
    struct ls_take_report report = {0};
    char *lines[MAX_FINDINGS];
    Lightstage__TakeVerifyReply body = LIGHTSTAGE__TAKE_VERIFY_REPLY__INIT;
    enum ls_err err = open_take(self, &take, diag);
    if (err)
        return err;
    err = ls_takedir_verify(take, &report, diag);
    if (!err) {
        body.conditions_checked = report.pictures_good + report.pictures_damaged;
        body.conditions_missing = report.pictures_missing;
        body.conditions_damaged = report.pictures_damaged;
        size_t n = cut_lines(report.text, lines);
        body.n_findings = n < MAX_FINDINGS ? n : MAX_FINDINGS;
        body.findings_left_out = (uint32_t)(n - body.n_findings);
        body.findings = lines;
        body.shots_planned = report.shots_planned;
        body.shots_ticketed = report.shots_ticketed;
        *last = true;
        err = reply(self, LS_MESSAGE_TAKE_VERIFY, &body.base, true, chunk, diag);
    }
    ls_take_report_finish(&report);
    ls_takedir_close(take);
    return err;
}

struct ls_job *ls_take_verify_job(uint32_t request, const char *storage, const char *take)
{
    static const struct ls_job_ops ops = {"verify", verify_step, take_job_destroy};
    return make(&ops, request, storage, take);
}

/* ---- slate ---- */

struct slate_job {
    struct take_job base;
    unsigned fields; /* that change; 0: it is read */
    struct ls_slate slate;
};

static enum ls_err slate_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct slate_job *self = (struct slate_job *)job;
    char folder[PATH_BYTES];
    bool damaged = false;
    Lightstage__Slate slate = LIGHTSTAGE__SLATE__INIT;
    Lightstage__TakeSlateReply body = LIGHTSTAGE__TAKE_SLATE_REPLY__INIT;
    enum ls_err err = folder_of(&self->base, folder, diag);
    if (!err)
        err = self->fields ? ls_slate_change(folder, self->fields, &self->slate, &damaged, diag)
                           : ls_slate_read(folder, &self->slate, diag);
    if (err)
        return err;
    slate.slate = self->slate.slate;
    slate.scene = self->slate.scene;
    slate.take = self->slate.take;
    slate.circled = self->slate.circled;
    slate.timecode = self->slate.timecode;
    slate.notes = self->slate.notes;
    body.slate = &slate;
    body.damaged = damaged;
    *last = true;
    return reply(&self->base, LS_MESSAGE_TAKE_SLATE, &body.base, true, chunk, diag);
}

static bool copy(const char *text, char *out, size_t size)
{
    return g_strlcpy(out, text, size) < size;
}

static enum ls_err slate_of(const Lightstage__Slate *in, struct ls_slate *out, struct ls_diag *diag)
{
    out->take = in->take;
    out->circled = in->circled;
    if (!copy(in->slate, out->slate, sizeof out->slate) ||
        !copy(in->scene, out->scene, sizeof out->scene) ||
        !copy(in->timecode, out->timecode, sizeof out->timecode) ||
        !copy(in->notes, out->notes, sizeof out->notes))
        return ls_fail(diag, LS_ERR_INVALID,
                       "slate: expected at most 63 bytes of slate and scene, 4095 of notes, and a "
                       "timecode like 10:11:12:13");
    return ls_slate_check(out, diag);
}

static enum ls_err fields_of(const Lightstage__TakeSlate *message, unsigned *fields,
                             struct ls_diag *diag)
{
    *fields = message->n_fields ? 0 : LS_SLATE_ALL;
    for (size_t k = 0; k < message->n_fields; k++) {
        uint32_t number = message->fields[k];
        if (number == 0 || number > LS_SLATE_FIELDS)
            return ls_fail(diag, LS_ERR_INVALID, "slate: there is no field %u", number);
        *fields |= 1u << (number - 1);
    }
    return LS_OK;
}

enum ls_err ls_take_slate_job(uint32_t request, const char *storage,
                              const Lightstage__TakeSlate *message, struct ls_job **job,
                              struct ls_diag *diag)
{
    static const struct ls_job_ops ops = {"slate", slate_step, take_job_destroy};
    struct ls_slate slate = {.take = 0};
    unsigned fields = 0;
    enum ls_err err = LS_OK;
    if (message->write)
        err = slate_of(message->write, &slate, diag);
    if (!err && message->write)
        err = fields_of(message, &fields, diag);
    if (err)
        return err;
    struct slate_job *self = g_new0(struct slate_job, 1);
    init(&self->base, &ops, request, storage, message->take);
    self->fields = fields;
    self->slate = slate;
    *job = &self->base.job;
    return LS_OK;
}

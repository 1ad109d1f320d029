#include "daemon/session_private.h"

#include "daemon/take_reply.h"

#include <stdio.h>
#include <string.h>

static void drop_job(gpointer data)
{
    struct ls_job *job = data;
    job->ops->destroy(job);
}

static void drop_pending(struct ls_session *session)
{
    while (session->pending) {
        struct ls_pending *pending = session->pending->data;
        ls_session_waited(session, pending);
        pending->drop(pending, false);
    }
}

void ls_session_drop_requests(struct ls_session *session)
{
    drop_pending(session);
    g_queue_clear_full(&session->jobs, drop_job);
    if (session->stepping)
        ls_job_cancel(session->stepping);
}

/* ---- steps ---- */

static bool send_frame(void *user, struct ls_job *job, struct ls_chunk *chunk)
{
    struct ls_session *session = user;
    bool credit_ends = ls_job_use_credit(job, ls_chunk_payload(chunk));
    return ls_traffic_send(&session->traffic, chunk) && !credit_ends;
}

/* What it lacks may come yet. */
static bool is_of_running_take(const struct ls_session *session, const struct ls_job *job)
{
    const struct ls_take_status *take = &session->service->take;
    return job->take && !ls_take_ended(take) && strcmp(job->take, take->id) == 0;
}

static void tell_failure(struct ls_session *session, struct ls_job *job,
                         const struct ls_job_result *result)
{
    if (ls_job_cancelled(job)) {
        ls_session_error(session, job->request, LS_PROTO_CANCELLED, "cancelled by the client");
    } else if (result->err == LS_ERR_STATE && is_of_running_take(session, job)) {
        struct ls_diag diag;
        ls_fail(&diag, LS_ERR_STATE, "not yet, the take still runs: %.450s", result->diag.text);
        ls_session_fail(session, job->request, LS_ERR_STATE, LS_PROTO_ABOUT_REQUEST, &diag);
    } else {
        ls_session_fail(session, job->request, result->err, LS_PROTO_ABOUT_STORAGE, &result->diag);
    }
}

static void on_step(void *user, struct ls_job *job, struct ls_job_result *result)
{
    struct ls_session *session = user;
    bool on = session->open && !session->closing;
    session->stepping = NULL;
    if (on && result->err)
        tell_failure(session, job, result);
    if (on && !result->err && !result->last) {
        session->service->credit_waits += !ls_job_may_send(job);
        g_queue_push_tail(&session->jobs, job);
    } else {
        job->ops->destroy(job);
    }
    ls_traffic_settle(&session->traffic);
    ls_session_release(session);
}

void ls_session_next_job(struct ls_session *session)
{
    if (session->stepping || session->closing || !session->open ||
        !ls_traffic_has_room(&session->traffic))
        return;
    GList *next = session->jobs.head;
    while (next && !ls_job_may_send(next->data))
        next = next->next;
    if (!next)
        return;
    session->stepping = next->data;
    g_queue_delete_link(&session->jobs, next);
    ls_session_hold(session);
    ls_job_pool_step(session->service->pool, session->stepping, send_frame, on_step, session);
}

/* ---- requests ---- */

unsigned ls_session_in_flight(const struct ls_session *session)
{
    return session->jobs.length + (session->stepping != NULL) + g_list_length(session->pending) +
           ls_session_streams(session);
}

static bool has_room(struct ls_session *session, uint32_t request)
{
    char text[128];
    unsigned n = ls_session_in_flight(session);
    if (n < session->service->config.max_requests)
        return true;
    snprintf(text, sizeof text, "%u requests are in flight on this connection, at most %u allowed",
             n, session->service->config.max_requests);
    ls_session_error(session, request, LS_PROTO_TOO_MANY, text);
    return false;
}

void ls_session_run(struct ls_session *session, struct ls_job *job)
{
    if (!has_room(session, job->request)) {
        job->ops->destroy(job);
        return;
    }
    g_queue_push_tail(&session->jobs, job);
    ls_session_next_job(session);
}

bool ls_session_wait(struct ls_session *session, struct ls_pending *pending)
{
    if (!has_room(session, pending->request))
        return false;
    session->pending = g_list_prepend(session->pending, pending);
    return true;
}

void ls_session_waited(struct ls_session *session, struct ls_pending *pending)
{
    session->pending = g_list_remove(session->pending, pending);
}

static bool cancel_pending(struct ls_session *session, uint32_t request)
{
    for (GList *l = session->pending; l; l = l->next) {
        struct ls_pending *pending = l->data;
        if (pending->request != request)
            continue;
        ls_session_waited(session, pending);
        pending->drop(pending, true);
        ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
        return true;
    }
    return false;
}

static bool cancel_job(struct ls_session *session, uint32_t request)
{
    if (session->stepping && session->stepping->request == request) {
        ls_job_cancel(session->stepping);
        return true;
    }
    for (GList *l = session->jobs.head; l; l = l->next) {
        struct ls_job *job = l->data;
        if (job->request != request)
            continue;
        g_queue_delete_link(&session->jobs, l);
        job->ops->destroy(job);
        ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
        return true;
    }
    return false;
}

bool ls_session_cancel(struct ls_session *session, uint32_t request)
{
    return cancel_pending(session, request) || ls_session_cancel_stream(session, request) ||
           cancel_job(session, request);
}

static struct ls_job *job_of(const struct ls_session *session, uint32_t request)
{
    if (session->stepping && session->stepping->request == request)
        return session->stepping;
    for (GList *l = session->jobs.head; l; l = l->next)
        if (((struct ls_job *)l->data)->request == request)
            return l->data;
    return NULL;
}

bool ls_session_credit(struct ls_session *session, uint32_t request, uint64_t bytes)
{
    struct ls_job *job = job_of(session, request);
    if (!job || !job->counts_credit)
        return false;
    ls_job_give_credit(job, bytes);
    ls_session_next_job(session);
    return true;
}

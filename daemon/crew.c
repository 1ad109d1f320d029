#include "daemon/crew.h"

#include <glib.h>
#include <stdatomic.h>

struct run {
    const struct ls_crew *crew;
    ls_crew_work *work;
    void *user;
    uint32_t n_items;
    atomic_uint next;
    atomic_bool stop;
};

struct member {
    struct run *run;
    unsigned number;
    GThread *thread;
    uint32_t item; /* that failed */
    enum ls_err err;
    struct ls_diag diag;
};

unsigned ls_crew_threads(void)
{
    unsigned processors = g_get_num_processors();
    return processors < 4 ? processors : 4;
}

static enum ls_err one(struct member *member, uint32_t item)
{
    const struct run *run = member->run;
    if (run->crew->asker && ls_job_cancelled(run->crew->asker))
        return ls_fail(&member->diag, LS_ERR_ABORTED, "cancelled");
    return run->work(run->user, item, member->number, &member->diag);
}

static gpointer work(gpointer data)
{
    struct member *member = data;
    struct run *run = member->run;
    while (!atomic_load(&run->stop)) {
        uint32_t item = atomic_fetch_add(&run->next, 1);
        if (item >= run->n_items)
            break;
        member->item = item;
        member->err = one(member, item);
        if (member->err)
            atomic_store(&run->stop, true);
    }
    return NULL;
}

enum ls_err ls_crew_run(const struct ls_crew *crew, uint32_t n_items, ls_crew_work *piece,
                        void *user, struct ls_diag *diag)
{
    struct run run = {.crew = crew, .work = piece, .user = user, .n_items = n_items};
    struct member members[LS_CREW_MAX_THREADS] = {0};
    unsigned n = crew->n_threads < n_items ? crew->n_threads : n_items;
    const struct member *failed = NULL;
    n = n < 1 ? 1 : n > LS_CREW_MAX_THREADS ? LS_CREW_MAX_THREADS : n;
    for (unsigned t = 0; t < n; t++) {
        members[t] = (struct member){.run = &run, .number = t};
        if (t > 0)
            members[t].thread = g_thread_try_new("ls-crew", work, &members[t], NULL);
    }
    work(&members[0]);
    for (unsigned t = 0; t < n; t++) {
        if (members[t].thread)
            g_thread_join(members[t].thread);
        if (members[t].err && (!failed || members[t].item < failed->item))
            failed = &members[t];
    }
    if (!failed)
        return LS_OK;
    if (diag)
        *diag = failed->diag;
    return failed->err;
}

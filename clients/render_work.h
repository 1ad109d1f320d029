/*
 * render_work: the frames, shared out among threads with a connection each.
 * Layer: clients. Threads: start and wait on the main thread; its workers. Ownership: everything is
 * the caller's and outlives the work.
 *
 * A worker takes some frames at a time, reads their environments, solves their strengths, asks the
 * daemon for all of them in one pass over the take, and writes rows as they come: in its memory are
 * 64 rows of each.
 */
#ifndef LS_CLIENTS_RENDER_WORK_H
#define LS_CLIENTS_RENDER_WORK_H

#include "clients/render_options.h"
#include "clients/take_document.h"

#include <pthread.h>
#include <stdatomic.h>

enum { LS_RENDER_BATCH = 16 }; /* frames */

struct ls_render_work {
    const struct ls_render_options *options;
    const struct ls_take_document *document;
    pthread_mutex_t lock; /* of what is below */
    pthread_cond_t changed;
    uint32_t next;       /* frame that nobody has taken yet */
    uint32_t made, kept; /* frames */
    uint64_t rows;       /* of the frames being made */
    unsigned running;    /* workers */
    int code;            /* the first failure's exit code */
    bool warned;
    _Atomic bool *stop; /* interrupted */
};

/** A worker's whole life, on a thread of its own: struct ls_render_worker. */
void *ls_render_worker_run(void *worker);

struct ls_render_worker {
    struct ls_render_work *work;
    struct ls_command_context context; /* with a connection */
    pthread_t thread;
};

#endif

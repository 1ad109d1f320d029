/*
 * store_writer: the thread ls-store, its bounded queue and the group commit.
 * Layer: daemon, internal to the store. Threads: enqueue, flush, stats and error from any normal
 * thread; start and stop from one. Ownership: enqueue takes the item over.
 */
#ifndef LS_DAEMON_STORE_WRITER_H
#define LS_DAEMON_STORE_WRITER_H

#include "core/error.h"
#include "daemon/journal.h"
#include "daemon/store.h"
#include "daemon/take_folder.h"
#include "daemon/write_buffers.h"

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { LS_COMMIT_PICTURES = 16 };

enum ls_store_item_kind {
    LS_ITEM_TICKET,
    LS_ITEM_PICTURE,
    LS_ITEM_RAW,
    LS_ITEM_ALARM,
    LS_ITEM_STATE
};

/** Work: put a file in place (if it has bytes), then append a record (if it has one). */
struct ls_store_item {
    struct ls_store_item *next;
    enum ls_store_item_kind kind;
    struct ls_journal_batch record; /* appended once the file is in place */
    uint32_t camera;
    struct ls_picture_times times; /* PICTURE */
    char condition[64];            /* PICTURE */
    char file[128];                /* PICTURE, RAW, STATE: relative to the take folder */
    struct ls_write_buffer buffer; /* its contents */
    size_t n;
};

struct ls_store_writer {
    struct ls_take_folder folder; /* ls-store's own while it runs */
    struct ls_write_buffers buffers;

    pthread_t thread;
    pthread_mutex_t lock; /* of everything down to the next blank line */
    pthread_cond_t work, progress;
    struct ls_store_item *first, **last;
    size_t queue_bytes, queue_limit_bytes;
    uint64_t queued, processed, durable; /* items, counted from the start */
    uint64_t flush_wanted;               /* commit as soon as `processed` reaches it */
    struct ls_store_stats stats;
    bool stopping;
    enum ls_err err; /* the first one, latched */
    struct ls_diag err_diag;

    /* ls-store alone */
    struct ls_journal_batch batch;
    uint32_t batch_tickets, batch_pictures;
    bool told_of_cache; /* that the file system refuses direct writes */
    struct ls_picture_times batch_times[LS_COMMIT_PICTURES];
    char batch_conditions[LS_COMMIT_PICTURES][64];
    uint32_t batch_cameras[LS_COMMIT_PICTURES];
    ls_store_published *published; /* or NULL */
    void *published_user;
    int64_t batch_since_ns; /* 0 = empty */
    bool dirty[LS_FOLDER_MAX_CAMERAS], raw_dirty[LS_FOLDER_MAX_CAMERAS];
};

/** Lock and queue; the folder is the caller's to open. */
void ls_store_writer_init(struct ls_store_writer *writer);

LS_MUST_CHECK enum ls_err ls_store_writer_start(struct ls_store_writer *writer,
                                                struct ls_diag *diag);

/** NULL with LS_ERR_NOMEM's sentence in @diag. */
struct ls_store_item *ls_store_item_new(enum ls_store_item_kind kind, struct ls_diag *diag);

/** And give its buffer back. NULL is allowed. */
void ls_store_item_free(struct ls_store_writer *writer, struct ls_store_item *item);

/** Waits while the queue is full; one item always fits. Returns the latched error. */
LS_MUST_CHECK enum ls_err ls_store_writer_enqueue(struct ls_store_writer *writer,
                                                  struct ls_store_item *item, struct ls_diag *diag);

/** Wait until everything enqueued before is durable, or return the latched error. */
LS_MUST_CHECK enum ls_err ls_store_writer_flush(struct ls_store_writer *writer,
                                                struct ls_diag *diag);

/** The latched error; call with the lock held or after stop. */
LS_MUST_CHECK enum ls_err ls_store_writer_error(const struct ls_store_writer *writer,
                                                struct ls_diag *diag);

/** Work off the queue, commit, end the thread. */
void ls_store_writer_stop(struct ls_store_writer *writer);

/** Free queue and lock, not the folder. Not while the thread runs. */
void ls_store_writer_finish(struct ls_store_writer *writer);

#endif

#include "daemon/store_writer.h"

#include "daemon/realtime.h"

#include <glib.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { ITEM_COST_BYTES = 512 /* of an item beside its bytes */ };
static const int64_t commit_ns = 50 * 1000000LL;
static const size_t default_queue_bytes = (size_t)256 << 20;

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

struct ls_store_item *ls_store_item_new(enum ls_store_item_kind kind, struct ls_diag *diag)
{
    struct ls_store_item *item = calloc(1, sizeof *item);
    if (item)
        item->kind = kind;
    else
        ls_fail(diag, LS_ERR_NOMEM, "no memory for the store's queue");
    return item;
}

void ls_store_item_free(struct ls_store_writer *writer, struct ls_store_item *item)
{
    if (!item)
        return;
    ls_journal_batch_finish(&item->record);
    ls_write_buffers_give_back(&writer->buffers, item->buffer);
    free(item);
}

static enum ls_err sync_dirty(struct ls_store_writer *writer, struct ls_diag *diag)
{
    struct ls_take_folder *folder = &writer->folder;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < folder->n_cameras && !err; k++) {
        if (writer->dirty[k])
            err = ls_disk_sync_dir(folder->shim, folder->camera_fd[k], "of a camera", diag);
        if (writer->raw_dirty[k] && !err)
            err = ls_disk_sync_dir(folder->shim, folder->raw_fd[k], "of raw frames", diag);
        writer->dirty[k] = writer->raw_dirty[k] = false;
    }
    return err;
}

/* Everything pending becomes durable: folders first, then the records that vouch for the files. */
static enum ls_err commit(struct ls_store_writer *writer, struct ls_diag *diag)
{
    struct ls_take_folder *folder = &writer->folder;
    struct ls_journal_batch *batch = &writer->batch;
    enum ls_err err = sync_dirty(writer, diag);
    if (!err)
        err = ls_take_folder_release(folder, batch->n, diag);
    if (!err)
        err =
            ls_disk_write(folder->shim, folder->journal_fd, "journal", batch->text, batch->n, diag);
    if (!err)
        err = ls_disk_sync(folder->shim, folder->journal_fd, "journal", diag);
    batch->n = 0;
    writer->batch_since_ns = 0;
    return err;
}

static void tell_of_cache(struct ls_store_writer *writer)
{
    if (!writer->told_of_cache)
        g_message("take %s: its file system refuses direct writes; pictures pass the page cache, "
                  "which costs several times the processor time",
                  writer->folder.id);
    writer->told_of_cache = true;
}

static enum ls_err put_file(struct ls_store_writer *writer, const struct ls_store_item *item,
                            struct ls_diag *diag)
{
    struct ls_take_folder *folder = &writer->folder;
    enum ls_err err = ls_take_folder_release(folder, item->n, diag);
    size_t n_direct = 0;
    if (!err)
        err = ls_disk_replace(folder->shim, folder->dir_fd, item->file, item->buffer.bytes, item->n,
                              &n_direct, diag);
    if (!err && !n_direct && ls_disk_can_be_direct(item->buffer.bytes, item->n))
        tell_of_cache(writer);
    return err;
}

static enum ls_err add_record(struct ls_store_writer *writer, const struct ls_store_item *item,
                              struct ls_diag *diag)
{
    if (ls_journal_add_batch(&writer->batch, &item->record))
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a journal record");
    return LS_OK;
}

/* The journal first: what take.json calls complete has no torn end that nobody will cut off. */
static enum ls_err put_state(struct ls_store_writer *writer, const struct ls_store_item *item,
                             struct ls_diag *diag)
{
    struct ls_take_folder *folder = &writer->folder;
    enum ls_err err = add_record(writer, item, diag);
    if (!err)
        err = commit(writer, diag);
    if (!err)
        err = put_file(writer, item, diag);
    if (!err)
        err = ls_disk_sync_dir(folder->shim, folder->dir_fd, folder->path, diag);
    return err;
}

static void note_picture(struct ls_store_writer *writer, const struct ls_store_item *item)
{
    uint32_t n = writer->batch_pictures++;
    writer->batch_times[n] = item->times;
    memcpy(writer->batch_conditions[n], item->condition, sizeof item->condition);
    writer->batch_cameras[n] = item->camera;
}

static enum ls_err process(struct ls_store_writer *writer, const struct ls_store_item *item,
                           struct ls_diag *diag)
{
    bool state = item->kind == LS_ITEM_STATE;
    enum ls_err err = state ? put_state(writer, item, diag) : LS_OK;
    if (!state && item->buffer.bytes)
        err = put_file(writer, item, diag);
    if (!state && !err)
        err = add_record(writer, item, diag);
    writer->batch_tickets += item->kind == LS_ITEM_TICKET;
    if (item->kind == LS_ITEM_PICTURE)
        note_picture(writer, item);
    writer->dirty[item->camera] |= item->kind == LS_ITEM_PICTURE;
    writer->raw_dirty[item->camera] |= item->kind == LS_ITEM_RAW;
    if (!writer->batch_since_ns)
        writer->batch_since_ns = now_ns();
    return err;
}

static void latch(struct ls_store_writer *writer, enum ls_err err, const struct ls_diag *diag)
{
    if (err && !writer->err) {
        writer->err = err;
        writer->err_diag = *diag;
    }
}

static bool commit_due(const struct ls_store_writer *writer)
{
    if (!writer->batch_since_ns || writer->err)
        return false;
    bool flushing =
        writer->flush_wanted > writer->durable && writer->processed >= writer->flush_wanted;
    return flushing || (writer->stopping && !writer->first) ||
           writer->batch_pictures >= LS_COMMIT_PICTURES ||
           now_ns() - writer->batch_since_ns >= commit_ns;
}

static void tell_stored(const struct ls_store_writer *writer)
{
    uint64_t now = ls_host_ns();
    for (uint32_t i = 0; i < writer->batch_pictures; i++) {
        ls_metrics_stored(&writer->batch_times[i], now);
        if (writer->published)
            writer->published(writer->published_user, writer->batch_conditions[i],
                              writer->batch_cameras[i]);
    }
}

/* Called with the lock held; drops it while the disk works. */
static void commit_unlocked(struct ls_store_writer *writer)
{
    struct ls_diag diag = {0};
    uint64_t reached = writer->processed;
    pthread_mutex_unlock(&writer->lock);
    enum ls_err err = commit(writer, &diag);
    if (!err)
        tell_stored(writer);
    pthread_mutex_lock(&writer->lock);
    latch(writer, err, &diag);
    if (!err) {
        writer->durable = reached;
        writer->stats.tickets += writer->batch_tickets;
        writer->stats.published += writer->batch_pictures;
        writer->stats.commits++;
    }
    writer->batch_tickets = writer->batch_pictures = 0;
    pthread_cond_broadcast(&writer->progress);
}

static size_t cost_of(const struct ls_store_item *item)
{
    return item->n + item->record.n + ITEM_COST_BYTES;
}

static void process_unlocked(struct ls_store_writer *writer)
{
    struct ls_diag diag = {0};
    struct ls_store_item *item = writer->first;
    writer->first = item->next;
    if (!writer->first)
        writer->last = &writer->first;
    bool dead = writer->err != LS_OK;
    pthread_mutex_unlock(&writer->lock);
    enum ls_err err = dead ? LS_OK : process(writer, item, &diag);
    size_t cost = cost_of(item), file_bytes = dead || item->kind == LS_ITEM_STATE ? 0 : item->n;
    ls_store_item_free(writer, item);
    pthread_mutex_lock(&writer->lock);
    latch(writer, err, &diag);
    writer->queue_bytes -= cost;
    writer->stats.bytes += err ? 0 : file_bytes;
    writer->processed++;
    pthread_cond_broadcast(&writer->progress);
}

static void wait_for_work(struct ls_store_writer *writer)
{
    if (!writer->batch_since_ns || writer->err) {
        pthread_cond_wait(&writer->work, &writer->lock);
        return;
    }
    int64_t until = writer->batch_since_ns + commit_ns;
    struct timespec t = {until / 1000000000, until % 1000000000};
    pthread_cond_timedwait(&writer->work, &writer->lock, &t);
}

static void *run(void *user)
{
    struct ls_store_writer *writer = user;
    pthread_mutex_lock(&writer->lock);
    for (;;) {
        if (commit_due(writer))
            commit_unlocked(writer);
        else if (writer->first)
            process_unlocked(writer);
        else if (writer->stopping)
            break;
        else
            wait_for_work(writer);
    }
    pthread_mutex_unlock(&writer->lock);
    return NULL;
}

enum ls_err ls_store_writer_error(const struct ls_store_writer *writer, struct ls_diag *diag)
{
    return writer->err ? ls_fail(diag, writer->err, "%s", writer->err_diag.text) : LS_OK;
}

enum ls_err ls_store_writer_enqueue(struct ls_store_writer *writer, struct ls_store_item *item,
                                    struct ls_diag *diag)
{
    size_t cost = cost_of(item);
    pthread_mutex_lock(&writer->lock);
    while (!writer->err && writer->queue_bytes &&
           writer->queue_bytes + cost > writer->queue_limit_bytes)
        pthread_cond_wait(&writer->progress, &writer->lock);
    enum ls_err err = ls_store_writer_error(writer, diag);
    if (!err) {
        *writer->last = item;
        writer->last = &item->next;
        writer->queue_bytes += cost;
        writer->queued++;
        pthread_cond_signal(&writer->work);
    }
    pthread_mutex_unlock(&writer->lock);
    if (err)
        ls_store_item_free(writer, item);
    return err;
}

enum ls_err ls_store_writer_flush(struct ls_store_writer *writer, struct ls_diag *diag)
{
    pthread_mutex_lock(&writer->lock);
    uint64_t wanted = writer->queued;
    if (wanted > writer->flush_wanted)
        writer->flush_wanted = wanted;
    pthread_cond_signal(&writer->work);
    while (!writer->err && writer->durable < wanted)
        pthread_cond_wait(&writer->progress, &writer->lock);
    enum ls_err err = ls_store_writer_error(writer, diag);
    pthread_mutex_unlock(&writer->lock);
    return err;
}

void ls_store_writer_init(struct ls_store_writer *writer)
{
    pthread_condattr_t attr;
    *writer = (struct ls_store_writer){0};
    pthread_condattr_init(&attr);
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_cond_init(&writer->work, &attr);
    pthread_cond_init(&writer->progress, NULL);
    pthread_condattr_destroy(&attr);
    pthread_mutex_init(&writer->lock, NULL);
    ls_write_buffers_init(&writer->buffers);
    writer->last = &writer->first;
    writer->queue_limit_bytes = default_queue_bytes;
}

enum ls_err ls_store_writer_start(struct ls_store_writer *writer, struct ls_diag *diag)
{
    int error = pthread_create(&writer->thread, NULL, run, writer);
    if (error)
        return ls_fail(diag, LS_ERR_OS, "cannot start ls-store: %s", strerror(error));
    pthread_setname_np(writer->thread, "ls-store");
    return LS_OK;
}

void ls_store_writer_stop(struct ls_store_writer *writer)
{
    pthread_mutex_lock(&writer->lock);
    writer->stopping = true;
    pthread_cond_signal(&writer->work);
    pthread_mutex_unlock(&writer->lock);
    pthread_join(writer->thread, NULL);
}

void ls_store_writer_finish(struct ls_store_writer *writer)
{
    while (writer->first) {
        struct ls_store_item *item = writer->first;
        writer->first = item->next;
        ls_store_item_free(writer, item);
    }
    pthread_cond_destroy(&writer->work);
    pthread_cond_destroy(&writer->progress);
    pthread_mutex_destroy(&writer->lock);
    ls_journal_batch_finish(&writer->batch);
    ls_write_buffers_finish(&writer->buffers);
}

#include "daemon/store.h"

#include "daemon/journal.h"
#include "daemon/take_folder.h"
#include "daemon/take_head.h"
#include "daemon/takedir.h"
#include "daemon/tilesum.h"

#include <glib.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    COMMIT_PICTURES = 16,
    ITEM_COST_BYTES = 512, /* of an item without its bytes */
    SHOT_OVERHEAD_BYTES = 1024, /* of journal: a ticket is about 500 bytes, half of them repaired */
    TAKE_OVERHEAD_BYTES = 1 << 20,
};
static const int64_t commit_ns = 50 * 1000000LL;
static const size_t default_queue_bytes = (size_t)256 << 20;

enum kind { TICKET, PICTURE, RAW, ALARM, STATE };

struct item {
    struct item *next;
    enum kind kind;
    struct ls_journal_batch record; /* to append once the file is in place */
    uint32_t camera;
    char file[128]; /* PICTURE, RAW, STATE */
    uint8_t *bytes; /* its contents */
    size_t n;
};

struct ls_store {
    struct ls_take_folder folder;
    struct ls_take_head head;
    char *document; /* the caller's JSON */
    size_t queue_limit_bytes;

    pthread_t thread;
    pthread_mutex_t lock; /* of everything below down to the next blank line */
    pthread_cond_t work, progress;
    struct item *first, **last;
    size_t queue_bytes;
    uint64_t queued, processed, durable; /* items, counted from the start */
    uint64_t flush_wanted;               /* commit as soon as `processed` reaches it */
    GHashTable *published;               /* "cam<k>/<condition>" */
    struct ls_store_stats stats;
    bool stopping;
    enum ls_err err;
    struct ls_diag err_diag;

    /* ls-store alone */
    struct ls_journal_batch batch;
    uint32_t batch_tickets, batch_pictures;
    int64_t batch_since_ns; /* 0 = empty */
    bool dirty[LS_FOLDER_MAX_CAMERAS], raw_dirty[LS_FOLDER_MAX_CAMERAS];
};

static int64_t now_ns(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

/* ---- ls-store: the disk's side ---- */

static void free_item(struct item *item)
{
    if (!item)
        return;
    ls_journal_batch_finish(&item->record);
    free(item->bytes);
    free(item);
}

static enum ls_err sync_dirty(struct ls_store *store, struct ls_diag *diag)
{
    struct ls_take_folder *folder = &store->folder;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < folder->n_cameras && !err; k++) {
        if (store->dirty[k])
            err = ls_disk_sync_dir(folder->shim, folder->camera_fd[k], "of a camera", diag);
        if (store->raw_dirty[k] && !err)
            err = ls_disk_sync_dir(folder->shim, folder->raw_fd[k], "of raw frames", diag);
        store->dirty[k] = store->raw_dirty[k] = false;
    }
    return err;
}

/* Everything pending becomes durable: folders first, then the records that vouch for the files. */
static enum ls_err commit(struct ls_store *store, struct ls_diag *diag)
{
    struct ls_take_folder *folder = &store->folder;
    struct ls_journal_batch *batch = &store->batch;
    enum ls_err err = sync_dirty(store, diag);
    if (!err)
        err = ls_take_folder_release(folder, batch->n, diag);
    if (!err)
        err = ls_disk_write(folder->shim, folder->journal_fd, "journal", batch->text, batch->n,
                            diag);
    if (!err)
        err = ls_disk_sync(folder->shim, folder->journal_fd, "journal", diag);
    batch->n = 0;
    store->batch_since_ns = 0;
    return err;
}

static enum ls_err put_file(struct ls_store *store, const struct item *item, struct ls_diag *diag)
{
    struct ls_take_folder *folder = &store->folder;
    enum ls_err err = ls_take_folder_release(folder, item->n, diag);
    if (!err)
        err = ls_disk_replace(folder->shim, folder->dir_fd, item->file, item->bytes, item->n,
                              diag);
    return err;
}

static enum ls_err put_state(struct ls_store *store, const struct item *item,
                             struct ls_diag *diag)
{
    struct ls_take_folder *folder = &store->folder;
    enum ls_err err = commit(store, diag);
    if (!err)
        err = put_file(store, item, diag);
    if (!err)
        err = ls_disk_sync_dir(folder->shim, folder->dir_fd, folder->path, diag);
    return err;
}

static enum ls_err process(struct ls_store *store, const struct item *item, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (item->kind == STATE)
        err = put_state(store, item, diag);
    else if (item->bytes)
        err = put_file(store, item, diag);
    if (!err && ls_journal_add_batch(&store->batch, &item->record))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for a journal record");
    store->batch_tickets += item->kind == TICKET;
    store->batch_pictures += item->kind == PICTURE;
    store->dirty[item->camera] |= item->kind == PICTURE;
    store->raw_dirty[item->camera] |= item->kind == RAW;
    if (!store->batch_since_ns)
        store->batch_since_ns = now_ns(CLOCK_MONOTONIC);
    return err;
}

static void latch(struct ls_store *store, enum ls_err err, const struct ls_diag *diag)
{
    if (err && !store->err) {
        store->err = err;
        store->err_diag = *diag;
    }
}

static bool commit_due(const struct ls_store *store)
{
    if (!store->batch_since_ns || store->err)
        return false;
    bool flushing = store->flush_wanted > store->durable &&
                    store->processed >= store->flush_wanted;
    return flushing || (store->stopping && !store->first) ||
           store->batch_pictures >= COMMIT_PICTURES ||
           now_ns(CLOCK_MONOTONIC) - store->batch_since_ns >= commit_ns;
}

/* Called with the lock held; drops it while the disk works. */
static void commit_unlocked(struct ls_store *store)
{
    struct ls_diag diag = {0};
    uint64_t reached = store->processed;
    pthread_mutex_unlock(&store->lock);
    enum ls_err err = commit(store, &diag);
    pthread_mutex_lock(&store->lock);
    latch(store, err, &diag);
    if (!err) {
        store->durable = reached;
        store->stats.tickets += store->batch_tickets;
        store->stats.published += store->batch_pictures;
        store->stats.commits++;
    }
    store->batch_tickets = store->batch_pictures = 0;
    pthread_cond_broadcast(&store->progress);
}

static size_t cost_of(const struct item *item)
{
    return item->n + item->record.n + ITEM_COST_BYTES;
}

static void process_unlocked(struct ls_store *store)
{
    struct ls_diag diag = {0};
    struct item *item = store->first;
    store->first = item->next;
    if (!store->first)
        store->last = &store->first;
    bool dead = store->err != LS_OK;
    pthread_mutex_unlock(&store->lock);
    enum ls_err err = dead ? LS_OK : process(store, item, &diag);
    size_t cost = cost_of(item), file_bytes = dead || item->kind == STATE ? 0 : item->n;
    free_item(item);
    pthread_mutex_lock(&store->lock);
    latch(store, err, &diag);
    store->queue_bytes -= cost;
    store->stats.bytes += err ? 0 : file_bytes;
    store->processed++;
    pthread_cond_broadcast(&store->progress);
}

static void wait_for_work(struct ls_store *store)
{
    if (!store->batch_since_ns || store->err) {
        pthread_cond_wait(&store->work, &store->lock);
        return;
    }
    int64_t until = store->batch_since_ns + commit_ns;
    struct timespec t = {until / 1000000000, until % 1000000000};
    pthread_cond_timedwait(&store->work, &store->lock, &t);
}

static void *run(void *user)
{
    struct ls_store *store = user;
    pthread_mutex_lock(&store->lock);
    for (;;) {
        if (commit_due(store))
            commit_unlocked(store);
        else if (store->first)
            process_unlocked(store);
        else if (store->stopping)
            break;
        else
            wait_for_work(store);
    }
    pthread_mutex_unlock(&store->lock);
    return NULL;
}

/* ---- the callers' side ---- */

static enum ls_err latched(const struct ls_store *store, struct ls_diag *diag)
{
    return store->err ? ls_fail(diag, store->err, "%s", store->err_diag.text) : LS_OK;
}

/* Takes @item over, whatever it returns. Waits while the queue is full. */
static enum ls_err enqueue(struct ls_store *store, struct item *item, struct ls_diag *diag)
{
    size_t cost = cost_of(item);
    pthread_mutex_lock(&store->lock);
    while (!store->err && store->queue_bytes &&
           store->queue_bytes + cost > store->queue_limit_bytes)
        pthread_cond_wait(&store->progress, &store->lock);
    enum ls_err err = latched(store, diag);
    if (!err) {
        *store->last = item;
        store->last = &item->next;
        store->queue_bytes += cost;
        store->queued++;
        pthread_cond_signal(&store->work);
    }
    pthread_mutex_unlock(&store->lock);
    if (err)
        free_item(item);
    return err;
}

static struct item *new_item(enum kind kind, struct ls_diag *diag)
{
    struct item *item = calloc(1, sizeof *item);
    if (item)
        item->kind = kind;
    else
        ls_fail(diag, LS_ERR_NOMEM, "no memory for the store's queue");
    return item;
}

enum ls_err ls_store_ticket(struct ls_store *store, const struct ls_ticket *ticket,
                            struct ls_diag *diag)
{
    struct item *item = new_item(TICKET, diag);
    if (!item)
        return LS_ERR_NOMEM;
    enum ls_err err = ls_journal_add_ticket(&item->record, ticket);
    if (!err)
        return enqueue(store, item, diag);
    free_item(item);
    return ls_fail(diag, err, "ticket of shot %u: %s", ticket->shot,
                   err == LS_ERR_INVALID ? "a time in it is not finite" : "no memory");
}

enum ls_err ls_store_alarm(struct ls_store *store, const char *text, struct ls_diag *diag)
{
    struct item *item = new_item(ALARM, diag);
    if (!item)
        return LS_ERR_NOMEM;
    enum ls_err err = ls_journal_add_alarm(&item->record, (uint64_t)now_ns(CLOCK_MONOTONIC_RAW),
                                           text);
    if (!err)
        return enqueue(store, item, diag);
    free_item(item);
    return ls_fail(diag, err, "no memory for an alarm");
}

enum ls_err ls_store_raw(struct ls_store *store, uint32_t camera, uint32_t shot, uint32_t attempt,
                         const void *bytes, size_t n_bytes, struct ls_diag *diag)
{
    if (!store->head.keep_raw)
        return ls_fail(diag, LS_ERR_STATE, "this take does not keep raw frames");
    if (camera >= store->head.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u of %u", camera, store->head.n_cameras);
    struct item *item = new_item(RAW, diag);
    if (!item)
        return LS_ERR_NOMEM;
    item->bytes = malloc(n_bytes ? n_bytes : 1);
    if (!item->bytes) {
        free_item(item);
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a raw frame of %zu bytes", n_bytes);
    }
    memcpy(item->bytes, bytes, n_bytes);
    item->n = n_bytes;
    item->camera = camera;
    snprintf(item->file, sizeof item->file, "cam%u/raw/%u-%u.raw", camera, shot, attempt);
    return enqueue(store, item, diag);
}

static enum ls_err check_picture(const struct ls_store *store,
                                 const struct ls_store_picture *picture, struct ls_diag *diag)
{
    const struct ls_exr_mosaic *mosaic = &picture->mosaic;
    if (!ls_takedir_name_ok(picture->condition, 63))
        return ls_fail(diag, LS_ERR_INVALID, "condition \"%.80s\": expected 1 to 63 letters, "
                       "digits, _ or -", picture->condition);
    if (picture->camera >= store->head.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "condition %s: camera %u of %u", picture->condition,
                       picture->camera, store->head.n_cameras);
    if (!mosaic->half == !mosaic->floats || !mosaic->width || !mosaic->height)
        return ls_fail(diag, LS_ERR_INVALID, "condition %s: expected either half or float pixels "
                       "of at least 1 x 1", picture->condition);
    return LS_OK;
}

/* Only one may publish a condition: the key is taken first, given back if encoding fails. */
static enum ls_err claim(struct ls_store *store, const char *key, struct ls_diag *diag)
{
    pthread_mutex_lock(&store->lock);
    enum ls_err err = latched(store, diag);
    if (!err && !g_hash_table_add(store->published, g_strdup(key)))
        err = ls_fail(diag, LS_ERR_EXISTS, "%s is published already", key);
    pthread_mutex_unlock(&store->lock);
    return err;
}

static void unclaim(struct ls_store *store, const char *key)
{
    pthread_mutex_lock(&store->lock);
    g_hash_table_remove(store->published, key);
    pthread_mutex_unlock(&store->lock);
}

static enum ls_err encode(const struct ls_store_picture *picture, struct item *item,
                          struct ls_diag *diag)
{
    struct ls_published published = {.camera = picture->camera};
    enum ls_err err = ls_exr_write_mosaic(&picture->mosaic, &item->bytes, &item->n, diag);
    if (err)
        return err;
    item->camera = picture->camera;
    snprintf(item->file, sizeof item->file, "cam%u/%s.exr", picture->camera, picture->condition);
    g_strlcpy(published.file, item->file, sizeof published.file);
    g_strlcpy(published.condition, picture->condition, sizeof published.condition);
    published.bytes = item->n;
    err = ls_tilesum(&picture->mosaic, &published);
    if (!err)
        err = ls_journal_add_published(&item->record, &published);
    ls_published_finish(&published);
    return err ? ls_fail(diag, err, "condition %s: %s", picture->condition, ls_err_name(err))
               : LS_OK;
}

enum ls_err ls_store_publish(struct ls_store *store, const struct ls_store_picture *picture,
                             struct ls_diag *diag)
{
    char key[128];
    enum ls_err err = check_picture(store, picture, diag);
    if (err)
        return err;
    snprintf(key, sizeof key, "cam%u/%s", picture->camera, picture->condition);
    err = claim(store, key, diag);
    if (err)
        return err;
    struct item *item = new_item(PICTURE, diag);
    err = item ? encode(picture, item, diag) : LS_ERR_NOMEM;
    if (err)
        free_item(item);
    else
        err = enqueue(store, item, diag);
    if (err)
        unclaim(store, key);
    return err;
}

enum ls_err ls_store_flush(struct ls_store *store, struct ls_diag *diag)
{
    pthread_mutex_lock(&store->lock);
    uint64_t wanted = store->queued;
    if (wanted > store->flush_wanted)
        store->flush_wanted = wanted;
    pthread_cond_signal(&store->work);
    while (!store->err && store->durable < wanted)
        pthread_cond_wait(&store->progress, &store->lock);
    enum ls_err err = latched(store, diag);
    pthread_mutex_unlock(&store->lock);
    return err;
}

void ls_store_stats(struct ls_store *store, struct ls_store_stats *out)
{
    pthread_mutex_lock(&store->lock);
    *out = store->stats;
    out->queued = (uint32_t)(store->queued - store->processed);
    pthread_mutex_unlock(&store->lock);
}

enum ls_err ls_store_set_state(struct ls_store *store, const struct ls_store_end *end,
                               struct ls_diag *diag)
{
    char *text;
    store->head.state = end->state;
    enum ls_err err = ls_take_head_write(&store->head,
                                         end->take_json ? end->take_json : store->document,
                                         end->missing, end->n_missing, end->skips_json, &text,
                                         diag);
    if (err)
        return err;
    struct item *item = new_item(STATE, diag);
    if (!item) {
        free(text);
        return LS_ERR_NOMEM;
    }
    item->bytes = (uint8_t *)text;
    item->n = strlen(text);
    strcpy(item->file, "take.json");
    err = ls_journal_add_state(&item->record, (uint64_t)now_ns(CLOCK_MONOTONIC_RAW),
                               ls_store_state_name(end->state));
    if (err) {
        free_item(item);
        return ls_fail(diag, err, "no memory for a state");
    }
    err = enqueue(store, item, diag);
    return err ? err : ls_store_flush(store, diag);
}

const char *ls_store_folder(const struct ls_store *store)
{
    return store->folder.path;
}

const char *ls_store_id(const struct ls_store *store)
{
    return store->folder.id;
}

bool ls_store_keeps_raw(const struct ls_store *store)
{
    return store->head.keep_raw;
}

/* ---- life ---- */

static void free_store(struct ls_store *store)
{
    while (store->first) {
        struct item *item = store->first;
        store->first = item->next;
        free_item(item);
    }
    if (store->published)
        g_hash_table_destroy(store->published);
    pthread_cond_destroy(&store->work);
    pthread_cond_destroy(&store->progress);
    pthread_mutex_destroy(&store->lock);
    ls_journal_batch_finish(&store->batch);
    ls_take_head_finish(&store->head);
    free(store->document);
    free(store);
}

static struct ls_store *new_store(size_t queue_bytes)
{
    struct ls_store *store = calloc(1, sizeof *store);
    if (!store)
        return NULL;
    pthread_condattr_t attr;
    pthread_condattr_init(&attr);
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_cond_init(&store->work, &attr);
    pthread_cond_init(&store->progress, NULL);
    pthread_condattr_destroy(&attr);
    pthread_mutex_init(&store->lock, NULL);
    store->last = &store->first;
    store->queue_limit_bytes = queue_bytes ? queue_bytes : default_queue_bytes;
    store->published = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    return store;
}

static enum ls_err start(struct ls_store *store, struct ls_diag *diag)
{
    int error = pthread_create(&store->thread, NULL, run, store);
    if (error)
        return ls_fail(diag, LS_ERR_OS, "cannot start ls-store: %s", strerror(error));
    pthread_setname_np(store->thread, "ls-store");
    return LS_OK;
}

static enum ls_err make_head(const struct ls_store_config *config, struct ls_take_head *head,
                             struct ls_diag *diag)
{
    time_t seconds = (time_t)config->utc_s;
    struct tm tm;
    if (!ls_takedir_name_ok(config->name, 64))
        return ls_fail(diag, LS_ERR_INVALID, "take name \"%.80s\": expected 1 to 64 letters, "
                       "digits, _ or -", config->name);
    if (!config->n_cameras || config->n_cameras > LS_FOLDER_MAX_CAMERAS ||
        !gmtime_r(&seconds, &tm))
        return ls_fail(diag, LS_ERR_INVALID, "a take of %u cameras at second %lld",
                       config->n_cameras, (long long)config->utc_s);
    head->n_cameras = config->n_cameras;
    head->n_shots = config->n_shots;
    head->keep_raw = config->keep_raw;
    strcpy(head->name, config->name);
    strftime(head->utc, sizeof head->utc, "%Y-%m-%dT%H:%M:%SZ", &tm);
    head->conditions = calloc(config->n_conditions + 1, sizeof *head->conditions);
    if (!head->conditions)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for %u conditions", config->n_conditions);
    for (uint32_t k = 0; k < config->n_conditions; k++) {
        if (!ls_takedir_name_ok(config->conditions[k], 63))
            return ls_fail(diag, LS_ERR_INVALID, "condition \"%.80s\": expected 1 to 63 letters, "
                           "digits, _ or -", config->conditions[k]);
        head->conditions[k] = strdup(config->conditions[k]);
        if (!head->conditions[k])
            return ls_fail(diag, LS_ERR_NOMEM, "no memory for %u conditions",
                           config->n_conditions);
        head->n_conditions++;
    }
    return LS_OK;
}

/* take.json on the disk says "open" and the space is ours before anything fires. */
static enum ls_err begin(struct ls_store *store, uint64_t need_bytes, uint64_t spare_bytes,
                         struct ls_diag *diag)
{
    struct ls_take_folder *folder = &store->folder;
    char *text = NULL;
    store->head.state = LS_STORE_OPEN;
    need_bytes += (uint64_t)store->head.n_shots * SHOT_OVERHEAD_BYTES + TAKE_OVERHEAD_BYTES +
                  2 * strlen(store->document);
    enum ls_err err = ls_take_head_write(&store->head, store->document, NULL, 0, NULL, &text,
                                         diag);
    if (!err)
        err = ls_take_folder_reserve(folder, need_bytes, spare_bytes, diag);
    if (!err)
        err = ls_take_folder_release(folder, strlen(text), diag);
    if (!err)
        err = ls_disk_replace(folder->shim, folder->dir_fd, "take.json", text, strlen(text), diag);
    if (!err)
        err = ls_disk_sync_dir(folder->shim, folder->dir_fd, folder->path, diag);
    free(text);
    return err ? err : start(store, diag);
}

enum ls_err ls_store_create(const struct ls_store_config *config, struct ls_store **out,
                            struct ls_diag *diag)
{
    struct ls_store *store = new_store(config->queue_bytes);
    if (!store)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    enum ls_err err = make_head(config, &store->head, diag);
    if (!err && !(store->document = strdup(config->take_json)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    if (!err)
        err = ls_take_folder_create(config->root, config->name, config->utc_s, config->n_cameras,
                                    config->keep_raw, config->shim, &store->folder, diag);
    if (!err) {
        err = begin(store, config->need_bytes, config->spare_bytes, diag);
        if (err)
            ls_take_folder_discard(&store->folder);
    }
    if (err) {
        free_store(store);
        return err;
    }
    *out = store;
    return LS_OK;
}

static enum ls_err adopt(struct ls_store *store, struct ls_takedir *take, struct ls_diag *diag)
{
    enum ls_err err = ls_take_head_parse(take->take_json, strlen(take->take_json), &store->head,
                                         diag);
    if (!err && !(store->document = strdup(take->take_json)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    for (size_t k = 0; k < take->n_published && !err; k++)
        g_hash_table_add(store->published, g_strdup_printf("cam%u/%s", take->published[k].camera,
                                                           take->published[k].condition));
    if (!err && take->torn_bytes)
        err = ls_disk_truncate(store->folder.shim, store->folder.journal_fd, "journal",
                               take->journal_good_bytes, diag);
    if (!err && take->torn_bytes)
        err = ls_disk_sync(store->folder.shim, store->folder.journal_fd, "journal", diag);
    return err ? err : ls_take_folder_sweep(&store->folder, diag);
}

/* Read twice: once to know what to lock, then, under the lock, what is really there. */
static enum ls_err reopen(struct ls_store *store, const char *folder,
                          const struct ls_disk_shim *shim, struct ls_diag *diag)
{
    struct ls_takedir *take;
    enum ls_err err = ls_takedir_open(folder, &take, diag);
    if (err)
        return err;
    err = ls_take_folder_open(folder, take->n_cameras, take->keep_raw, shim, &store->folder, diag);
    ls_takedir_close(take);
    if (err)
        return err;
    err = ls_takedir_open(folder, &take, diag);
    if (!err && take->state == LS_STORE_COMPLETE)
        err = ls_fail(diag, LS_ERR_STATE, "take %s is complete: nothing is missing", take->id);
    if (!err)
        err = adopt(store, take, diag);
    ls_takedir_close(take);
    return err;
}

enum ls_err ls_store_reopen(const char *folder, uint64_t need_bytes, uint64_t spare_bytes,
                            const struct ls_disk_shim *shim, struct ls_store **out,
                            struct ls_diag *diag)
{
    struct ls_store *store = new_store(0);
    if (!store)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    enum ls_err err = reopen(store, folder, shim, diag);
    if (!err)
        err = begin(store, need_bytes, spare_bytes, diag);
    if (err) {
        if (store->folder.path)
            ls_take_folder_close(&store->folder);
        free_store(store);
        return err;
    }
    *out = store;
    return LS_OK;
}

enum ls_err ls_store_close(struct ls_store *store, struct ls_diag *diag)
{
    if (!store)
        return LS_OK;
    pthread_mutex_lock(&store->lock);
    store->stopping = true;
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
    pthread_join(store->thread, NULL);
    enum ls_err err = latched(store, diag);
    ls_take_folder_close(&store->folder);
    free_store(store);
    return err;
}

#include "daemon/store_private.h"

#include "daemon/journal.h"
#include "daemon/realtime.h"
#include "daemon/takedir.h"
#include "daemon/tilesum.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum ls_err ls_store_ticket(struct ls_store *store, const struct ls_ticket *ticket,
                            struct ls_diag *diag)
{
    struct ls_store_item *item = ls_store_item_new(LS_ITEM_TICKET, diag);
    if (!item)
        return LS_ERR_NOMEM;
    enum ls_err err = ls_journal_add_ticket(&item->record, ticket);
    if (!err)
        return ls_store_writer_enqueue(&store->writer, item, diag);
    ls_store_item_free(&store->writer, item);
    return ls_fail(diag, err, "ticket of shot %u: %s", ticket->shot,
                   err == LS_ERR_INVALID ? "a time in it is not finite" : "no memory");
}

enum ls_err ls_store_alarm(struct ls_store *store, const char *text, struct ls_diag *diag)
{
    struct ls_store_item *item = ls_store_item_new(LS_ITEM_ALARM, diag);
    if (!item)
        return LS_ERR_NOMEM;
    enum ls_err err = ls_journal_add_alarm(&item->record, ls_host_ns(), text);
    if (!err)
        return ls_store_writer_enqueue(&store->writer, item, diag);
    ls_store_item_free(&store->writer, item);
    return ls_fail(diag, err, "no memory for an alarm");
}

static enum ls_err fill(struct ls_store *store, struct ls_store_item *item, const void *bytes,
                        size_t n_bytes, struct ls_diag *diag)
{
    enum ls_err err =
        ls_write_buffers_take(&store->writer.buffers, n_bytes + !n_bytes, &item->buffer, diag);
    if (err)
        return err;
    memcpy(item->buffer.bytes, bytes, n_bytes);
    item->n = n_bytes;
    return LS_OK;
}

enum ls_err ls_store_raw(struct ls_store *store, uint32_t camera, uint32_t shot, uint32_t attempt,
                         const void *bytes, size_t n_bytes, struct ls_diag *diag)
{
    if (!store->head.keep_raw)
        return ls_fail(diag, LS_ERR_STATE, "this take does not keep raw frames");
    if (camera >= store->head.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u of %u", camera, store->head.n_cameras);
    struct ls_store_item *item = ls_store_item_new(LS_ITEM_RAW, diag);
    if (!item)
        return LS_ERR_NOMEM;
    enum ls_err err = fill(store, item, bytes, n_bytes, diag);
    if (err) {
        ls_store_item_free(&store->writer, item);
        return err;
    }
    item->camera = camera;
    snprintf(item->file, sizeof item->file, "cam%u/raw/%u-%u.raw", camera, shot, attempt);
    return ls_store_writer_enqueue(&store->writer, item, diag);
}

static enum ls_err check_picture(const struct ls_store *store,
                                 const struct ls_store_picture *picture, struct ls_diag *diag)
{
    const struct ls_exr_mosaic *mosaic = &picture->mosaic;
    if (!ls_takedir_name_ok(picture->condition, 63))
        return ls_fail(diag, LS_ERR_INVALID,
                       "condition \"%.80s\": expected 1 to 63 letters, "
                       "digits, _ or -",
                       picture->condition);
    if (picture->camera >= store->head.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "condition %s: camera %u of %u", picture->condition,
                       picture->camera, store->head.n_cameras);
    if (!mosaic->half == !mosaic->floats || !mosaic->width || !mosaic->height)
        return ls_fail(diag, LS_ERR_INVALID,
                       "condition %s: expected either half or float pixels "
                       "of at least 1 x 1",
                       picture->condition);
    return LS_OK;
}

/* Only one may publish a condition: the key is taken first, given back if encoding fails. */
static enum ls_err claim(struct ls_store *store, const char *key, struct ls_diag *diag)
{
    pthread_mutex_lock(&store->writer.lock);
    enum ls_err err = ls_store_writer_error(&store->writer, diag);
    if (!err && !g_hash_table_add(store->published, g_strdup(key)))
        err = ls_fail(diag, LS_ERR_EXISTS, "%s is published already", key);
    pthread_mutex_unlock(&store->writer.lock);
    return err;
}

static void unclaim(struct ls_store *store, const char *key)
{
    pthread_mutex_lock(&store->writer.lock);
    g_hash_table_remove(store->published, key);
    pthread_mutex_unlock(&store->writer.lock);
}

static enum ls_err write_exr(struct ls_store *store, const struct ls_exr_mosaic *mosaic,
                             struct ls_store_item *item, struct ls_diag *diag)
{
    enum ls_err err = ls_write_buffers_take(&store->writer.buffers, ls_exr_mosaic_room(mosaic),
                                            &item->buffer, diag);
    return err ? err
               : ls_exr_write_mosaic_to(mosaic, item->buffer.bytes, item->buffer.capacity, &item->n,
                                        diag);
}

static enum ls_err encode(struct ls_store *store, const struct ls_store_picture *picture,
                          struct ls_store_item *item, struct ls_diag *diag)
{
    struct ls_published published = {.camera = picture->camera};
    struct ls_exr_mosaic mosaic = picture->mosaic;
    enum ls_err err = ls_tilesum(&mosaic, &published);
    if (!published.tile_invalid) /* nothing to look through again */
        mosaic.validity = NULL;
    if (err)
        ls_fail(diag, err, "condition %s: %s", picture->condition, ls_err_name(err));
    else
        err = write_exr(store, &mosaic, item, diag);
    if (err) {
        ls_published_finish(&published);
        return err;
    }
    item->camera = picture->camera;
    snprintf(item->file, sizeof item->file, "cam%u/%s.exr", picture->camera, picture->condition);
    g_strlcpy(published.file, item->file, sizeof published.file);
    g_strlcpy(published.condition, picture->condition, sizeof published.condition);
    published.bytes = item->n;
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
    struct ls_store_item *item = ls_store_item_new(LS_ITEM_PICTURE, diag);
    err = item ? encode(store, picture, item, diag) : LS_ERR_NOMEM;
    if (!err)
        item->times = picture->times;
    if (!err)
        g_strlcpy(item->condition, picture->condition, sizeof item->condition);
    if (err)
        ls_store_item_free(&store->writer, item);
    else
        err = ls_store_writer_enqueue(&store->writer, item, diag);
    if (err)
        unclaim(store, key);
    return err;
}

void ls_store_tell(struct ls_store *store, ls_store_published *published, void *user)
{
    store->writer.published = published;
    store->writer.published_user = user;
}

enum ls_err ls_store_flush(struct ls_store *store, struct ls_diag *diag)
{
    return ls_store_writer_flush(&store->writer, diag);
}

void ls_store_stats(struct ls_store *store, struct ls_store_stats *out)
{
    pthread_mutex_lock(&store->writer.lock);
    *out = store->writer.stats;
    out->queued = (uint32_t)(store->writer.queued - store->writer.processed);
    pthread_mutex_unlock(&store->writer.lock);
}

enum ls_err ls_store_set_state(struct ls_store *store, const struct ls_store_end *end,
                               struct ls_diag *diag)
{
    char *text;
    store->head.state = end->state;
    enum ls_err err =
        ls_take_head_write(&store->head, end->take_json ? end->take_json : store->document,
                           end->missing, end->n_missing, end->skips_json, &text, diag);
    if (err)
        return err;
    struct ls_store_item *item = ls_store_item_new(LS_ITEM_STATE, diag);
    err = item ? fill(store, item, text, strlen(text), diag) : LS_ERR_NOMEM;
    free(text);
    if (!err && ls_journal_add_state(&item->record, ls_host_ns(), ls_store_state_name(end->state)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for a state");
    if (err) {
        ls_store_item_free(&store->writer, item);
        return err;
    }
    strcpy(item->file, "take.json");
    err = ls_store_writer_enqueue(&store->writer, item, diag);
    return err ? err : ls_store_flush(store, diag);
}

void ls_store_limit_queue(struct ls_store *store, uint64_t bytes)
{
    pthread_mutex_lock(&store->writer.lock);
    store->writer.queue_limit_bytes = bytes;
    pthread_mutex_unlock(&store->writer.lock);
}

const char *ls_store_folder(const struct ls_store *store)
{
    return store->writer.folder.path;
}

const char *ls_store_id(const struct ls_store *store)
{
    return store->writer.folder.id;
}

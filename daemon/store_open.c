#include "daemon/store_private.h"

#include "daemon/takedir.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    SHOT_OVERHEAD_BYTES = 1024, /* of journal: a ticket is about 500 bytes, half of them repaired */
    TAKE_OVERHEAD_BYTES = 1 << 20,
};

static void free_store(struct ls_store *store)
{
    ls_store_writer_finish(&store->writer);
    g_hash_table_destroy(store->published);
    ls_take_head_finish(&store->head);
    free(store->document);
    free(store);
}

static struct ls_store *new_store(void)
{
    struct ls_store *store = calloc(1, sizeof *store);
    if (!store)
        return NULL;
    ls_store_writer_init(&store->writer);
    store->published = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    return store;
}

static enum ls_err make_head(const struct ls_store_config *config, struct ls_take_head *head,
                             struct ls_diag *diag)
{
    time_t seconds = (time_t)config->utc_s;
    struct tm tm;
    if (!ls_takedir_name_ok(config->name, 64))
        return ls_fail(diag, LS_ERR_INVALID,
                       "take name \"%.80s\": expected 1 to 64 letters, "
                       "digits, _ or -",
                       config->name);
    if (!config->n_cameras || config->n_cameras > LS_FOLDER_MAX_CAMERAS || !gmtime_r(&seconds, &tm))
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
            return ls_fail(diag, LS_ERR_INVALID,
                           "condition \"%.80s\": expected 1 to 63 letters, "
                           "digits, _ or -",
                           config->conditions[k]);
        head->conditions[k] = strdup(config->conditions[k]);
        if (!head->conditions[k])
            return ls_fail(diag, LS_ERR_NOMEM, "no memory for %u conditions", config->n_conditions);
        head->n_conditions++;
    }
    return LS_OK;
}

/* take.json on the disk says "open" and the space is ours before anything fires. */
static enum ls_err begin(struct ls_store *store, uint64_t need_bytes, uint64_t spare_bytes,
                         struct ls_diag *diag)
{
    struct ls_take_folder *folder = &store->writer.folder;
    char *text = NULL;
    store->head.state = LS_STORE_OPEN;
    need_bytes += (uint64_t)store->head.n_shots * SHOT_OVERHEAD_BYTES + TAKE_OVERHEAD_BYTES +
                  2 * strlen(store->document);
    enum ls_err err = ls_take_head_write(&store->head, store->document, NULL, 0, NULL, &text, diag);
    if (!err)
        err = ls_take_folder_reserve(folder, need_bytes, spare_bytes, diag);
    if (!err)
        err = ls_take_folder_release(folder, strlen(text), diag);
    if (!err)
        err = ls_disk_replace(folder->shim, folder->dir_fd, "take.json", text, strlen(text), NULL,
                              diag);
    if (!err)
        err = ls_disk_sync_dir(folder->shim, folder->dir_fd, folder->path, diag);
    free(text);
    return err ? err : ls_store_writer_start(&store->writer, diag);
}

enum ls_err ls_store_create(const struct ls_store_config *config, struct ls_store **out,
                            struct ls_diag *diag)
{
    struct ls_store *store = new_store();
    if (!store)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    enum ls_err err = make_head(config, &store->head, diag);
    if (!err && !(store->document = strdup(config->take_json)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    if (!err)
        err = ls_take_folder_create(config->root, config->name, config->utc_s, config->n_cameras,
                                    config->keep_raw, config->shim, &store->writer.folder, diag);
    if (!err) {
        err = begin(store, config->need_bytes, config->spare_bytes, diag);
        if (err)
            ls_take_folder_discard(&store->writer.folder);
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
    enum ls_err err =
        ls_take_head_parse(take->take_json, strlen(take->take_json), &store->head, diag);
    if (!err && !(store->document = strdup(take->take_json)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    for (size_t k = 0; k < take->n_published && !err; k++)
        g_hash_table_add(store->published, g_strdup_printf("cam%u/%s", take->published[k].camera,
                                                           take->published[k].condition));
    if (!err && take->torn_bytes)
        err = ls_disk_truncate(store->writer.folder.shim, store->writer.folder.journal_fd,
                               "journal", take->journal_good_bytes, diag);
    if (!err && take->torn_bytes)
        err = ls_disk_sync(store->writer.folder.shim, store->writer.folder.journal_fd, "journal",
                           diag);
    return err ? err : ls_take_folder_sweep(&store->writer.folder, diag);
}

/* Read twice: once to know what to lock, then, under the lock, what is really there. */
static enum ls_err reopen(struct ls_store *store, const char *folder,
                          const struct ls_disk_shim *shim, struct ls_diag *diag)
{
    struct ls_takedir *take;
    enum ls_err err = ls_takedir_open(folder, &take, diag);
    if (err)
        return err;
    err = ls_take_folder_open(folder, take->n_cameras, take->keep_raw, shim, &store->writer.folder,
                              diag);
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
    struct ls_store *store = new_store();
    if (!store)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a take");
    enum ls_err err = reopen(store, folder, shim, diag);
    if (!err)
        err = begin(store, need_bytes, spare_bytes, diag);
    if (err) {
        if (store->writer.folder.path)
            ls_take_folder_close(&store->writer.folder);
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
    ls_store_writer_stop(&store->writer);
    enum ls_err err = ls_store_writer_error(&store->writer, diag);
    ls_take_folder_close(&store->writer.folder);
    free_store(store);
    return err;
}

#include "daemon/field_cache.h"

#include "daemon/takedir.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

struct entry {
    struct ls_field_source *source;
    unsigned users;
    uint64_t journal_bytes; /* length of the file when it was opened */
    bool stale;
};

struct ls_field_cache {
    const char *storage;
    unsigned n_idle;
    uint64_t spare_bytes;
    GMutex lock;
    GQueue entries; /* struct entry, last used first */
};

struct ls_field_cache *ls_field_cache_create(const char *storage, unsigned n_idle,
                                             uint64_t spare_bytes)
{
    struct ls_field_cache *cache = g_new0(struct ls_field_cache, 1);
    cache->storage = storage;
    cache->n_idle = n_idle;
    cache->spare_bytes = spare_bytes;
    g_mutex_init(&cache->lock);
    g_queue_init(&cache->entries);
    return cache;
}

static void entry_free(struct entry *entry)
{
    ls_field_source_close(entry->source);
    g_free(entry);
}

static uint64_t journal_bytes(const struct ls_field_cache *cache, const char *take)
{
    char path[4096];
    struct stat info;
    if (snprintf(path, sizeof path, "%s/%s/journal", cache->storage, take) >= (int)sizeof path ||
        stat(path, &info))
        return 0;
    return (uint64_t)info.st_size;
}

/* Drop what nobody uses: everything stale, and the oldest beyond n_idle. */
static void trim(struct ls_field_cache *cache)
{
    unsigned idle = 0;
    for (GList *l = cache->entries.head, *next; l; l = next) {
        struct entry *entry = l->data;
        next = l->next;
        if (entry->users > 0 || (!entry->stale && ++idle <= cache->n_idle))
            continue;
        g_queue_delete_link(&cache->entries, l);
        entry_free(entry);
    }
}

static struct entry *find(struct ls_field_cache *cache, const char *take, uint32_t camera)
{
    uint64_t bytes = journal_bytes(cache, take);
    for (GList *l = cache->entries.head; l; l = l->next) {
        struct entry *entry = l->data;
        if (entry->stale || strcmp(entry->source->take, take) || entry->source->camera != camera)
            continue;
        if (entry->journal_bytes == bytes && !ls_field_source_sound(entry->source, true, NULL))
            return entry;
        entry->stale = true;
    }
    return NULL;
}

static enum ls_err add(struct ls_field_cache *cache, const char *take, uint32_t camera,
                       struct entry **out, struct ls_diag *diag)
{
    struct ls_field_source *source = NULL;
    uint64_t bytes = journal_bytes(cache, take);
    enum ls_err err = ls_field_source_open(cache->storage, take, camera, &source, diag);
    if (err)
        return err;
    struct entry *entry = g_new0(struct entry, 1);
    source->spare_bytes = cache->spare_bytes;
    *entry = (struct entry){.source = source, .journal_bytes = bytes};
    g_queue_push_head(&cache->entries, entry);
    *out = entry;
    return LS_OK;
}

enum ls_err ls_field_cache_get(struct ls_field_cache *cache, const char *take, uint32_t camera,
                               struct ls_field_source **out, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (!ls_takedir_id_ok(take))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "\"%.64s\" is not the name of a take", take);
    g_mutex_lock(&cache->lock);
    struct entry *entry = find(cache, take, camera);
    if (!entry)
        err = add(cache, take, camera, &entry, diag);
    if (!err) {
        entry->users++;
        g_queue_remove(&cache->entries, entry);
        g_queue_push_head(&cache->entries, entry);
        *out = entry->source;
    }
    trim(cache);
    g_mutex_unlock(&cache->lock);
    return err;
}

/* The lock is held. */
static struct entry *entry_of(struct ls_field_cache *cache, const struct ls_field_source *source)
{
    GList *l = cache->entries.head;
    while (((struct entry *)l->data)->source != source)
        l = l->next;
    return l->data;
}

void ls_field_cache_share(struct ls_field_cache *cache, struct ls_field_source *source)
{
    g_mutex_lock(&cache->lock);
    entry_of(cache, source)->users++;
    g_mutex_unlock(&cache->lock);
}

void ls_field_cache_put(struct ls_field_cache *cache, struct ls_field_source *source)
{
    g_mutex_lock(&cache->lock);
    entry_of(cache, source)->users--;
    trim(cache);
    g_mutex_unlock(&cache->lock);
}

void ls_field_cache_destroy(struct ls_field_cache *cache)
{
    if (!cache)
        return;
    for (struct entry *entry; (entry = g_queue_pop_head(&cache->entries));)
        entry_free(entry);
    g_mutex_clear(&cache->lock);
    g_free(cache);
}

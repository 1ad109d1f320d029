#include "daemon/stored_tiles.h"

#include <glib.h>
#include <stdatomic.h>
#include <string.h>
#if defined(__x86_64__)
#include <xxh_x86dispatch.h> /* the same functions, by what the processor has */
#else
#include <xxhash.h>
#endif

struct ls_tile_hashes {
    gatomicrefcount users;
    struct ls_picture_id id;
    size_t n;
    _Atomic uint64_t hash[];
};

struct ls_stored_tiles {
    GMutex lock;
    size_t max_bytes, bytes;
    GQueue known; /* struct ls_tile_hashes, last asked for first */
    GHashTable *by_id;
};

uint64_t ls_tile_hash(const void *tile, size_t bytes)
{
    uint64_t hash = XXH3_64bits(tile, bytes);
    return hash ? hash : 1;
}

static guint hash_of_id(gconstpointer id)
{
    return (guint)XXH3_64bits(id, sizeof(struct ls_picture_id));
}

static gboolean same_id(gconstpointer a, gconstpointer b)
{
    return memcmp(a, b, sizeof(struct ls_picture_id)) == 0;
}

struct ls_stored_tiles *ls_stored_tiles_create(size_t max_bytes)
{
    struct ls_stored_tiles *stored = g_new0(struct ls_stored_tiles, 1);
    stored->max_bytes = max_bytes;
    g_mutex_init(&stored->lock);
    g_queue_init(&stored->known);
    stored->by_id = g_hash_table_new(hash_of_id, same_id);
    return stored;
}

void ls_tile_hashes_put(struct ls_tile_hashes *hashes)
{
    if (g_atomic_ref_count_dec(&hashes->users))
        g_free(hashes);
}

static size_t bytes_of(const struct ls_tile_hashes *hashes)
{
    return sizeof *hashes + hashes->n * sizeof *hashes->hash;
}

static void drop(struct ls_stored_tiles *stored, GList *link)
{
    struct ls_tile_hashes *hashes = link->data;
    g_hash_table_remove(stored->by_id, &hashes->id);
    g_queue_delete_link(&stored->known, link);
    stored->bytes -= bytes_of(hashes);
    ls_tile_hashes_put(hashes);
}

void ls_stored_tiles_destroy(struct ls_stored_tiles *stored)
{
    if (!stored)
        return;
    while (stored->known.tail)
        drop(stored, stored->known.tail);
    g_hash_table_unref(stored->by_id);
    g_mutex_clear(&stored->lock);
    g_free(stored);
}

static struct ls_tile_hashes *unknown(const struct ls_picture_map *map)
{
    size_t n = (size_t)map->tiles.n_x * map->tiles.n_y;
    struct ls_tile_hashes *hashes = g_malloc0(sizeof *hashes + n * sizeof *hashes->hash);
    g_atomic_ref_count_init(&hashes->users);
    hashes->id = map->id;
    hashes->n = n;
    return hashes;
}

static GList *find_or_add(struct ls_stored_tiles *stored, const struct ls_picture_map *map)
{
    GList *link = g_hash_table_lookup(stored->by_id, &map->id);
    if (link) {
        g_queue_unlink(&stored->known, link);
        g_queue_push_head_link(&stored->known, link);
        return link;
    }
    struct ls_tile_hashes *hashes = unknown(map);
    g_queue_push_head(&stored->known, hashes);
    g_hash_table_insert(stored->by_id, &hashes->id, stored->known.head);
    stored->bytes += bytes_of(hashes);
    while (stored->bytes > stored->max_bytes && stored->known.length > 1)
        drop(stored, stored->known.tail);
    return stored->known.head;
}

struct ls_tile_hashes *ls_stored_tiles_get(struct ls_stored_tiles *stored,
                                           const struct ls_picture_map *map)
{
    if (!stored)
        return unknown(map);
    g_mutex_lock(&stored->lock);
    struct ls_tile_hashes *hashes = find_or_add(stored, map)->data;
    g_atomic_ref_count_inc(&hashes->users);
    g_mutex_unlock(&stored->lock);
    return hashes;
}

uint64_t ls_tile_hashes_get(const struct ls_tile_hashes *hashes, uint32_t number)
{
    return atomic_load_explicit(&hashes->hash[number], memory_order_relaxed);
}

void ls_tile_hashes_note(struct ls_tile_hashes *hashes, uint32_t number, uint64_t hash)
{
    atomic_store_explicit(&hashes->hash[number], hash, memory_order_relaxed);
}

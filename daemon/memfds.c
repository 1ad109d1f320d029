#include "daemon/memfds.h"

#include <errno.h>
#include <fcntl.h>
#include <glib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { MOST_KEPT = 64, TILE_BYTES = 2 * LS_EXR_TILE_PX * LS_EXR_TILE_PX };

struct kept {
    struct ls_picture_id id;
    uint64_t bytes;
    int fd;
};

struct ls_memfds {
    GMutex lock;
    uint64_t max_bytes, bytes;
    GQueue kept; /* last asked for first */
};

static enum ls_err fail(const char *what, struct ls_diag *diag)
{
    bool memory = errno == ENOMEM || errno == ENOSPC;
    return ls_fail(diag, memory ? LS_ERR_NOMEM : LS_ERR_OS, "memfd: %s: %s", what, strerror(errno));
}

enum ls_err ls_memfd_create(uint64_t bytes, int *fd, struct ls_diag *diag)
{
    *fd = memfd_create("lightstaged-tiles", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (*fd < 0)
        return fail("memfd_create", diag);
    if (ftruncate(*fd, (off_t)bytes) == 0)
        return LS_OK;
    enum ls_err err = fail("ftruncate", diag);
    close(*fd);
    *fd = -1;
    return err;
}

enum ls_err ls_memfd_write(int fd, uint64_t at, const void *bytes, size_t n, struct ls_diag *diag)
{
    for (size_t done = 0; done < n;) {
        ssize_t k = pwrite(fd, (const char *)bytes + done, n - done, (off_t)(at + done));
        if (k < 0 && errno == EINTR)
            continue;
        if (k <= 0)
            return fail("write", diag);
        done += (size_t)k;
    }
    return LS_OK;
}

enum ls_err ls_memfd_share(int fd, int *out, struct ls_diag *diag)
{
    *out = fcntl(fd, F_DUPFD_CLOEXEC, 0);
    return *out < 0 ? fail("dup", diag) : LS_OK;
}

enum ls_err ls_memfd_seal(int fd, struct ls_diag *diag)
{
    int seals = F_SEAL_SEAL | F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE;
    return fcntl(fd, F_ADD_SEALS, seals) ? fail("cannot be sealed", diag) : LS_OK;
}

/* ---- stored pictures ---- */

struct ls_memfds *ls_memfds_create(uint64_t max_bytes)
{
    struct ls_memfds *memfds = g_new0(struct ls_memfds, 1);
    memfds->max_bytes = max_bytes;
    g_mutex_init(&memfds->lock);
    g_queue_init(&memfds->kept);
    return memfds;
}

static void drop_last(struct ls_memfds *memfds)
{
    struct kept *kept = g_queue_pop_tail(&memfds->kept);
    memfds->bytes -= kept->bytes;
    close(kept->fd);
    g_free(kept);
}

void ls_memfds_destroy(struct ls_memfds *memfds)
{
    if (!memfds)
        return;
    while (memfds->kept.length > 0)
        drop_last(memfds);
    g_mutex_clear(&memfds->lock);
    g_free(memfds);
}

/* The lock is held. NULL: it is not kept. */
static struct kept *find(struct ls_memfds *memfds, const struct ls_picture_id *id)
{
    for (GList *l = memfds->kept.head; l; l = l->next) {
        struct kept *kept = l->data;
        if (memcmp(&kept->id, id, sizeof *id))
            continue;
        g_queue_unlink(&memfds->kept, l);
        g_queue_push_head_link(&memfds->kept, l);
        return kept;
    }
    return NULL;
}

static enum ls_err fill(int fd, const struct ls_picture_map *map, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    uint32_t n = map->tiles.n_x * map->tiles.n_y;
    uint8_t room[TILE_BYTES];
    for (uint32_t i = 0; i < n && !err; i++)
        err = ls_memfd_write(fd, (uint64_t)i * TILE_BYTES, ls_picture_map_tile(map, i, room),
                             TILE_BYTES, diag);
    if (!err && !ls_picture_map_sound(map))
        err = ls_fail(diag, LS_ERR_INVALID, "%s: cannot be read to its end", map->path);
    return err ? err : ls_memfd_seal(fd, diag);
}

static void keep(struct ls_memfds *memfds, const struct ls_picture_map *map, uint64_t bytes, int fd)
{
    struct kept kept = {map->id, bytes, fcntl(fd, F_DUPFD_CLOEXEC, 0)};
    g_mutex_lock(&memfds->lock);
    if (kept.fd >= 0 && bytes <= memfds->max_bytes && !find(memfds, &map->id)) {
        memfds->bytes += bytes;
        g_queue_push_head(&memfds->kept, g_memdup2(&kept, sizeof kept));
        while (memfds->bytes > memfds->max_bytes || memfds->kept.length > MOST_KEPT)
            drop_last(memfds);
    } else if (kept.fd >= 0) {
        close(kept.fd);
    }
    g_mutex_unlock(&memfds->lock);
}

enum ls_err ls_memfds_get(struct ls_memfds *memfds, const struct ls_picture_map *map, int *fd,
                          struct ls_diag *diag)
{
    uint64_t bytes = (uint64_t)map->tiles.n_x * map->tiles.n_y * TILE_BYTES;
    g_mutex_lock(&memfds->lock);
    const struct kept *kept = find(memfds, &map->id);
    enum ls_err err = kept ? ls_memfd_share(kept->fd, fd, diag) : LS_OK;
    g_mutex_unlock(&memfds->lock);
    if (kept)
        return err;
    err = ls_memfd_create(bytes, fd, diag);
    if (err)
        return err;
    err = fill(*fd, map, diag);
    if (!err)
        keep(memfds, map, bytes, *fd);
    else
        close(*fd);
    return err;
}

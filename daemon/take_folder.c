#include "daemon/take_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

static const char reserve_name[] = ".reserve";
/* A released reservation is cut in steps of whole blocks of the file systems in use. */
static const uint64_t block_bytes = 4096;

static void init(struct ls_take_folder *folder, uint32_t n_cameras, const struct ls_disk_shim *shim)
{
    *folder = (struct ls_take_folder){
        .dir_fd = -1, .journal_fd = -1, .reserve_fd = -1, .n_cameras = n_cameras, .shim = shim};
    for (int k = 0; k < LS_FOLDER_MAX_CAMERAS; k++)
        folder->camera_fd[k] = folder->raw_fd[k] = -1;
}

static enum ls_err fail(const char *doing, const char *what, struct ls_diag *diag)
{
    enum ls_err err = errno == ENOENT   ? LS_ERR_NOT_FOUND
                      : errno == ENOSPC ? LS_ERR_FULL
                                        : LS_ERR_OS;
    return ls_fail(diag, err, "cannot %s %s: %m", doing, what);
}

static enum ls_err set_path(struct ls_take_folder *folder, char *path, struct ls_diag *diag)
{
    folder->path = path;
    if (!path)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a path");
    for (size_t n = strlen(path); n > 1 && path[n - 1] == '/'; n--)
        path[n - 1] = 0;
    const char *slash = strrchr(path, '/');
    folder->id = slash ? slash + 1 : path;
    return LS_OK;
}

/* Make a subfolder unless it is there, and open it. */
static enum ls_err subfolder(struct ls_take_folder *folder, const char *name, int *fd,
                             struct ls_diag *diag)
{
    if (mkdirat(folder->dir_fd, name, 0755) && errno != EEXIST)
        return fail("make the folder", name, diag);
    *fd = openat(folder->dir_fd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return *fd < 0 ? fail("open the folder", name, diag) : LS_OK;
}

static enum ls_err subfolders(struct ls_take_folder *folder, bool keep_raw, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < folder->n_cameras && !err; k++) {
        char name[32];
        snprintf(name, sizeof name, "cam%u", k);
        err = subfolder(folder, name, &folder->camera_fd[k], diag);
        snprintf(name, sizeof name, "cam%u/raw", k);
        if (!err && keep_raw)
            err = subfolder(folder, name, &folder->raw_fd[k], diag);
        if (!err)
            err = ls_disk_sync_dir(folder->shim, folder->camera_fd[k], name, diag);
    }
    return err;
}

static enum ls_err open_journal(struct ls_take_folder *folder, int flags, struct ls_diag *diag)
{
    folder->journal_fd =
        openat(folder->dir_fd, "journal", O_WRONLY | O_APPEND | O_CLOEXEC | flags, 0644);
    if (folder->journal_fd < 0)
        return fail("open the journal of", folder->path, diag);
    if (flock(folder->journal_fd, LOCK_EX | LOCK_NB))
        return errno == EWOULDBLOCK
                   ? ls_fail(diag, LS_ERR_BUSY, "take %s is being written by another program",
                             folder->id)
                   : fail("lock the journal of", folder->path, diag);
    return LS_OK;
}

static char *new_path(const char *root, const char *name, int64_t utc_s)
{
    char stamp[32], *path;
    uint8_t random[3];
    time_t seconds = (time_t)utc_s;
    struct tm tm;
    if (!gmtime_r(&seconds, &tm) || !strftime(stamp, sizeof stamp, "%Y%m%dT%H%M%SZ", &tm) ||
        getrandom(random, sizeof random, 0) != sizeof random)
        return NULL;
    if (asprintf(&path, "%s/%s-%s-%02x%02x%02x", root, stamp, name, random[0], random[1],
                 random[2]) < 0)
        return NULL;
    return path;
}

static enum ls_err make(const char *root, const char *name, int64_t utc_s,
                        struct ls_take_folder *folder, struct ls_diag *diag)
{
    enum ls_err err = set_path(folder, new_path(root, name, utc_s), diag);
    if (err)
        return err;
    if (mkdir(folder->path, 0755))
        return fail("make the folder", folder->path, diag);
    folder->dir_fd = open(folder->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return folder->dir_fd < 0 ? fail("open the folder", folder->path, diag) : LS_OK;
}

static enum ls_err sync_root(const char *root, const struct ls_disk_shim *shim,
                             struct ls_diag *diag)
{
    int fd = open(root, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return fail("open the folder", root, diag);
    enum ls_err err = ls_disk_sync_dir(shim, fd, root, diag);
    close(fd);
    return err;
}

enum ls_err ls_take_folder_create(const char *root, const char *name, int64_t utc_s,
                                  uint32_t n_cameras, bool keep_raw,
                                  const struct ls_disk_shim *shim, struct ls_take_folder *folder,
                                  struct ls_diag *diag)
{
    init(folder, n_cameras, shim);
    enum ls_err err = make(root, name, utc_s, folder, diag);
    if (!err)
        err = open_journal(folder, O_CREAT | O_EXCL, diag);
    if (!err)
        err = subfolders(folder, keep_raw, diag);
    if (!err)
        err = ls_disk_sync_dir(shim, folder->dir_fd, folder->path, diag);
    if (!err)
        err = sync_root(root, shim, diag);
    if (err)
        ls_take_folder_discard(folder);
    return err;
}

enum ls_err ls_take_folder_open(const char *path, uint32_t n_cameras, bool keep_raw,
                                const struct ls_disk_shim *shim, struct ls_take_folder *folder,
                                struct ls_diag *diag)
{
    init(folder, n_cameras, shim);
    enum ls_err err = set_path(folder, strdup(path), diag);
    if (!err) {
        folder->dir_fd = open(folder->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (folder->dir_fd < 0)
            err = fail("open the take", folder->path, diag);
    }
    if (!err)
        err = open_journal(folder, 0, diag);
    if (!err)
        err = subfolders(folder, keep_raw, diag);
    if (err)
        ls_take_folder_close(folder);
    return err;
}

static enum ls_err sweep_dir(int fd, const char *name, struct ls_diag *diag)
{
    int copy = openat(fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *dir = copy < 0 ? NULL : fdopendir(copy);
    if (!dir) {
        if (copy >= 0)
            close(copy);
        return fail("list the folder", name, diag);
    }
    enum ls_err err = LS_OK;
    for (struct dirent *entry; !err && (entry = readdir(dir));) {
        size_t n = strlen(entry->d_name);
        bool stale = (n > 4 && !strcmp(entry->d_name + n - 4, ".tmp")) ||
                     !strcmp(entry->d_name, reserve_name);
        if (stale && unlinkat(fd, entry->d_name, 0) && errno != ENOENT)
            err = fail("remove", entry->d_name, diag);
    }
    closedir(dir);
    return err;
}

enum ls_err ls_take_folder_sweep(struct ls_take_folder *folder, struct ls_diag *diag)
{
    enum ls_err err = sweep_dir(folder->dir_fd, folder->path, diag);
    for (uint32_t k = 0; k < folder->n_cameras && !err; k++) {
        err = sweep_dir(folder->camera_fd[k], "of a camera", diag);
        if (!err && folder->raw_fd[k] >= 0)
            err = sweep_dir(folder->raw_fd[k], "of raw frames", diag);
    }
    return err;
}

/* @why: what the system said, or "". */
static enum ls_err too_little(uint64_t need, uint64_t spare, uint64_t available, const char *why,
                              struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_FULL,
                   "the disk has %.1f MB free; the take needs %.1f MB and %.1f "
                   "MB are to stay free (%llu, %llu, %llu bytes)%s%s: make room or choose another "
                   "storage folder",
                   (double)available / 1e6, (double)need / 1e6, (double)spare / 1e6,
                   (unsigned long long)available, (unsigned long long)need,
                   (unsigned long long)spare, *why ? "; " : "", why);
}

enum ls_err ls_take_folder_reserve(struct ls_take_folder *folder, uint64_t need_bytes,
                                   uint64_t spare_bytes, struct ls_diag *diag)
{
    struct statvfs info;
    if (fstatvfs(folder->dir_fd, &info))
        return fail("ask for the free space of", folder->path, diag);
    uint64_t available = (uint64_t)info.f_bavail * info.f_frsize;
    if (available < spare_bytes || available - spare_bytes < need_bytes)
        return too_little(need_bytes, spare_bytes, available, "", diag);
    struct ls_diag why = {0};
    enum ls_err err =
        ls_disk_create(folder->shim, folder->dir_fd, reserve_name, &folder->reserve_fd, &why);
    if (!err)
        err = ls_disk_allocate(folder->shim, folder->reserve_fd, reserve_name, need_bytes, &why);
    folder->reserved_bytes = err ? 0 : need_bytes;
    if (err == LS_ERR_FULL)
        return too_little(need_bytes, spare_bytes, available, why.text, diag);
    return err ? ls_fail(diag, err, "%s", why.text) : LS_OK;
}

enum ls_err ls_take_folder_release(struct ls_take_folder *folder, uint64_t n_bytes,
                                   struct ls_diag *diag)
{
    uint64_t n = (n_bytes + block_bytes - 1) / block_bytes * block_bytes;
    if (folder->reserve_fd < 0 || !folder->reserved_bytes)
        return LS_OK;
    folder->reserved_bytes -= n < folder->reserved_bytes ? n : folder->reserved_bytes;
    return ls_disk_truncate(folder->shim, folder->reserve_fd, reserve_name, folder->reserved_bytes,
                            diag);
}

static void close_fd(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

void ls_take_folder_close(struct ls_take_folder *folder)
{
    if (folder->reserve_fd >= 0)
        unlinkat(folder->dir_fd, reserve_name, 0);
    close_fd(&folder->reserve_fd);
    close_fd(&folder->journal_fd);
    close_fd(&folder->dir_fd);
    for (uint32_t k = 0; k < LS_FOLDER_MAX_CAMERAS; k++) {
        close_fd(&folder->camera_fd[k]);
        close_fd(&folder->raw_fd[k]);
    }
    free(folder->path);
    folder->path = NULL;
    folder->id = NULL;
}

void ls_take_folder_discard(struct ls_take_folder *folder)
{
    for (uint32_t k = 0; folder->dir_fd >= 0 && k < folder->n_cameras; k++) {
        char name[32];
        snprintf(name, sizeof name, "cam%u/raw", k);
        unlinkat(folder->dir_fd, name, AT_REMOVEDIR);
        snprintf(name, sizeof name, "cam%u", k);
        unlinkat(folder->dir_fd, name, AT_REMOVEDIR);
    }
    if (folder->dir_fd >= 0) {
        unlinkat(folder->dir_fd, reserve_name, 0);
        unlinkat(folder->dir_fd, "journal", 0);
        unlinkat(folder->dir_fd, "take.json", 0);
        rmdir(folder->path);
    }
    ls_take_folder_close(folder);
}

#include "daemon/map_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/statvfs.h>
#include <unistd.h>

/* Not every file system knows files without a name. */
static int open_named(const char *folder)
{
    char path[4096];
    if (snprintf(path, sizeof path, "%s/.map-XXXXXX", folder) >= (int)sizeof path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    int fd = mkostemp(path, O_CLOEXEC);
    if (fd >= 0)
        unlink(path);
    return fd;
}

static int open_unnamed(const char *folder)
{
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    return fd < 0 && (errno == EOPNOTSUPP || errno == EISDIR) ? open_named(folder) : fd;
}

/* Takes on a disk that is only read are served too. */
static int open_beside(const char *folder)
{
    int fd = open_unnamed(folder);
    return fd < 0 && (errno == EROFS || errno == EACCES) ? open_unnamed("/var/tmp") : fd;
}

static enum ls_err failed(const char *folder, size_t bytes, int error, struct ls_diag *diag)
{
    bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
    return ls_fail(diag, full ? LS_ERR_FULL : LS_ERR_OS,
                   "%s: no room for a map of %.1f MB of promoted pixels: %s", folder,
                   (double)bytes / 1e6, strerror(error));
}

/* Takes in the making have their room already (daemon/take_folder.h). */
static enum ls_err check_spare(int fd, const char *folder, size_t bytes, uint64_t spare_bytes,
                               struct ls_diag *diag)
{
    struct statvfs disk;
    if (fstatvfs(fd, &disk))
        return failed(folder, bytes, errno, diag);
    double room = (double)disk.f_bavail * (double)disk.f_frsize;
    if ((double)bytes + (double)spare_bytes <= room)
        return LS_OK;
    return ls_fail(diag, LS_ERR_FULL,
                   "%s: no room for a map of %.1f MB of promoted pixels: %.1f MB stay reserved and "
                   "%.1f MB are free",
                   folder, (double)bytes / 1e6, (double)spare_bytes / 1e6, room / 1e6);
}

enum ls_err ls_map_file_create(struct ls_map_file *map, const char *folder, size_t bytes,
                               uint64_t spare_bytes, struct ls_diag *diag)
{
    int fd = open_beside(folder);
    if (fd < 0)
        return failed(folder, bytes, errno, diag);
    enum ls_err err = check_spare(fd, folder, bytes, spare_bytes, diag);
    if (err) {
        close(fd);
        return err;
    }
    int error = posix_fallocate(fd, 0, (off_t)bytes);
    void *base = error ? MAP_FAILED : mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (!error && base == MAP_FAILED)
        error = errno;
    close(fd);
    if (error)
        return failed(folder, bytes, error, diag);
    *map = (struct ls_map_file){base, bytes};
    return LS_OK;
}

void ls_map_file_finish(struct ls_map_file *map)
{
    if (map->base)
        munmap(map->base, map->bytes);
    *map = (struct ls_map_file){0};
}

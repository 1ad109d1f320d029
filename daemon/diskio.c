#include "daemon/diskio.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum ls_err fail(const char *doing, const char *name, int error, struct ls_diag *diag)
{
    enum ls_err err = error == ENOSPC || error == EDQUOT || error == EFBIG ? LS_ERR_FULL
                      : error == ENOENT                                    ? LS_ERR_NOT_FOUND
                                                                           : LS_ERR_OS;
    return ls_fail(diag, err, "cannot %s %s: %s", doing, name, strerror(error));
}

/* 0, or the errno the shim wants. */
static int ask(const struct ls_disk_shim *shim, enum ls_disk_op op, const char *name, size_t *n)
{
    size_t none = 0;
    return shim ? shim->before(shim->user, op, name, n ? n : &none) : 0;
}

enum ls_err ls_disk_write(const struct ls_disk_shim *shim, int fd, const char *name,
                          const void *bytes, size_t n_bytes, struct ls_diag *diag)
{
    const char *at = bytes;
    while (n_bytes) {
        size_t n = n_bytes < SSIZE_MAX ? n_bytes : SSIZE_MAX;
        int error = ask(shim, LS_DISK_WRITE, name, &n);
        if (error)
            return fail("write", name, error, diag);
        ssize_t done = write(fd, at, n);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return fail("write", name, done ? errno : ENOSPC, diag);
        at += done;
        n_bytes -= (size_t)done;
    }
    return LS_OK;
}

enum ls_err ls_disk_sync(const struct ls_disk_shim *shim, int fd, const char *name,
                         struct ls_diag *diag)
{
    int error = ask(shim, LS_DISK_SYNC, name, NULL);
    if (!error && fdatasync(fd))
        error = errno;
    return error ? fail("sync", name, error, diag) : LS_OK;
}

enum ls_err ls_disk_sync_dir(const struct ls_disk_shim *shim, int dir_fd, const char *name,
                             struct ls_diag *diag)
{
    int error = ask(shim, LS_DISK_SYNC_DIR, name, NULL);
    if (!error && fsync(dir_fd))
        error = errno;
    return error ? fail("sync the folder", name, error, diag) : LS_OK;
}

enum ls_err ls_disk_allocate(const struct ls_disk_shim *shim, int fd, const char *name,
                             uint64_t n_bytes, struct ls_diag *diag)
{
    int error = ask(shim, LS_DISK_ALLOCATE, name, NULL);
    while (!error && n_bytes && fallocate(fd, 0, 0, (off_t)n_bytes))
        if (errno != EINTR)
            error = errno;
    if (error == EOPNOTSUPP || error == ENOSYS)
        return LS_OK;
    return error ? fail("reserve space for", name, error, diag) : LS_OK;
}

enum ls_err ls_disk_truncate(const struct ls_disk_shim *shim, int fd, const char *name,
                             uint64_t n_bytes, struct ls_diag *diag)
{
    int error = ask(shim, LS_DISK_TRUNCATE, name, NULL);
    if (!error && ftruncate(fd, (off_t)n_bytes))
        error = errno;
    return error ? fail("shorten", name, error, diag) : LS_OK;
}

enum ls_err ls_disk_create(const struct ls_disk_shim *shim, int dir_fd, const char *name, int *fd,
                           struct ls_diag *diag)
{
    int error = ask(shim, LS_DISK_CREATE, name, NULL);
    *fd = error ? -1 : openat(dir_fd, name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (!error && *fd < 0)
        error = errno;
    return error ? fail("create", name, error, diag) : LS_OK;
}

/* The page cache between memory and disk, or not. */
static bool set_direct(int fd, bool direct)
{
    int flags = fcntl(fd, F_GETFL);
    return flags >= 0 && !fcntl(fd, F_SETFL, direct ? flags | O_DIRECT : flags & ~O_DIRECT);
}

/* Whole blocks from the front, until something has to go another way: an end that is no block, or
 * everything, where the file system refuses. */
static enum ls_err write_blocks(const struct ls_disk_shim *shim, int fd, const char *name,
                                const char *bytes, size_t n_bytes, size_t *n_done,
                                struct ls_diag *diag)
{
    while (n_bytes - *n_done >= LS_DISK_BLOCK_BYTES && *n_done % LS_DISK_BLOCK_BYTES == 0) {
        size_t n = n_bytes - *n_done;
        int error = ask(shim, LS_DISK_WRITE, name, &n);
        if (error)
            return fail("write", name, error, diag);
        n -= n % LS_DISK_BLOCK_BYTES;
        ssize_t done = n ? write(fd, bytes + *n_done, n) : 0;
        if (done < 0 && errno == EINTR)
            continue;
        if (!n || (done < 0 && errno == EINVAL))
            return LS_OK;
        if (done <= 0)
            return fail("write", name, done ? errno : ENOSPC, diag);
        *n_done += (size_t)done;
    }
    return LS_OK;
}

static enum ls_err fill(const struct ls_disk_shim *shim, int fd, const char *name,
                        const char *bytes, size_t n_bytes, size_t *n_direct, struct ls_diag *diag)
{
    *n_direct = 0;
    enum ls_err err = ls_disk_allocate(shim, fd, name, n_bytes, diag);
    if (!err && ls_disk_can_be_direct(bytes, n_bytes) && set_direct(fd, true)) {
        err = write_blocks(shim, fd, name, bytes, n_bytes, n_direct, diag);
        if (!err && !set_direct(fd, false))
            err = fail("write", name, errno, diag);
    }
    if (!err)
        err = ls_disk_write(shim, fd, name, bytes + *n_direct, n_bytes - *n_direct, diag);
    return err ? err : ls_disk_sync(shim, fd, name, diag);
}

bool ls_disk_can_be_direct(const void *bytes, size_t n_bytes)
{
    return (uintptr_t)bytes % LS_DISK_BLOCK_BYTES == 0 && n_bytes >= LS_DISK_BLOCK_BYTES;
}

enum ls_err ls_disk_replace(const struct ls_disk_shim *shim, int dir_fd, const char *name,
                            const void *bytes, size_t n_bytes, size_t *n_direct,
                            struct ls_diag *diag)
{
    char temporary[PATH_MAX];
    size_t unasked;
    int fd;
    int n = snprintf(temporary, sizeof temporary, "%s.tmp", name);
    if (n < 0 || (size_t)n >= sizeof temporary)
        return fail("create", name, ENAMETOOLONG, diag);
    enum ls_err err = ls_disk_create(shim, dir_fd, temporary, &fd, diag);
    if (err)
        return err;
    err = fill(shim, fd, name, bytes, n_bytes, n_direct ? n_direct : &unasked, diag);
    if (close(fd) && !err)
        err = fail("close", name, errno, diag);
    int error = err ? 0 : ask(shim, LS_DISK_RENAME, name, NULL);
    if (!err && !error && renameat(dir_fd, temporary, dir_fd, name))
        error = errno;
    if (error)
        err = fail("rename", name, error, diag);
    if (err)
        unlinkat(dir_fd, temporary, 0);
    return err;
}

static enum ls_err read_all(int fd, const char *name, size_t n, uint8_t *bytes,
                            struct ls_diag *diag)
{
    for (size_t at = 0; at < n;) {
        ssize_t got = read(fd, bytes + at, n - at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return fail("read", name, got ? errno : EIO, diag);
        at += (size_t)got;
    }
    return LS_OK;
}

enum ls_err ls_disk_read(int dir_fd, const char *name, size_t limit_bytes, uint8_t **bytes,
                         size_t *n_bytes, struct ls_diag *diag)
{
    struct stat info;
    int fd = openat(dir_fd, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0)
        return fail("open", name, errno, diag);
    enum ls_err err = LS_OK;
    uint8_t *buffer = NULL;
    if (fstat(fd, &info) || !S_ISREG(info.st_mode))
        err = ls_fail(diag, LS_ERR_OS, "%s is not a file", name);
    else if ((uint64_t)info.st_size > limit_bytes)
        err = ls_fail(diag, LS_ERR_LIMIT, "%s has %lld bytes: more than the limit of %zu", name,
                      (long long)info.st_size, limit_bytes);
    else if (!(buffer = malloc((size_t)info.st_size + 1)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory to read %s", name);
    else
        err = read_all(fd, name, (size_t)info.st_size, buffer, diag);
    close(fd);
    if (err) {
        free(buffer);
        return err;
    }
    buffer[info.st_size] = 0;
    *bytes = buffer;
    *n_bytes = (size_t)info.st_size;
    return LS_OK;
}

#include "clients/command_file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum ls_err ls_command_read_file(const char *path, size_t limit, char **bytes, size_t *n,
                                 struct ls_diag *diag)
{
    struct stat info;
    FILE *file = fopen(path, "rbe");
    if (!file)
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    if (fstat(fileno(file), &info) || !S_ISREG(info.st_mode) || (uint64_t)info.st_size > limit) {
        fclose(file);
        return ls_fail(diag, LS_ERR_INVALID, "%s: expected a file of at most %zu bytes", path,
                       limit);
    }
    size_t size = (size_t)info.st_size;
    *bytes = malloc(size + 1);
    *n = *bytes ? fread(*bytes, 1, size, file) : 0;
    fclose(file);
    if (!*bytes)
        return ls_fail(diag, LS_ERR_NOMEM, "%s: out of memory", path);
    (*bytes)[*n] = '\0';
    return LS_OK;
}

enum ls_err ls_command_read_json(const char *path, size_t limit, json_t **root,
                                 struct ls_diag *diag)
{
    char *bytes = NULL;
    size_t n = 0;
    json_error_t error;
    enum ls_err err = ls_command_read_file(path, limit, &bytes, &n, diag);
    if (err)
        return err;
    *root = json_loadb(bytes, n, JSON_REJECT_DUPLICATES, &error);
    free(bytes);
    return *root ? LS_OK
                 : ls_fail(diag, LS_ERR_INVALID, "%.200s:%d: %.200s", path, error.line, error.text);
}

static bool write_all(int fd, const uint8_t *bytes, size_t n)
{
    for (size_t at = 0; at < n;) {
        ssize_t wrote = write(fd, bytes + at, n - at);
        if (wrote < 0 && errno == EINTR)
            continue;
        if (wrote <= 0)
            return false;
        at += (size_t)wrote;
    }
    return true;
}

/* Devices and pipes: there is nothing to replace. */
static enum ls_err write_through(const char *path, const void *bytes, size_t n,
                                 struct ls_diag *diag)
{
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    bool ok = fd >= 0 && write_all(fd, bytes, n);
    int reason = errno;
    if (fd >= 0 && close(fd) && ok) {
        ok = false;
        reason = errno;
    }
    return ok ? LS_OK : ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(reason));
}

/* What open(2) would have given a new file; a replaced one keeps its own. */
static mode_t new_file_mode(void)
{
    mode_t mask = umask(0);
    umask(mask);
    return 0666 & ~mask;
}

/* An interrupt waits until the file beside is whole or gone. */
static void hold_interrupts(bool hold, sigset_t *before)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigprocmask(hold ? SIG_BLOCK : SIG_SETMASK, hold ? &set : before, hold ? before : NULL);
}

static enum ls_err write_beside(const char *path, mode_t mode, const void *bytes, size_t n,
                                struct ls_diag *diag)
{
    char beside[PATH_MAX];
    if (snprintf(beside, sizeof beside, "%s.XXXXXX", path) >= (int)sizeof beside)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", path);
    int fd = mkostemp(beside, O_CLOEXEC);
    if (fd < 0)
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    bool ok = write_all(fd, bytes, n) && fchmod(fd, mode) == 0;
    int reason = errno;
    if (close(fd) && ok) {
        ok = false;
        reason = errno;
    }
    if (ok && rename(beside, path) == 0)
        return LS_OK;
    reason = ok ? errno : reason;
    unlink(beside);
    return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(reason));
}

static enum ls_err replace(const char *path, mode_t mode, const void *bytes, size_t n,
                           struct ls_diag *diag)
{
    sigset_t before;
    hold_interrupts(true, &before);
    enum ls_err err = write_beside(path, mode, bytes, n, diag);
    hold_interrupts(false, &before);
    return err;
}

enum ls_err ls_command_check_writable(const char *path, struct ls_diag *diag)
{
    struct stat info;
    char target[PATH_MAX], folder[PATH_MAX];
    path = realpath(path, target) ? target : path;
    const char *slash = strrchr(path, '/');
    int n = slash ? (int)(slash - path) + 1 : 0;
    if (snprintf(folder, sizeof folder, "%.*s.", n, path) >= (int)sizeof folder)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", path);
    bool there = stat(path, &info) == 0;
    if (there && S_ISDIR(info.st_mode))
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(EISDIR));
    if (there && !S_ISREG(info.st_mode))
        return LS_OK; /* a pipe or a device: its other end may come later */
    return access(folder, W_OK | X_OK)
               ? ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno))
               : LS_OK;
}

enum ls_err ls_command_write_file(const char *path, const void *bytes, size_t n,
                                  struct ls_diag *diag)
{
    struct stat info;
    char target[PATH_MAX];
    if (lstat(path, &info))
        return errno == ENOENT ? replace(path, new_file_mode(), bytes, n, diag)
                               : ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    if (S_ISLNK(info.st_mode)) {
        if (!realpath(path, target) || lstat(target, &info))
            return ls_fail(diag, LS_ERR_INVALID, "%s: a link to nothing that can be written: %s",
                           path, strerror(errno));
        path = target;
    }
    if (S_ISDIR(info.st_mode))
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(EISDIR));
    return S_ISREG(info.st_mode) ? replace(path, info.st_mode & 07777, bytes, n, diag)
                                 : write_through(path, bytes, n, diag);
}

#include "clients/render_file.h"

#include "clients/command_file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

struct ls_render_file {
    char path[PATH_MAX], part[PATH_MAX];
    int fd;    /* -1: none */
    int error; /* errno of a write that failed */
    struct ls_exr_rows *rows;
};

static bool put(void *user, const void *bytes, size_t n, uint64_t offset)
{
    struct ls_render_file *file = user;
    for (const char *at = bytes; n > 0;) {
        ssize_t wrote = pwrite(file->fd, at, n, (off_t)offset);
        if (wrote < 0 && errno == EINTR)
            continue;
        if (wrote <= 0) {
            file->error = wrote < 0 ? errno : ENOSPC;
            return false;
        }
        at += wrote;
        n -= (size_t)wrote;
        offset += (uint64_t)wrote;
    }
    return true;
}

static enum ls_err failed(const struct ls_render_file *file, int error, struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_INVALID, "%s: %s", file->path, strerror(error));
}

static enum ls_err open_part(struct ls_render_file *file, struct ls_diag *diag)
{
    file->fd = open(file->part, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (file->fd < 0)
        return failed(file, errno, diag);
    if (flock(file->fd, LOCK_EX | LOCK_NB)) {
        enum ls_err err =
            ls_fail(diag, LS_ERR_BUSY, "%s: another program is making it", file->path);
        close(file->fd); /* not ours to remove */
        file->fd = -1;
        return err;
    }
    return ftruncate(file->fd, 0) ? failed(file, errno, diag) : LS_OK;
}

enum ls_err ls_render_file_begin(const char *path, const struct ls_exr_rows_of *of,
                                 struct ls_render_file **out, struct ls_diag *diag)
{
    struct ls_render_file *file = calloc(1, sizeof *file);
    struct ls_exr_rows_of to = *of;
    if (!file)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    file->fd = -1;
    to.put = put;
    to.user = file;
    snprintf(file->path, sizeof file->path, "%s", path);
    enum ls_err err =
        snprintf(file->part, sizeof file->part, "%s.part", path) < (int)sizeof file->part
            ? open_part(file, diag)
            : failed(file, ENAMETOOLONG, diag);
    if (!err)
        err = ls_exr_rows_begin(&to, &file->rows, diag);
    if (err && file->error)
        err = failed(file, file->error, diag);
    if (err) {
        ls_render_file_destroy(file);
        return err;
    }
    *out = file;
    return LS_OK;
}

enum ls_err ls_render_file_add(struct ls_render_file *file, const float *rgb, uint32_t n_rows,
                               struct ls_diag *diag)
{
    enum ls_err err = ls_exr_rows_add(file->rows, rgb, n_rows, diag);
    return err && file->error ? failed(file, file->error, diag) : err;
}

enum ls_err ls_render_file_end(struct ls_render_file *file, struct ls_diag *diag)
{
    enum ls_err err = ls_exr_rows_end(file->rows, diag);
    if (err)
        return file->error ? failed(file, file->error, diag) : err;
    if (fsync(file->fd) || rename(file->part, file->path))
        return failed(file, errno, diag);
    int closed = close(file->fd);
    file->fd = -1;
    return closed ? failed(file, errno, diag) : LS_OK;
}

void ls_render_file_destroy(struct ls_render_file *file)
{
    if (!file)
        return;
    ls_exr_rows_destroy(file->rows);
    if (file->fd >= 0) {
        unlink(file->part);
        close(file->fd);
    }
    free(file);
}

bool ls_render_file_is_whole(const char *path, const char *recipe)
{
    static const size_t limit = (size_t)4 << 30;
    struct ls_diag diag = {0};
    struct ls_exr_attrs attrs = {0};
    struct ls_image image = {0};
    char *bytes = NULL;
    size_t n = 0;
    bool same = false;
    if (access(path, F_OK) == 0 && !ls_command_read_file(path, limit, &bytes, &n, &diag) &&
        !ls_exr_read(bytes, n, NULL, limit, &image, &attrs, &diag)) {
        const struct ls_exr_attr *attr = ls_exr_attrs_find(&attrs, "lightstage/recipe");
        same = attr && attr->kind == LS_EXR_ATTR_STRING && strcmp(attr->text, recipe) == 0;
    }
    ls_exr_attrs_finish(&attrs);
    ls_image_finish(&image);
    free(bytes);
    return same;
}

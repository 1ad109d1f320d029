#include "daemon/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

static enum ls_err read_whole(int fd, const char *path, char *text, size_t size, size_t *length,
                              struct ls_diag *diag)
{
    for (*length = 0; *length < size;) {
        ssize_t n = read(fd, text + *length, size - *length);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return ls_fail(diag, LS_ERR_OS, "%s: cannot be read: %m", path);
        if (n == 0)
            break;
        *length += (size_t)n;
    }
    text[*length] = 0;
    return LS_OK;
}

enum ls_err ls_file_read(const char *path, size_t max, char **text, size_t *length,
                         struct ls_diag *diag)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return ls_fail(diag, errno == ENOENT ? LS_ERR_NOT_FOUND : LS_ERR_OS, "%s: cannot open: %m",
                       path);
    struct stat st;
    enum ls_err err = LS_OK;
    char *bytes = NULL;
    if (fstat(fd, &st) || !S_ISREG(st.st_mode))
        err = ls_fail(diag, LS_ERR_OS, "%s: not a regular file", path);
    else if ((uintmax_t)st.st_size > max)
        err = ls_fail(diag, LS_ERR_LIMIT, "%s: %jd bytes: expected at most %zu", path,
                      (intmax_t)st.st_size, max);
    else if (!(bytes = malloc((size_t)st.st_size + 1)))
        err = ls_fail(diag, LS_ERR_NOMEM, "%s: out of memory", path);
    else
        err = read_whole(fd, path, bytes, (size_t)st.st_size, length, diag);
    close(fd);
    if (err)
        free(bytes);
    else
        *text = bytes;
    return err;
}

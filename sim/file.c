#include "sim/file.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum ls_err read_all(FILE *file, const char *path, size_t limit_bytes, char **bytes,
                            size_t *n_bytes, struct ls_diag *diag)
{
    long end = fseek(file, 0, SEEK_END) ? -1 : ftell(file);
    if (end < 0 || fseek(file, 0, SEEK_SET))
        return ls_fail(diag, LS_ERR_OS, "%s: %s", path, strerror(errno));
    if ((size_t)end > limit_bytes)
        return ls_fail(diag, LS_ERR_LIMIT, "%s: %ld bytes: expected at most %zu", path, end,
                       limit_bytes);
    LS_CLEANUP_FREE char *text = malloc((size_t)end + 1);
    if (!text)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory reading %s", path);
    if (fread(text, 1, (size_t)end, file) != (size_t)end)
        return ls_fail(diag, LS_ERR_OS, "%s: cannot be read", path);
    *bytes = text;
    *n_bytes = (size_t)end;
    text = NULL;
    return LS_OK;
}

enum ls_err sim_file_read(const char *path, size_t limit_bytes, char **bytes, size_t *n_bytes,
                          struct ls_diag *diag)
{
    FILE *file = fopen(path, "rbe");
    if (!file)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %s", path, strerror(errno));
    enum ls_err err = read_all(file, path, limit_bytes, bytes, n_bytes, diag);
    fclose(file);
    return err;
}

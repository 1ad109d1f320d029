#include "clients/kept_files.h"

#include "clients/command.h"

#include <stdlib.h>
#include <sys/stat.h>

static bool find(const char *path, struct ls_kept_file *out)
{
    struct stat info;
    if (stat(path, &info) || !S_ISREG(info.st_mode))
        return false;
    *out = (struct ls_kept_file){info.st_dev, info.st_ino};
    return true;
}

static int in_order(const void *a, const void *b)
{
    const struct ls_kept_file *x = a, *y = b;
    if (x->device != y->device)
        return x->device < y->device ? -1 : 1;
    return (x->inode > y->inode) - (x->inode < y->inode);
}

bool ls_kept_files_init(struct ls_kept_files *out, const char *const *paths, size_t n)
{
    out->files = calloc(n + 1, sizeof *out->files);
    if (!out->files)
        return false;
    for (size_t i = 0; i < n; i++)
        out->n += find(paths[i], &out->files[out->n]);
    qsort(out->files, out->n, sizeof *out->files, in_order);
    return true;
}

int ls_kept_files_check(const struct ls_kept_files *kept, const char *option, const char *path)
{
    struct ls_kept_file file;
    if (!find(path, &file) || !bsearch(&file, kept->files, kept->n, sizeof *kept->files, in_order))
        return LS_EXIT_OK;
    return ls_command_wrong("%s %s: that is what the picture is lit with, which is kept", option,
                            path);
}

void ls_kept_files_finish(struct ls_kept_files *kept)
{
    free(kept->files);
    *kept = (struct ls_kept_files){0};
}

/*
 * kept_files: files that a command reads, which its output does not replace.
 * Layer: clients. Threads: the main thread. Ownership: see finish.
 */
#ifndef LS_CLIENTS_KEPT_FILES_H
#define LS_CLIENTS_KEPT_FILES_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

struct ls_kept_files {
    struct ls_kept_file {
        dev_t device;
        ino_t inode;
    } * files; /* [n], sorted */
    size_t n;
};

/** Those of paths[n] that there are. *out: zeroed; finish in any case. false: out of memory. */
bool ls_kept_files_init(struct ls_kept_files *out, const char *const *paths, size_t n);

/** May @path be written? LS_EXIT_OK, or LS_EXIT_USAGE, said already: it is one of them, under
 * whatever name. @option: "--output". */
int ls_kept_files_check(const struct ls_kept_files *kept, const char *option, const char *path);

/** Zeroed is allowed. */
void ls_kept_files_finish(struct ls_kept_files *kept);

#endif

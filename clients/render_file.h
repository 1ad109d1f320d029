/*
 * render_file: one frame on its way to disk: NAME.part while it is made, NAME once it is whole.
 * Layer: clients. Threads: one at a time per file. Ownership: as stated.
 *
 * A part that was left behind, by whoever was killed, is written over. Two programs that make the
 * same frame at once are told apart by a lock on it: the second is refused.
 */
#ifndef LS_CLIENTS_RENDER_FILE_H
#define LS_CLIENTS_RENDER_FILE_H

#include "core/error.h"
#include "core/exr_rows.h"

#include <stdbool.h>

struct ls_render_file;

/** Begin the picture @of (but for put and user) at @path. Errors: LS_ERR_INVALID (with the reason),
 * LS_ERR_BUSY (another program makes it), those of ls_exr_rows_begin. *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_render_file_begin(const char *path, const struct ls_exr_rows_of *of,
                                               struct ls_render_file **out, struct ls_diag *diag);

/** The next rows. Errors: LS_ERR_INVALID, naming the file and why. */
LS_MUST_CHECK enum ls_err ls_render_file_add(struct ls_render_file *file, const float *rgb,
                                             uint32_t n_rows, struct ls_diag *diag);

/** It is whole: on the disk, under its name. Errors as before. */
LS_MUST_CHECK enum ls_err ls_render_file_end(struct ls_render_file *file, struct ls_diag *diag);

/** What was not ended is removed. NULL is allowed. */
void ls_render_file_destroy(struct ls_render_file *file);

/** Is there a readable picture at @path that was made by @recipe (its attribute
 * lightstage/recipe)? */
bool ls_render_file_is_whole(const char *path, const char *recipe);

#endif

/*
 * export_list: which files an export, or a fetch, consists of, as JSON and as CSV.
 * Layer: clients. Threads: the main thread. Ownership: owns its texts; finish it.
 */
#ifndef LS_CLIENTS_EXPORT_LIST_H
#define LS_CLIENTS_EXPORT_LIST_H

#include "clients/take_document.h"

#include <jansson.h>
#include <stdio.h>

struct ls_export_list {
    json_t *frames;
    char *csv;
    size_t csv_bytes;
    FILE *csv_stream; /* into csv */
};

/** LS_ERR_NOMEM. @list: zeroed; finish it in any case. */
LS_MUST_CHECK enum ls_err ls_export_list_begin(struct ls_export_list *list, struct ls_diag *diag);

/** One file: its name, its light, the @weight its values have been multiplied by. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_export_list_add(struct ls_export_list *list,
                                             const struct ls_take_document *document,
                                             const char *file, uint32_t light, double weight,
                                             struct ls_diag *diag);

/** Write @document, which holds the frames, and the CSV to their paths. Errors: those of
 * ls_command_write_file, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_export_list_write(struct ls_export_list *list, const json_t *document,
                                               const char *json_path, const char *csv_path,
                                               struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_export_list_finish(struct ls_export_list *list);

#endif

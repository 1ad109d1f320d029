#include "clients/export_list.h"

#include "clients/command_file.h"

#include <stdlib.h>
#include <string.h>

static enum ls_err no_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

enum ls_err ls_export_list_begin(struct ls_export_list *list, struct ls_diag *diag)
{
    list->frames = json_array();
    list->csv_stream = open_memstream(&list->csv, &list->csv_bytes);
    return list->frames && list->csv_stream &&
                   fputs("file,light,x,y,z,solid_angle_sr,weight\n", list->csv_stream) >= 0
               ? LS_OK
               : no_memory(diag);
}

enum ls_err ls_export_list_add(struct ls_export_list *list, const struct ls_take_document *document,
                               const char *file, uint32_t light, double weight,
                               struct ls_diag *diag)
{
    const float *v = document->direction[light];
    double omega = document->omega_sr[light], x = (double)v[0], y = (double)v[1], z = (double)v[2];
    json_t *frame = json_pack("{ss sI s[fff] sf sf}", "file", file, "light", (json_int_t)light,
                              "direction", x, y, z, "solid_angle_sr", omega, "weight", weight);
    return json_array_append_new(list->frames, frame) ||
                   fprintf(list->csv_stream, "%s,%u,%.9g,%.9g,%.9g,%.9g,%.9g\n", file, light, x, y,
                           z, omega, weight) < 0
               ? no_memory(diag)
               : LS_OK;
}

static enum ls_err end_csv(struct ls_export_list *list, struct ls_diag *diag)
{
    FILE *stream = list->csv_stream;
    list->csv_stream = NULL;
    return fclose(stream) ? no_memory(diag) : LS_OK;
}

enum ls_err ls_export_list_write(struct ls_export_list *list, const json_t *document,
                                 const char *json_path, const char *csv_path, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *text = json_dumps(document, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    enum ls_err err = text ? end_csv(list, diag) : no_memory(diag);
    if (!err)
        err = ls_command_write_file(json_path, text, strlen(text), diag);
    if (!err)
        err = ls_command_write_file(csv_path, list->csv, list->csv_bytes, diag);
    return err;
}

void ls_export_list_finish(struct ls_export_list *list)
{
    if (list->csv_stream)
        fclose(list->csv_stream);
    json_decref(list->frames);
    free(list->csv);
}

#include "clients/plan_text.h"

#include "clients/command.h"

#include <stdio.h>
#include <stdlib.h>

enum { MAX_BYTES = 1024 * 1024 };

/* As a string of the configuration's syntax. */
static void put_string(FILE *out, const char *text)
{
    fputc('"', out);
    for (; *text; text++) {
        unsigned char c = (unsigned char)*text;
        if (c == '"' || c == '\\')
            fprintf(out, "\\%c", c);
        else if (c == '\n')
            fputs("\\n", out);
        else if (c < 0x20)
            fprintf(out, "\\x%02x", c);
        else
            fputc(c, out);
    }
    fputc('"', out);
}

static enum ls_err join(const char *plan, const char *custom, bool sweep, char **text, size_t *n,
                        struct ls_diag *diag)
{
    FILE *out = open_memstream(text, n);
    if (!out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a plan");
    fprintf(out, "%s\n", plan);
    if (sweep)
        fputs("sweep = true;\n", out);
    if (custom) {
        fputs("custom = ", out);
        put_string(out, custom);
        fputs(";\n", out);
    }
    return fclose(out) ? ls_fail(diag, LS_ERR_NOMEM, "out of memory for a plan") : LS_OK;
}

enum ls_err ls_plan_text_read(const char *plan_path, const char *custom_path, bool sweep,
                              char **text, size_t *n, struct ls_diag *diag)
{
    size_t unused;
    if (!custom_path && !sweep)
        return ls_command_read_file(plan_path, MAX_BYTES, text, n, diag);
    LS_CLEANUP_FREE char *plan = NULL;
    LS_CLEANUP_FREE char *custom = NULL;
    enum ls_err err = ls_command_read_file(plan_path, MAX_BYTES, &plan, &unused, diag);
    if (!err && custom_path)
        err = ls_command_read_file(custom_path, MAX_BYTES, &custom, &unused, diag);
    return err ? err : join(plan, custom, sweep, text, n, diag);
}

#include "core/error.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

enum ls_err ls_fail(struct ls_diag *diag, enum ls_err err, const char *fmt, ...)
{
    if (diag) {
        va_list args;
        va_start(args, fmt);
        vsnprintf(diag->text, sizeof diag->text, fmt, args);
        va_end(args);
    }
    return err;
}

const char *ls_err_name(enum ls_err err)
{
    static const char *const names[] = {
        [LS_OK] = "ok",
        [LS_ERR_NOMEM] = "out of memory",
        [LS_ERR_OS] = "system error",
        [LS_ERR_BUG] = "internal error",
        [LS_ERR_INVALID] = "invalid",
        [LS_ERR_UNSUPPORTED] = "unsupported",
        [LS_ERR_NOT_FOUND] = "not found",
        [LS_ERR_EXISTS] = "exists already",
        [LS_ERR_STATE] = "not possible now",
        [LS_ERR_BUSY] = "busy",
        [LS_ERR_LIMIT] = "over a limit",
        [LS_ERR_FULL] = "full",
        [LS_ERR_TIMEOUT] = "timed out",
        [LS_ERR_GONE] = "gone",
        [LS_ERR_REFUSED] = "refused",
        [LS_ERR_MISMATCH] = "mismatch",
        [LS_ERR_ABORTED] = "aborted",
    };
    if ((unsigned)err >= sizeof names / sizeof *names || !names[err])
        return "unknown error";
    return names[err];
}

void ls_cleanup_free(void *pointer_to_pointer)
{
    free(*(void **)pointer_to_pointer);
}

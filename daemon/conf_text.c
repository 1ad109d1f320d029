#include "daemon/conf_text.h"

#include <stdbool.h>
#include <string.h>

/* The end of the comment that begins at @at, or @at. */
static const char *after_comment(const char *at)
{
    if (*at == '#' || (at[0] == '/' && at[1] == '/'))
        return at + strcspn(at, "\n");
    if (at[0] != '/' || at[1] != '*')
        return at;
    const char *end = strstr(at + 2, "*/");
    return end ? end + 2 : at + strlen(at);
}

/* The end of the string that begins at @at, or NULL. */
static const char *after_string(const char *at)
{
    for (at++; *at && *at != '"'; at++)
        if (*at == '\\' && (at[1] == '\\' || at[1] == '"'))
            at++;
    return *at ? at + 1 : NULL;
}

static int line_of(const char *text, const char *at)
{
    int line = 1;
    for (; text < at; text++)
        line += *text == '\n';
    return line;
}

/* Strings end, and stand where a value may begin or after another string. */
static enum ls_err check_strings(const char *what, const char *text, struct ls_diag *diag)
{
    char before = 0; /* the last character that is neither blank nor comment */
    for (const char *at = text; *at;) {
        const char *end = after_comment(at);
        if (end == at && *at == '"') {
            end = after_string(at);
            if (!end)
                return ls_fail(diag, LS_ERR_INVALID, "%s:%d: the string has no end", what,
                               line_of(text, at));
            if (!before || !strchr("=:[(,\"", before))
                return ls_fail(diag, LS_ERR_INVALID, "%s:%d: a string where no value is expected",
                               what, line_of(text, at));
        }
        if (end == at && !strchr(" \t\r\n\f\v", *at))
            before = *at;
        else if (end != at && *at == '"')
            before = '"';
        at = end == at ? at + 1 : end;
    }
    return LS_OK;
}

enum ls_err ls_conf_text(const char *what, const char *text, config_t *tree, struct ls_diag *diag)
{
    if (strstr(text, "@include"))
        return ls_fail(diag, LS_ERR_INVALID, "%s: @include: expected the whole %s in one text",
                       what, what);
    enum ls_err err = check_strings(what, text, diag);
    if (!err && !config_read_string(tree, text))
        err = ls_fail(diag, LS_ERR_INVALID, "%s:%d: %s", what, config_error_line(tree),
                      config_error_text(tree));
    return err;
}

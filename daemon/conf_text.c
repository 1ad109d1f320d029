#include "daemon/conf_text.h"

#include <stdbool.h>
#include <string.h>

enum { DEEPEST = 32 };

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

/* Where in a text. */
struct place {
    char before;        /* the last character that is neither blank nor comment; of a string '"' */
    char open[DEEPEST]; /* brackets */
    size_t depth;
};

/* A comma ends a setting, too. */
static bool value_may_begin(const struct place *place)
{
    bool among_values = place->depth > 0 && strchr("[(", place->open[place->depth - 1]);
    return place->before &&
           (strchr("=:[(\"", place->before) || (place->before == ',' && among_values));
}

/* False: too deep. */
static bool pass(struct place *place, char c)
{
    if (strchr("[({", c) && place->depth == DEEPEST)
        return false;
    if (strchr("[({", c))
        place->open[place->depth++] = c;
    else if (strchr("])}", c) && place->depth > 0)
        place->depth--;
    place->before = c;
    return true;
}

static enum ls_err check_string(const char *what, const char *text, const char *at,
                                const struct place *place, const char **end, struct ls_diag *diag)
{
    *end = after_string(at);
    if (!*end)
        return ls_fail(diag, LS_ERR_INVALID, "%s:%d: the string has no end", what,
                       line_of(text, at));
    if (!value_may_begin(place))
        return ls_fail(diag, LS_ERR_INVALID, "%s:%d: a string where no value is expected", what,
                       line_of(text, at));
    return LS_OK;
}

/* Strings end, and stand where a value may begin or after another string. */
static enum ls_err check_strings(const char *what, const char *text, struct ls_diag *diag)
{
    struct place place = {0};
    for (const char *at = text, *end; *at; at = end) {
        end = after_comment(at);
        if (end > at)
            continue;
        enum ls_err err = LS_OK;
        end = at + 1;
        if (*at == '"')
            err = check_string(what, text, at, &place, &end, diag);
        if (err)
            return err;
        if (!strchr(" \t\r\n\f\v", *at) && !pass(&place, *at))
            return ls_fail(diag, LS_ERR_INVALID, "%s:%d: brackets in more than %d others", what,
                           line_of(text, at), DEEPEST);
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

#include "clients/numbered_name.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

/* The '%' of the number, and what follows it; NULL: there is none. */
static const char *find(const char *name, const char **end, int *width, bool *zeros)
{
    for (const char *at = strchr(name, '%'); at; at = strchr(at + 1, '%')) {
        const char *p = at + 1;
        *zeros = *p == '0';
        *width = 0;
        for (int k = 0; k < 2 && is_digit(*p); k++)
            *width = *width * 10 + *p++ - '0';
        *end = p + 1;
        if (*p == 'd')
            return at;
    }
    return NULL;
}

bool ls_name_has_number(const char *name)
{
    const char *end;
    int width;
    bool zeros;
    return find(name, &end, &width, &zeros) != NULL;
}

char *ls_name_numbered(const char *name, uint32_t number)
{
    const char *end;
    int width;
    bool zeros;
    const char *at = find(name, &end, &width, &zeros);
    size_t size = strlen(name) + 112; /* a width of at most 99 */
    char *out = malloc(size);
    if (!out)
        return NULL;
    if (!at)
        return strcpy(out, name);
    snprintf(out, size, zeros ? "%.*s%0*u%s" : "%.*s%*u%s", (int)(at - name), name, width, number,
             end);
    return out;
}

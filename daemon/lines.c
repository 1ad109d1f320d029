#include "daemon/lines.h"

#include <glib.h>

enum { MAX_LINES = 10 };

void ls_lines_turned_away(struct ls_lines *lines, const char *who, const char *why)
{
    int64_t now_us = g_get_monotonic_time();
    if (now_us - lines->second_us >= G_USEC_PER_SEC) {
        if (lines->said > MAX_LINES)
            g_message("%u more were turned away", lines->said - MAX_LINES);
        lines->second_us = now_us;
        lines->said = 0;
    }
    if (lines->said++ < MAX_LINES)
        g_message("%s is turned away: %s", who, why);
}

#include "clients/command.h"

#include <stdio.h>

static int run(struct ls_command_context *context, int argc, char **argv)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    Lightstage__Blank body = LIGHTSTAGE__BLANK__INIT;
    struct ls_reply reply;
    if (ls_command_option(context, &ls_command_blank, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_blank, argc, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_call(context, LS_MESSAGE_BLANK, &body.base, NULL, 0, &reply);
    if (code)
        return code;
    ls_reply_finish(&reply);
    puts("all lights are off");
    return LS_EXIT_OK;
}

const struct ls_command ls_command_blank = {
    "blank", "All lights off, now; ends a running take", "", run};

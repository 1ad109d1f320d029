#include "clients/command.h"

#include <stdio.h>

static int run(struct ls_command_context *context, int argc, char **argv)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    if (ls_command_option(context, &ls_command_blank, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_blank, argc, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context, lightstage_blank(context->stage, &context->error));
    if (!code)
        puts("all lights are off");
    return code;
}

const struct ls_command ls_command_blank = {"blank", "All lights off, now; ends a running take", "",
                                            run};

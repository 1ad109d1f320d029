/*
 * lightstagectl: the operator's command line. Finds the command, runs it, returns its exit code.
 */
#include "clients/command.h"
#include "clients/interrupt.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct ls_command *const commands[] = {
    &ls_command_status,     &ls_command_rig,       &ls_command_preview,    &ls_command_blank,
    &ls_command_calibrate,  &ls_command_preflight, &ls_command_take_start, &ls_command_take_resume,
    &ls_command_take_abort, &ls_command_take_list, &ls_command_take_show,  &ls_command_take_verify,
    &ls_command_take_slate, &ls_command_fetch,     &ls_command_export,     &ls_command_relight,
    &ls_command_metrics,    &ls_command_events,    &ls_command_pki_init,   &ls_command_pki_add,
};

enum { N_COMMANDS = sizeof commands / sizeof *commands };

static void print_help(FILE *out)
{
    fputs("usage: lightstagectl [--socket PATH | --server URL] COMMAND [ARGUMENTS] [--json]\n\n",
          out);
    for (size_t i = 0; i < N_COMMANDS; i++)
        fprintf(out, "  %-12s  %s\n", commands[i]->name, commands[i]->summary);
    fputs("\n"
          "  --socket PATH  where lightstaged listens; else LIGHTSTAGED_SOCKET, else\n"
          "                 /run/lightstaged/socket\n"
          "  --server tls://HOST:PORT --certificate FILE --key FILE --authority FILE\n"
          "                 a daemon on another machine; else LIGHTSTAGED_SERVER,\n"
          "                 LIGHTSTAGED_CERTIFICATE, LIGHTSTAGED_KEY, LIGHTSTAGED_AUTHORITY\n"
          "  --json         machine-readable answer, with every reading command\n"
          "  --version\n"
          "  COMMAND --help says more of a command\n"
          "\n"
          "Exit status: 0 done; 1 done, and the answer is no (damage found, take not complete);\n"
          "2 wrong command line or file; 3 no daemon, or connection lost; refused because of the\n"
          "4 request, 5 state, 6 rig, 7 storage; 8 internal error; 130 interrupted.\n",
          out);
}

/* Print the commands that begin with @word, as "take"; false if there are none. */
static bool print_family(FILE *out, const char *word)
{
    size_t n = strlen(word);
    bool any = false;
    for (size_t i = 0; i < N_COMMANDS; i++) {
        if (strncmp(commands[i]->name, word, n) != 0 || commands[i]->name[n] != ' ')
            continue;
        if (!any)
            fprintf(out, "usage: lightstagectl %s COMMAND [ARGUMENTS]\n\n", word);
        any = true;
        fprintf(out, "  %-12s  %s\n", commands[i]->name, commands[i]->summary);
    }
    return any;
}

/* A command's name is one word or two. Returns how many of @argv it takes, 0 = none. */
static int match(const struct ls_command *command, int argc, char **argv)
{
    const char *space = strchr(command->name, ' ');
    if (!space)
        return argc >= 1 && strcmp(argv[0], command->name) == 0 ? 1 : 0;
    size_t first = (size_t)(space - command->name);
    return argc >= 2 && strlen(argv[0]) == first && strncmp(argv[0], command->name, first) == 0 &&
                   strcmp(argv[1], space + 1) == 0
               ? 2
               : 0;
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    for (size_t i = 0; i < N_COMMANDS; i++) {
        int words = match(commands[i], argc, argv);
        if (!words)
            continue;
        optind = 0; /* getopt starts anew, at the word after the name */
        return commands[i]->run(context, argc - words + 1, argv + words - 1);
    }
    if (argc > 1 && strcmp(argv[1], "--help") == 0 && print_family(stdout, argv[0]))
        return LS_EXIT_OK;
    if (!print_family(stderr, argv[0]))
        ls_command_wrong("%s: no such command; --help lists them", argv[0]);
    else if (argc > 1)
        ls_command_wrong("%s %s: no such command", argv[0], argv[1]);
    return LS_EXIT_USAGE;
}

static int command_line(int argc, char **argv)
{
    static const struct option options[] = {{"version", no_argument, NULL, 'v'}, LS_COMMON_OPTIONS};
    struct ls_command_context context = {0};
    ls_command_defaults(&context);
    for (int option; (option = getopt_long(argc, argv, "+", options, NULL)) != -1;) {
        if (ls_command_take_option(&context, option, optarg))
            continue;
        switch (option) {
        case 'v':
            puts("lightstagectl " LS_VERSION);
            return LS_EXIT_OK;
        case LS_OPTION_HELP:
            print_help(stdout);
            return LS_EXIT_OK;
        default:
            print_help(stderr);
            return LS_EXIT_USAGE;
        }
    }
    if (optind == argc) {
        print_help(stderr);
        return LS_EXIT_USAGE;
    }
    int code = run(&context, argc - optind, argv + optind);
    lightstage_close(context.stage);
    return code;
}

int main(int argc, char **argv)
{
    ls_interrupt_install();
    return ls_command_end(command_line(argc, argv));
}

#include "clients/command.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void print_usage(const struct ls_command *command, FILE *out)
{
    fprintf(out, "usage: %s%s%s%s%s\n%s.\n", program_invocation_short_name,
            command->name[0] ? " " : "", command->name, command->usage[0] ? " " : "",
            command->usage, command->summary);
}

void ls_command_defaults(struct ls_command_context *context)
{
    const char *socket = getenv("LIGHTSTAGED_SOCKET"), *server = getenv("LIGHTSTAGED_SERVER");
    context->socket_path = socket && socket[0] ? socket : "/run/lightstaged/socket";
    context->server = server && server[0] ? server : NULL;
    context->certificate = getenv("LIGHTSTAGED_CERTIFICATE");
    context->key = getenv("LIGHTSTAGED_KEY");
    context->authority = getenv("LIGHTSTAGED_AUTHORITY");
}

bool ls_command_take_option(struct ls_command_context *context, int option, const char *value)
{
    switch (option) {
    case LS_OPTION_SOCKET:
        context->socket_path = value;
        context->server = NULL;
        return true;
    case LS_OPTION_SERVER:
        context->server = value;
        return true;
    case LS_OPTION_CERTIFICATE:
        context->certificate = value;
        return true;
    case LS_OPTION_KEY:
        context->key = value;
        return true;
    case LS_OPTION_AUTHORITY:
        context->authority = value;
        return true;
    case LS_OPTION_JSON:
        context->json = true;
        return true;
    default:
        return false;
    }
}

int ls_command_option(struct ls_command_context *context, const struct ls_command *command,
                      int argc, char **argv, const struct option *options)
{
    int option;
    do
        option = getopt_long(argc, argv, "", options, NULL);
    while (ls_command_take_option(context, option, optarg));
    if (option == LS_OPTION_HELP) {
        print_usage(command, stdout);
        exit(ls_command_end(LS_EXIT_OK));
    }
    if (option == '?')
        print_usage(command, stderr);
    return option;
}

bool ls_command_arguments(const struct ls_command *command, int argc, int n)
{
    if (argc - optind == n)
        return true;
    ls_command_wrong("%s: expected %d argument%s, found %d", command->name, n, n == 1 ? "" : "s",
                     argc - optind);
    print_usage(command, stderr);
    return false;
}

int ls_command_wrong(const char *fmt, ...)
{
    va_list args;
    fprintf(stderr, "%s: ", program_invocation_short_name);
    va_start(args, fmt);
    vfprintf(stderr, fmt, args);
    va_end(args);
    fputc('\n', stderr);
    return LS_EXIT_USAGE;
}

int ls_command_end(int code)
{
    bool said = fflush(stdout) == 0 && !ferror(stdout);
    return said || code != LS_EXIT_OK ? code
                                      : ls_command_wrong("standard output: cannot be written");
}

static int exit_of_number(uint32_t number)
{
    static const int of_class[] = {LS_EXIT_REQUEST, LS_EXIT_STATE, LS_EXIT_RIG, LS_EXIT_STORAGE,
                                   LS_EXIT_INTERNAL};
    return number >= 100 && number < 600 ? of_class[number / 100 - 1] : LS_EXIT_INTERNAL;
}

static const char *clean(char *text)
{
    for (char *p = text; *p; p++)
        if (((unsigned char)*p < ' ' && *p != '\n') || *p == 0x7f)
            *p = '?';
    return text;
}

void ls_say(const char *fmt, ...)
{
    va_list args;
    char *text = NULL;
    va_start(args, fmt);
    int n = vasprintf(&text, fmt, args);
    va_end(args);
    fputs(n < 0 ? "out of memory\n" : clean(text), stdout);
    if (n >= 0)
        free(text);
}

int ls_command_failed(struct ls_command_context *context, enum ls_err err)
{
    uint32_t number = context->error.number;
    clean(context->diag.text);
    if (err == LS_ERR_REFUSED && number >= 100) {
        ls_command_wrong("%s (%u %s)", context->diag.text, number, lightstage_error_name(number));
        return exit_of_number(number);
    }
    ls_command_wrong("%s", context->diag.text[0] ? context->diag.text : ls_err_name(err));
    if (err == LS_ERR_NOMEM || err == LS_ERR_BUG)
        return LS_EXIT_INTERNAL;
    return err == LS_ERR_GONE || err == LS_ERR_NOT_FOUND || err == LS_ERR_REFUSED
               ? LS_EXIT_UNREACHABLE
               : LS_EXIT_USAGE;
}

int ls_command_open(struct ls_command_context *context)
{
    const struct lightstage_address address = {
        .size = sizeof address,
        .where = context->server ? context->server : context->socket_path,
        .certificate = context->certificate,
        .key = context->key,
        .authority = context->authority,
    };
    if (context->stage)
        return LS_EXIT_OK;
    if (context->server && strncmp(context->server, "tls://", 6) != 0) {
        ls_command_wrong("--server %s: expected tls://HOST:PORT", context->server);
        return LS_EXIT_UNREACHABLE;
    }
    if (!lightstage_connect(&address, &context->stage, &context->error))
        return LS_EXIT_OK;
    clean(context->error.text);
    ls_command_wrong("%s%s", context->error.text,
                     context->error.number == LIGHTSTAGE_UNREACHABLE && !context->server
                         ? " with --socket or LIGHTSTAGED_SOCKET"
                         : "");
    return LS_EXIT_UNREACHABLE;
}

enum ls_err ls_command_said(struct ls_command_context *context, uint32_t number)
{
    static const enum ls_err own[] = {
        [LIGHTSTAGE_UNREACHABLE] = LS_ERR_NOT_FOUND, [LIGHTSTAGE_LOST] = LS_ERR_GONE,
        [LIGHTSTAGE_NO_MEMORY] = LS_ERR_NOMEM,       [LIGHTSTAGE_UNTRUSTED] = LS_ERR_REFUSED,
        [LIGHTSTAGE_STRANGE] = LS_ERR_INVALID,
    };
    if (!number)
        return LS_OK;
    return ls_fail(&context->diag, number < sizeof own / sizeof *own ? own[number] : LS_ERR_REFUSED,
                   "%s", context->error.text);
}

int ls_command_answered(struct ls_command_context *context, uint32_t number)
{
    enum ls_err err = ls_command_said(context, number);
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

static bool interrupted(const struct ls_command_context *context)
{
    struct pollfd wait = {.fd = lightstage_descriptor(context->stage), .events = POLLIN};
    sigset_t mask;
    sigprocmask(SIG_SETMASK, NULL, &mask);
    sigdelset(&mask, SIGINT);
    return ppoll(&wait, 1, NULL, &mask) < 0 && errno == EINTR;
}

enum ls_err ls_command_wait(struct ls_command_context *context, uint32_t request)
{
    while (!lightstage_has_ended(context->stage, request)) {
        if (interrupted(context))
            return ls_fail(&context->diag, LS_ERR_ABORTED, "interrupted");
        (void)lightstage_dispatch(context->stage, NULL); /* a loss ends every request */
    }
    return ls_command_said(context, lightstage_wait(context->stage, request, &context->error));
}

void ls_command_print_json(json_t *object)
{
    json_dumpf(object, stdout, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    putchar('\n');
    json_decref(object);
}

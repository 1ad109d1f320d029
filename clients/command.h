/*
 * command: what every command of lightstagectl, and lightstage-render, shares: exit codes, options,
 * output. Layer: clients. Threads: the main thread. Ownership: the context is main's.
 */
#ifndef LS_CLIENTS_COMMAND_H
#define LS_CLIENTS_COMMAND_H

#include "clients/command_file.h"
#include "clients/lightstage.h"
#include "core/error.h"

#include <getopt.h>
#include <jansson.h>
#include <stdbool.h>

/** Exit codes, stable; lightstagectl(1) explains them. */
enum ls_exit {
    LS_EXIT_OK = 0,
    LS_EXIT_NO = 1,          /* done, and the answer is no: damage found, take not complete */
    LS_EXIT_USAGE = 2,       /* wrong command line, or an input or output file */
    LS_EXIT_UNREACHABLE = 3, /* no daemon, or the connection was lost */
    LS_EXIT_REQUEST = 4,     /* refused with 1xx */
    LS_EXIT_STATE = 5,       /* 2xx */
    LS_EXIT_RIG = 6,         /* 3xx */
    LS_EXIT_STORAGE = 7,     /* 4xx */
    LS_EXIT_INTERNAL = 8,    /* 5xx */
    LS_EXIT_INTERRUPTED = 130,
};

struct ls_command_context {
    const char *socket_path;
    const char *server; /* of another machine, with the three below: in place of the socket */
    const char *certificate, *key, *authority;
    bool json;
    bool quiet; /* takes are part of something longer: what they come to goes to standard error */
    struct lightstage *stage;      /* NULL until ls_command_open */
    struct lightstage_error error; /* what a call of the library said last */
    struct ls_diag diag;
};

struct ls_command {
    const char *name;    /* "status", "take list" */
    const char *summary; /* one line */
    const char *usage;   /* what follows the name, then the options */
    int (*run)(struct ls_command_context *context, int argc, char **argv); /* enum ls_exit */
};

extern const struct ls_command ls_command_status, ls_command_rig, ls_command_preflight,
    ls_command_take_start, ls_command_take_resume, ls_command_take_abort, ls_command_take_list,
    ls_command_take_show, ls_command_take_verify, ls_command_take_slate, ls_command_fetch,
    ls_command_relight, ls_command_blank, ls_command_calibrate, ls_command_metrics,
    ls_command_preview, ls_command_pki_init, ls_command_pki_add, ls_command_events,
    ls_command_export;

/** Options every command has; put them at the end of its table. */
enum {
    LS_OPTION_SOCKET = 1000,
    LS_OPTION_SERVER,
    LS_OPTION_CERTIFICATE,
    LS_OPTION_KEY,
    LS_OPTION_AUTHORITY,
    LS_OPTION_JSON,
    LS_OPTION_HELP,
};
#define LS_COMMON_OPTIONS                                                                         \
    {"socket", required_argument, NULL, LS_OPTION_SOCKET},                                        \
        {"server", required_argument, NULL, LS_OPTION_SERVER},                                    \
        {"certificate", required_argument, NULL, LS_OPTION_CERTIFICATE},                          \
        {"key", required_argument, NULL, LS_OPTION_KEY},                                          \
        {"authority", required_argument, NULL, LS_OPTION_AUTHORITY},                              \
        {"json", no_argument, NULL, LS_OPTION_JSON}, {"help", no_argument, NULL, LS_OPTION_HELP}, \
    {                                                                                             \
        0                                                                                         \
    }

/** What the environment says of where the daemon is. */
void ls_command_defaults(struct ls_command_context *context);

/** Take one of the common options that stand before the command too, but --help. False: it is
 * another. */
bool ls_command_take_option(struct ls_command_context *context, int option, const char *value);

/**
 * getopt_long for a command: handles the common options, returns the others, -1 at the end.
 * Prints and returns '?' on a wrong one: return LS_EXIT_USAGE then. --help prints and exits.
 */
int ls_command_option(struct ls_command_context *context, const struct ls_command *command,
                      int argc, char **argv, const struct option *options);

/** Positional arguments left: exactly @n? Else says what was expected. */
bool ls_command_arguments(const struct ls_command *command, int argc, int n);

/** Print "lightstagectl: sentence", the program's own name, and return LS_EXIT_USAGE. */
int ls_command_wrong(const char *fmt, ...) LS_PRINTF(1, 2);

/** Before the process ends with @code: a success that could not be said is none (LS_EXIT_USAGE). */
int ls_command_end(int code);

/** Print context->diag and return the exit code for a failed call. */
int ls_command_failed(struct ls_command_context *context, enum ls_err err);

/** Connect context->stage if that has not been done. LS_EXIT_OK, or the sentence printed and its
 * exit code. */
int ls_command_open(struct ls_command_context *context);

/** What the library said, with @number and context->error, as an error with its sentence in
 * context->diag. The daemon's numbers are LS_ERR_REFUSED. */
LS_MUST_CHECK enum ls_err ls_command_said(struct ls_command_context *context, uint32_t number);

/** The same for a command that has no more to do: LS_EXIT_OK, or printed and its exit code. */
int ls_command_answered(struct ls_command_context *context, uint32_t number);

/** Wait for the end of @request, and how it ended. LS_ERR_ABORTED: a SIGINT arrived, which comes in
 * here even where it is blocked, so that a program that blocks it everywhere else cannot miss one;
 * nothing is lost, call again. */
LS_MUST_CHECK enum ls_err ls_command_wait(struct ls_command_context *context, uint32_t request);

/** Print @object (transfer full) as indented JSON on stdout. */
void ls_command_print_json(json_t *object);

/** printf to stdout, for text from the daemon: control characters but line ends become '?'. */
void ls_say(const char *fmt, ...) LS_PRINTF(1, 2);

#endif

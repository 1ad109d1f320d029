#include "clients/command.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void print_usage(const struct ls_command *command, FILE *out)
{
    fprintf(out, "usage: lightstagectl %s %s\n%s.\n", command->name, command->usage,
            command->summary);
}

void ls_command_defaults(struct ls_command_context *context)
{
    const char *socket = getenv("LIGHTSTAGED_SOCKET"), *server = getenv("LIGHTSTAGED_SERVER");
    context->socket_path = socket && socket[0] ? socket : "/run/lightstaged/socket";
    context->remote = (struct ls_remote){.url = server && server[0] ? server : NULL,
                                         .certificate = getenv("LIGHTSTAGED_CERTIFICATE"),
                                         .key = getenv("LIGHTSTAGED_KEY"),
                                         .authority = getenv("LIGHTSTAGED_AUTHORITY")};
}

bool ls_command_take_option(struct ls_command_context *context, int option, const char *value)
{
    switch (option) {
    case LS_OPTION_SOCKET:
        context->socket_path = value;
        context->remote.url = NULL;
        return true;
    case LS_OPTION_SERVER:
        context->remote.url = value;
        return true;
    case LS_OPTION_CERTIFICATE:
        context->remote.certificate = value;
        return true;
    case LS_OPTION_KEY:
        context->remote.key = value;
        return true;
    case LS_OPTION_AUTHORITY:
        context->remote.authority = value;
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
    fprintf(stderr, "lightstagectl: %s: %d arguments, expected %d\n", command->name, argc - optind,
            n);
    print_usage(command, stderr);
    return false;
}

int ls_command_wrong(const char *fmt, ...)
{
    va_list args;
    fputs("lightstagectl: ", stderr);
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

const char *ls_clean(char *text)
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
    fputs(n < 0 ? "out of memory\n" : ls_clean(text), stdout);
    if (n >= 0)
        free(text);
}

int ls_command_failed(struct ls_command_context *context, enum ls_err err)
{
    uint32_t number = context->connection ? ls_connection_error(context->connection) : 0;
    number = number ? number : context->error.number;
    ls_clean(context->diag.text);
    if (err == LS_ERR_REFUSED && number >= 100) {
        fprintf(stderr, "lightstagectl: %s (%u %s)\n", context->diag.text, number,
                lightstage_error_name(number));
        return exit_of_number(number);
    }
    fprintf(stderr, "lightstagectl: %s\n",
            context->diag.text[0] ? context->diag.text : ls_err_name(err));
    if (err == LS_ERR_NOMEM || err == LS_ERR_BUG)
        return LS_EXIT_INTERNAL;
    return err == LS_ERR_GONE || err == LS_ERR_NOT_FOUND || err == LS_ERR_REFUSED
               ? LS_EXIT_UNREACHABLE
               : LS_EXIT_USAGE;
}

int ls_command_connect(struct ls_command_context *context)
{
    if (context->connection)
        return LS_EXIT_OK;
    enum ls_err err =
        context->remote.url
            ? ls_connection_open_remote(&context->remote, &context->connection, &context->diag)
            : ls_connection_open(context->socket_path, &context->connection, &context->diag);
    if (err) {
        ls_command_failed(context, err);
        return LS_EXIT_UNREACHABLE;
    }
    ls_connection_let_in(context->connection, SIGINT); /* blocked elsewhere: take_follow.c */
    return LS_EXIT_OK;
}

int ls_command_open(struct ls_command_context *context)
{
    const struct ls_remote *remote = &context->remote;
    const struct lightstage_address address = {
        .size = sizeof address,
        .where = remote->url ? remote->url : context->socket_path,
        .certificate = remote->certificate,
        .key = remote->key,
        .authority = remote->authority,
    };
    if (context->stage)
        return LS_EXIT_OK;
    if (remote->url && strncmp(remote->url, "tls://", 6) != 0) {
        ls_command_wrong("--server %s: expected tls://HOST:PORT", remote->url);
        return LS_EXIT_UNREACHABLE;
    }
    if (!lightstage_connect(&address, &context->stage, &context->error))
        return LS_EXIT_OK;
    ls_clean(context->error.text);
    ls_command_wrong("%s", context->error.text);
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

int ls_command_call(struct ls_command_context *context, uint16_t type, const ProtobufCMessage *body,
                    const void *payload, size_t payload_bytes, struct ls_reply *reply)
{
    int code = ls_command_connect(context);
    if (code)
        return code;
    enum ls_err err = ls_connection_call(context->connection, type, body, payload, payload_bytes,
                                         reply, &context->diag);
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

void ls_command_print_json(json_t *object)
{
    json_dumpf(object, stdout, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    putchar('\n');
    json_decref(object);
}

enum ls_err ls_command_read_file(const char *path, size_t limit, char **bytes, size_t *n,
                                 struct ls_diag *diag)
{
    struct stat info;
    FILE *file = fopen(path, "rbe");
    if (!file)
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    if (fstat(fileno(file), &info) || !S_ISREG(info.st_mode) || (uint64_t)info.st_size > limit) {
        fclose(file);
        return ls_fail(diag, LS_ERR_INVALID, "%s: expected a file of at most %zu bytes", path,
                       limit);
    }
    size_t size = (size_t)info.st_size;
    *bytes = malloc(size + 1);
    *n = *bytes ? fread(*bytes, 1, size, file) : 0;
    fclose(file);
    if (!*bytes)
        return ls_fail(diag, LS_ERR_NOMEM, "%s: out of memory", path);
    (*bytes)[*n] = '\0';
    return LS_OK;
}

enum ls_err ls_command_read_json(const char *path, size_t limit, json_t **root,
                                 struct ls_diag *diag)
{
    char *bytes = NULL;
    size_t n = 0;
    json_error_t error;
    enum ls_err err = ls_command_read_file(path, limit, &bytes, &n, diag);
    if (err)
        return err;
    *root = json_loadb(bytes, n, JSON_REJECT_DUPLICATES, &error);
    free(bytes);
    return *root ? LS_OK
                 : ls_fail(diag, LS_ERR_INVALID, "%.200s:%d: %.200s", path, error.line, error.text);
}

static bool write_all(int fd, const uint8_t *bytes, size_t n)
{
    for (size_t at = 0; at < n;) {
        ssize_t wrote = write(fd, bytes + at, n - at);
        if (wrote < 0 && errno == EINTR)
            continue;
        if (wrote <= 0)
            return false;
        at += (size_t)wrote;
    }
    return true;
}

/* Devices and pipes: there is nothing to replace. */
static enum ls_err write_through(const char *path, const void *bytes, size_t n,
                                 struct ls_diag *diag)
{
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    bool ok = fd >= 0 && write_all(fd, bytes, n);
    int reason = errno;
    if (fd >= 0 && close(fd) && ok) {
        ok = false;
        reason = errno;
    }
    return ok ? LS_OK : ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(reason));
}

/* What open(2) would have given a new file; a replaced one keeps its own. */
static mode_t new_file_mode(void)
{
    mode_t mask = umask(0);
    umask(mask);
    return 0666 & ~mask;
}

/* An interrupt waits until the file beside is whole or gone. */
static void hold_interrupts(bool hold, sigset_t *before)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigprocmask(hold ? SIG_BLOCK : SIG_SETMASK, hold ? &set : before, hold ? before : NULL);
}

static enum ls_err write_beside(const char *path, mode_t mode, const void *bytes, size_t n,
                                struct ls_diag *diag)
{
    char beside[PATH_MAX];
    if (snprintf(beside, sizeof beside, "%s.XXXXXX", path) >= (int)sizeof beside)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", path);
    int fd = mkostemp(beside, O_CLOEXEC);
    if (fd < 0)
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    bool ok = write_all(fd, bytes, n) && fchmod(fd, mode) == 0;
    int reason = errno;
    if (close(fd) && ok) {
        ok = false;
        reason = errno;
    }
    if (ok && rename(beside, path) == 0)
        return LS_OK;
    reason = ok ? errno : reason;
    unlink(beside);
    return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(reason));
}

static enum ls_err replace(const char *path, mode_t mode, const void *bytes, size_t n,
                           struct ls_diag *diag)
{
    sigset_t before;
    hold_interrupts(true, &before);
    enum ls_err err = write_beside(path, mode, bytes, n, diag);
    hold_interrupts(false, &before);
    return err;
}

enum ls_err ls_command_check_writable(const char *path, struct ls_diag *diag)
{
    struct stat info;
    char target[PATH_MAX], folder[PATH_MAX];
    path = realpath(path, target) ? target : path;
    const char *slash = strrchr(path, '/');
    int n = slash ? (int)(slash - path) + 1 : 0;
    if (snprintf(folder, sizeof folder, "%.*s.", n, path) >= (int)sizeof folder)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", path);
    bool there = stat(path, &info) == 0;
    if (there && S_ISDIR(info.st_mode))
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(EISDIR));
    if (there && !S_ISREG(info.st_mode))
        return LS_OK; /* a pipe or a device: its other end may come later */
    return access(folder, W_OK | X_OK)
               ? ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno))
               : LS_OK;
}

enum ls_err ls_command_write_file(const char *path, const void *bytes, size_t n,
                                  struct ls_diag *diag)
{
    struct stat info;
    char target[PATH_MAX];
    if (lstat(path, &info))
        return errno == ENOENT ? replace(path, new_file_mode(), bytes, n, diag)
                               : ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    if (S_ISLNK(info.st_mode)) {
        if (!realpath(path, target) || lstat(target, &info))
            return ls_fail(diag, LS_ERR_INVALID, "%s: a link to nothing that can be written: %s",
                           path, strerror(errno));
        path = target;
    }
    if (S_ISDIR(info.st_mode))
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", path, strerror(EISDIR));
    return S_ISREG(info.st_mode) ? replace(path, info.st_mode & 07777, bytes, n, diag)
                                 : write_through(path, bytes, n, diag);
}

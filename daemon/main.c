/*
 * lightstaged: the daemon's life. Load the configuration, listen, serve until told to stop, and
 * leave the stage dark.
 */
#include "daemon/arrivals.h"
#include "daemon/config.h"
#include "daemon/engine.h"
#include "daemon/listen.h"
#include "daemon/privileges.h"
#include "daemon/server.h"
#include "daemon/supervisor.h"

#include <errno.h>
#include <getopt.h>
#include <glib-unix.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { EXIT_USAGE = 2 };

static const char usage[] =
    "usage: lightstaged --config FILE [--ready-fd N]\n"
    "\n"
    "Run a light stage: sequence its lights, trigger its cameras, store and serve its takes.\n"
    "\n"
    "  -c, --config FILE   daemon configuration; lightstaged.conf(5) has its keys\n"
    "      --ready-fd N    write one line of JSON to descriptor N once clients may connect\n"
    "      --check         read configuration, rig and calibration, say whether they are good\n"
    "  -h, --help          print this and exit\n"
    "      --version       print the version and exit\n"
    "\n"
    "SIGTERM or SIGINT ends a running take (lights dark, what is stored stays) and the daemon.\n"
    "Exit status: 0 ended as asked, 1 could not start (a sentence says why), 2 wrong usage.\n";

struct options {
    const char *config;
    int ready_fd;
    bool check;
};

/* A success that could not be said is none. */
static int end(int status)
{
    if ((fflush(stdout) == 0 && !ferror(stdout)) || status != EXIT_SUCCESS)
        return status;
    fputs("lightstaged: standard output cannot be written\n", stderr);
    return EXIT_FAILURE;
}

static int descriptor(const char *text)
{
    char *end;
    long n = strtol(text, &end, 10);
    if (*text && !*end && n >= 0 && n <= INT_MAX)
        return (int)n;
    fprintf(stderr, "lightstaged: --ready-fd %s: expected the number of a descriptor\n", text);
    exit(EXIT_USAGE);
}

static struct options parse_options(int argc, char **argv)
{
    enum { READY_FD = 256, VERSION, CHECK };
    static const struct option longs[] = {
        {"config", required_argument, NULL, 'c'}, {"ready-fd", required_argument, NULL, READY_FD},
        {"check", no_argument, NULL, CHECK},      {"help", no_argument, NULL, 'h'},
        {"version", no_argument, NULL, VERSION},  {0},
    };
    struct options o = {.ready_fd = -1};
    for (int c; (c = getopt_long(argc, argv, "c:h", longs, NULL)) != -1;) {
        switch (c) {
        case 'c':
            o.config = optarg;
            break;
        case READY_FD:
            o.ready_fd = descriptor(optarg);
            break;
        case CHECK:
            o.check = true;
            break;
        case 'h':
            fputs(usage, stdout);
            exit(end(EXIT_SUCCESS));
        case VERSION:
            puts("lightstaged " LS_VERSION);
            exit(end(EXIT_SUCCESS));
        default:
            fputs(usage, stderr);
            exit(EXIT_USAGE);
        }
    }
    if (optind != argc || !o.config) {
        fputs(usage, stderr);
        exit(EXIT_USAGE);
    }
    return o;
}

/* What the loop's callbacks need. */
struct daemon {
    struct ls_config *config;
    struct ls_engine *engine;
    struct ls_server *server;
    GMainLoop *loop;
};

static void on_take(void *user, const struct ls_take_status *status)
{
    struct daemon *d = user;
    if (d->server)
        ls_server_take_event(d->server, status);
}

static gboolean on_signal(gpointer user)
{
    struct daemon *d = user;
    g_main_loop_quit(d->loop);
    return G_SOURCE_CONTINUE;
}

/* @make: where there is none. @write: takes are made. */
static enum ls_err prepare_storage(const char *path, bool make, bool write, struct ls_diag *diag)
{
    struct stat info;
    if (!make && write && access(path, F_OK) && errno == ENOENT)
        return LS_OK; /* made at the start */
    if ((make && mkdir(path, 0777) && errno != EEXIST) || stat(path, &info))
        return ls_fail(diag, LS_ERR_OS, "storage folder %s: %m", path);
    if (!S_ISDIR(info.st_mode))
        return ls_fail(diag, LS_ERR_INVALID, "storage folder %s: it is no folder", path);
    if (access(path, R_OK | X_OK | (write ? W_OK : 0)))
        return ls_fail(diag, LS_ERR_OS, "storage folder %s cannot be %s: %m", path,
                       write ? "written" : "read");
    return LS_OK;
}

static enum ls_err prepare(struct daemon *d, const struct options *o, struct ls_diag *diag)
{
    enum ls_err err = ls_config_load(o->config, &d->config, diag);
    if (!err)
        err = ls_listen_check(d->config->socket_path, diag);
    if (!err)
        err = ls_arrivals_check(&d->config->listen, diag);
    if (!err)
        err = prepare_storage(d->config->storage, !o->check && d->config->n_lights > 0,
                              d->config->n_lights > 0, diag);
    return err ? err : ls_engine_create(d->config, on_take, d, &d->engine, diag);
}

static enum ls_err listen_for_clients(struct daemon *d, struct ls_diag *diag)
{
    struct ls_server_config server = {.socket_path = d->config->socket_path,
                                      .storage = d->config->storage,
                                      .spare_bytes = d->config->reserve_bytes,
                                      .access = &d->config->access,
                                      .listen = &d->config->listen,
                                      .max_connections = d->config->max_connections,
                                      .max_connections_each = d->config->max_connections_each,
                                      .idle_s = d->config->idle_s};
    int passed;
    enum ls_err err = ls_supervisor_socket(d->config->socket_path, &passed, diag);
    server.listener = passed > 0 ? passed : 0;
    return err ? err : ls_server_create(&server, d->engine, &d->server, diag);
}

static void say_ready(const struct daemon *d, int fd)
{
    char missing[256];
    ls_privileges_missing(missing, sizeof missing);
    const char *remote = ls_server_remote_address(d->server);
    fprintf(stderr, "lightstaged %s: listening on %s%s%s\n", LS_VERSION, d->config->socket_path,
            remote ? " and at tls://" : "", remote ? remote : "");
    if (d->config->n_lights == 0)
        missing[0] = 0; /* serving needs none */
    if (missing[0])
        fprintf(stderr, "lightstaged: running without %s\n", missing);
    ls_supervisor_ready(missing[0] ? "running without some privileges, see the log" : "ready");
    if (fd >= 0 && dprintf(fd, "{\"ready\":true,\"pid\":%d,\"socket\":\"%s\"%s%s%s}\n",
                           (int)getpid(), d->config->socket_path, remote ? ",\"tls\":\"" : "",
                           remote ? remote : "", remote ? "\"" : "") < 0)
        fprintf(stderr, "lightstaged: --ready-fd %d: %s\n", fd, strerror(errno));
}

/* The signals stay caught to the end: another one must not cut the way to the dark short. */
static void run(struct daemon *d, int ready_fd)
{
    g_unix_signal_add(SIGTERM, on_signal, d);
    g_unix_signal_add(SIGINT, on_signal, d);
    guint watchdog = ls_supervisor_watchdog();
    say_ready(d, ready_fd);
    g_main_loop_run(d->loop);
    ls_supervisor_stopping();
    if (watchdog)
        g_source_remove(watchdog);
}

int main(int argc, char **argv)
{
    const struct options o = parse_options(argc, argv);
    struct daemon d = {.loop = g_main_loop_new(NULL, FALSE)};
    struct ls_diag diag = {0};
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* a write beyond a file size limit is an error of the store */
    enum ls_err err = prepare(&d, &o, &diag);
    if (!err && !o.check)
        err = listen_for_clients(&d, &diag);
    if (err)
        fprintf(stderr, "lightstaged: %s\n", diag.text);
    else if (o.check && d.config->n_lights == 0)
        printf("%s: good: serves the takes of %s, without a rig\n", o.config, d.config->storage);
    else if (o.check)
        printf("%s: good: %u lights, %u channels, %u cameras\n", o.config, d.config->n_lights,
               d.config->n_channels, d.config->n_cameras);
    else
        run(&d, o.ready_fd);
    ls_engine_destroy(d.engine); /* first: a running take ends dark and tells its clients */
    ls_server_destroy(d.server);
    ls_config_destroy(d.config);
    g_main_loop_unref(d.loop);
    return end(err ? EXIT_FAILURE : EXIT_SUCCESS);
}

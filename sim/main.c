/* lightstage-sim: the simulated rig as a process. */
#include "sim/config.h"
#include "sim/rig.h"
#include "sim/truth.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

enum { EXIT_USAGE = 2 };

static const char usage_text[] =
    "usage: lightstage-sim run [--config FILE] [--ready-fd N] [--die-with-parent]\n"
    "       lightstage-sim describe|field|relit|environment|samples|masks [--config FILE] ...\n"
    "\n"
    "run serves a simulated dome (Modbus TCP) and its cameras (GigE Vision) until SIGTERM.\n"
    "The others ask for the truth of its scene; each prints its own usage.\n"
    "See sim/README.md.\n";

struct options {
    const char *config;
    int ready_fd;
    bool die_with_parent;
};

static int usage(void)
{
    fputs(usage_text, stderr);
    return EXIT_USAGE;
}

/* A success that could not be said is none. */
static int end(int status)
{
    if ((fflush(stdout) == 0 && !ferror(stdout)) || status != EXIT_SUCCESS)
        return status;
    fputs("lightstage-sim: standard output cannot be written\n", stderr);
    return EXIT_FAILURE;
}

static bool asks_for_help(int argc, char **argv)
{
    for (int i = 1; i < argc; i++)
        if (!strcmp(argv[i], "--help") || !strcmp(argv[i], "-h"))
            return true;
    return false;
}

static int fail(const struct ls_diag *diag)
{
    fprintf(stderr, "lightstage-sim: %s\n", diag->text);
    return EXIT_FAILURE;
}

static bool parse_fd(const char *text, int *fd)
{
    char *end;
    long value = strtol(text, &end, 10);
    *fd = (int)value;
    return *text && !*end && value >= 0 && value < 1 << 20;
}

static bool parse_run(int argc, char **argv, struct options *options)
{
    *options = (struct options){.ready_fd = -1};
    for (int i = 1; i < argc; i++) {
        bool more = i + 1 < argc;
        if (!strcmp(argv[i], "--config") && more)
            options->config = argv[++i];
        else if (!strcmp(argv[i], "--ready-fd") && more &&
                 parse_fd(argv[i + 1], &options->ready_fd))
            i++;
        else if (!strcmp(argv[i], "--die-with-parent"))
            options->die_with_parent = true;
        else
            return false;
    }
    return true;
}

static enum ls_err load(const char *path, struct sim_config *config, struct ls_diag *diag)
{
    if (path)
        return sim_config_load(path, config, diag);
    sim_config_defaults(config);
    return LS_OK;
}

static void block_signals(sigset_t *stop)
{
    sigemptyset(stop);
    sigaddset(stop, SIGTERM);
    sigaddset(stop, SIGINT);
    sigprocmask(SIG_BLOCK, stop, NULL);
    signal(SIGPIPE, SIG_IGN);
}

static enum ls_err announce(const struct sim_rig *rig, int fd, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *line = sim_rig_ready_line(rig);
    if (!line)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (dprintf(fd < 0 ? STDOUT_FILENO : fd, "%s\n", line) < 0)
        return ls_fail(diag, LS_ERR_OS, "cannot write the ready line to descriptor %d", fd);
    if (fd > STDERR_FILENO)
        close(fd);
    return LS_OK;
}

static int run(int argc, char **argv)
{
    struct options options;
    struct sim_config config;
    struct sim_rig *rig = NULL;
    struct ls_diag diag = {0};
    sigset_t stop;
    int signal_number;
    if (!parse_run(argc, argv, &options))
        return usage();
    block_signals(&stop);
    if (options.die_with_parent)
        prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (load(options.config, &config, &diag) || sim_rig_create(&config, &rig, &diag))
        return fail(&diag);
    enum ls_err err = announce(rig, options.ready_fd, &diag);
    if (!err)
        sigwait(&stop, &signal_number);
    enum ls_err end = sim_rig_destroy(rig, err ? NULL : &diag);
    return err || end ? fail(&diag) : EXIT_SUCCESS;
}

static int ask(int argc, char **argv)
{
    struct sim_config config;
    struct ls_diag diag = {0};
    const char *path = NULL;
    for (int i = 1; i + 1 < argc; i++)
        if (!strcmp(argv[i], "--config"))
            path = argv[i + 1];
    if (load(path, &config, &diag))
        return fail(&diag);
    return sim_truth_main(&config.scene, argc, argv);
}

static int help(const char *subcommand)
{
    fputs(subcommand && sim_truth_has(subcommand) ? sim_truth_usage() : usage_text, stdout);
    return EXIT_SUCCESS;
}

static int command_line(int argc, char **argv)
{
    if (argc < 2)
        return usage();
    bool is_run = !strcmp(argv[1], "run"), option = argv[1][0] == '-';
    if (!option && !is_run && !sim_truth_has(argv[1])) {
        fprintf(stderr, "lightstage-sim: %s: no such subcommand\n", argv[1]);
        return usage();
    }
    if (asks_for_help(argc, argv))
        return help(option ? NULL : argv[1]);
    if (option)
        return usage();
    return is_run ? run(argc - 1, argv + 1) : ask(argc - 1, argv + 1);
}

int main(int argc, char **argv)
{
    return end(command_line(argc, argv));
}

#include "clients/render_serve.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define A_TAKES_NAME "20260102T030405Z-vase-a1b2c3"

/* Does it begin with a date, as A_TAKES_NAME? */
static bool is_dated(const char *name)
{
    return strspn(name, "0123456789") == 8 && name[8] == 'T';
}

enum ls_err ls_render_is_folder(const char *take, bool *out, struct ls_diag *diag)
{
    char path[PATH_MAX];
    struct stat info;
    int n = snprintf(path, sizeof path, "%s/take.json", take);
    *out = n < (int)sizeof path && stat(path, &info) == 0;
    if (*out || (!strchr(take, '/') && is_dated(take)))
        return LS_OK;
    if (stat(take, &info) == 0)
        return ls_fail(diag, LS_ERR_INVALID,
                       "%s: no take.json in it: expected the folder of a take", take);
    return ls_fail(diag, LS_ERR_INVALID, "%s: no such folder%s", take,
                   strchr(take, '/') ? ""
                                     : ", nor the name of a take, as " A_TAKES_NAME
                                       "; lightstagectl take list tells those of the daemon");
}

/* The daemon's configuration, in memory: nothing to clean up. */
static enum ls_err write_configuration(const char *storage, const char *socket, int *out,
                                       struct ls_diag *diag)
{
    if (strpbrk(storage, "\"\\\n"))
        return ls_fail(diag, LS_ERR_INVALID, "%s: a path with quotes or backslashes", storage);
    *out = memfd_create("lightstaged.conf", 0);
    if (*out < 0 || dprintf(*out, "storage = \"%s\";\nsocket = \"%s\";\n", storage, socket) < 0)
        return ls_fail(diag, LS_ERR_OS, "no memory for a configuration: %s", strerror(errno));
    return LS_OK;
}

/* Beside this program, else in PATH. */
static void run_daemon(int configuration, int ready, int log)
{
    char self[PATH_MAX], beside[PATH_MAX + 16], path[32], number[16];
    ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
    snprintf(path, sizeof path, "/dev/fd/%d", configuration);
    snprintf(number, sizeof number, "%d", ready);
    char name[] = "lightstaged", config[] = "--config", ready_fd[] = "--ready-fd";
    char *argv[] = {name, config, path, ready_fd, number, NULL};
    dup2(log, STDERR_FILENO);
    if (n > 0) {
        self[n] = '\0';
        *strrchr(self, '/') = '\0';
        snprintf(beside, sizeof beside, "%s/lightstaged", self);
        execv(beside, argv);
    }
    execvp(argv[0], argv);
    _exit(127);
}

/* It may fail to start: then its line never comes, and the log says why. */
static enum ls_err wait_until_ready(struct ls_render_serve *serve, int ready, int log,
                                    struct ls_diag *diag)
{
    char byte, said[256] = "";
    ssize_t n;
    int status = 0;
    do
        n = read(ready, &byte, 1);
    while (n < 0 && errno == EINTR);
    if (n == 1)
        return LS_OK;
    waitpid(serve->child, &status, 0);
    serve->child = 0;
    if (pread(log, said, sizeof said - 1, 0) < 0)
        said[0] = '\0';
    said[strcspn(said, "\n")] = '\0';
    return WIFEXITED(status) && WEXITSTATUS(status) == 127
               ? ls_fail(diag, LS_ERR_NOT_FOUND,
                         "lightstaged, which reads takes, is neither beside this program nor in "
                         "PATH")
               : ls_fail(diag, LS_ERR_OS, "lightstaged did not start: %s", said);
}

static enum ls_err start(struct ls_render_serve *serve, int configuration, struct ls_diag *diag)
{
    int ready[2], log = memfd_create("lightstaged.log", MFD_CLOEXEC);
    if (log < 0 || pipe2(ready, O_CLOEXEC)) {
        if (log >= 0)
            close(log);
        return ls_fail(diag, LS_ERR_OS, "no pipe: %s", strerror(errno));
    }
    pid_t parent = getpid();
    serve->child = fork();
    if (serve->child == 0) {
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        if (getppid() != parent)
            _exit(1);
        fcntl(ready[1], F_SETFD, 0);
        setpgid(0, 0); /* Ctrl-C is this program's, which ends it when it is done with it */
        run_daemon(configuration, ready[1], log);
    }
    close(ready[1]);
    enum ls_err err = LS_OK;
    if (serve->child < 0) {
        serve->child = 0;
        err = ls_fail(diag, LS_ERR_OS, "no process: %s", strerror(errno));
    } else {
        err = wait_until_ready(serve, ready[0], log, diag);
    }
    close(ready[0]);
    close(log);
    return err;
}

enum ls_err ls_render_serve_start(const char *take, struct ls_render_serve *out,
                                  struct ls_diag *diag)
{
    char folder[PATH_MAX];
    int configuration = -1;
    if (!realpath(take, folder))
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", take, strerror(errno));
    char *slash = strrchr(folder, '/');
    if (!is_dated(slash + 1) ||
        snprintf(out->take, sizeof out->take, "%s", slash + 1) >= (int)sizeof out->take)
        return ls_fail(diag, LS_ERR_INVALID,
                       "%s: the folder of a take has the take's name, as " A_TAKES_NAME
                       ": rename it back",
                       take);
    slash[slash == folder] = '\0';
    snprintf(out->folder, sizeof out->folder, "/tmp/lightstage-render-XXXXXX");
    if (!mkdtemp(out->folder)) {
        out->folder[0] = '\0';
        return ls_fail(diag, LS_ERR_OS, "/tmp: %s", strerror(errno));
    }
    snprintf(out->socket, sizeof out->socket, "%s/socket", out->folder);
    enum ls_err err = write_configuration(folder, out->socket, &configuration, diag);
    if (!err)
        err = start(out, configuration, diag);
    if (configuration >= 0)
        close(configuration);
    return err;
}

void ls_render_serve_hide(struct ls_render_serve *serve)
{
    if (!serve->folder[0])
        return;
    unlink(serve->socket);
    rmdir(serve->folder);
    serve->folder[0] = '\0';
}

void ls_render_serve_stop(struct ls_render_serve *serve)
{
    if (serve->child > 0) {
        kill(serve->child, SIGTERM);
        while (waitpid(serve->child, NULL, 0) < 0 && errno == EINTR)
            ;
    }
    serve->child = 0;
    ls_render_serve_hide(serve);
}

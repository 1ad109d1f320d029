#include "clients/certificates.h"
#include "clients/command.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

enum { YEAR_DAYS = 365, MAX_HOSTS = 16, NAME_CHARACTERS = 64 };

static enum ls_err make(const char *folder, const char *stem, enum ls_certificate_use use,
                        const char *const *hosts, size_t n_hosts, struct ls_diag *diag)
{
    bool authority = use == LS_CERTIFICATE_AUTHORITY;
    struct ls_certificate_wish wish = {.use = use,
                                       .name = authority ? "lightstage authority" : stem,
                                       .hosts = hosts,
                                       .n_hosts = n_hosts,
                                       .days = authority ? 10 * YEAR_DAYS : YEAR_DAYS};
    return ls_certificate_make(folder, stem, authority ? NULL : "authority", &wish, diag);
}

static int done(struct ls_command_context *context, const char *folder, enum ls_err err)
{
    if (err)
        return ls_command_wrong("%s", context->diag.text);
    printf("%s: done; a daemon's listen group and --certificate, --key, --authority take these "
           "files\n",
           folder);
    return LS_EXIT_OK;
}

static int init(struct ls_command_context *context, const char *folder, const char *const *hosts,
                size_t n_hosts)
{
    struct ls_diag *diag = &context->diag;
    if (mkdir(folder, 0700) && errno != EEXIST)
        return ls_command_wrong("%s: %s", folder, strerror(errno));
    enum ls_err err = make(folder, "authority", LS_CERTIFICATE_AUTHORITY, NULL, 0, diag);
    if (!err)
        err = make(folder, "server", LS_CERTIFICATE_SERVER, hosts, n_hosts, diag);
    if (!err)
        err = make(folder, "operator", LS_CERTIFICATE_CLIENT, NULL, 0, diag);
    if (!err)
        err = make(folder, "reader", LS_CERTIFICATE_CLIENT, NULL, 0, diag);
    return done(context, folder, err);
}

static int run_init(struct ls_command_context *context, int argc, char **argv)
{
    enum { HOST = 1 };
    static const struct option options[] = {{"host", required_argument, NULL, HOST},
                                            LS_COMMON_OPTIONS};
    const char *hosts[MAX_HOSTS] = {"localhost", "127.0.0.1", "::1"};
    size_t n = 3;
    for (int option;
         (option = ls_command_option(context, &ls_command_pki_init, argc, argv, options)) != -1;) {
        if (option != HOST)
            return LS_EXIT_USAGE;
        if (n == MAX_HOSTS)
            return ls_command_wrong("--host: at most %zu of them", (size_t)MAX_HOSTS - 3);
        hosts[n++] = optarg;
    }
    if (!ls_command_arguments(&ls_command_pki_init, argc, 1))
        return LS_EXIT_USAGE;
    return init(context, argv[optind], hosts, n);
}

static int run_add(struct ls_command_context *context, int argc, char **argv)
{
    static const char letters[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.";
    static const struct option options[] = {LS_COMMON_OPTIONS};
    if (ls_command_option(context, &ls_command_pki_add, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_pki_add, argc, 2))
        return LS_EXIT_USAGE;
    const char *folder = argv[optind], *name = argv[optind + 1];
    size_t n = strlen(name);
    if (n == 0 || n > NAME_CHARACTERS || name[0] == '.' || strspn(name, letters) != n)
        return ls_command_wrong("\"%s\": expected 1 to %d letters, digits, -, _ or .", name,
                                NAME_CHARACTERS);
    return done(context, folder,
                make(folder, name, LS_CERTIFICATE_CLIENT, NULL, 0, &context->diag));
}

const struct ls_command ls_command_pki_init = {
    "pki init", "An authority, and certificates of a daemon, an operator and a reader",
    "FOLDER [--host NAME]...", run_init};

const struct ls_command ls_command_pki_add = {
    "pki add", "A certificate for one more client, from the authority in a folder", "FOLDER NAME",
    run_add};

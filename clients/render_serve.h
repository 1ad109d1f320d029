/*
 * render_serve: a take's folder, served: lightstaged as a child, without a rig, on a socket of its
 * own.
 * Layer: clients. Threads: the main thread, before it starts others. Ownership: see functions.
 *
 * The child ends when this program does, however that happens.
 */
#ifndef LS_CLIENTS_RENDER_SERVE_H
#define LS_CLIENTS_RENDER_SERVE_H

#include "core/error.h"

#include <stdbool.h>
#include <sys/types.h>

struct ls_render_serve {
    char take[128];  /* its name */
    char socket[64]; /* where its daemon listens */
    char folder[48]; /* of the socket */
    pid_t child;     /* 0: none */
};

/** Is @take a take's folder (*out), rather than a take's name? Errors: LS_ERR_INVALID: it is
 * neither, and the sentence says what is wrong with it. */
LS_MUST_CHECK enum ls_err ls_render_is_folder(const char *take, bool *out, struct ls_diag *diag);

/** Serve the take in folder @take. Errors: LS_ERR_INVALID, LS_ERR_NOT_FOUND (no lightstaged beside
 * this program or in PATH), LS_ERR_OS (with what the daemon said). Stop it in any case. */
LS_MUST_CHECK enum ls_err ls_render_serve_start(const char *take, struct ls_render_serve *out,
                                                struct ls_diag *diag);

/** All are connected: the socket's folder goes, and nothing of this is left on disk. */
void ls_render_serve_hide(struct ls_render_serve *serve);

/** Zeroed is allowed. */
void ls_render_serve_stop(struct ls_render_serve *serve);

#endif

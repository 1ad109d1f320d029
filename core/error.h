/*
 * error: the one error type of the project, and the sentence that goes with it.
 * Layer: core (no dependencies). Threads: any. Ownership: the caller owns every ls_diag.
 *
 * Errors come in two kinds. *Fatal* ones (LS_ERR_NOMEM, LS_ERR_OS, LS_ERR_BUG) are nobody's
 * documented condition: a caller forwards them untouched, and whoever owns the task gives it up.
 * *Domain* ones are conditions a function documents in its header; its caller handles them.
 * Cold paths also fill a caller-owned diagnostic: what, where, expected, found, what to do.
 * Outside input never asserts; assertions are for our own bugs.
 */
#ifndef LS_CORE_ERROR_H
#define LS_CORE_ERROR_H

#define LS_MUST_CHECK __attribute__((warn_unused_result))
#define LS_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))

enum ls_err {
    LS_OK = 0,
    /* fatal: forward */
    LS_ERR_NOMEM, /* out of memory */
    LS_ERR_OS,    /* the operating system refused something that should work */
    LS_ERR_BUG,   /* our own invariant is broken */
    /* domain: handle */
    LS_ERR_INVALID,     /* input is malformed or out of its documented range */
    LS_ERR_UNSUPPORTED, /* input is well formed and asks for what we do not do */
    LS_ERR_NOT_FOUND,   /* the named thing does not exist */
    LS_ERR_EXISTS,      /* the named thing exists already */
    LS_ERR_STATE,       /* not now: the object is in the wrong state for this call */
    LS_ERR_BUSY,        /* somebody else holds it */
    LS_ERR_LIMIT,       /* a documented limit would be exceeded */
    LS_ERR_FULL,        /* no room left (disk, memory of the controller) */
    LS_ERR_TIMEOUT,     /* no answer within the documented time */
    LS_ERR_GONE,        /* the device or peer has disappeared */
    LS_ERR_REFUSED,     /* the device or peer said no (interlock, fault, permission) */
    LS_ERR_MISMATCH,    /* a check failed: CRC, read-back, identity */
    LS_ERR_ABORTED,     /* the caller, an operator or a shutdown asked to stop */
};

/** The sentence for a person. Zero-initialise; empty when nothing went wrong. */
struct ls_diag {
    char text[512];
};

/**
 * Fill @diag (NULL is allowed) and return @err, so that a cold path is one line:
 *     return ls_fail(diag, LS_ERR_INVALID, "%s:%u: exposure %g us: expected 1..1e6", ...);
 * Truncates to the diagnostic's size. Not RT-safe.
 */
enum ls_err ls_fail(struct ls_diag *diag, enum ls_err err, const char *fmt, ...) LS_PRINTF(3, 4);

/** Short lower-case name, e.g. "timed out". Never NULL. RT-safe. */
const char *ls_err_name(enum ls_err err);

/** Cleanup attribute for `free`: `LS_CLEANUP_FREE char *p = NULL;`. */
#define LS_CLEANUP_FREE __attribute__((cleanup(ls_cleanup_free)))
void ls_cleanup_free(void *pointer_to_pointer);

#endif

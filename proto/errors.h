/*
 * errors: the numbers a client sees, and nothing else of what went wrong inside.
 * Layer: proto. Threads: any. Ownership: none.
 *
 * The number is stable for ever, its hundred is its class; the sentence that travels with it
 * (Error.text) is for a person and may change. Never an errno.
 */
#ifndef LS_PROTO_ERRORS_H
#define LS_PROTO_ERRORS_H

#include "core/error.h"

#include <stdint.h>

enum ls_proto_error {
    /* 1xx: the request itself is wrong; sending it again will not help */
    LS_PROTO_BAD_FRAME = 100,       /* not this protocol, or a damaged stream; closes */
    LS_PROTO_BAD_VERSION = 101,     /* no common version; closes */
    LS_PROTO_UNKNOWN_TYPE = 102,    /* closes */
    LS_PROTO_MESSAGE_TOO_BIG = 103, /* message or payload over the limit; closes */
    LS_PROTO_BAD_MESSAGE = 104,     /* does not decode; closes */
    LS_PROTO_NO_HELLO = 105,        /* first message was not Hello; closes */
    LS_PROTO_TOO_MANY = 106,        /* requests in flight, or connections (closes) */
    LS_PROTO_BAD_ARGUMENT = 107,    /* a value is malformed or out of range */
    LS_PROTO_UNSUPPORTED = 108,     /* well formed, and asks for what this daemon does not do */
    LS_PROTO_OVER_LIMIT = 109,      /* a documented limit of a request */
    LS_PROTO_NOT_ALLOWED = 110,     /* not with this client's role; with none (closes) */
    /* 2xx: right request, wrong moment or wrong name */
    LS_PROTO_WRONG_STATE = 200, /* also: the take still runs, and lacks what was asked for */
    LS_PROTO_BUSY = 201, /* another take runs */
    LS_PROTO_NOT_FOUND = 202,
    LS_PROTO_EXISTS = 203,
    LS_PROTO_CANCELLED = 204, /* by Cancel */
    LS_PROTO_ABORTED = 205,
    LS_PROTO_RIG_CHANGED = 206,
    LS_PROTO_CLOSING = 207, /* the daemon ends, or the client asks for nothing; closes */
    /* 3xx: the rig */
    LS_PROTO_RIG_GONE = 300,
    LS_PROTO_RIG_TIMEOUT = 301,
    LS_PROTO_RIG_REFUSED = 302, /* interlock, fault, flashing rule */
    LS_PROTO_RIG_LIMIT = 303,   /* duty, current, period, memory of the controller */
    LS_PROTO_RIG_MISMATCH = 304,
    /* 4xx: storage */
    LS_PROTO_STORAGE = 400, /* could not be read or written */
    LS_PROTO_STORAGE_FULL = 401,
    LS_PROTO_DAMAGED = 402,    /* what is stored fails its check */
    LS_PROTO_INCOMPLETE = 403, /* the take lacks what was asked for */
    /* 5xx: the daemon's own fault */
    LS_PROTO_INTERNAL = 500,
    LS_PROTO_NO_MEMORY = 501,
    LS_PROTO_SYSTEM = 502,
};

/** What a failed call was dealing with: decides the class of its number. */
enum ls_proto_context {
    LS_PROTO_ABOUT_REQUEST,
    LS_PROTO_ABOUT_RIG,
    LS_PROTO_ABOUT_STORAGE,
};

/** The number for @err met while dealing with @about. Fatal errors are always 5xx. */
enum ls_proto_error ls_proto_error_of(enum ls_err err, enum ls_proto_context about);

/** Short lower-case name of a number ("busy"); "error" for one this version does not know. */
const char *ls_proto_error_name(uint32_t number);

#endif

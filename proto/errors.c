#include "proto/errors.h"

static enum ls_proto_error common(enum ls_err err)
{
    switch (err) {
    case LS_ERR_NOMEM:
        return LS_PROTO_NO_MEMORY;
    case LS_ERR_OS:
        return LS_PROTO_SYSTEM;
    case LS_ERR_INVALID:
        return LS_PROTO_BAD_ARGUMENT;
    case LS_ERR_UNSUPPORTED:
        return LS_PROTO_UNSUPPORTED;
    case LS_ERR_NOT_FOUND:
        return LS_PROTO_NOT_FOUND;
    case LS_ERR_EXISTS:
        return LS_PROTO_EXISTS;
    case LS_ERR_STATE:
        return LS_PROTO_WRONG_STATE;
    case LS_ERR_BUSY:
        return LS_PROTO_BUSY;
    case LS_ERR_LIMIT:
        return LS_PROTO_OVER_LIMIT;
    case LS_ERR_FULL:
        return LS_PROTO_STORAGE_FULL;
    case LS_ERR_TIMEOUT:
        return LS_PROTO_RIG_TIMEOUT;
    case LS_ERR_GONE:
        return LS_PROTO_RIG_GONE;
    case LS_ERR_REFUSED:
        return LS_PROTO_RIG_REFUSED;
    case LS_ERR_MISMATCH:
        return LS_PROTO_DAMAGED;
    case LS_ERR_ABORTED:
        return LS_PROTO_ABORTED;
    case LS_OK:
    case LS_ERR_BUG:
        break;
    }
    return LS_PROTO_INTERNAL;
}

enum ls_proto_error ls_proto_error_of(enum ls_err err, enum ls_proto_context about)
{
    if (about == LS_PROTO_ABOUT_RIG && err == LS_ERR_LIMIT)
        return LS_PROTO_RIG_LIMIT;
    if (about == LS_PROTO_ABOUT_RIG && err == LS_ERR_MISMATCH)
        return LS_PROTO_RIG_MISMATCH;
    if (about == LS_PROTO_ABOUT_STORAGE && err == LS_ERR_OS)
        return LS_PROTO_STORAGE;
    if (about == LS_PROTO_ABOUT_STORAGE && err == LS_ERR_INVALID)
        return LS_PROTO_DAMAGED;
    if (about == LS_PROTO_ABOUT_STORAGE && err == LS_ERR_STATE)
        return LS_PROTO_INCOMPLETE;
    return common(err);
}

const char *ls_proto_error_name(uint32_t number)
{
    switch ((enum ls_proto_error)number) {
    case LS_PROTO_BAD_FRAME:
        return "bad frame";
    case LS_PROTO_BAD_VERSION:
        return "no common version";
    case LS_PROTO_UNKNOWN_TYPE:
        return "unknown type";
    case LS_PROTO_MESSAGE_TOO_BIG:
        return "too big";
    case LS_PROTO_BAD_MESSAGE:
        return "bad message";
    case LS_PROTO_NO_HELLO:
        return "hello expected";
    case LS_PROTO_TOO_MANY:
        return "too many";
    case LS_PROTO_BAD_ARGUMENT:
        return "bad argument";
    case LS_PROTO_UNSUPPORTED:
        return "unsupported";
    case LS_PROTO_OVER_LIMIT:
        return "over a limit";
    case LS_PROTO_NOT_ALLOWED:
        return "not allowed";
    case LS_PROTO_WRONG_STATE:
        return "not possible now";
    case LS_PROTO_BUSY:
        return "busy";
    case LS_PROTO_NOT_FOUND:
        return "not found";
    case LS_PROTO_EXISTS:
        return "exists already";
    case LS_PROTO_CANCELLED:
        return "cancelled";
    case LS_PROTO_ABORTED:
        return "aborted";
    case LS_PROTO_RIG_CHANGED:
        return "rig changed";
    case LS_PROTO_CLOSING:
        return "closing";
    case LS_PROTO_RIG_GONE:
        return "device gone";
    case LS_PROTO_RIG_TIMEOUT:
        return "device timed out";
    case LS_PROTO_RIG_REFUSED:
        return "refused";
    case LS_PROTO_RIG_LIMIT:
        return "over a limit of the rig";
    case LS_PROTO_RIG_MISMATCH:
        return "device disagrees";
    case LS_PROTO_STORAGE:
        return "storage failed";
    case LS_PROTO_STORAGE_FULL:
        return "storage full";
    case LS_PROTO_DAMAGED:
        return "damaged";
    case LS_PROTO_INCOMPLETE:
        return "take incomplete";
    case LS_PROTO_INTERNAL:
        return "internal error";
    case LS_PROTO_NO_MEMORY:
        return "out of memory";
    case LS_PROTO_SYSTEM:
        return "system error";
    }
    return "error";
}

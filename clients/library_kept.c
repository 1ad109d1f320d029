/* Replies that a caller keeps: one block of memory each, with the message behind it. */
#include "clients/library.h"

#include <stdalign.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

struct kept {
    ProtobufCMessage *message;
    alignas(max_align_t) char bytes[];
};

void *ls_library_keep(const struct ls_reply *reply, size_t bytes, struct lightstage_error *error)
{
    struct kept *kept = calloc(1, sizeof *kept + bytes);
    if (!kept) {
        ls_library_fail(error, LIGHTSTAGE_NO_MEMORY, "out of memory");
        return NULL;
    }
    kept->message = reply->message;
    ((struct ls_reply *)reply)->message = NULL;
    return kept->bytes;
}

void ls_library_release(void *kept)
{
    if (!kept)
        return;
    struct kept *own = (struct kept *)((char *)kept - offsetof(struct kept, bytes));
    ls_message_free(own->message);
    free(own);
}

struct ask {
    ls_make_kept *make;
    void *out; /* of a pointer */
};

static uint32_t take_made(const struct ls_reply *reply, void *user, struct lightstage_error *error)
{
    const struct ask *ask = user;
    if (!reply->last)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE, "the daemon answers more than once");
    void *made = ask->make(reply, error);
    if (!made)
        return error->number;
    memcpy(ask->out, &made, sizeof made);
    return 0;
}

uint32_t ls_library_ask(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                        const void *payload, size_t payload_bytes, ls_make_kept *make, void *out,
                        struct lightstage_error *error)
{
    const struct ask ask = {make, out};
    return ls_library_call(stage, type, body, payload, payload_bytes, take_made, &ask, sizeof ask,
                           error);
}

/* To a daemon, and what it says of itself. */
#include "clients/library.h"

#include <stdlib.h>
#include <string.h>

const char *lightstage_version(void)
{
    return LS_VERSION;
}

static enum ls_err greet(struct lightstage *stage, struct ls_diag *diag)
{
    struct ls_reply reply;
    enum ls_err err = ls_connection_greet(stage->connection, &reply, diag);
    if (err)
        return err;
    stage->hello = reply.message; /* stolen */
    reply.message = NULL;
    ls_reply_finish(&reply);
    return LS_OK;
}

uint32_t lightstage_connect(const struct lightstage_address *address, struct lightstage **out,
                            struct lightstage_error *error)
{
    struct lightstage_address a;
    struct ls_diag diag = {0};
    uint32_t number = ls_library_take_in(&a, sizeof a, address, error);
    if (number)
        return number;
    if (!a.where)
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT, "no address: set where");
    struct lightstage *stage = calloc(1, sizeof *stage);
    if (!stage)
        return ls_library_fail(error, LIGHTSTAGE_NO_MEMORY, "out of memory");
    const struct ls_remote remote = {a.where, a.certificate, a.key, a.authority};
    enum ls_err err = ls_connection_reach(&remote, &stage->connection, &diag);
    if (err) {
        free(stage);
        number = err == LS_ERR_INVALID ? LIGHTSTAGE_BAD_ARGUMENT : ls_library_number(err);
        return ls_library_fail(error, number, "%s", diag.text);
    }
    err = greet(stage, &diag);
    if (!err) {
        *out = stage;
        return 0;
    }
    number = err == LS_ERR_REFUSED ? ls_connection_error(stage->connection) : 0;
    lightstage_close(stage);
    return ls_library_fail(error, number ? number : ls_library_number(err), "%s", diag.text);
}

enum lightstage_role lightstage_role(const struct lightstage *stage)
{
    return (enum lightstage_role)((const Lightstage__HelloReply *)stage->hello)->role;
}

int lightstage_can(const struct lightstage *stage, const char *capability)
{
    const Lightstage__HelloReply *hello = (const Lightstage__HelloReply *)stage->hello;
    size_t i = 0;
    while (i < hello->n_capabilities && strcmp(hello->capabilities[i], capability))
        i++;
    return i < hello->n_capabilities;
}

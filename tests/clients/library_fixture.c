#include "tests/clients/library_fixture.h"

struct lightstage *connected(const struct stage *stage)
{
    struct lightstage_address address = {.size = sizeof address, .where = stage->socket_path};
    struct lightstage *client = NULL;
    struct lightstage_error error = {0};
    lightstage_connect(&address, &client, &error);
    g_assert_cmpstr(error.text, ==, "");
    g_assert_nonnull(client);
    return client;
}

struct lightstage_fetch stored(const struct made_take *take)
{
    return (struct lightstage_fetch){.size = sizeof(struct lightstage_fetch),
                                     .take = take->id,
                                     .channel = "W",
                                     .quantity = LIGHTSTAGE_ESTIMATE};
}

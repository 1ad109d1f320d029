/* liblightstage: takes, from their start to their slate, and what is on disk. */
#include "tests/clients/library_fixture.h"

static int keep_state(const struct lightstage_take_status *status, void *user)
{
    g_assert_true(!status->repaired == (status->state < LIGHTSTAGE_TAKE_COMPLETE));
    *(enum lightstage_take_state *)user = status->state;
    return 0;
}

static int stop_at_once(const struct lightstage_take_status *status, void *user)
{
    return 1;
}

static void a_take_is_started_followed_and_told(struct stage *stage, gconstpointer data)
{
    struct lightstage *client = connected(stage);
    struct lightstage_error error = {0};
    struct lightstage_status *status = NULL;
    enum lightstage_take_state state = LIGHTSTAGE_TAKE_NONE;
    struct lightstage_started *started[2] = {NULL};
    for (int i = 0; i < 2; i++)
        g_assert_cmpuint(lightstage_take_start(client, "face", "token-1", "subject = \"still\";",
                                               &started[i], &error),
                         ==, 0);
    g_assert_false(started[0]->already);
    g_assert_true(started[1]->already);
    g_assert_cmpstr(started[1]->take->token, ==, "token-1");
    lightstage_started_free(started[0]);
    lightstage_started_free(started[1]);
    g_assert_cmpuint(lightstage_status(client, &status, &error), ==, 0);
    g_assert_nonnull(status->take);
    g_assert_cmpint(status->take->state, ==, LIGHTSTAGE_TAKE_PREPARING);
    g_assert_cmpstr(status->take->token, ==, "token-1");
    g_assert_null(status->take->repaired);
    g_assert_cmpuint(status->connections, ==, 1);
    lightstage_status_free(status);
    g_assert_cmpuint(lightstage_take_progress(client, "token-1", stop_at_once, NULL, &error), ==,
                     LIGHTSTAGE_CANCELLED);
    take_ends(stage, LS_TAKE_COMPLETE);
    g_assert_cmpuint(lightstage_take_progress(client, "token-1", keep_state, &state, &error), ==,
                     0);
    g_assert_cmpint(state, ==, LIGHTSTAGE_TAKE_COMPLETE);
    lightstage_close(client);
}

struct listed {
    uint32_t n;
    char id[64];
};

static int keep_id(const struct lightstage_take_summary *take, void *user)
{
    struct listed *listed = user;
    g_assert_cmpstr(take->problem, ==, "");
    g_assert_cmpuint(take->conditions_planned, >=, TAKE_LIGHTS);
    g_strlcpy(listed->id, take->id, sizeof listed->id);
    return ++listed->n == 2;
}

static void takes_on_disk_are_listed_and_verified(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, 3);
    struct lightstage *client = connected(stage);
    struct listed listed = {0};
    struct lightstage_verified *verified = NULL;
    struct lightstage_error error;
    g_assert_cmpuint(lightstage_take_list(client, keep_id, &listed, NULL), ==, 0);
    g_assert_cmpuint(listed.n, ==, 1);
    g_assert_cmpstr(listed.id, ==, take->id);
    listed.n = 1; /* the callback stops at 2 */
    g_assert_cmpuint(lightstage_take_list(client, keep_id, &listed, NULL), ==,
                     LIGHTSTAGE_CANCELLED);
    struct lightstage_take_summary *summary = NULL;
    g_assert_cmpuint(lightstage_take_summary(client, take->id, &summary, NULL), ==, 0);
    g_assert_cmpstr(summary->id, ==, take->id);
    g_assert_cmpuint(summary->width, ==, TAKE_W);
    g_assert_cmpuint(summary->height, ==, TAKE_H);
    g_assert_cmpuint(summary->n_lights, ==, TAKE_LIGHTS);
    g_assert_cmpuint(summary->conditions_published, ==, summary->conditions_planned - 1);
    lightstage_take_summary_free(summary);
    g_assert_cmpuint(lightstage_take_verify(client, take->id, &verified, NULL), ==, 0);
    g_assert_cmpuint(verified->conditions_missing, ==, 1);
    g_assert_cmpuint(verified->n_findings, >, 0);
    g_assert_cmpstr(verified->findings[0], !=, "");
    lightstage_verified_free(verified);
    g_assert_cmpuint(lightstage_take_verify(client, "none", &verified, &error), !=, 0);
    g_assert_cmpstr(error.text, !=, "");
    lightstage_close(client);
    made_take_free(take);
}

static void a_slate_is_written_field_by_field(struct stage *stage, gconstpointer data)
{
    struct made_take *take = make_take(stage->storage, true, -1);
    struct lightstage *client = connected(stage);
    struct lightstage_slate write = {.size = sizeof write, .slate = "12A", .scene = "other"}, *is;
    g_assert_cmpuint(lightstage_take_slate(client, take->id, &is, NULL), ==, 0);
    g_assert_cmpstr(is->slate, ==, "");
    lightstage_slate_free(is);
    write.take = 4;
    write.circled = 1;
    write.timecode = "10:00:00:12";
    g_assert_cmpuint(lightstage_take_slate_write(client, take->id, &write,
                                                 LIGHTSTAGE_SLATE | LIGHTSTAGE_SLATE_TAKE |
                                                     LIGHTSTAGE_SLATE_CIRCLED,
                                                 &is, NULL),
                     ==, 0);
    lightstage_slate_free(is);
    write.slate = NULL;
    write.take = 0;
    write.notes = "soft";
    g_assert_cmpuint(lightstage_take_slate_write(client, take->id, &write,
                                                 LIGHTSTAGE_SLATE_TIMECODE | LIGHTSTAGE_SLATE_NOTES,
                                                 &is, NULL),
                     ==, 0);
    lightstage_slate_free(is);
    g_assert_cmpuint(lightstage_take_slate_write(client, take->id, &write, 0, &is, NULL), ==,
                     LIGHTSTAGE_BAD_ARGUMENT);
    g_assert_cmpuint(lightstage_take_slate(client, take->id, &is, NULL), ==, 0);
    g_assert_cmpstr(is->slate, ==, "12A");
    g_assert_cmpstr(is->scene, ==, "");
    g_assert_cmpuint(is->take, ==, 4);
    g_assert_cmpint(is->circled, ==, 1);
    g_assert_cmpstr(is->timecode, ==, "10:00:00:12");
    g_assert_cmpstr(is->notes, ==, "soft");
    g_assert_cmpint(is->damaged, ==, 0);
    lightstage_slate_free(is);
    lightstage_close(client);
    made_take_free(take);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_LIBRARY("a-take-is-started-followed-and-told", a_take_is_started_followed_and_told);
    ADD_LIBRARY("takes-on-disk-are-listed-and-verified", takes_on_disk_are_listed_and_verified);
    ADD_LIBRARY("a-slate-is-written-field-by-field", a_slate_is_written_field_by_field);
    return g_test_run();
}

/* serving: damaged pictures, clients that stall, leave or ask too much, and a take as a whole. */
#include "daemon/field_source.h"
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/serving_fixture.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

/* The sentence of the refusal, or "" if the relight was answered. */
static char *refusal_of(struct hall *hall, const struct relight *r, uint32_t *number)
{
    struct ls_diag diag = {0};
    uint32_t request = send_request(hall, LS_MESSAGE_RELIGHT, &r->body.base, r->weights,
                                    r->n_rows * TAKE_LIGHTS * sizeof(float));
    for (bool last = false; !last;) {
        struct ls_reply reply;
        if (ls_connection_receive(hall->client, request, &reply, &diag))
            break;
        last = reply.last;
        ls_reply_finish(&reply);
    }
    *number = diag.text[0] ? ls_connection_error(hall->client) : 0;
    return g_strdup(diag.text);
}

static void a_take_is_listed_shown_and_verified(struct hall *hall, gconstpointer data)
{
    Lightstage__TakeShow show = LIGHTSTAGE__TAKE_SHOW__INIT;
    Lightstage__TakeVerify verify = LIGHTSTAGE__TAKE_VERIFY__INIT;
    Lightstage__TakeList list = LIGHTSTAGE__TAKE_LIST__INIT;
    struct ls_reply reply;
    g_assert_cmpint(
        ls_connection_call(hall->client, LS_MESSAGE_TAKE_LIST, &list.base, NULL, 0, &reply, NULL),
        ==, LS_OK);
    g_assert_cmpuint(((const Lightstage__TakeListReply *)reply.message)->n_takes, ==, 1);
    ls_reply_finish(&reply);
    show.take = verify.take = hall->take->id;
    g_assert_cmpint(
        ls_connection_call(hall->client, LS_MESSAGE_TAKE_SHOW, &show.base, NULL, 0, &reply, NULL),
        ==, LS_OK);
    const Lightstage__TakeSummary *s = ((const Lightstage__TakeShowReply *)reply.message)->summary;
    g_assert_cmpstr(s->state, ==, "complete");
    g_assert_cmpuint(s->n_lights, ==, TAKE_LIGHTS);
    g_assert_cmpuint(s->width, ==, TAKE_W);
    g_assert_nonnull(g_strstr_len((const char *)reply.payload, (gssize)reply.payload_bytes,
                                  "reference_exposure_s"));
    ls_reply_finish(&reply);
    g_assert_cmpint(ls_connection_call(hall->client, LS_MESSAGE_TAKE_VERIFY, &verify.base, NULL, 0,
                                       &reply, NULL),
                    ==, LS_OK);
    g_assert_cmpuint(((const Lightstage__TakeVerifyReply *)reply.message)->conditions_damaged, ==,
                     0);
    ls_reply_finish(&reply);
}

static void a_damaged_picture_is_refused(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    uint32_t number;
    char *path = g_build_filename(hall->stage.storage, hall->take->id, "cam0", "W-0000.exr", NULL);
    g_assert_true(g_file_set_contents(path, "not a picture", -1, NULL));
    a_fetch(&fetch, hall);
    g_byte_array_unref(fetched(hall, &fetch, &number));
    g_assert_cmpuint(number / 100, ==, 4);
    g_free(path);
}

static void a_picture_cut_short_between_two_relights_is_named(struct hall *hall, gconstpointer data)
{
    struct relight r;
    uint32_t number;
    char *path = g_build_filename(hall->stage.storage, hall->take->id, "cam0", "W-0002.exr", NULL);
    a_relight(&r, hall, LIGHTSTAGE__WEIGHT_MODE__SHARED);
    g_byte_array_unref(relit(hall, &r, &number));
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpint(truncate(path, 5000), ==, 0);
    char *text = refusal_of(hall, &r, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_DAMAGED);
    g_assert_nonnull(strstr(text, "W-0002.exr"));
    g_free(text);
    g_assert_cmpint(unlink(path), ==, 0);
    text = refusal_of(hall, &r, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_DAMAGED);
    g_assert_nonnull(strstr(text, "W-0002.exr: No such file"));
    g_free(text);
    g_free(path);
    ls_connection_close(hall->client); /* the daemon lives */
    hall->client = a_client(&hall->stage);
}

/* The file is cut while the source is open, after its length was looked at: the pages are gone
 * under the mapping. */
static void a_picture_cut_short_under_the_mapping_is_named(struct hall *hall, gconstpointer data)
{
    struct ls_field_source *source = NULL;
    struct ls_diag diag = {0};
    float pixels[64];
    char *path = g_build_filename(hall->stage.storage, hall->take->id, "cam0", "W-0002.exr", NULL);
    g_assert_cmpint(ls_field_source_open(hall->stage.storage, hall->take->id, 0, &source, &diag),
                    ==, LS_OK);
    const struct ls_picture_map *cut = ls_field_source_picture(source, 0, 2, NULL);
    const struct ls_picture_map *other = ls_field_source_picture(source, 0, 3, NULL);
    g_assert_cmpint(ls_field_source_sound(source, true, &diag), ==, LS_OK);
    g_assert_cmpint(truncate(path, 5000), ==, 0);
    ls_picture_map_read(other, 0, TAKE_H - 1, 64, 1, 1, pixels);
    g_assert_cmpint(ls_field_source_sound(source, false, &diag), ==, LS_OK);
    ls_picture_map_read(cut, 0, TAKE_H - 1, 64, 1, 1, pixels);
    g_assert_cmpfloat(pixels[0], ==, 0);
    g_assert_cmpint(ls_field_source_sound(source, false, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "W-0002.exr"));
    g_assert_true(ls_picture_map_sound(other));
    ls_field_source_close(source);
    g_free(path);
}

static void a_bus_error_elsewhere_still_ends_the_process(void)
{
    if (!g_test_subprocess()) {
        g_test_trap_subprocess(NULL, 0, 0);
        g_test_trap_assert_failed();
        return;
    }
    char *path = NULL, bytes[64] = "some bytes";
    struct ls_map_guard guard;
    int fd = g_file_open_tmp("lightstage-XXXXXX", &path, NULL);
    unlink(path);
    ls_map_guard_add(&guard, bytes, 1); /* of this stack's page: not what faults */
    g_assert_cmpint(ftruncate(fd, 1), ==, 0);
    volatile char *mapped = mmap(NULL, 1, PROT_READ, MAP_SHARED, fd, 0);
    g_assert_true(mapped != MAP_FAILED);
    g_assert_cmpint(ftruncate(fd, 0), ==, 0);
    exit(mapped[0]);
}

/* A client asks for everything, reads nothing, and is closed in time; another works meanwhile. */
static void a_stalled_client_holds_nobody_up(struct hall *hall, gconstpointer data)
{
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    Lightstage__Fetch fetch;
    uint32_t lights[24], number;
    int stalled[8];
    uint8_t *bytes = NULL;
    size_t n = 0;
    hello.version = LS_FRAME_VERSION;
    for (int i = 0; i < 24; i++)
        lights[i] = (uint32_t)i % TAKE_LIGHTS;
    a_fetch(&fetch, hall);
    fetch.lights = lights;
    fetch.n_lights = 24;
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB; /* 6 MB of answer per request */
    for (size_t k = 0; k < G_N_ELEMENTS(stalled); k++) {
        int fd = a_bare_socket(&hall->stage);
        g_assert_cmpint(ls_message_frame(LS_MESSAGE_HELLO, 1, 1, &hello.base, 0, &bytes, &n, NULL),
                        ==, LS_OK);
        g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
        free(bytes);
        g_assert_cmpint(ls_message_frame(LS_MESSAGE_FETCH, 2, 1, &fetch.base, 0, &bytes, &n, NULL),
                        ==, LS_OK);
        g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
        free(bytes);
        stalled[k] = fd;
    }
    GByteArray *got = fetched(hall, &fetch, &number);
    g_assert_cmpuint(number, ==, 0);
    g_assert_cmpuint(got->len, ==, 12u * TAKE_PIXELS * 24);
    g_byte_array_unref(got);
    wait_for_connections(&hall->stage, 1);
    for (size_t k = 0; k < G_N_ELEMENTS(stalled); k++)
        close(stalled[k]);
}

static void a_client_that_leaves_in_the_middle_frees_its_job(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    a_fetch(&fetch, hall);
    for (int k = 0; k < 20; k++) {
        struct ls_connection *client = a_client(&hall->stage);
        struct ls_reply reply;
        uint32_t request;
        g_assert_cmpint(
            ls_connection_send(client, LS_MESSAGE_FETCH, &fetch.base, NULL, 0, &request, NULL), ==,
            LS_OK);
        if (k % 2)
            g_assert_cmpint(ls_connection_receive(client, request, &reply, NULL), ==, LS_OK);
        if (k % 2)
            ls_reply_finish(&reply);
        ls_connection_close(client);
    }
    wait_for_connections(&hall->stage, 1);
}

static void cancel_ends_a_fetch(struct hall *hall, gconstpointer data)
{
    Lightstage__Fetch fetch;
    Lightstage__Cancel cancel = LIGHTSTAGE__CANCEL__INIT;
    uint32_t lights[4096] = {0}, number, cancel_request;
    a_fetch(&fetch, hall);
    fetch.lights = lights;
    fetch.n_lights = 4096;
    cancel.request = send_request(hall, LS_MESSAGE_FETCH, &fetch.base, NULL, 0);
    cancel_request = send_request(hall, LS_MESSAGE_CANCEL, &cancel.base, NULL, 0);
    g_assert_cmpuint(cancel_request, !=, cancel.request);
    GByteArray *got = receive_all(hall, cancel.request, &number);
    g_assert_cmpuint(number, ==, LS_PROTO_CANCELLED);
    g_assert_cmpuint(got->len, <, 4096u * 4 * TAKE_PIXELS);
    g_byte_array_unref(got);
}

static void too_many_requests_in_flight_are_refused(struct hall *hall, gconstpointer data)
{
    Lightstage__TakeVerify verify = LIGHTSTAGE__TAKE_VERIFY__INIT;
    uint32_t refused = 0, done = 0;
    verify.take = hall->take->id;
    for (int i = 0; i < 40; i++)
        send_request(hall, LS_MESSAGE_TAKE_VERIFY, &verify.base, NULL, 0);
    while (refused + done < 40) {
        struct ls_reply reply;
        enum ls_err err = ls_connection_receive(hall->client, 0, &reply, NULL);
        if (err == LS_ERR_REFUSED) {
            g_assert_cmpuint(ls_connection_error(hall->client), ==, LS_PROTO_TOO_MANY);
            refused++;
            continue;
        }
        g_assert_cmpint(err, ==, LS_OK);
        ls_reply_finish(&reply);
        done++;
    }
    g_assert_cmpuint(done, >=, 8);
    g_assert_cmpuint(refused, >, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("a-take-is-listed-shown-and-verified", with_take, a_take_is_listed_shown_and_verified);
    ADD("a-damaged-picture-is-refused", with_take, a_damaged_picture_is_refused);
    ADD("a-picture-cut-short-between-two-relights-is-named", with_take,
        a_picture_cut_short_between_two_relights_is_named);
    ADD("a-picture-cut-short-under-the-mapping-is-named", with_take,
        a_picture_cut_short_under_the_mapping_is_named);
    g_test_add_func("/serving/a-bus-error-elsewhere-still-ends-the-process",
                    a_bus_error_elsewhere_still_ends_the_process);
    ADD("a-stalled-client-holds-nobody-up", with_take_and_little_patience,
        a_stalled_client_holds_nobody_up);
    ADD("a-client-that-leaves-in-the-middle-frees-its-job", with_take,
        a_client_that_leaves_in_the_middle_frees_its_job);
    ADD("cancel-ends-a-fetch", with_take, cancel_ends_a_fetch);
    ADD("too-many-requests-in-flight-are-refused", with_take,
        too_many_requests_in_flight_are_refused);
    return g_test_run();
}

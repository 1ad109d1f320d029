#include "clients/command.h"
#include "clients/take_text.h"

#include <inttypes.h>
#include <stdio.h>

static json_t *camera_json(const Lightstage__CameraStatus *c)
{
    return json_pack("{sb ss ss ss ss sb}", "connected", c->connected, "name", c->name, "model",
                     c->model, "serial", c->serial, "unverified", c->unverified, "packet_socket",
                     c->packet_socket);
}

static json_t *lights_json(const Lightstage__LightsStatus *l)
{
    json_t *faults = json_array();
    for (size_t i = 0; i < l->n_faults; i++)
        json_array_append_new(faults, json_string(l->faults[i]));
    json_t *now = json_array();
    for (size_t i = 0; i < l->n_now; i++)
        json_array_append_new(now, json_string(l->now[i]));
    return json_pack("{sb ss ss so so si si}", "connected", l->connected, "serial", l->serial,
                     "state", l->state, "faults", faults, "now", now, "temperature_c",
                     (int)l->temperature_c, "missed_triggers", (int)l->missed_triggers);
}

static void print_json(const Lightstage__StatusReply *s)
{
    json_t *cameras = json_array();
    for (size_t i = 0; i < s->n_cameras; i++)
        json_array_append_new(cameras, camera_json(s->cameras[i]));
    ls_command_print_json(json_pack(
        "{so* so so* ss ss sI si sI sI sI}", "lights", s->lights ? lights_json(s->lights) : NULL,
        "cameras", cameras, "take", s->take ? ls_take_status_json(s->take) : NULL, "calibration",
        s->calibration, "privileges", s->privileges, "disk_free_bytes",
        (json_int_t)s->disk_free_bytes, "connections", (int)s->connections, "stalled_closed",
        (json_int_t)s->stalled_closed, "events_skipped", (json_int_t)s->events_skipped,
        "credit_waits", (json_int_t)s->credit_waits));
}

/* A device that is connected and was never asked: a take or a live view has had it since. */
static void print_lights(const Lightstage__LightsStatus *l)
{
    if (!l->connected) {
        puts("lights       not connected");
        return;
    }
    if (!l->serial[0])
        puts("lights       in use");
    else
        printf("lights       %s, %s, %" PRId32 " C\n", ls_clean(l->serial), ls_clean(l->state),
               l->temperature_c);
    for (size_t i = 0; i < l->n_faults; i++)
        printf("             FAULT: %s\n", ls_clean(l->faults[i]));
    for (size_t i = 0; i < l->n_now; i++)
        printf("             %s\n", ls_clean(l->now[i]));
}

static void print_camera(const Lightstage__CameraStatus *c)
{
    printf("camera       %s: ", ls_clean(c->name));
    if (!c->connected) {
        puts("not connected");
        return;
    }
    if (!c->model[0])
        puts("in use");
    else
        printf("%s, serial %s, %s\n", ls_clean(c->model), ls_clean(c->serial),
               c->packet_socket ? "packet socket" : "UDP");
    if (c->unverified[0])
        printf("             unverified: %s\n", ls_clean(c->unverified));
}

static void print_text(const Lightstage__StatusReply *s)
{
    if (s->lights)
        print_lights(s->lights);
    for (size_t i = 0; i < s->n_cameras; i++)
        print_camera(s->cameras[i]);
    printf("calibration  %s\n", ls_clean(s->calibration));
    printf("disk         %.1f GB free\n", (double)s->disk_free_bytes * 1e-9);
    if (s->privileges[0])
        printf("privileges   missing: %s\n", ls_clean(s->privileges));
    if (s->take)
        ls_take_status_print(s->take);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
    struct ls_reply reply;
    if (ls_command_option(context, &ls_command_status, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_status, argc, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_call(context, LS_MESSAGE_STATUS, &body.base, NULL, 0, &reply);
    if (code)
        return code;
    if (context->json)
        print_json((const Lightstage__StatusReply *)reply.message);
    else
        print_text((const Lightstage__StatusReply *)reply.message);
    ls_reply_finish(&reply);
    return LS_EXIT_OK;
}

const struct ls_command ls_command_status = {
    "status", "What is connected, what runs, what is missing", "[--json]", run};

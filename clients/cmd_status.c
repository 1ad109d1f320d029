#include "clients/command.h"
#include "clients/take_text.h"

#include <inttypes.h>
#include <stdio.h>

static json_t *camera_json(const struct lightstage_camera_status *c)
{
    return json_pack("{sb ss ss ss ss sb}", "connected", c->connected, "name", c->name, "model",
                     c->model, "serial", c->serial, "unverified", c->unverified, "packet_socket",
                     c->packet_socket);
}

static json_t *lights_json(const struct lightstage_status *l)
{
    json_t *faults = json_array();
    for (size_t i = 0; i < l->n_faults; i++)
        json_array_append_new(faults, json_string(l->faults[i]));
    json_t *now = json_array();
    for (size_t i = 0; i < l->n_now; i++)
        json_array_append_new(now, json_string(l->now[i]));
    return json_pack("{sb ss ss so so si si}", "connected", l->lights_connected, "serial",
                     l->lights_serial, "state", l->lights_state, "faults", faults, "now", now,
                     "temperature_c", (int)l->temperature_c, "missed_triggers",
                     (int)l->missed_triggers);
}

static void print_json(const struct lightstage_status *s)
{
    json_t *cameras = json_array();
    for (size_t i = 0; i < s->n_cameras; i++)
        json_array_append_new(cameras, camera_json(s->cameras[i]));
    ls_command_print_json(json_pack(
        "{so so so* ss ss sI si sI sI sI}", "lights", lights_json(s), "cameras", cameras, "take",
        s->take ? ls_take_status_json(s->take) : NULL, "calibration", s->calibration, "privileges",
        s->privileges, "disk_free_bytes", (json_int_t)s->disk_free_bytes, "connections",
        (int)s->connections, "stalled_closed", (json_int_t)s->stalled_closed, "events_skipped",
        (json_int_t)s->events_skipped, "credit_waits", (json_int_t)s->credit_waits));
}

/* A device that is connected and was never asked: a take or a live view has had it since. */
static void print_lights(const struct lightstage_status *l)
{
    if (!l->lights_connected) {
        puts("lights       not connected");
        return;
    }
    if (!l->lights_serial[0])
        puts("lights       in use");
    else
        ls_say("lights       %s, %s, %" PRId32 " C\n", l->lights_serial, l->lights_state,
               l->temperature_c);
    for (size_t i = 0; i < l->n_faults; i++)
        ls_say("             FAULT: %s\n", l->faults[i]);
    for (size_t i = 0; i < l->n_now; i++)
        ls_say("             %s\n", l->now[i]);
}

static void print_camera(const struct lightstage_camera_status *c)
{
    ls_say("camera       %s: ", c->name);
    if (!c->connected) {
        puts("not connected");
        return;
    }
    if (!c->model[0])
        puts("in use");
    else
        ls_say("%s, serial %s, %s\n", c->model, c->serial,
               c->packet_socket ? "packet socket" : "UDP");
    if (c->unverified[0])
        ls_say("             unverified: %s\n", c->unverified);
}

static void print_text(const struct lightstage_status *s)
{
    print_lights(s);
    for (size_t i = 0; i < s->n_cameras; i++)
        print_camera(s->cameras[i]);
    ls_say("calibration  %s\n", s->calibration);
    printf("disk         %.1f GB free\n", (double)s->disk_free_bytes * 1e-9);
    if (s->privileges[0])
        ls_say("privileges   missing: %s\n", s->privileges);
    if (s->take)
        ls_take_status_print(s->take);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    struct lightstage_status *status = NULL;
    if (ls_command_option(context, &ls_command_status, argc, argv, options) != -1 ||
        !ls_command_arguments(&ls_command_status, argc, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context,
                                   lightstage_status(context->stage, &status, &context->error));
    if (!code && context->json)
        print_json(status);
    else if (!code)
        print_text(status);
    lightstage_status_free(status);
    return code;
}

const struct ls_command ls_command_status = {
    "status", "What is connected, what runs, what is missing", "[--json]", run};

#include "clients/command.h"
#include "clients/plan_text.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

static void print_json(const struct lightstage_preflight *p)
{
    ls_command_print_json(
        json_pack("{ss sI sI sI sf sI sI sf sf sf sf ss}", "bracket", p->bracket, "conditions",
                  (json_int_t)p->conditions, "steps", (json_int_t)p->steps, "shots",
                  (json_int_t)p->shots, "seconds", p->seconds, "bytes", (json_int_t)p->bytes,
                  "disk_free_bytes", (json_int_t)p->disk_free_bytes, "dark_noise_share",
                  p->dark_noise_share, "energy_j", p->energy_j, "peak_current_a", p->peak_current_a,
                  "led_duty", p->led_duty, "warnings", p->warnings));
}

static void print_text(const struct lightstage_preflight *p)
{
    ls_say("conditions  %u\nshots       %u\nexposures   by %s\nduration    %.0f s\ndisk        "
           "%.2f GB of %.1f GB "
           "free\ndark noise  %.0f %% of a relit picture's\n",
           p->conditions, p->shots, p->bracket, p->seconds, (double)p->bytes * 1e-9,
           (double)p->disk_free_bytes * 1e-9, p->dark_noise_share * 100);
    printf("LEDs        %.0f J, at most %.1f A, the busiest lit %.2f %% of the time\n", p->energy_j,
           p->peak_current_a, p->led_duty * 100);
    if (p->warnings[0])
        ls_say("warning     %s\n", p->warnings);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    enum { PLAN = 1, CUSTOM };
    static const struct option options[] = {{"plan", required_argument, NULL, PLAN},
                                            {"custom", required_argument, NULL, CUSTOM},
                                            LS_COMMON_OPTIONS};
    struct lightstage_preflight *cost = NULL;
    const char *path = NULL, *custom = NULL;
    char *text = NULL;
    size_t n = 0;
    int option;
    while ((option = ls_command_option(context, &ls_command_preflight, argc, argv, options)) ==
               PLAN ||
           option == CUSTOM)
        *(option == PLAN ? &path : &custom) = optarg;
    if (option != -1 || !ls_command_arguments(&ls_command_preflight, argc, 0))
        return LS_EXIT_USAGE;
    if (!path)
        return ls_command_wrong("preflight: --plan FILE is needed");
    enum ls_err err = ls_plan_text_read(path, custom, false, &text, &n, &context->diag);
    if (err)
        return ls_command_failed(context, err);
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(
            context, lightstage_preflight(context->stage, text, &cost, &context->error));
    free(text);
    if (!code && context->json)
        print_json(cost);
    else if (!code)
        print_text(cost);
    lightstage_preflight_free(cost);
    return code;
}

const struct ls_command ls_command_preflight = {
    "preflight", "What a plan would cost, and whether the rig allows it",
    "--plan FILE [--custom FILE] [--json]", run};

#include "clients/calibrate_shoot.h"

#include "clients/calibrate_plan.h"
#include "clients/take_follow.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

static const struct {
    const char *take, *subject;
} objects[LS_N_OBJECTS] = {
    {"calibrate-grey", "the grey sphere"},
    {"calibrate-chrome", "the chrome ball"},
    {"calibrate-gloss", "the black glossy sphere"},
};

/* ---- asking ---- */

static void let_interrupts_in(bool in)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigprocmask(in ? SIG_UNBLOCK : SIG_BLOCK, &set, NULL);
}

static int ask(enum ls_calibrate_object object)
{
    char line[64];
    fprintf(stderr, "Put %s at the stage's centre, clear the stage, and press Enter: ",
            objects[object].subject);
    let_interrupts_in(true);
    bool answered = fgets(line, sizeof line, stdin) != NULL;
    bool ended = feof(stdin);
    let_interrupts_in(false);
    if (answered)
        return LS_EXIT_OK;
    fputc('\n', stderr);
    if (!ended)
        return LS_EXIT_INTERRUPTED;
    ls_command_wrong("nobody answers on standard input; --yes goes on without asking");
    return LS_EXIT_NO;
}

/* ---- the plan ---- */

/* "R", "A" of the channels wanted. */
static void channel_list(const struct lightstage_rig *rig, bool spectra, bool polarisers,
                         bool white_alone, char *out, size_t size)
{
    size_t at = 0;
    out[0] = '\0';
    for (size_t c = 0; c < rig->n_channels && at < size; c++) {
        const struct lightstage_channel *channel = rig->channels[c];
        if (channel->polariser ? !polarisers : !spectra)
            continue;
        at += (size_t)snprintf(out + at, size - at, "%s\"%s\"", at ? ", " : "", channel->name);
        if (white_alone)
            return;
    }
}

static enum ls_err write_plan(const struct ls_calibrate_shoot *shoot,
                              enum ls_calibrate_object object, const struct lightstage_rig *rig,
                              char **out, struct ls_diag *diag)
{
    char channels[512];
    if (object == LS_OBJECT_GREY) {
        const struct ls_calibrate_plan plan = {shoot->exposures_us[object], shoot->darks,
                                               shoot->segments, shoot->shown, shoot->shown_name};
        return ls_calibrate_plan_text(&plan, rig, out, diag);
    }
    channel_list(rig, object == LS_OBJECT_CHROME, object == LS_OBJECT_GLOSS,
                 object == LS_OBJECT_CHROME, channels, sizeof channels);
    int n = asprintf(out,
                     "subject = \"still\"; exposures_us = [%s]; darks = %u;\n"
                     "conditions = ( { kind = \"each\"; channels = [%s]; } );\n",
                     shoot->exposures_us[object], shoot->darks, channels);
    return n < 0 ? ls_fail(diag, LS_ERR_NOMEM, "out of memory for a plan") : LS_OK;
}

static int make_plan(struct ls_command_context *context, const struct ls_calibrate_shoot *shoot,
                     enum ls_calibrate_object object, char **plan)
{
    struct lightstage_rig *rig = NULL;
    int code = ls_command_answered(context, lightstage_rig(context->stage, &rig, &context->error));
    if (code)
        return code;
    if (shoot->segments_asked && shoot->segments > rig->n_lights)
        code = ls_command_wrong("--segments %u: the rig has %u lights", shoot->segments,
                                rig->n_lights);
    enum ls_err err = code ? LS_OK : write_plan(shoot, object, rig, plan, &context->diag);
    lightstage_rig_free(rig);
    return err ? ls_command_failed(context, err) : code;
}

/* ---- the take ---- */

static int keep_id(const struct lightstage_take_status *status, void *user)
{
    snprintf(user, 128, "%s", status->id);
    return 0;
}

static int photograph(struct ls_command_context *context, enum ls_calibrate_object object,
                      const char *plan, char id[128])
{
    char token[64];
    if (!ls_take_token(token))
        return ls_command_wrong("no random numbers for a token");
    int code =
        ls_command_answered(context, lightstage_take_start(context->stage, objects[object].take,
                                                           token, plan, NULL, &context->error));
    if (!code)
        code = ls_take_follow(context, token);
    if (!code)
        code = ls_command_answered(
            context, lightstage_take_progress(context->stage, token, keep_id, id, &context->error));
    return code;
}

int ls_calibrate_shoot(struct ls_command_context *context, const struct ls_calibrate_shoot *shoot,
                       enum ls_calibrate_object object, char id[128])
{
    LS_CLEANUP_FREE char *plan = NULL;
    int code = ls_command_open(context);
    if (code)
        return code;
    ls_take_follow_signals();
    code = make_plan(context, shoot, object, &plan);
    if (!code && !shoot->yes)
        code = ask(object);
    if (!code)
        code = photograph(context, object, plan, id);
    return code;
}
